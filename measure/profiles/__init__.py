"""Colour profiles of cameras, photos through them, and what an archive asks of a picture."""
