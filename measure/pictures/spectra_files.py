"""Spectra of every pixel written to two files, some rows at a time, in their order.

The mean goes to ``mean.exr`` and the standard deviation to ``standard_deviation.exr``, spectral EXR
of one layer a wavelength (spectral_layers.py); the mean also has the colours under D65 as channels
R, G and B (linear sRGB), which any image viewer shows. As ENVI images they are ``mean.hdr`` and
``standard_deviation.hdr`` with their values in files of their own, as OME-Zarr images
``mean.zarr`` and ``standard_deviation.zarr``. What is in memory grows with the width of the picture
alone: the rows of one row of tiles or chunks are held.
"""
from __future__ import annotations

import contextlib
import json
import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from spectrabox.capture.photo.image_rows import exr_rows
from spectrabox.measure.pictures import pixel_spectra
from spectrabox.measure.shoot.options import PictureFormat
from spectrabox.radiometry import appearance, files
from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.radiometry.spectra import spectral_layers
from spectrabox.radiometry.spectra.formats import envi, zarr_array
from spectrabox.radiometry.spectra.formats.zarr_array import SUFFIX as ZARR
from spectrabox.radiometry.system.strips import WriteRows
from spectrabox.sampling.prior.mixture import PRIOR_GRID

DAYLIGHT = "D65"
MEAN, DEVIATION = "mean", "standard_deviation"
QUANTITIES = {
    MEAN: Quantity.REFLECTANCE.name.lower(), DEVIATION: spectral_layers.STANDARD_DEVIATION
}
RESPONSES = "spectrabox:bandResponses"
OF_WIDTH = ("fwhm is that of the wavelength grid on which spectra are estimated, not what the "
            "camera resolves; how well each value is known is in standard_deviation")
BRIGHTEST = {MEAN: 1.0, DEVIATION: 0.2}     # as viewers show them at first
SUFFIXES = {"exr": ".exr", "tiled-exr": ".exr", "envi": ".hdr", "zarr": ZARR}

Rows = TypeVar("Rows")
Made = TypeVar("Made")


def files_of(form: PictureFormat) -> tuple[str, ...]:
    """Names of all files of a format, with those of the values of ENVI images."""
    names = tuple(f"{name}{SUFFIXES[form]}" for name in (MEAN, DEVIATION))
    return (*names, MEAN + envi.VALUES, DEVIATION + envi.VALUES) if form == "envi" else names


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
        for first, last in pixel_spectra.row_blocks(height, width):
            waiting.append((first, last, pool.submit(compute, read(first, last))))
            if len(waiting) > cores:
                first, last, result = waiting.popleft()
                yield first, last, result.result()
        for first, last, result in waiting:
            yield first, last, result.result()


def write_spectra(blocks: Iterable[tuple[int, int, tuple[np.ndarray, ...]]],
                  size: tuple[int, int], folder: Path, layout: pixel_spectra.PictureLayout,
                  progress: Callable[[float], None], responses: np.ndarray,
                  maps: Sequence[str] = ()) -> dict[str, Path]:
    """Write mean and standard deviation, and maps of one number a pixel, whole or not at all.

    Parameters
    ----------
    blocks : iterable of (first row, last row, (mean (n, P), standard deviation (n, Q), maps
        (n, 1)))
    size : (height, width)
    folder : Path
    layout : PictureLayout
    progress : function of the share that is done
    responses : (J, K, 61) array
        Relative response of each band under each of the typical lights, kept with the mean.
    maps : sequence of str
        Names of the maps, each an EXR of one channel of that name, whatever the layout.

    Returns
    -------
    dict
        "mean", "standard_deviation" and the maps to their files.
    """
    paths = {name: folder / f"{name}{SUFFIXES[layout.form]}" for name in (MEAN, DEVIATION)}
    with files.writable(folder), contextlib.ExitStack() as stack:
        writers = [stack.enter_context(layer_rows(name, path, size, layout, responses))
                   for name, path in paths.items()]
        for name in maps:
            paths[name] = folder / f"{name}.exr"
            writers.append(stack.enter_context(exr_rows(paths[name], *size, [name],
                                                        not layout.full)))
        for first, last, parts in blocks:
            for write, part in zip(writers, parts, strict=True):
                write(first, part.reshape(last - first, size[1], -1))
            progress(last / size[0])
    return paths


@contextlib.contextmanager
def layer_rows(name: str, path: Path, size: tuple[int, int], layout: pixel_spectra.PictureLayout,
               responses: np.ndarray | None = None) -> Iterator[WriteRows]:
    """A function of (first row, pixels) that writes the next rows of the mean or of the standard
    deviation.

    Parameters
    ----------
    name : str
        "mean" or "standard_deviation".
    path : Path
    size : (height, width)
    layout : PictureLayout
    responses : (J, K, 61) array, optional
        As of ``write_spectra``; ENVI headers have no place for them.
    """
    nm, half = layout.nm[name == DEVIATION], not layout.full
    words = name.replace("_", " ") + (" of the" if name == DEVIATION else "")
    with contextlib.ExitStack() as stack:
        if layout.form == "envi":
            yield stack.enter_context(envi.envi_rows(path, *size, nm, QUANTITIES[name],
                                                f"{words} reflectance of every pixel; {OF_WIDTH}",
                                                float(pixel_spectra.GRID_STEP_NM)))
        elif layout.form == "zarr":
            yield stack.enter_context(zarr_array.zarr_rows(path, *size, nm, half,
                                                *zarr_facts(name, responses)))
        else:
            colours = "RGB" if name == MEAN else ""
            bands = {key: json.dumps(facts)
                     for key, facts in _response_facts(name, responses).items()}
            write = stack.enter_context(
                exr_rows(
                    path, *size, [*colours, *spectral_layers.layer_names(nm)], half,
                    spectral_layers.layout_attributes(
                        Quantity.REFLECTANCE if colours else spectral_layers.STANDARD_DEVIATION)
                    | bands, tiles=layout.form == "tiled-exr"))
            to_srgb = srgb_of_spectra(nm)
            yield (lambda first, mean: write(first, np.dstack([mean @ to_srgb, mean]))) \
                if colours else write


def zarr_facts(name: str, responses: np.ndarray | None) -> tuple[dict[str, Any], float]:
    """Attributes of a Zarr image of the mean or of the standard deviation, and its brightest."""
    return {spectral_layers.QUANTITY: QUANTITIES[name]} | _response_facts(
        name, responses), BRIGHTEST[name]


def _response_facts(name: str, responses: np.ndarray | None) -> dict[str, Any]:
    """What is kept of the bands' responses (J, K, 61), if the file is the mean."""
    if name != MEAN or responses is None:
        return {}
    relative = [[[float(f"{value:.6g}") for value in band] for band in light]
                for light in responses]
    return {RESPONSES: {"wavelengths_nm": PRIOR_GRID.nm.tolist(), "relative": relative}}


def srgb_of_spectra(nm: np.ndarray, light: str = DAYLIGHT) -> np.ndarray:
    """Matrix (P, 3) from reflectances to linear sRGB under a light, adapted to D65."""
    return (appearance.TO_SRGB @ appearance.adapted_tristimulus(nm, light)).T.astype(np.float32)
