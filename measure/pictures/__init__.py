"""Spectra of every pixel of an image, of photos of flat samples and of scenes."""
