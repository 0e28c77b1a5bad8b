"""Signals and measurements as written on the command line or in small files."""
from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.records import SpectralMeasurement
from spectrabox.sampling.further.conditioning import Reading

GRID_NM = 1.0           # of the integration; draws and bands are at every 5 nm
READING_ERROR = 0.005   # standard error of a reading that states none
FWHM_TO_SD = 1 / (2 * np.sqrt(2 * np.log(2)))


def causes_of_error(signal: np.ndarray, noise_covariance: np.ndarray, light_error: float,
                    sensitivity_error: float) -> dict[str, np.ndarray]:
    """Covariances (K, K) of a signal by cause: a light error moves all bands together, a curve's
    its own band.

    Raises
    ------
    InputError
        For a relative error outside 0 to 0.5.
    """
    for name, error in (("light", light_error), ("sensitivity", sensitivity_error)):
        if not 0 <= error < 0.5:
            raise InputError(f"--{name}-error {error:g} is a relative error; 0 to 0.5 is needed")
    return {"photo noise": noise_covariance, "light": light_error**2 * np.outer(signal, signal),
            "sensitivities": sensitivity_error**2 * np.diag(signal**2)}


def measurement_of_signal(relative_response: np.ndarray, signal: np.ndarray, white: str | None,
                          noise: str | None) -> SpectralMeasurement:
    """The measurement relative to white, from a signal (K,) and the options --white and --noise.

    Raises
    ------
    InputError
        If white is not positive, the noise is negative, or the signal lies beyond twice white.
    """
    bands = len(relative_response)
    whites = np.ones(bands) if white is None else numbers(white, bands, "white")
    if np.any(whites <= 0):
        raise InputError(f"the white {white} is not positive in every band; give what a perfect "
                         "white reads")
    errors = np.zeros(bands) if noise is None else numbers(noise, bands, "noise")
    if np.any(errors < 0):
        raise InputError(f"the noise {noise} is negative; give standard errors")
    relative = signal / whites
    if np.any(np.abs(relative) > 2):
        raise InputError(f"the signal is {np.abs(relative).max():.3g} times white; give what white "
                         "reads with --white")
    return SpectralMeasurement(visible_grid(GRID_NM), relative_response, relative,
                               np.diag((errors / whites)**2))


def numbers(text: str, bands: int, name: str) -> np.ndarray:
    """Numbers (K,) of an option such as 0.2,0.3,0.1."""
    try:
        values = np.array([float(part) for part in text.replace(";", ",").split(",")])
    except ValueError:
        raise InputError(f"--{name} {text!r} is not a list of numbers; write v1,v2,v3") from None
    if values.size != bands:
        raise InputError(f"--{name} has {values.size} values; the sensitivities have {bands} bands")
    if not np.all(np.isfinite(values)):
        raise InputError(f"--{name} {text!r} holds a value that is not finite")
    return values


def read_signals(path: Path, bands: int) -> list[np.ndarray]:
    """Signals (K,) of a CSV: a header of band names, one signal per row."""
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
    return [numbers(",".join(row), bands, f"signals {path.name} row {index + 2}") for index,
            row in enumerate(rows[1:])]


def parse_reading(text: str) -> Reading:
    """A reading written as NM:REFLECTANCE[:ERROR], or NM/FWHM:REFLECTANCE[:ERROR] where its band is
    that wide.

    Raises
    ------
    InputError
    """
    place, *others = text.split(":")
    centre, slash, width = place.partition("/")
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
    places = visible_grid(GRID_NM).nm
    weights = np.exp(-0.5 * ((places - nm) / (fwhm_nm * FWHM_TO_SD))**2)
    return Reading(f"the reading at {nm:g} nm, {fwhm_nm:g} nm wide", places, weights, reflectance,
                   error)


def signal_and_noise(text: str, bands: int, name: str) -> tuple[str, str | None]:
    """The two parts of v1,v2,v3:e1,e2,e3; the errors are optional."""
    signal, _, noise = text.partition(":")
    numbers(signal, bands, name)
    return signal, noise or None
