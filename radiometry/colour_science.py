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

import numpy as np

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


def aces_idt(nm: np.ndarray, curves: np.ndarray, illuminant: str) -> tuple[np.ndarray, np.ndarray]:
    """Matrix (3, 3) from white-balanced camera signals to ACES, and the white balance (3,).

    The input transform by colour-science's optimisation after RAW to ACES, of S-2013-001's 190
    training reflectances, as ``colour.matrix_idt`` chooses it.

    Parameters
    ----------
    nm : (P,) array
        Evenly spaced; curves are taken for 0 beyond.
    curves : (3, P) array
        Of any scale.
    illuminant : str
        CIE name, such as D55.
    """
    colour = colour_science()
    each_nm = np.arange(380.0, 781.0, 5.0)
    curves = np.array([np.interp(each_nm, nm, curve, left=0, right=0) for curve in curves])
    sensitivities = colour.characterisation.RGB_CameraSensitivities(
        curves.T / curves.max(), each_nm)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")         # it says that it aligns its own tables
        matrix, balance = colour.matrix_idt(sensitivities, colour.SDS_ILLUMINANTS[illuminant])
    return np.asarray(matrix), np.asarray(balance)
