"""What colour-science computes for us; it takes a second to import, so only where it is needed."""
from __future__ import annotations

import warnings
from typing import Any

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records.spectra import WavelengthGrid
from spectrabox.radiometry.spectra.named_spectra import light_samples, relative_response


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
        CIE name, such as D55, or a file of the light's spectrum.
    """
    import colour

    light_nm_power = light_samples(illuminant)
    each_nm = np.arange(380.0, 781.0, 5.0)
    curves = np.array([np.interp(each_nm, nm, curve, left=0, right=0) for curve in curves])
    sensitivities = colour.characterisation.RGB_CameraSensitivities(
        curves.T / curves.max(), each_nm)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")         # it says that it aligns its own tables
        matrix, balance = colour.matrix_idt(sensitivities, colour.SpectralDistribution(
            light_nm_power[1], light_nm_power[0]))
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


# ---- upsampling ----------------------------------------------------------------------------------
# Single spectra that other authors would give for a colour, as colour-science implements them.

METHODS = ("Smits 1999", "Meng 2015", "Otsu 2018", "Jakob 2019", "Mallett 2019")


def observer_response(grid: WavelengthGrid) -> np.ndarray:
    """Response (3, P) of the CIE 1931 observer under D65, rows summing to 1.

    Parameters
    ----------
    grid : WavelengthGrid
        Working grid, of P wavelengths.
    """
    return relative_response("CIE 1931 2 Degree Standard Observer", "D65", grid)


def upsampled(relative_xyz: np.ndarray, grid: WavelengthGrid, method: str) -> np.ndarray:
    """Spectrum (P,) that a published method gives for a colour.

    Parameters
    ----------
    relative_xyz : (3,) array
        Tristimulus values over those of the perfect reflector, under D65.
    grid : WavelengthGrid
        Working grid, of P wavelengths.
    method : str
        One of ``METHODS``.

    Raises
    ------
    InputError
        If the method is not known.
    """
    if method not in METHODS:
        raise InputError(f"{method!r} is no method that is known; known are {', '.join(METHODS)}")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import colour

        white = colour.xy_to_XYZ(
            colour.CCS_ILLUMINANTS["CIE 1931 2 Degree Standard Observer"]["D65"])
        spectrum = _recovered(colour, relative_xyz * white, method)
        shaped = spectrum.copy().align(colour.SpectralShape(380, 780, 5))
    return np.interp(grid.nm, np.asarray(shaped.wavelengths), np.asarray(shaped.values))


def _recovered(colour: Any, xyz: np.ndarray, method: str) -> Any:
    from colour.recovery import (
        RGB_to_sd_Mallett2019,
        RGB_to_sd_Smits1999,
        XYZ_to_sd_Jakob2019,
        XYZ_to_sd_Meng2015,
        XYZ_to_sd_Otsu2018,
    )

    observer = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"].copy().align(
        colour.SpectralShape(360, 780, 5))
    light = colour.SDS_ILLUMINANTS["D65"].copy().align(observer.shape)
    rgb = np.clip(colour.XYZ_to_RGB(xyz, "sRGB", apply_cctf_encoding=False), 0, 1)
    return {"Smits 1999": lambda: RGB_to_sd_Smits1999(rgb),
            "Mallett 2019": lambda: RGB_to_sd_Mallett2019(rgb),
            "Meng 2015": lambda: XYZ_to_sd_Meng2015(xyz, observer, light),
            "Otsu 2018": lambda: XYZ_to_sd_Otsu2018(xyz, observer, light),
            "Jakob 2019": lambda: XYZ_to_sd_Jakob2019(xyz, observer, light)}[method]()
