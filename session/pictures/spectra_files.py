"""Spectra of every pixel written to two files, some rows at a time, in their order.

The mean goes to ``mean.exr`` and the standard deviation to ``standard_deviation.exr``, spectral EXR
of one layer a wavelength (spectral_layers.py); the mean also has the colours under D65 as channels
R, G and B (linear sRGB), which any image viewer shows. As ENVI images they are ``mean.hdr`` and
``standard_deviation.hdr`` with their values in files of their own, as Zarr arrays ``mean.zarr`` and
``standard_deviation.zarr``. What is in memory grows with the width of the picture alone: the rows
of one row of tiles or chunks are held.
"""
from __future__ import annotations

import contextlib
import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeVar

import numpy as np

from spectrabox.capture.photo.image_rows import exr_rows
from spectrabox.measure.pictures.pixel_spectra import KeptWavelengths, row_blocks
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

DAYLIGHT = "D65"
MEAN, DEVIATION = "mean", "standard_deviation"
QUANTITIES = {MEAN: Quantity.REFLECTANCE.name.lower(), DEVIATION: STANDARD_DEVIATION}
Format = Literal["exr", "tiled-exr", "envi", "zarr"]
SUFFIXES = {"exr": ".exr", "tiled-exr": ".exr", "envi": ".hdr", "zarr": ZARR}

Rows = TypeVar("Rows")
Made = TypeVar("Made")


@dataclass(frozen=True)
class PictureLayout(KeptWavelengths):
    """The wavelengths that are written, and the format of the files; ENVI's are single floats."""

    form: Format = "exr"

    def paths(self, folder: Path) -> dict[str, Path]:
        """The file of the mean and that of the standard deviation."""
        return {name: folder / f"{name}{SUFFIXES[self.form]}" for name in (MEAN, DEVIATION)}

    def files(self) -> tuple[str, ...]:
        """Names of all files, with those of the values of ENVI images."""
        names = tuple(path.name for path in self.paths(Path()).values())
        return (*names, MEAN + VALUES, DEVIATION + VALUES) if self.form == "envi" else names

    @property
    def pixel_type(self) -> str:
        """Type of the numbers in the files."""
        return "float" if self.full or self.form == "envi" else "half"


def computed_blocks(height: int, width: int, read: Callable[[int, int], Rows],
                    compute: Callable[[Rows], Made]) -> Iterator[tuple[int, int, Made]]:
    """First row, last row and result of parts of a picture in their order, as many computed at a
    time as there are cores.

    Parameters
    ----------
    height, width : int
    read : function of (first, last)
        Called by one thread.
    compute : function of the rows that were read
        Called by several threads.
    """
    cores = os.cpu_count() or 1
    waiting: deque[tuple[int, int, Future[Made]]] = deque()
    with ThreadPoolExecutor(cores) as pool:
        for first, last in row_blocks(height, width):
            waiting.append((first, last, pool.submit(compute, read(first, last))))
            if len(waiting) > cores:
                first, last, result = waiting.popleft()
                yield first, last, result.result()
        for first, last, result in waiting:
            yield first, last, result.result()


def write_spectra(blocks: Iterable[tuple[int, int, tuple[np.ndarray, ...]]],
                  size: tuple[int, int], folder: Path, layout: PictureLayout,
                  progress: Callable[[float], None]) -> dict[str, Path]:
    """Write mean and standard deviation, whole or not at all.

    Parameters
    ----------
    blocks : iterable of (first row, last row, (mean (n, P), standard deviation (n, Q)))
    size : (height, width)
    folder : Path
    layout : PictureLayout
    progress : function of the share that is done

    Returns
    -------
    dict
        "mean" and "standard_deviation" to their files.
    """
    paths = layout.paths(folder)
    write_blocks(blocks, size, folder, [layer_rows(name, path, size, layout)
                                        for name, path in paths.items()], progress)
    return paths


def write_blocks(blocks: Iterable[tuple[int, int, tuple[np.ndarray, ...]]], size: tuple[int, int],
                 folder: Path, files: list[contextlib.AbstractContextManager[WriteRows]],
                 progress: Callable[[float], None]) -> None:
    """Write the parts of each block, one to each of the files."""
    with writable(folder), contextlib.ExitStack() as stack:
        writers = [stack.enter_context(file) for file in files]
        for first, last, parts in blocks:
            for write, part in zip(writers, parts, strict=True):
                write(first, part.reshape(last - first, size[1], -1))
            progress(last / size[0])


@contextlib.contextmanager
def layer_rows(name: str, path: Path, size: tuple[int, int],
               layout: PictureLayout) -> Iterator[WriteRows]:
    """A function of (first row, pixels) that writes the next rows of the mean or of the standard
    deviation.

    Parameters
    ----------
    name : str
        "mean" or "standard_deviation".
    path : Path
    size : (height, width)
    layout : PictureLayout
    """
    nm, half = layout.nm[name == DEVIATION], not layout.full
    words = name.replace("_", " ") + (" of the" if name == DEVIATION else "")
    with contextlib.ExitStack() as stack:
        if layout.form == "envi":
            yield stack.enter_context(envi_rows(path, *size, nm, QUANTITIES[name],
                                                f"{words} reflectance of every pixel"))
        elif layout.form == "zarr":
            yield stack.enter_context(zarr_rows(path, *size, nm, half,
                                                {QUANTITY: QUANTITIES[name]}))
        else:
            colours = "RGB" if name == MEAN else ""
            write = stack.enter_context(exr_rows(
                path, *size, [*colours, *layer_names(nm)], half,
                layout_attributes(Quantity.REFLECTANCE if colours else STANDARD_DEVIATION),
                tiles=layout.form == "tiled-exr"))
            to_srgb = srgb_of_spectra(nm)
            yield (lambda first, mean: write(first, np.dstack([mean @ to_srgb, mean]))) \
                if colours else write


def srgb_of_spectra(nm: np.ndarray, light: str = DAYLIGHT) -> np.ndarray:
    """Matrix (P, 3) from reflectances to linear sRGB under a light, adapted to D65."""
    return (TO_SRGB @ adapted_tristimulus(nm, light)).T.astype(np.float32)
