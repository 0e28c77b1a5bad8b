"""Readings of several instruments made comparable, each by the calibration of its own instrument.

Two spectroradiometers of one model differ by some per cent, differently at every wavelength: a mean
or a ratio over both is a measurement by neither.
"""
from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records.spectra import Quantity, Spectrum
from spectrabox.radiometry.spectra.readings import SpectralReading
from spectrabox.radiometry.spectra.spectrum_files import read_spectrum

POSSIBLE = (0.2, 5.0)       # a factor beyond is a spectrum of something else
Maker = tuple[str, str]     # model and serial number


@dataclass(frozen=True)
class MeterCalibration:
    """Factors by which an instrument's readings become those of the common standard."""

    serial_number: str
    factor: Spectrum        # 1, with its standard error where that is known


def read_calibration(text: str) -> MeterCalibration:
    """A calibration as the operator names it, "65123456=pr655.csv".

    Parameters
    ----------
    text : str

    Raises
    ------
    InputError
        If it names no file, or the file holds no factors near 1.
    """
    serial_number, separator, file = text.partition("=")
    if not (separator and serial_number.strip() and file.strip()):
        raise InputError(f"the calibration {text!r} is not SERIAL=FILE, such as 65123456=pr655.csv")
    factor = read_spectrum(Path(file.strip()), role=Quantity.RELATIVE)
    if factor.quantity is not Quantity.RELATIVE:
        raise InputError(f"{file} states {factor.quantity.name.lower()}; a calibration is a table "
                         "of factors ('# quantity: relative')")
    low, high = float(factor.values.min()), float(factor.values.max())
    if not POSSIBLE[0] <= low <= high <= POSSIBLE[1]:
        raise InputError(f"{file} holds factors from {low:.3g} to {high:.3g}; a calibration has "
                         f"factors near 1, {POSSIBLE[0]} to {POSSIBLE[1]}")
    return MeterCalibration(serial_number.strip(), factor)


def makers_of(readings: Iterable[SpectralReading]) -> list[Maker]:
    """The instruments of readings that hold a spectrum, each once, in the order they were used.

    Parameters
    ----------
    readings : iterable of SpectralReading
    """
    return list(dict.fromkeys((reading.instrument, reading.serial_number) for reading in readings
                              if reading.spectrum is not None))


def require_comparable(makers: Sequence[Maker], calibrations: Sequence[MeterCalibration],
                       what: str) -> None:
    """Refuse to compare what different instruments read, unless each has its calibration.

    Parameters
    ----------
    makers : sequence of (model, serial number)
    calibrations : sequence of MeterCalibration
    what : str
        Was read, for errors.

    Raises
    ------
    InputError
        Also at a calibration for none of the instruments.
    """
    used = list(dict.fromkeys(makers))
    calibrated = [calibration.serial_number for calibration in calibrations]
    serials = [serial_number for _, serial_number in used]
    if foreign := [number for number in calibrated if number not in serials]:
        raise InputError(f"{what}: there is a calibration for {', '.join(foreign)}, but readings "
                         f"by {named(used)} only")
    distinct = len(set(serials)) == len(serials) and len(set(calibrated)) == len(calibrated)
    if len(used) > 1 and not (distinct and set(serials) == set(calibrated)):
        raise InputError(f"{what}: read by {named(used)}, and their calibrations differ, so that a "
                         "mean or a ratio is a measurement by neither: measure with one of them "
                         "(--again starts a new series), or give the calibration of each with "
                         "--calibration SERIAL=FILE")


def named(makers: Sequence[Maker]) -> str:
    """Instruments as a sentence lists them."""
    return " and ".join(f"{model} {serial_number}" for model, serial_number in makers)


def factors_at(nm: np.ndarray, calibrations: Sequence[MeterCalibration]) -> Mapping[
        str, tuple[np.ndarray, np.ndarray]]:
    """Factors (P,) and their standard errors (P,), zero where not known, by serial number.

    Parameters
    ----------
    nm : (P,) array
    calibrations : sequence of MeterCalibration

    Raises
    ------
    InputError
        If a calibration does not reach from the first to the last wavelength.
    """
    factors = {}
    for calibration in calibrations:
        factor = calibration.factor
        if factor.grid.nm[0] > nm[0] or factor.grid.nm[-1] < nm[-1]:
            raise InputError(f"the calibration of {calibration.serial_number} covers "
                             f"{factor.grid.nm[0]:g}-{factor.grid.nm[-1]:g} nm; its readings cover "
                             f"{nm[0]:g}-{nm[-1]:g} nm")
        error = (np.zeros(nm.size) if factor.standard_error is None
                 else np.interp(nm, factor.grid.nm, factor.standard_error))
        factors[calibration.serial_number] = (np.interp(nm, factor.grid.nm, factor.values), error)
    return factors
