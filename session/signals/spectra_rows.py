"""Spectra of every pixel written to two files, some rows at a time, in their order.

The mean goes to ``mean.exr`` and the standard deviation to ``standard_deviation.exr``, spectral EXR
of one layer a wavelength (spectral_layers.py); the mean also has the colours under D65 as channels
R, G and B (linear sRGB), which any viewer of pictures shows. As ENVI images they are ``mean.hdr``
and ``standard_deviation.hdr`` with their values beside them, as Zarr arrays ``mean.zarr`` and
``standard_deviation.zarr``. What is in memory grows with the width of the picture alone: rows that
make up a row of tiles or chunks are held.
"""
from __future__ import annotations

import contextlib
import os
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, Literal, TypeVar

import numpy as np

from spectrabox.capture.photo.image_rows import ROWS_PER_BLOCK, exr_rows
from spectrabox.radiometry.appearance import TO_SRGB, adapted_tristimulus
from spectrabox.radiometry.files import writable
from spectrabox.radiometry.records import Quantity
from spectrabox.radiometry.spectra.formats.envi_cube import VALUES, envi_rows
from spectrabox.radiometry.spectra.formats.zarr_array import SUFFIX as ZARR
from spectrabox.radiometry.spectra.formats.zarr_array import zarr_rows
from spectrabox.radiometry.spectra.spectral_layers import (
    QUANTITY,
    STANDARD_DEVIATION,
    layer_names,
    layout_attributes,
)
from spectrabox.radiometry.system.strips import WriteRows
from spectrabox.sampling.prior.mixture import GRID

PIXELS_AT_ONCE = 65_536
GRID_STEP_NM = 5
SPREAD_STEPS = 2        # the standard deviation changes slowly: every second wavelength is kept
DAYLIGHT = "D65"
MEAN, SPREAD = "mean", "standard_deviation"
QUANTITIES = {MEAN: Quantity.REFLECTANCE.name.lower(), SPREAD: STANDARD_DEVIATION}
Format = Literal["exr", "tiled-exr", "envi", "zarr"]
SUFFIXES = {"exr": ".exr", "tiled-exr": ".exr", "envi": ".hdr", "zarr": ZARR}

Rows = TypeVar("Rows")      # what some rows of a picture are given as
Spectra = tuple[np.ndarray, ...]    # mean (n, P), standard deviation (n, Q), and what else there is


@dataclass(frozen=True)
class KeptWavelengths:
    """Which of the prior's wavelengths mean and standard deviation are written at."""

    step_nm: int            # between wavelengths of the mean, a multiple of 5
    full: bool = False      # all wavelengths of both, in single floats
    form: Format = "exr"    # of the files; ENVI's are single floats

    @property
    def mean(self) -> slice:
        """Of the 61 wavelengths."""
        return slice(None, None, 1 if self.full else self.step_nm // GRID_STEP_NM)

    @property
    def spread(self) -> slice:
        """Of the 61 wavelengths."""
        return slice(None, None, 1 if self.full else SPREAD_STEPS * self.step_nm // GRID_STEP_NM)

    @property
    def nm(self) -> tuple[np.ndarray, np.ndarray]:
        """Wavelengths of the mean and of the standard deviation."""
        return GRID.nm[self.mean], GRID.nm[self.spread]

    def paths(self, folder: Path) -> dict[str, Path]:
        """The file of the mean and that of the standard deviation."""
        return {name: folder / f"{name}{SUFFIXES[self.form]}" for name in (MEAN, SPREAD)}

    def files(self) -> tuple[str, ...]:
        """Names of all files, with those of the values of ENVI images."""
        names = tuple(path.name for path in self.paths(Path()).values())
        return (*names, MEAN + VALUES, SPREAD + VALUES) if self.form == "envi" else names


@dataclass(frozen=True)
class Canvas(Generic[Rows]):
    """A picture to be written: its size, and how its rows become spectra."""

    height: int
    width: int
    read: Callable[[int, int], Rows]            # first and last row, one caller at a time
    spectra: Callable[[Rows], Spectra]          # on several cores


def write_spectra(canvas: Canvas[Rows], folder: Path, kept: KeptWavelengths,
                  progress: Callable[[float], None],
                  also: Callable[[int, int, Spectra], None] = lambda first, last, made: None
                  ) -> dict[str, Path]:
    """Write both files, whole or not at all.

    Parameters
    ----------
    canvas : Canvas
    folder : Path
    kept : KeptWavelengths
    progress : function of the share that is done
    also : function of (first, last, spectra), optional
        Takes the spectra of some rows, from the top to the bottom.

    Returns
    -------
    dict
        "mean" and "standard_deviation" to their files.
    """
    paths, width = kept.paths(folder), canvas.width
    with writable(folder), _mean_rows(paths[MEAN], canvas, kept) as write_mean, \
            _spread_rows(paths[SPREAD], canvas, kept) as write_spread:
        for first, last, made in in_order(canvas):
            write_mean(first, made[0].reshape(last - first, width, -1))
            write_spread(first, made[1].reshape(last - first, width, -1))
            also(first, last, made)
            progress(last / canvas.height)
    return paths


@contextlib.contextmanager
def _mean_rows(path: Path, canvas: Canvas[Rows], kept: KeptWavelengths) -> Iterator[WriteRows]:
    nm, size = kept.nm[0], (canvas.height, canvas.width)
    if kept.form == "envi":
        with envi_rows(path, *size, nm, Quantity.REFLECTANCE.name.lower(),
                       "mean reflectance of every pixel") as write:
            yield write
        return
    if kept.form == "zarr":
        with zarr_rows(path, *size, nm, not kept.full,
                       {QUANTITY: QUANTITIES[MEAN]}) as write:
            yield write
        return
    to_srgb = (TO_SRGB @ adapted_tristimulus(nm, DAYLIGHT)).T.astype(np.float32)
    with exr_rows(path, *size, [*"RGB", *layer_names(nm)], not kept.full,
                  layout_attributes(Quantity.REFLECTANCE), tiles=kept.form == "tiled-exr") as write:
        yield lambda first, mean: write(first, np.dstack([mean @ to_srgb, mean]))


@contextlib.contextmanager
def _spread_rows(path: Path, canvas: Canvas[Rows], kept: KeptWavelengths) -> Iterator[WriteRows]:
    nm, size = kept.nm[1], (canvas.height, canvas.width)
    made = (envi_rows(path, *size, nm, STANDARD_DEVIATION,
                      "standard deviation of the reflectance of every pixel")
            if kept.form == "envi" else
            zarr_rows(path, *size, nm, not kept.full, {QUANTITY: QUANTITIES[SPREAD]})
            if kept.form == "zarr" else
            exr_rows(path, *size, layer_names(nm), not kept.full,
                     layout_attributes(STANDARD_DEVIATION), tiles=kept.form == "tiled-exr"))
    with made as write:
        yield write


def row_blocks(height: int, width: int) -> list[tuple[int, int]]:
    """First and last row of the parts in which a picture is read."""
    rows = max(1, PIXELS_AT_ONCE // (width * ROWS_PER_BLOCK)) * ROWS_PER_BLOCK
    return [(first, min(first + rows, height)) for first in range(0, height, rows)]


def in_order(canvas: Canvas[Rows]) -> Iterator[tuple[int, int, Spectra]]:
    """The spectra of parts of the picture in their order, as many at a time as there are cores."""
    cores = os.cpu_count() or 1
    waiting: deque[tuple[int, int, Future[Spectra]]] = deque()
    with ThreadPoolExecutor(cores) as pool:
        for first, last in row_blocks(canvas.height, canvas.width):
            waiting.append((first, last, pool.submit(canvas.spectra, canvas.read(first, last))))
            if len(waiting) > cores:
                first, last, spectra = waiting.popleft()
                yield first, last, spectra.result()
        for first, last, spectra in waiting:
            yield first, last, spectra.result()
