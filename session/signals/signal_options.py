"""Signals and measurements as written on the command line or in small files."""
from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from spectrabox.measure.signals import READING_ERROR, listed, reading_at
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.files import read_text
from spectrabox.radiometry.grid import FINE_GRID, interpolation_matrix
from spectrabox.radiometry.spectra import named_spectra
from spectrabox.radiometry.system.words import is_number
from spectrabox.sampling.further.conditioning import Reading
from spectrabox.sampling.prior.mixture import PRIOR_GRID


def response_of_names(sensitivity: str, light: str) -> np.ndarray:
    """Relative response (K, 61) of named curves and light, integrated at 1 nm."""
    return named_spectra.relative_response(sensitivity, light, FINE_GRID) \
        @ interpolation_matrix(PRIOR_GRID.nm, FINE_GRID.nm)


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
        raise InputError(f"--{name} {listed(values)} holds a value that is not finite")
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
    rows = csv_rows(path, "signals")
    if len(rows) < 2:
        raise InputError(f"{path.name} holds no signals; a header of band names and one signal per "
                         "row are needed")
    if all(is_number(part) for cell in rows[0] for part in cell.split(";")):
        raise InputError(f"{path.name} begins with numbers, and its first row must name the bands: "
                         "write a row such as R,G,B above the signals (letters, where bands are "
                         "named by their wavelengths: 450 nm)")
    return [_signal_of(row, bands, f"signals {path.name} row {number}")
            for number, row in enumerate(rows[1:], 2)]


def csv_rows(path: Path, what: str) -> list[list[str]]:
    """The rows of a CSV that hold anything.

    Raises
    ------
    InputError
        If the file cannot be read as text; ``what`` says what it should hold.
    """
    try:
        lines = read_text(path).splitlines()
    except OSError as error:
        raise InputError(
            f"{path} cannot be read ({error.strerror}); give a CSV of {what}") from None
    except UnicodeDecodeError:
        raise InputError(f"{path.name} is not a text file; give a CSV of {what}") from None
    return [row for row in csv.reader(lines) if any(map(str.strip, row))]


def _signal_of(row: list[str], bands: int, name: str) -> np.ndarray:
    try:
        values = np.array([float(part) for cell in row for part in cell.split(";")])
    except ValueError:
        raise InputError(f"--{name} {','.join(row)!r} is not a list of numbers; write v1,v2,v3") \
            from None
    return per_band(values, bands, name)


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
