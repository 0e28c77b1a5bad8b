"""Regions of flat samples: white and signals at them, spectra of any part that is pointed at."""
