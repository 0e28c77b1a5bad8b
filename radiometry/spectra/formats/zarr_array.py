"""Pictures as Zarr arrays (https://zarr-specs.readthedocs.io, version 3): a folder of chunks, of
which any part is read and written by itself.

Only what the specification's own codecs encode is read: others may run code.
"""
from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.radiometry.errors import EnvironmentProblem, InputError
from spectrabox.radiometry.files import whole_folder
from spectrabox.radiometry.outside.bands_of_rows import WriteRows, written_by_bands

SUFFIX, METADATA = ".zarr", "zarr.json"
CHUNK_PX = 128              # of one side; a chunk holds all bands
CHUNKS_A_SHARD = 32         # side by side in one file: thousands of files slow a disk down
CODECS = {"bytes", "blosc", "crc32c", "gzip", "sharding_indexed", "transpose", "zstd"}
AXES = ("y", "x", "wavelength")


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
    _require_plain(path)
    zarr = _library()
    try:
        array = zarr.open_array(str(path), mode="r")
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise _unreadable(path, error) from None
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
    zarr = _library()
    kind = np.dtype(np.float16 if half else np.float32)
    shape = (height, width, nm.size)
    with whole_folder(path) as unfinished:
        array = zarr.create_array(
            str(unfinished), shape=shape, dtype=kind, dimension_names=AXES,
            chunks=(CHUNK_PX, CHUNK_PX, nm.size),
            shards=(CHUNK_PX, CHUNK_PX * CHUNKS_A_SHARD, nm.size),
            # bytes of one place together: smaller by a fifth, and packed in half the time
            compressors=zarr.codecs.BloscCodec(cname="zstd", clevel=1, shuffle="shuffle"),
            attributes={"wavelengths_nm": nm.tolist(), **attributes})

        def write(first: int, band: np.ndarray) -> None:
            array[first:first + len(band)] = band

        with written_by_bands(write, shape, CHUNK_PX, kind) as take:
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
