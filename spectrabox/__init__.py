"""Ordinary camera captures to calibrated reflectance spectra, with honest uncertainty."""
import os
import sys

# As a command this takes no module from the folder that Python puts first, the working folder of
# "python -m" or that of the script: either may hold a stranger's numpy.py. (While the module of -m
# is looked for, argv begins with "-m".)
if not sys.flags.safe_path and (
        (sys.argv[:1] == ["-m"] and not {"spectrabox", "-mspectrabox"}.isdisjoint(sys.orig_argv))
        or os.path.realpath("".join(sys.argv[:1])) == f"{sys.path[0]}{os.sep}spectrabox"):
    del sys.path[0]

import lazy_loader

__version__ = "0.2.0"

# The public names are those of __init__.pyi; each is imported when it is first used (SPEC 1).
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
