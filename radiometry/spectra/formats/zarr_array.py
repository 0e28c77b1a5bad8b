"""Pictures as Zarr arrays (https://zarr-specs.readthedocs.io, version 3): a folder of chunks, of
which any part is read and written by itself.

Only what the specification's own codecs encode is read: others may run code.
"""
from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.radiometry.errors import EnvironmentProblem, InputError
from spectrabox.radiometry.files import sync, whole_folder
from spectrabox.radiometry.system.strips import WriteRows, written_by_strips

SUFFIX, METADATA = ".zarr", "zarr.json"
CHUNK_PX = 128              # of one side; a chunk holds all bands
CHUNKS_A_SHARD = 32         # side by side in one file: thousands of files slow a disk down
CODECS = {"bytes", "blosc", "crc32c", "gzip", "sharding_indexed", "transpose", "zstd"}
AXES = ("y", "x", "wavelength")
WAVELENGTHS = "wavelengths_nm"
COEFFICIENTS = "coefficients"
MAX_TABLE = 1_000_000       # values of a small table


@dataclass(frozen=True)
class ZarrPicture:
    """An array of a picture, open for reading."""

    shape: tuple[int, int, int]                 # (H, W, C)
    chunk_rows: int
    dtype: np.dtype[Any]
    read: Callable[[int, int], np.ndarray]      # (first, last) -> (last - first, W, C)


def open_zarr(path: Path) -> ZarrPicture:
    """A picture (H, W, C) of numbers.

    Parameters
    ----------
    path : Path
        Folder of one array.

    Raises
    ------
    InputError
        If it is none, or encoded in a way that is not read.
    EnvironmentProblem
        If Zarr is not installed.
    """
    array = _opened(path)
    if array.ndim != 3 or array.dtype.kind not in "fu" or 0 in array.shape:
        raise InputError(f"{path.name} is an array of shape {array.shape} and type {array.dtype}; "
                         "needed are rows, columns and bands of floats or unsigned integers")

    def read(first: int, last: int) -> np.ndarray:
        try:
            return np.asarray(array[first:last])
        except (OSError, ValueError, RuntimeError) as error:
            raise _unreadable(path, error) from None

    return ZarrPicture(array.shape, (array.shards or array.chunks)[0], array.dtype, read)


@contextlib.contextmanager
def zarr_rows(path: Path, height: int, width: int, nm: np.ndarray, half: bool,
              attributes: Mapping[str, str]) -> Iterator[WriteRows]:
    """A function of (first row, pixels (n, W, P)) that writes the next rows of an array, which is
    there once all of them are written.

    Parameters
    ----------
    path : Path
    height, width : int
    nm : (P,) array
    half : bool
        Half floats, 16 bits; else single floats, 32 bits.
    attributes : dict
        Words kept with the array, beside its wavelengths.

    Raises
    ------
    EnvironmentProblem
        If it cannot be written, or Zarr is not installed.
    """
    shape = height, width, nm.size
    _library()
    with whole_folder(path) as unfinished:
        create_picture(unfinished, shape, half, {WAVELENGTHS: nm.tolist(), **attributes})
        with _rows_of(unfinished, shape) as take:
            yield take


@contextlib.contextmanager
def low_rank_rows(path: Path, height: int, width: int, half: bool,
                  tables: Mapping[str, np.ndarray], about: Mapping[str, Any]
                  ) -> Iterator[WriteRows]:
    """The same for a group of ``coefficients`` (H, W, N) and small tables beside them.

    Parameters
    ----------
    path : Path
    height, width : int
    half : bool
        Of the coefficients.
    tables : dict
        Name to array (1 + N, P) of a basis.
    about : dict
        Attributes of the group, JSON.

    Raises
    ------
    EnvironmentProblem
        If it cannot be written, or Zarr is not installed.
    """
    shape = height, width, len(next(iter(tables.values()))) - 1
    _library()
    with whole_folder(path) as unfinished:
        create_low_rank(unfinished, shape, half, tables, about)
        with _rows_of(unfinished / COEFFICIENTS, shape) as take:
            yield take


def create_picture(folder: Path, shape: tuple[int, int, int], half: bool,
                   attributes: Mapping[str, Any], axes: tuple[str, str, str] = AXES) -> None:
    """An array (H, W, C) of half or single floats that holds zeros until it is written to.

    Raises
    ------
    EnvironmentProblem
        If Zarr is not installed.
    """
    zarr = _library()
    zarr.create_array(
        str(folder), shape=shape, dtype=np.float16 if half else np.float32, dimension_names=axes,
        chunks=(CHUNK_PX, CHUNK_PX, shape[2]),
        shards=(CHUNK_PX, CHUNK_PX * CHUNKS_A_SHARD, shape[2]),
        # bytes of equal significance together: smaller by a fifth, and packed in half the time
        compressors=zarr.codecs.BloscCodec(cname="zstd", clevel=1, shuffle="shuffle"),
        attributes=dict(attributes))


def create_low_rank(folder: Path, shape: tuple[int, int, int], half: bool,
                    tables: Mapping[str, np.ndarray], about: Mapping[str, Any]) -> None:
    """A group of ``coefficients``, as ``create_picture`` makes them, and of small tables."""
    zarr = _library()
    zarr.create_group(str(folder), attributes=dict(about))
    create_picture(folder / COEFFICIENTS, shape, half, {}, ("y", "x", "component"))
    for name, values in tables.items():
        zarr.create_array(str(folder / name), data=values,
                          dimension_names=("row", f"{name}_wavelength"))


@dataclass(frozen=True)
class Region:
    """An array that several processes write to, each into whole shards."""

    write: Callable[[int, int, np.ndarray], None]       # first row, first column, (n, m, C)
    sync: Callable[[int, int], None]                    # first and last row: onto the disk


def open_region(folder: Path) -> Region:
    """An array of ``create_picture``, open for writing."""
    array = _library().open_array(str(folder), mode="r+")
    rows = array.shards[0]

    def write(row: int, column: int, pixels: np.ndarray) -> None:
        array[row:row + len(pixels), column:column + pixels.shape[1]] = pixels

    def synced(first: int, last: int) -> None:
        for row in range(first // rows, -(-last // rows)):
            for path in (folder / "c" / str(row)).rglob("*"):   # the names of the specification
                if path.is_file():
                    sync(path)

    return Region(write, synced)


def read_group(path: Path, tables: Sequence[str]) -> tuple[dict[str, Any], list[np.ndarray]]:
    """Attributes of a group, and some of its arrays whole.

    Parameters
    ----------
    path : Path
    tables : sequence of str
        Names of small arrays (n, P).

    Raises
    ------
    InputError
        If it is no group of version 3, or an array is missing, damaged or large.
    """
    try:
        about = json.loads((path / METADATA).read_text(encoding="utf-8"))
        if about["node_type"] != "group" or about["zarr_format"] != 3:
            raise InputError(f"{path.name} is no Zarr group of version 3; name the folder that "
                             "was written")
        arrays = [_opened(path / name) for name in tables]
        if any(array.ndim != 2 or array.size > MAX_TABLE for array in arrays):
            raise InputError(f"{path.name} holds no small tables under {', '.join(tables)}")
        return dict(about["attributes"]), [np.asarray(array[...]) for array in arrays]
    except FileNotFoundError:
        raise InputError(f"{path} holds no {METADATA}: it is no Zarr group of version 3; name the "
                         "folder that was written") from None
    except (OSError, ValueError, KeyError, TypeError, RecursionError, RuntimeError) as error:
        raise _unreadable(path, error) from None


def _opened(path: Path) -> Any:
    _require_plain(path)
    try:
        return _library().open_array(str(path), mode="r")
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise _unreadable(path, error) from None


@contextlib.contextmanager
def _rows_of(folder: Path, shape: tuple[int, int, int]) -> Iterator[WriteRows]:
    array = _library().open_array(str(folder), mode="r+")

    def write(first: int, band: np.ndarray) -> None:
        array[first:first + len(band)] = band

    with written_by_strips(write, shape, CHUNK_PX, array.dtype) as take:
        yield take


def _library() -> Any:
    try:
        import zarr
        import zarr.codecs
    except ImportError:
        raise EnvironmentProblem("Zarr is not installed: pip install 'spectrabox[zarr]', or use "
                                 "an EXR") from None
    return zarr


def _require_plain(path: Path) -> None:
    """Refuse what is no array of version 3, and codecs beyond those of the specification."""
    try:
        about = json.loads((path / METADATA).read_text(encoding="utf-8"))
        if about["node_type"] != "array" or about["zarr_format"] != 3:
            raise InputError(f"{path.name} holds a {about['node_type']}, not one array; name the "
                             "folder of the array itself")
        names = set(_codecs(about["codecs"]))
    except FileNotFoundError:
        raise InputError(f"{path} holds no {METADATA}: it is no Zarr array of version 3; save it "
                         "as one, or as EXR") from None
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise _unreadable(path, error) from None
    if names - CODECS:
        raise InputError(f"{path.name} is encoded by {', '.join(sorted(names - CODECS))}, which is "
                         f"not read; save it with {', '.join(sorted(CODECS))}")


def _codecs(listed: list[dict[str, Any]]) -> Iterator[str]:
    for codec in listed:
        yield str(codec["name"])
        inside = codec.get("configuration", {})
        for name in ("codecs", "index_codecs"):
            yield from _codecs(inside.get(name, []))


def _unreadable(path: Path, error: Exception) -> InputError:
    return InputError(f"{path.name} cannot be read as a Zarr array ({error}); copy or save it "
                      "again")
