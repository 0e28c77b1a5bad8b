"""Spectra of every pixel of a photo, of flat samples and of scenes."""
