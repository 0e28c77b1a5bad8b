"""Signals without a session: their spectra, what could have given them, and how good both are."""
