"""Pictures too large to hold: linear EXR, TIFF and Zarr read, EXR and PNG written, some rows at a
time.

Of tiles and chunks a band is held: as many rows as one is high.
"""
from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio

from spectrabox.capture.photo import image_files, image_writers, linear, stored_images
from spectrabox.radiometry import appearance, errors, files
from spectrabox.radiometry.spectra.formats.zarr_array import open_zarr
from spectrabox.radiometry.system import strips
from spectrabox.radiometry.system.words import reason_of

ROWS_PER_BLOCK = 16     # of a compressed EXR; fewer rows at a time unpack it again and again
PNG_LEVEL = 2           # of 9: larger by a tenth than at 6, and three times as fast
TILE_PX = 64            # of one side, of an EXR that is written in tiles


def open_rows(path: Path) -> tuple[tuple[int, int, int], strips.ReadRows]:
    """Linear signal of a linear EXR, TIFF or Zarr array from its file as it is asked for, of a raw
    from memory.

    Values and order of bands are those of `linear.open_photo`; bands of a Zarr array are in its own
    order, its integers fractions of their full scale.

    Parameters
    ----------
    path : Path

    Returns
    -------
    (H, W, K)
    function of (first, last)
        Reads rows (last - first, W, K) float32, as often as needed.

    Raises
    ------
    InputError
        As `linear.open_photo`; of values that are NaN only once their rows are read.
    """
    if path.is_dir():
        return _zarr_rows(path)
    if not path.is_file() or not stored_images.is_image_file(path):
        return rows_of_array(linear.open_photo(path).signal)
    file = stored_images.open_as_stored(path)
    if file is None:
        return rows_of_array(linear.open_photo(path).signal)
    spec = file.spec()
    header = stored_images.PictureHeader(path, spec, file.format_name())
    header.full_scale()
    bands = header.bands
    if len(bands) < 3:
        raise errors.InputError(f"photo {path.name} has {len(bands)} band(s) "
                                f"({', '.join(header.names)}); at least 3 are needed")
    stored_images.require_decodable(path, spec, _rows_at_once(file), stored_images.LINEAR_BYTES)
    return (spec.height, spec.width, len(bands)), _reader(path, file, bands, header)


def _rows_at_once(file: Any) -> int:
    """Rows of a tile, or of what a file without tiles unpacks together."""
    spec = file.spec()
    if file.format_name() not in stored_images.LINEAR_FORMATS:    # such as a PNG that is interlaced
        return int(spec.height)
    strip = spec.get_int_attribute("tiff:RowsPerStrip", ROWS_PER_BLOCK)
    return min(max(spec.tile_height, strip, ROWS_PER_BLOCK), spec.height)


def open_encoded(path: Path) -> tuple[tuple[int, int, int], strips.ReadRows]:
    """What the CIE 1931 observer sees of a picture in sRGB under D65, relative to white, as
    ``open_rows`` gives it.

    Parameters
    ----------
    path : Path
        PNG, JPEG or TIFF.

    Raises
    ------
    InputError
        As `image_files.read_encoded_values`.
    """
    signal = appearance.signal_of_srgb(image_files.read_encoded_values(path)).astype(np.float32)
    return rows_of_array(signal)


def _reader(path: Path, file: Any, bands: Sequence[int],
            header: stored_images.PictureHeader) -> strips.ReadRows:
    """A function of (first, last) that reads some channels of rows."""
    spec = file.spec()

    def read(first: int, last: int) -> np.ndarray:
        # As floats, integers come as fractions of their full scale.
        stored = (file.read_tiles(spec.x, spec.x + spec.width, first + spec.y, last + spec.y,
                                  spec.z, spec.z + 1, 0, spec.nchannels, "float")
                  if spec.tile_width else
                  file.read_scanlines(first + spec.y, last + spec.y, 0, 0, spec.nchannels, "float"))
        if stored is None or file.has_error:
            raise errors.InputError(f"photo {path.name} cannot be read to its end "
                                    f"({reason_of(file)}); copy or export it again")
        signal = np.asarray(stored).reshape(last - first, spec.width, -1)[..., bands]
        stored_images.require_finite(path.name, signal)
        if header.levels is not None:
            signal = np.ascontiguousarray(signal)
            stored_images.apply_levels(signal, *header.levels, first, header.full_scale())
        return signal

    return strips.read_by_strips(read, spec.height, spec.tile_height) if spec.tile_width else read


def open_channels(path: str | os.PathLike[str]) -> tuple[list[str], int, int,
                                                         Callable[[int, int], np.ndarray]]:
    """Channel names of a picture, its height and width, and a function that reads rows.

    The function takes the first and the last row (exclusive) and gives (rows, W, C).

    Parameters
    ----------
    path : path

    Raises
    ------
    InputError
        If the file is missing or damaged.
    """
    path = Path(path)
    file = stored_images.open_as_stored(path) if path.is_file() else None
    if file is None:
        raise errors.InputError(
            f"picture {path} is missing or no readable image ({reason_of(oiio)}); " "give an EXR")
    spec = file.spec()
    stored_images.require_decodable(path, spec, _rows_at_once(file), stored_images.LINEAR_BYTES)

    def rows(first: int, last: int) -> np.ndarray:
        top = spec.y
        read = file.read_scanlines(first + top, last + top, 0, 0, spec.nchannels, "float")
        if read is None or file.has_error:
            raise errors.InputError(f"picture {path.name} cannot be read ({reason_of(file)}); save "
                                    "it as scan lines")
        return np.asarray(read).reshape(last - first, spec.width, spec.nchannels)

    names = stored_images.PictureHeader(path, spec, file.format_name()).names
    return names, spec.height, spec.width, rows


def _zarr_rows(path: Path) -> tuple[tuple[int, int, int], strips.ReadRows]:
    (height, width, bands), chunk_rows, dtype, read_rows = open_zarr(path)
    if bands < 3:
        raise errors.InputError(f"{path.name} has {bands} band(s); at least 3 are needed")
    full = np.iinfo(dtype).max if dtype.kind == "u" else 1

    def read(first: int, last: int) -> np.ndarray:
        signal = read_rows(first, last).astype(np.float32)
        if full != 1:
            signal /= np.float32(full)
        stored_images.require_finite(path.name, signal)
        return signal

    return (height, width, bands), strips.read_by_strips(read, height, chunk_rows)


def rows_of_array(signal: np.ndarray) -> tuple[tuple[int, int, int], strips.ReadRows]:
    """A picture (H, W, K) in memory as ``open_rows`` gives one."""
    height, width, bands = signal.shape
    return (height, width, bands), lambda first, last: signal[first:last]


@contextlib.contextmanager
def exr_rows(path: Path, height: int, width: int, channel_names: Sequence[str],
             half: bool, attributes: Mapping[str, str] | None = None, *,
             tiles: bool = False) -> Iterator[strips.WriteRows]:
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
    tiles : bool
        In tiles of ``TILE_PX``, of which programs read what they show; else in scan lines.

    Raises
    ------
    EnvironmentProblem
        If the file cannot be written.
    """
    spec = image_writers.exr_spec(height, width, channel_names, oiio.HALF if half else oiio.FLOAT,
                                  attributes)
    if not tiles:
        with _rows_of(path, spec, np.float32) as write:
            yield write
        return
    spec.tile_width = spec.tile_height = TILE_PX
    kind = np.dtype(np.float16 if half else np.float32)
    with _rows_of(path, spec, kind) as write, \
            strips.written_by_strips(write, (height, width, spec.nchannels), TILE_PX, kind) as take:
        yield take


@contextlib.contextmanager
def png_rows(path: Path, height: int, width: int, channels: int) -> Iterator[strips.WriteRows]:
    """The same for a PNG of 8 bits, of 1 channel (grey) or 3, already encoded for the screen.

    Parameters
    ----------
    path : Path
    height, width, channels : int

    Raises
    ------
    EnvironmentProblem
        If the file cannot be written.
    """
    spec = oiio.ImageSpec(width, height, channels, oiio.UINT8)
    spec.attribute("png:compressionLevel", PNG_LEVEL)
    with _rows_of(path, spec, np.uint8) as write:
        yield write


@contextlib.contextmanager
def _rows_of(path: Path, spec: oiio.ImageSpec, kind: Any) -> Iterator[strips.WriteRows]:
    files.require_utf8_name(path)
    with files.whole_file(path) as unfinished:
        file = oiio.ImageOutput.create(os.fspath(unfinished))
        if file is None or not file.open(os.fspath(unfinished), spec):
            raise image_writers.unwritten(path, oiio if file is None else file)

        def write(first: int, pixels: np.ndarray) -> None:
            rows: np.ndarray = np.ascontiguousarray(pixels, dtype=kind)
            last = first + len(rows)
            if not (file.write_tiles(0, spec.width, first, last, 0, 1, rows) if spec.tile_width
                    else file.write_scanlines(first, last, 0, rows)):
                raise image_writers.unwritten(path, file)

        try:
            yield write
            if not (file.close() and image_writers.ends_whole(unfinished)):
                raise image_writers.unwritten(path, file)
        finally:
            file.close()
