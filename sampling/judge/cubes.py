"""A hyperspectral picture made elsewhere, as something that is read row by row, and its
wavelengths.
"""
from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.spectra.formats.measurement_table import text_of
from spectrabox.radiometry.spectra.spectral_layers import REFLECTANCE, spectral_layers

MAX_BANDS, MOST_SIDE, MOST_IN_ROW = 5000, 200_000, 100_000_000     # the last: values, read at once


@dataclass(frozen=True)
class Cube:
    """A picture of C wavelengths; ``rows(first, last)`` reads (last - first, W, C) of it, in the
    file's unit.
    """

    file: str
    nm: np.ndarray              # (C,) ascending
    height: int
    width: int
    rows: Callable[[int, int], np.ndarray]


def cube_of_channels(file: str, names: Sequence[str], height: int, width: int,
                     rows: Callable[[int, int], np.ndarray]) -> Cube:
    """A picture whose channels are named by their wavelengths, as of a spectral EXR; others are
    left out.

    Raises
    ------
    InputError
        If fewer than two are.
    """
    # Of a spectral EXR's layers the reflectance T is meant.
    _, bands = spectral_layers(names, first=REFLECTANCE)
    if len(bands) < 2:
        raise InputError(f"{file} is an ordinary picture ({', '.join(names[:4])}); a hyperspectral "
                         "one has channels such as 560nm or T.560nm")
    check_sides(file, height, width, len(names))
    channels = [channel for _, channel in bands]
    return cube_of_rows(file, np.array([nm for nm, _ in bands]), height, width,
                        lambda first, last: rows(first, last)[..., channels])


def parse_wavelengths(text: str) -> np.ndarray:
    """Wavelengths (C,) in nm of FIRST:LAST:STEP, of a list v1,v2,..., or of a text file of numbers.

    Raises
    ------
    InputError
    """
    try:
        if len(parts := text.split(":")) == 3:
            first, last, step = map(float, parts)
            count = round((last - first) / step) + 1 if step > 0 and np.isfinite(step) else 0
            if not 2 <= count <= MAX_BANDS:
                raise ValueError
            return first + step * np.arange(count)
        if Path(text).is_file():
            text = ",".join(re.split(r"[\s,;]+", text_of(Path(text).read_bytes()[:1_000_000],
                                                         Path(text).name).strip()))
        nm = np.array([float(part) for part in text.split(",")])
    except (ValueError, OverflowError, OSError):
        raise InputError(f"--wavelengths {text[:60]!r} cannot be read; write 400:700:10, a list, "
                         "or the name of a text file of numbers in nm") from None
    return checked_wavelengths(nm, "--wavelengths")


def checked_wavelengths(nm: np.ndarray, name: str) -> np.ndarray:
    """The wavelengths (C,), two or more, different from one another and in nm."""
    if nm.size < 2 or not np.all(np.isfinite(nm)) or np.unique(nm).size != nm.size \
            or nm.min() < 100 or nm.max() > 1e5:
        raise InputError(f"{name}: {nm.size} wavelengths were given, not all of them different and "
                         "in nm; at least two are needed, such as 400, 410 ...")
    return nm


def cube_of_array(name: str, array: np.ndarray, nm: np.ndarray | None,
                  again: Callable[[], np.ndarray] | None = None) -> Cube:
    """A picture in an array (H, W, C) or (C, H, W): the axis that is as long as the list of
    wavelengths.

    ``again`` maps the same array anew: mapped for one block of rows, its pages leave memory with
    it.
    """
    if array.ndim != 3 or array.dtype.kind not in "fiu":
        raise InputError(f"{name} holds an array of {array.ndim} dimensions of type {array.dtype}; "
                         "three dimensions of real numbers are needed: rows, columns, wavelengths")
    nm = stated_wavelengths(name, nm)
    if nm.size not in (array.shape[2], array.shape[0]):
        raise InputError(f"{name} is an array of {' x '.join(map(str, array.shape))} and {nm.size} "
                         "wavelengths are stated; the last or the first dimension must be as long")
    axis = 2 if array.shape[2] == nm.size else 0
    height, width, bands = np.moveaxis(array, axis, 2).shape
    check_sides(name, height, width, bands)

    def rows(first: int, last: int) -> np.ndarray:
        return np.moveaxis(array if again is None else again(), axis, 2)[first:last]

    return cube_of_rows(name, nm, height, width, rows)


def cube_of_rows(name: str, nm: np.ndarray, height: int, width: int,
                 rows: Callable[[int, int], np.ndarray]) -> Cube:
    """The picture with its wavelengths in ascending order and its values as float64."""
    order = np.argsort(checked_wavelengths(nm, name))
    ascending = bool(np.all(np.diff(order) > 0))

    def ordered(first: int, last: int) -> np.ndarray:
        with np.errstate(all="ignore"):     # what is no number is left out with its pixel
            block = np.array(rows(first, last), dtype=float)
            return block if ascending else block[..., order]

    return Cube(name, nm[order], height, width, ordered)


def stated_wavelengths(name: str, nm: np.ndarray | None) -> np.ndarray:
    """The wavelengths (C,), of which there must be some."""
    if nm is None:
        raise InputError(f"{name} states no wavelengths; give them with --wavelengths 400:700:10, "
                         "or a file of them")
    return np.asarray(nm, dtype=float)


def check_sides(name: str, height: int, width: int, bands: int) -> None:
    """Raise unless these are the sides of a hyperspectral picture.

    Raises
    ------
    InputError
    """
    if not (0 < height <= MOST_SIDE and 0 < width <= MOST_SIDE and 2 <= bands <= MAX_BANDS) \
            or width * bands > MOST_IN_ROW:
        raise InputError(f"{name}: {height} x {width} pixels of {bands} bands cannot be a "
                         "hyperspectral picture; check which dimension holds the wavelengths")
