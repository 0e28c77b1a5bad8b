"""Spectra fitted to a photo through its traced transport."""
