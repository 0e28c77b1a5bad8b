"""Pictures of spectra as files: uplift of an image, picture stages of sessions, workers."""
