"""Spectra of every pixel written to two files, some rows at a time, in their order.

The mean goes to ``mean.exr`` and the standard deviation to ``standard_deviation.exr``, one channel
a wavelength. What is in memory does not grow with the picture.
"""
from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

import numpy as np

from spectrabox.capture.photo.image_rows import ROWS_PER_BLOCK, exr_rows
from spectrabox.radiometry.files import writable
from spectrabox.sampling.prior.mixture import GRID

PIXELS_AT_ONCE = 65_536
GRID_STEP_NM = 5
SPREAD_STEPS = 2        # the standard deviation changes slowly: every second wavelength is kept
MEAN, SPREAD = "mean.exr", "standard_deviation.exr"

Rows = TypeVar("Rows")      # what some rows of a picture are given as
Spectra = tuple[np.ndarray, ...]    # mean (n, P), standard deviation (n, Q), and what else there is


@dataclass(frozen=True)
class KeptWavelengths:
    """Which of the prior's wavelengths mean and standard deviation are written at."""

    step_nm: int            # between wavelengths of the mean, a multiple of 5
    full: bool = False      # all wavelengths of both, in single floats

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
    paths = {"mean": folder / MEAN, "standard_deviation": folder / SPREAD}
    mean_nm, spread_nm = (_names(nm) for nm in kept.nm)
    half, height, width = not kept.full, canvas.height, canvas.width
    with writable(folder), \
            exr_rows(paths["mean"], height, width, mean_nm, half) as write_mean, \
            exr_rows(paths["standard_deviation"], height, width, spread_nm, half) as write_spread:
        for first, last, made in _in_order(canvas):
            write_mean(first, made[0].reshape(last - first, width, -1))
            write_spread(first, made[1].reshape(last - first, width, -1))
            also(first, last, made)
            progress(last / height)
    return paths


def row_blocks(height: int, width: int) -> list[tuple[int, int]]:
    """First and last row of the parts in which a picture is read."""
    rows = max(1, PIXELS_AT_ONCE // (width * ROWS_PER_BLOCK)) * ROWS_PER_BLOCK
    return [(first, min(first + rows, height)) for first in range(0, height, rows)]


def _in_order(canvas: Canvas[Rows]) -> Iterator[tuple[int, int, Spectra]]:
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


def _names(nm: np.ndarray) -> list[str]:
    return [f"{wavelength:g}nm" for wavelength in nm]
