"""Spectra behind signals given on the command line or in files: options in, answers out."""
