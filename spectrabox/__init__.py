"""Ordinary camera captures to calibrated reflectance spectra, with honest uncertainty."""

__version__ = "0.2.0"
