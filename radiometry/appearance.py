"""What a reflectance looks like: its colour in sRGB and CIELAB, and CIEDE2000 differences.

Of the CIE 1931 2 degree observer. Reflectances are extended beyond their first and last wavelength
by their end values, as CIE 15 recommends, so that a perfect reflector has the colour of D65.
"""
from __future__ import annotations

import functools

import numpy as np

from spectrabox.radiometry import errors, grid
from spectrabox.radiometry.published import published_tables

WITHIN_NM = (360.0, 780.0)
BRIGHTEST = 1.1             # of white: a colour beyond is none of a surface that does not glow
DARK = (6 / 29) ** 3        # of white: below, L* is linear (CIE 15:2018)
# X, Y, Z to linear sRGB, IEC 61966-2-1:1999.
TO_SRGB = np.array([[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415],
                    [0.0557, -0.2040, 1.0570]])

# X, Y, Z to responses of cones, Lam 1985.
BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367],
                     [0.0389, -0.0685, 1.0296]])
# X, Y, Z to ACEScg (AP1), S-2014-004, and its white, about D60, from x, y = 0.32168, 0.33767
TO_ACESCG = np.array([[1.6410233797, -0.3248032942, -0.2364246952],
                      [-0.6636628587, 1.6153315917, 0.0167563477],
                      [0.0117218943, -0.0082844420, 0.9883948585]])
ACES_WHITE = np.array([0.32168 / 0.33767, 1.0, (1 - 0.32168 - 0.33767) / 0.33767])


def adaptation(white: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Matrix (3, 3) that takes X, Y, Z under one white to those under another, by Bradford.

    Parameters
    ----------
    white, wanted : (3,) arrays
        X, Y, Z of both whites.
    """
    gains = (BRADFORD @ wanted) / (BRADFORD @ white)
    return np.linalg.solve(BRADFORD, gains[:, None] * BRADFORD)


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


def signal_of_srgb(encoded: np.ndarray) -> np.ndarray:
    """What the CIE 1931 observer sees (..., 3) of sRGB code values under D65, relative to white.

    Parameters
    ----------
    encoded : (..., 3) array
        0 to 1.
    """
    to_xyz = np.linalg.inv(TO_SRGB)
    return np.asarray(decode_srgb(encoded) @ to_xyz.T / to_xyz.sum(axis=1))


def rounding_of_srgb(encoded: np.ndarray) -> np.ndarray:
    """How far rounding to 8 bits leaves ``signal_of_srgb`` open: standard errors (..., 3).

    Parameters
    ----------
    encoded : (..., 3) array
        0 to 1.
    """
    to_xyz = np.linalg.inv(TO_SRGB)
    # an even distribution over one step of 8 bits
    rounding = (decode_srgb(np.minimum(encoded + 0.5 / 255, 1))
                - decode_srgb(np.maximum(encoded - 0.5 / 255, 0))) / np.sqrt(12)
    return np.asarray(np.sqrt(rounding**2 @ (to_xyz**2).T) / to_xyz.sum(axis=1))


def delta_e00(nm: np.ndarray, a: np.ndarray, b: np.ndarray) -> float:
    """CIEDE2000 difference of two reflectances under D65.

    Parameters
    ----------
    nm : (P,) array
        Ascending.
    a, b : (P,) arrays
        Reflectances.
    """
    return float(ciede2000(reflectance_to_lab(nm, a), reflectance_to_lab(nm, b)))


def reflectance_to_lab(nm: np.ndarray, reflectance: np.ndarray, light: str = "D65") -> np.ndarray:
    """L*, a*, b* (..., 3) of reflectances under a light.

    Parameters
    ----------
    nm : (P,) array
        Ascending.
    reflectance : (..., P) array
        0 to 1.
    light : str
        CIE name: D65, A, FL11, LED-B3.

    Raises
    ------
    InputError
        If no light of that name is published.
    """
    weights = tristimulus_weights(nm, light)
    return lab_from_xyz(reflectance @ weights.T, weights.sum(axis=1))


def lab_from_xyz(xyz: np.ndarray, white: np.ndarray) -> np.ndarray:
    """L*, a*, b* (..., 3) of tristimulus values.

    Parameters
    ----------
    xyz : (..., 3) array
    white : (3,) array
        Tristimulus values of the perfect reflector under the same light.
    """
    share = xyz / white
    cubic = np.where(share > DARK, np.cbrt(share), share * (29 / 6) ** 2 / 3 + 4 / 29)
    x, y, z = np.moveaxis(cubic, -1, 0)
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=-1)


def share_of_white(lab: np.ndarray) -> np.ndarray:
    """Tristimulus values (..., 3) relative to those of white; undoes ``lab_from_xyz``.

    Parameters
    ----------
    lab : (..., 3) array
    """
    lightness, a, b = np.moveaxis(np.asarray(lab, dtype=float), -1, 0)
    y = (lightness + 16) / 116
    cubic = np.stack([y + a / 500, y, y - b / 200], axis=-1)
    return np.where(cubic > np.cbrt(DARK), cubic**3, (cubic - 4 / 29) * 3 * (6 / 29) ** 2)


def signal_of_colour(light: str, *, lab: np.ndarray | None = None,
                     xyz: np.ndarray | None = None) -> np.ndarray:
    """What the CIE 1931 observer sees (..., 3) of a colour, relative to white under its light.

    Parameters
    ----------
    light : str
        CIE name.
    lab : (..., 3) array, optional
        L*, a*, b*.
    xyz : (..., 3) array, optional
        In place of ``lab``; Y is 100 for white.

    Raises
    ------
    InputError
        If no light of that name is published, or it is not exactly one colour between black and
        white.
    """
    white = 100 * tristimulus_weights(np.arange(*WITHIN_NM), light).sum(axis=1)
    stated = [np.asarray(each, dtype=float) for each in (lab, xyz) if each is not None]
    if len(stated) != 1 or stated[0].shape[-1:] != (3,):
        raise errors.InputError("give L*a*b* or X, Y, Z of a colour, three numbers")
    signal = stated[0] / white if lab is None else share_of_white(stated[0])
    if not np.all((signal >= 0) & (signal <= BRIGHTEST)):
        raise errors.InputError(
            f"{stated[0]} is no colour of a surface under {light}: relative to white "
            f"it is {np.round(signal, 3)}; L* is 0 to 100, and Y is 100 for white")
    return signal


def ciede2000(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """CIEDE2000 (...), all weights 1; symbols as in Sharma, Wu and Dalal (2005), Eqs. 2-22.

    Parameters
    ----------
    first, second : (..., 3) arrays
        L*, a*, b*; the difference is the same in both orders.
    """
    (L1, a1, b1), (L2, a2, b2) = (np.moveaxis(np.asarray(lab, dtype=float), -1, 0)
                                  for lab in (first, second))
    C_mean = (np.hypot(a1, b1) + np.hypot(a2, b2)) / 2
    G = 0.5 * (1 - np.sqrt(C_mean**7 / (C_mean**7 + 25.0**7)))
    a1, a2 = (1 + G) * a1, (1 + G) * a2
    C1, C2 = np.hypot(a1, b1), np.hypot(a2, b2)
    h1, h2 = np.degrees(np.arctan2(b1, a1)) % 360, np.degrees(np.arctan2(b2, a2)) % 360
    grey = C1 * C2 == 0
    turn = np.where(grey, 0.0, (h2 - h1 + 180) % 360 - 180)
    dL, dC, dH = L2 - L1, C2 - C1, 2 * np.sqrt(C1 * C2) * np.sin(np.radians(turn / 2))
    L, C = (L1 + L2) / 2, (C1 + C2) / 2
    far = np.abs(h1 - h2) > 180
    h = np.where(grey, h1 + h2, (h1 + h2 + np.where(far, np.where(h1 + h2 < 360, 360, -360), 0))
                 / 2)
    T = (1 - 0.17 * np.cos(np.radians(h - 30)) + 0.24 * np.cos(np.radians(2 * h))
         + 0.32 * np.cos(np.radians(3 * h + 6)) - 0.20 * np.cos(np.radians(4 * h - 63)))
    S_L = 1 + 0.015 * (L - 50) ** 2 / np.sqrt(20 + (L - 50) ** 2)
    S_C, S_H = 1 + 0.045 * C, 1 + 0.015 * C * T
    R_C = 2 * np.sqrt(C**7 / (C**7 + 25.0**7))
    R_T = -np.sin(np.radians(60 * np.exp(-(((h - 275) / 25) ** 2)))) * R_C
    l_term, c_term, h_term = dL / S_L, dC / S_C, dH / S_H
    return np.sqrt(l_term**2 + c_term**2 + h_term**2 + R_T * c_term * h_term)


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


def acescg_weights(nm: np.ndarray) -> np.ndarray:
    """Weights (3, P) that give ACEScg under its own white of what looks alike under D65, by the
    Bradford transform: 1, 1, 1 is white.

    Parameters
    ----------
    nm : (P,) array
        Ascending.
    """
    to_xyz = tristimulus_weights(nm, "D65")
    cones, wanted = BRADFORD @ to_xyz.sum(axis=1), BRADFORD @ ACES_WHITE
    adapted = np.linalg.solve(BRADFORD, (wanted / cones)[:, None] * (BRADFORD @ to_xyz))
    return np.asarray(TO_ACESCG @ adapted)


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
    return np.asarray(weights @ grid.interpolation_matrix(nm, table_nm))


@functools.cache
def _weights_under(light_name: str) -> tuple[np.ndarray, np.ndarray]:
    """Wavelengths (P,) from 360 to 780 nm and the weights (3, P) of X, Y, Z."""
    nm, observer = published_tables.published_curves(published_tables.OBSERVERS,
                                                     "CIE 1931 2 Degree Standard Observer")
    inside = (nm >= WITHIN_NM[0]) & (nm <= WITHIN_NM[1])
    nm, light = nm[inside], published_tables.published_curves(published_tables.LIGHTS, light_name)
    weights = observer[:, inside] * np.interp(nm, light[0], light[1][0])
    return nm, weights / weights[1].sum()


# ---- lights --------------------------------------------------------------------------------------
# Tristimulus values and luminance of a spectrum (CIE 1931 2 degree observer, 683 lm/W).

LUMENS_PER_WATT = 683.0
OBSERVER_NM = (380.0, 780.0)      # CIE 15; beyond, the observer's table changes no digit


def luminance_of(nm: np.ndarray, values: np.ndarray) -> float:
    """Luminance in cd m-2 of a radiance, or illuminance in lx of an irradiance.

    Parameters
    ----------
    nm : (P,) array
        Ascending.
    values : (P,) array
        W m-2 sr-1 nm-1, or W m-2 nm-1.
    """
    return float(tristimulus_of(nm, values)[1])


def tristimulus_of(nm: np.ndarray, values: np.ndarray) -> np.ndarray:
    """X, Y, Z (3,) with Y in cd m-2 of a radiance, or in lx of an irradiance.

    Parameters
    ----------
    nm : (P,) array
        Ascending.
    values : (P,) array
        W m-2 sr-1 nm-1, or W m-2 nm-1.
    """
    return LUMENS_PER_WATT * colour_matching(nm) @ (grid.trapezoid_weights_nm(nm) * values)


def colour_matching(nm: np.ndarray) -> np.ndarray:
    """x-bar, y-bar and z-bar (3, P), 0 outside 380-780 nm.

    Parameters
    ----------
    nm : (P,) array
    """
    inside = (nm >= OBSERVER_NM[0]) & (nm <= OBSERVER_NM[1])
    table_nm, curves = _observer()
    return np.array([np.where(inside, np.interp(nm, table_nm, curve), 0.0) for curve in curves])


@functools.cache
def _observer() -> tuple[np.ndarray, np.ndarray]:
    return published_tables.published_curves(published_tables.OBSERVERS,
                                             "CIE 1931 2 Degree Standard Observer")
