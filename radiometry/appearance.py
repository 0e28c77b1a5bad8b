"""What a reflectance looks like under D65: its sRGB colour and CIEDE2000 differences.

Of the CIE 1931 2 degree observer. Reflectances are extended beyond their first and last wavelength
by their end values, as CIE 15 recommends, so that a perfect reflector has the colour of D65.
"""
from __future__ import annotations

import functools

import numpy as np

from spectrabox.radiometry.colour_difference import ciede2000, lab_from_xyz
from spectrabox.radiometry.colour_science import colour_science


def reflectance_to_srgb(nm: np.ndarray, reflectance: np.ndarray) -> np.ndarray:
    """Encoded sRGB (3,), 0 to 1, of a surface under D65; colours outside the gamut are clipped.

    Parameters
    ----------
    nm : (P,) array
        Ascending.
    reflectance : (P,) array
        0 to 1.
    """
    colour = colour_science()
    return np.clip(colour.XYZ_to_sRGB(tristimulus(nm, reflectance)), 0.0, 1.0)


def delta_e00(nm: np.ndarray, a: np.ndarray, b: np.ndarray) -> float:
    """CIEDE2000 difference of two reflectances under D65.

    Parameters
    ----------
    nm : (P,) array
        Ascending.
    a, b : (P,) arrays
        Reflectances.
    """
    white = tristimulus(nm, np.ones(len(nm)))
    return float(ciede2000(*(lab_from_xyz(tristimulus(nm, reflectance), white)
                             for reflectance in (a, b))))


def tristimulus(nm: np.ndarray, reflectance: np.ndarray) -> np.ndarray:
    """X, Y, Z (3,) under D65, with Y = 1 for a reflectance of 1 at every wavelength.

    Parameters
    ----------
    nm : (P,) array
        Ascending.
    reflectance : (P,) array
    """
    table_nm, weights = _d65_weights()
    return weights @ np.interp(table_nm, nm, reflectance)


@functools.cache
def _d65_weights() -> tuple[np.ndarray, np.ndarray]:
    """Wavelengths (P,) from 360 to 780 nm and the weights (3, P) of X, Y, Z."""
    colour = colour_science()
    shape = colour.SpectralShape(360, 780, 1)
    observer = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"].copy().align(shape)
    light = colour.SDS_ILLUMINANTS["D65"].copy().align(shape)
    weights = observer.values.T * light.values
    return np.asarray(observer.wavelengths), weights / weights[1].sum()
