"""The input transform of ACES for a camera: colour-science's optimisation after RAW to ACES."""
from __future__ import annotations

import warnings

import numpy as np

from spectrabox.radiometry.colour_science import colour_science


def aces_idt(nm: np.ndarray, curves: np.ndarray, illuminant: str) -> tuple[np.ndarray, np.ndarray]:
    """Matrix (3, 3) from white-balanced camera signals to ACES, and the white balance (3,).

    Of S-2013-001's 190 training reflectances, as ``colour.matrix_idt`` chooses it.

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
