"""Signals and measurements as written on the command line or in small files."""
from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import interpolation_matrix, visible_grid
from spectrabox.radiometry.records import SpectralMeasurement
from spectrabox.radiometry.spectra import named_spectra
from spectrabox.sampling.further.conditioning import Reading
from spectrabox.sampling.prior.mixture import PRIOR_GRID

GRID_NM = 1.0           # of the integration; draws and bands are at every 5 nm
READING_ERROR = 0.005   # standard error of a reading that states none
FWHM_TO_SD = 1 / (2 * np.sqrt(2 * np.log(2)))


def response_of_names(sensitivity: str, light: str) -> np.ndarray:
    """Relative response (K, 61) of named curves and light, integrated at 1 nm."""
    fine = visible_grid(1)
    return named_spectra.relative_response(sensitivity, light, fine) \
        @ interpolation_matrix(PRIOR_GRID.nm, fine.nm)


def causes_of_error(signals: np.ndarray, noise_covariance: np.ndarray, light_error: float,
                    sensitivity_error: float) -> dict[str, np.ndarray]:
    """Covariances (..., K, K) of signals (..., K) by cause: a light error moves all bands together,
    a curve's its own band.

    Raises
    ------
    InputError
        For a relative error outside 0 to 0.5.
    """
    for name, error in (("light", light_error), ("sensitivity", sensitivity_error)):
        if not 0 <= error < 0.5:
            raise InputError(f"--{name}-error {error:g} is a relative error; 0 to 0.5 is needed")
    products = signals[..., :, None] * signals[..., None, :]
    return {"photo noise": noise_covariance, "light": light_error**2 * products,
            "sensitivities": sensitivity_error**2 * np.eye(signals.shape[-1]) * products}


def measurement_of_signal(relative_response: np.ndarray, signal: np.ndarray,
                          white: np.ndarray | None = None,
                          noise: np.ndarray | None = None) -> SpectralMeasurement:
    """The measurement relative to white, from a signal as the camera gives it.

    Parameters
    ----------
    relative_response : (K, 301) array
        At every nm, rows summing to 1.
    signal : (K,) array
    white : (K,) array, optional
        What a perfect white reads, in the signal's unit; 1 by default.
    noise : (K,) array, optional
        Standard errors in the signal's unit; 0 by default.

    Raises
    ------
    InputError
        If white is not positive, the noise is negative, or the signal lies beyond twice white.
    """
    relative = relative_to_white(signal, white)
    noise = np.zeros_like(signal) if noise is None else noise
    if np.any(noise < 0):
        raise InputError(f"the noise {_listed(noise)} is negative; give standard errors")
    return SpectralMeasurement(visible_grid(GRID_NM), relative_response, relative,
                               np.diag((noise if white is None else noise / white)**2))


def relative_to_white(signals: np.ndarray, white: np.ndarray | None) -> np.ndarray:
    """Signals (..., K) over what a perfect white (K,) reads in the same unit, 1 by default.

    Raises
    ------
    InputError
        If white is not positive, or a signal lies beyond twice white.
    """
    if white is None:
        white = np.ones(signals.shape[-1])
    if np.any(white <= 0):
        raise InputError(f"the white {_listed(white)} is not positive in every band; give what a "
                         "perfect white reads")
    relative = signals / white
    if np.any(np.abs(relative) > 2):
        raise InputError(f"the signal is {np.abs(relative).max():.3g} times white; give what white "
                         "reads with --white")
    return relative


def numbers(text: str, bands: int, name: str) -> np.ndarray:
    """Numbers (K,) of an option such as 0.2,0.3,0.1.

    Raises
    ------
    InputError
        Naming the option ``--name``.
    """
    try:
        values = np.array([float(part) for part in text.replace(";", ",").split(",")])
    except ValueError:
        raise InputError(f"--{name} {text!r} is not a list of numbers; write v1,v2,v3") from None
    return per_band(values, bands, name)


def optional_numbers(text: str | None, bands: int, name: str) -> np.ndarray | None:
    """Numbers (K,) of an option, None where it was not given."""
    return None if text is None else numbers(text, bands, name)


def per_band(values: np.ndarray, bands: int, name: str) -> np.ndarray:
    """The values (K,), which must be finite and one for each band.

    Raises
    ------
    InputError
        Naming the option ``--name``.
    """
    if values.size != bands:
        raise InputError(f"--{name} has {values.size} values; the sensitivities have {bands} bands")
    if not np.all(np.isfinite(values)):
        raise InputError(f"--{name} {_listed(values)} holds a value that is not finite")
    return values


def signal_and_noise(text: str, bands: int, name: str) -> tuple[np.ndarray, np.ndarray | None]:
    """Signal and standard errors (K,) of v1,v2,v3:e1,e2,e3; the errors are optional."""
    signal, _, noise = text.partition(":")
    return numbers(signal, bands, name), numbers(noise, bands, "noise") if noise else None


def read_signals(path: Path, bands: int) -> list[np.ndarray]:
    """Signals (K,) of a CSV: a header of band names, one signal per row.

    Raises
    ------
    InputError
        Naming the row.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except OSError as error:
        raise InputError(
            f"{path} cannot be read ({error.strerror}); give a CSV of signals") from None
    except UnicodeDecodeError:
        raise InputError(f"{path.name} is not a text file; give a CSV of signals") from None
    rows = [row for row in csv.reader(lines) if any(map(str.strip, row))]
    if len(rows) < 2:
        raise InputError(f"{path.name} holds no signals; a header of band names and one signal per "
                         "row are needed")
    return [_signal_of(row, bands, f"signals {path.name} row {number}")
            for number, row in enumerate(rows[1:], 2)]


def _signal_of(row: list[str], bands: int, name: str) -> np.ndarray:
    try:
        values = np.array([float(part) for cell in row for part in cell.split(";")])
    except ValueError:
        raise InputError(f"--{name} {','.join(row)!r} is not a list of numbers; write v1,v2,v3") \
            from None
    return per_band(values, bands, name)


def _listed(values: np.ndarray) -> str:
    return ",".join(f"{value:g}" for value in values)


def parse_reading(text: str) -> Reading:
    """The reading of NM:REFLECTANCE[:ERROR], or of NM/FWHM:... where its band is that wide.

    Raises
    ------
    InputError
    """
    where, *others = text.split(":")
    centre, slash, width = where.partition("/")
    try:
        nm, values = float(centre), [float(part) for part in others]
        fwhm_nm = float(width) if slash else 0.0
    except ValueError:
        values = []
    if len(values) not in (1, 2) or (slash and not 1 <= fwhm_nm <= 300):
        raise InputError(f"--reading {text!r} cannot be read; write NM:REFLECTANCE or "
                         "NM:REFLECTANCE:ERROR, and NM/FWHM in place of NM for a band of that "
                         "width in nm")
    return reading_at(nm, values[0], values[1] if len(values) == 2 else READING_ERROR, fwhm_nm)


def reading_at(nm: float, reflectance: float, error: float = READING_ERROR,
               fwhm_nm: float = 0.0) -> Reading:
    """A reading at one wavelength, or through a Gaussian band of that full width at half maximum.

    Raises
    ------
    InputError
        As `Reading.at_wavelength`.
    """
    narrow = Reading.at_wavelength(nm, reflectance, error)
    if fwhm_nm <= 0:
        return narrow
    grid_nm = visible_grid(GRID_NM).nm
    weights = np.exp(-0.5 * ((grid_nm - nm) / (fwhm_nm * FWHM_TO_SD))**2)
    return Reading(f"the reading at {nm:g} nm, {fwhm_nm:g} nm wide", grid_nm, weights, reflectance,
                   error)
