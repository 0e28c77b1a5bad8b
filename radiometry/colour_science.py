"""What colour-science computes for us; it takes a second to import, so only where it is needed."""
from __future__ import annotations

import warnings

import numpy as np


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
    import colour

    each_nm = np.arange(380.0, 781.0, 5.0)
    curves = np.array([np.interp(each_nm, nm, curve, left=0, right=0) for curve in curves])
    sensitivities = colour.characterisation.RGB_CameraSensitivities(
        curves.T / curves.max(), each_nm)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")         # it says that it aligns its own tables
        matrix, balance = colour.matrix_idt(sensitivities, colour.SDS_ILLUMINANTS[illuminant])
    return np.asarray(matrix), np.asarray(balance)


def adapted_srgb(xyz: np.ndarray, white: np.ndarray) -> np.ndarray:
    """8-bit sRGB (..., 3) of tristimulus values seen by somebody adapted to the light.

    Parameters
    ----------
    xyz : (..., 3) array
        Y = 1 for white.
    white : (3,) array
        Of a perfect reflector under the light.
    """
    import colour

    rgb = colour.XYZ_to_sRGB(xyz, illuminant=colour.XYZ_to_xy(white))
    return np.asarray(np.round(255 * np.clip(rgb, 0, 1)), dtype=np.uint8)
