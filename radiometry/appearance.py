"""What a reflectance looks like under D65: its sRGB colour and CIEDE2000 differences.

Of the CIE 1931 2 degree observer. Reflectances are extended beyond their first and last wavelength
by their end values, as CIE 15 recommends, so that a perfect reflector has the colour of D65.
"""
from __future__ import annotations

import functools

import numpy as np

from spectrabox.radiometry.colour_difference import ciede2000, lab_from_xyz
from spectrabox.radiometry.published.published_tables import LIGHTS, OBSERVERS, published_curves

WITHIN_NM = (360.0, 780.0)
# X, Y, Z to linear sRGB, IEC 61966-2-1:1999.
TO_SRGB = np.array([[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415],
                    [0.0557, -0.2040, 1.0570]])

# X, Y, Z to responses of cones, Lam 1985.
BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367],
                     [0.0389, -0.0685, 1.0296]])


def reflectance_to_srgb(nm: np.ndarray, reflectance: np.ndarray) -> np.ndarray:
    """Encoded sRGB (3,), 0 to 1, of a surface under D65; colours outside the gamut are clipped.

    Parameters
    ----------
    nm : (P,) array
        Ascending.
    reflectance : (P,) array
        0 to 1.
    """
    return encoded_srgb(tristimulus(nm, reflectance))


def encoded_srgb(xyz: np.ndarray) -> np.ndarray:
    """Encoded sRGB (3,), 0 to 1, of tristimulus values under D65; clipped to the gamut.

    Parameters
    ----------
    xyz : (3,) array
        Y = 1 for white.
    """
    return encode_srgb(TO_SRGB @ xyz)


def encode_srgb(linear: np.ndarray) -> np.ndarray:
    """sRGB code values, 0 to 1, of linear values (IEC 61966-2-1).

    Parameters
    ----------
    linear : array of any shape
        Clipped to 0 to 1.
    """
    clipped = np.clip(linear, 0.0, 1.0)
    return np.where(clipped <= 0.0031308, 12.92 * clipped, 1.055 * clipped ** (1 / 2.4) - 0.055)


def decode_srgb(encoded: np.ndarray) -> np.ndarray:
    """Linear values of sRGB code values; undoes ``encode_srgb``.

    Parameters
    ----------
    encoded : array of any shape
        0 to 1.
    """
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


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
    table_nm, weights = _weights_under("D65")
    return weights @ np.interp(table_nm, nm, reflectance)


def adapted_tristimulus(nm: np.ndarray, light: str) -> np.ndarray:
    """Weights (3, P) that give X, Y, Z under D65 of what looks alike under another light.

    The eye is taken to have adapted to the light, by the Bradford transform: white stays white.

    Parameters
    ----------
    nm : (P,) array
        Ascending.
    light : str
        CIE name.

    Raises
    ------
    InputError
        If no light of that name is published.
    """
    cones, wanted = (BRADFORD @ _weights_under(name)[1].sum(axis=1) for name in (light, "D65"))
    return np.asarray(np.linalg.solve(
        BRADFORD, (wanted / cones)[:, None] * (BRADFORD @ tristimulus_weights(nm, light))))


def tristimulus_weights(nm: np.ndarray, light: str) -> np.ndarray:
    """Weights (3, P) that give X, Y, Z under a light, with Y = 1 for a reflectance of 1.

    Parameters
    ----------
    nm : (P,) array
        Ascending.
    light : str
        CIE name.

    Raises
    ------
    InputError
        If no light of that name is published.
    """
    table_nm, weights = _weights_under(light)
    return np.asarray(weights @ np.array([np.interp(table_nm, nm, unit)
                                          for unit in np.eye(len(nm))]).T)


@functools.cache
def _weights_under(light_name: str) -> tuple[np.ndarray, np.ndarray]:
    """Wavelengths (P,) from 360 to 780 nm and the weights (3, P) of X, Y, Z."""
    nm, observer = published_curves(OBSERVERS, "CIE 1931 2 Degree Standard Observer")
    inside = (nm >= WITHIN_NM[0]) & (nm <= WITHIN_NM[1])
    nm, light = nm[inside], published_curves(LIGHTS, light_name)
    weights = observer[:, inside] * np.interp(nm, light[0], light[1][0])
    return nm, weights / weights[1].sum()
