"""Spectral files of other programs and instruments: one file per format; spectrum_files.py chooses
by content.
"""
