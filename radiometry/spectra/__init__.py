"""Spectra by name and from files."""
