"""Surfaces of any capture: signals with their errors, and the spectra behind them."""
