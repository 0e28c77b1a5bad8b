"""Layouts of charts that ship or that an operator wrote, and references measured of them."""
