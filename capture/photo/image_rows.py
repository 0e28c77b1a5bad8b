"""Pictures too large to hold: linear EXR and TIFF read, EXR and PNG written, some rows at a time.
"""
from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio

from spectrabox.capture.photo.image_files import (
    NO_DATE,
    SATURATED,
    VARIANCE,
    band_order,
    channel_names,
    full_scale,
    is_image_file,
    require_finite,
)
from spectrabox.capture.photo.linear import open_photo
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.files import whole_file
from spectrabox.radiometry.outside.words import reason_of

ROWS_PER_BLOCK = 16     # of a compressed EXR; fewer rows at a time unpack it again and again
PNG_LEVEL = 2           # of 9: larger by a tenth than at 6, and three times as fast
WriteRows = Callable[[int, np.ndarray], None]   # first row, pixels (n, W, C)


@dataclass(frozen=True)
class PictureRows:
    """A linear picture, read a few rows at a time as often as needed."""

    height: int
    width: int
    bands: int
    read: Callable[[int, int], np.ndarray]      # (first, last) -> (last - first, W, K) float32


def open_rows(path: Path) -> PictureRows:
    """Linear signal of a linear EXR or TIFF from its file as it is asked for, of a raw from memory.

    Values and order of bands are those of `linear.open_photo`.

    Parameters
    ----------
    path : Path

    Raises
    ------
    InputError
        As `linear.open_photo`; of values that are NaN only once their rows are read.
    """
    if not path.is_file() or not is_image_file(path):
        return _held(path)
    as_stored = oiio.ImageSpec()
    # else a TIFF's bands come multiplied by its alpha
    as_stored.attribute("oiio:UnassociatedAlpha", 1)
    file = oiio.ImageInput.open(os.fspath(path), as_stored)
    if file is None or file.spec().tile_width:
        return _held(path)
    spec = file.spec()
    full_scale(path, spec, file.format_name())
    names = channel_names(path, spec)
    bands = [index for index in band_order(names)
             if not names[index].startswith((VARIANCE, SATURATED))]
    if len(bands) < 3:
        raise InputError(f"photo {path.name} has {len(bands)} band(s) ({', '.join(names)}); at "
                         "least 3 are needed")

    def read(first: int, last: int) -> np.ndarray:
        # As floats, integers come as fractions of their full scale.
        stored = file.read_scanlines(first + spec.y, last + spec.y, 0, 0, spec.nchannels, "float")
        if stored is None or file.has_error:
            raise InputError(f"photo {path.name} cannot be read to its end "
                             f"({reason_of(file)}); copy or export it again")
        signal = np.asarray(stored).reshape(last - first, spec.width, -1)[..., bands]
        require_finite(path, signal)
        return signal

    return PictureRows(spec.height, spec.width, len(bands), read)


def _held(path: Path) -> PictureRows:
    signal = open_photo(path).signal
    height, width, bands = signal.shape
    return PictureRows(height, width, bands, lambda first, last: signal[first:last])


@contextlib.contextmanager
def exr_rows(path: Path, height: int, width: int, channel_names: Sequence[str],
             half: bool, attributes: Mapping[str, str] | None = None) -> Iterator[WriteRows]:
    """A function that writes the next rows of an EXR, which is there once all of them are written.

    Parameters
    ----------
    path : Path
    height, width : int
    channel_names : sequence of str
    half : bool
        Half floats, 16 bits; else single floats, 32 bits.
    attributes : dict, optional
        Words of its header.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    spec = oiio.ImageSpec(width, height, len(channel_names), oiio.HALF if half else oiio.FLOAT)
    spec.channelnames = tuple(channel_names)
    spec.attribute("compression", "zip")
    spec.attribute("DateTime", NO_DATE)     # else the time of writing
    for name, words in (attributes or {}).items():
        spec.attribute(name, words)
    with _rows_of(path, spec, np.float32) as write:
        yield write


@contextlib.contextmanager
def png_rows(path: Path, height: int, width: int, channels: int) -> Iterator[WriteRows]:
    """The same for a PNG of 8 bits, of 1 channel (grey) or 3, already encoded for the screen.

    Parameters
    ----------
    path : Path
    height, width, channels : int

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    spec = oiio.ImageSpec(width, height, channels, oiio.UINT8)
    spec.attribute("png:compressionLevel", PNG_LEVEL)
    with _rows_of(path, spec, np.uint8) as write:
        yield write


@contextlib.contextmanager
def _rows_of(path: Path, spec: oiio.ImageSpec, kind: type) -> Iterator[WriteRows]:
    with whole_file(path) as unfinished:
        file = oiio.ImageOutput.create(os.fspath(unfinished))
        if file is None or not file.open(os.fspath(unfinished), spec):
            raise _unwritten(path, oiio if file is None else file)

        def write(first: int, pixels: np.ndarray) -> None:
            rows: np.ndarray = np.ascontiguousarray(pixels, dtype=kind)
            if not file.write_scanlines(first, first + len(rows), 0, rows):
                raise _unwritten(path, file)

        try:
            yield write
            if not file.close():
                raise _unwritten(path, file)
        finally:
            file.close()


def _unwritten(path: Path, writer: Any) -> InputError:
    return InputError(f"{path} cannot be written ({reason_of(writer)}); is the disk full?")
