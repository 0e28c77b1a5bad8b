"""Ordinary camera captures to calibrated reflectance spectra, with honest uncertainty."""
import lazy_loader

__version__ = "0.2.0"

# The public names are those of __init__.pyi; each is imported when it is first used (SPEC 1).
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
