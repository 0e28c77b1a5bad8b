"""The one way into colour-science: imported when first needed, and without its plotting until
somebody plots.

Importing colour-science also imports its plotting, and with it Matplotlib's user interface: half of
the three seconds that it takes. A stand-in puts that off to the first use, for us and for everybody
else in the process.
"""
from __future__ import annotations

import importlib
import sys
import warnings
from types import ModuleType
from typing import Any

PLOTTING = "colour.plotting"


def colour_science() -> ModuleType:
    """The module ``colour``, without its warnings about optional packages."""
    if "colour" not in sys.modules:
        stand_in = ModuleType(PLOTTING)
        stand_in.__getattr__ = _plotting_attribute  # type: ignore[method-assign]
        sys.modules[PLOTTING] = stand_in
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return importlib.import_module("colour")


def _plotting_attribute(name: str) -> Any:
    """Load the real plotting in the stand-in's place, and look the name up there."""
    if name.startswith("__"):
        raise AttributeError(name)
    sys.modules.pop(PLOTTING, None)
    plotting = importlib.import_module(PLOTTING)
    sys.modules["colour"].plotting = plotting  # type: ignore[attr-defined]
    return getattr(plotting, name)
