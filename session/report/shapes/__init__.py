"""Figures of plain shapes, which the page draws without a plotting library."""
