"""Signals and measurements as written on the command line or in small files."""
from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from spectrabox.measure.signals import sample
from spectrabox.radiometry import appearance, errors, files, grid
from spectrabox.radiometry.spectra import cameras, named_spectra
from spectrabox.radiometry.system.words import is_number
from spectrabox.sampling.further.more_measurements import Reading
from spectrabox.sampling.prior.mixture import PRIOR_GRID
from spectrabox.sampling.summary import READING_ERROR


def response_of_names(sensitivity: str, light: str) -> np.ndarray:
    """Relative response (K, 61) of named curves and light, integrated at 1 nm."""
    return named_spectra.relative_response(sensitivity, light, grid.FINE_GRID) \
        @ grid.interpolation_matrix(PRIOR_GRID.nm, grid.FINE_GRID.nm)


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
        raise errors.InputError(
            f"--{name} {text!r} is not a list of numbers; write v1,v2,v3") from None
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
        raise errors.InputError(
            f"--{name} has {values.size} values; the sensitivities have {bands} bands")
    if not np.all(np.isfinite(values)):
        raise errors.InputError(
            f"--{name} {sample.listed(values)} holds a value that is not finite")
    return values


def optional_noise(text: str | None, bands: int) -> np.ndarray | None:
    """Standard errors (K,) of ``--noise``, where one number stands for every band; None where it
    was not given.
    """
    if text is not None and is_number(text.strip()):
        text = ",".join([text] * bands)
    return optional_numbers(text, bands, "noise")


def colour_signal(kind: str, text: str, light: str) -> tuple[np.ndarray, np.ndarray | None]:
    """What the CIE 1931 observer sees of a colour, relative to white, and how far rounding leaves
    it open (standard error, None where it is stated exactly): (3,) each.

    Parameters
    ----------
    kind : str
        "srgb", "lab" or "xyz".
    text : str
        As the option of that name.
    light : str
        CIE name, of L*a*b* and X, Y, Z.

    Raises
    ------
    InputError
    """
    if kind == "srgb":
        return srgb_signal(text)
    if text.replace(";", ",").count(",") != 2:
        raise errors.InputError(f"--{kind} {text!r} is no colour; write three numbers, such as "
                         f"{'45,-27,30' if kind == 'lab' else '14.5,20.1,9.6'}")
    return appearance.signal_of_colour(light, **{kind: numbers(text, 3, kind)}), None


def srgb_values(text: str) -> np.ndarray:
    """Values (3,) of an sRGB colour, 0 to 255.

    Parameters
    ----------
    text : str
        R,G,B from 0 to 255, or #RRGGBB.

    Raises
    ------
    InputError
    """
    if re.fullmatch(r"#[0-9a-fA-F]{6}", text.strip()):
        text = ",".join(str(int(text.strip()[at:at + 2], 16)) for at in (1, 3, 5))
    try:
        values = np.array([float(part) for part in text.split(",")])
    except ValueError:
        values = np.empty(0)
    if values.shape != (3,) or not np.all((values >= 0) & (values <= 255)):
        raise errors.InputError(f"--srgb {text!r} is no sRGB colour; write R,G,B from 0 to 255, or "
                         "#RRGGBB")
    return values


def srgb_signal(text: str) -> tuple[np.ndarray, np.ndarray]:
    """What the CIE 1931 observer sees under D65 of an sRGB colour, of white, and how far rounding
    to 8 bits leaves it open (standard error): (3,) each.

    Parameters
    ----------
    text : str
        As of ``srgb_values``.

    Raises
    ------
    InputError
    """
    encoded = srgb_values(text) / 255
    return appearance.signal_of_srgb(encoded), appearance.rounding_of_srgb(encoded)


def signal_and_noise(text: str, bands: int, name: str) -> tuple[np.ndarray, np.ndarray | None]:
    """Signal and standard errors (K,) of v1,v2,v3:e1,e2,e3; the errors are optional."""
    signal, _, noise = text.partition(":")
    return numbers(signal, bands, name), numbers(noise, bands, "noise") if noise else None


def read_named_signals(path: Path, bands: Sequence[str]) -> dict[str, np.ndarray]:
    """Signals (K,) of a CSV by their names: a header of band names, one signal per row.

    A first column of words holds the names; they are numbers from 1 where there is none.

    Parameters
    ----------
    path : Path
    bands : sequence of K str
        Of the camera; columns of these names may come in any order.

    Raises
    ------
    InputError
        Naming the row, or the columns that are not the camera's bands.
    """
    rows = files.csv_rows(path, "signals")
    if len(rows) < 2:
        raise errors.InputError(
            f"{path.name} holds no signals; a header of band names and one signal per "
            "row are needed")
    if all(is_number(part) for cell in rows[0] for part in cell.split(";")):
        raise errors.InputError(
            f"{path.name} begins with numbers, and its first row must name the bands: "
            "write a row such as R,G,B above the signals (letters, where bands are "
            "named by their wavelengths: 450 nm)")
    named = not any(is_number(part) or not part.strip() for row in rows[1:]
                    for part in row[0].split(";"))
    columns = cameras.columns_of_bands(_parts(rows[0][1:] if named else rows[0]), bands, path.name)
    signals: dict[str, np.ndarray] = {}
    for number, row in enumerate(rows[1:], 1):
        name = row[0].strip() if named else str(number)
        if name in signals:
            raise errors.InputError(
                f"{path.name} names two signals {name!r}; give each a name of its own")
        values = _signal_of(row[1:] if named else row, len(bands),
                            f"signals {path.name} row {number + 1}")
        signals[name] = values[columns] if len(columns) == len(bands) else values
    return signals


def _parts(cells: Sequence[str]) -> list[str]:
    """Entries of a row of a CSV, which semicolons part as well."""
    return [part for cell in cells for part in cell.split(";")]


def _signal_of(row: list[str], bands: int, name: str) -> np.ndarray:
    try:
        values = np.array([float(part) for part in _parts(row)])
    except ValueError:
        raise errors.InputError(f"--{name} {','.join(row)!r} is not a list of numbers; write "
                                "v1,v2,v3") from None
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
        raise errors.InputError(f"--reading {text!r} cannot be read; write NM:REFLECTANCE or "
                         "NM:REFLECTANCE:ERROR, and NM/FWHM in place of NM for a band of that "
                         "width in nm")
    return sample.reading_at(nm, values[0], values[1] if len(values) == 2 else READING_ERROR,
                             fwhm_nm)
