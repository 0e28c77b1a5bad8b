"""Measuring with an operator: what is measured next, what is asked, what is written."""
