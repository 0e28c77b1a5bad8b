"""Pictures as Zarr arrays (https://zarr-specs.readthedocs.io, version 3): a folder of chunks, of
which any part is read and written by itself.

Pictures of spectra are OME-Zarr images (https://ngff.openmicroscopy.org/0.5): a group whose array
``0`` has the axes c, y, x, channels named by their wavelengths. Only what the specification's own
codecs encode is read: others may run code.
"""
from __future__ import annotations

import contextlib
import json
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.radiometry import appearance, files
from spectrabox.radiometry.errors import EnvironmentProblem, InputError
from spectrabox.radiometry.spectra.spectral_layers import QUANTITY
from spectrabox.radiometry.system.strips import WriteRows, written_by_strips

SUFFIX, METADATA = ".zarr", "zarr.json"
CHUNK_PX = 128              # of one side; a chunk holds all bands
CHUNKS_A_SHARD = 32         # side by side in one file: thousands of files slow a disk down
CODECS = {"bytes", "blosc", "crc32c", "gzip", "sharding_indexed", "transpose", "zstd"}
LEVEL = "0"                 # name of the array of an OME-Zarr image: its only resolution
AXES = ("c", "y", "x")      # their order in OME-Zarr
SHOWN_NM = (610.0, 550.0, 450.0)    # what a viewer shows first, as red, green and blue
WAVELENGTHS = "wavelengths_nm"
PLAIN_NAME = re.compile(r"\w[\w.-]*")     # of an array: no way out of the folder


def open_zarr(path: Path) -> tuple[tuple[int, int, int], int, np.dtype[Any],
                                   Callable[[int, int], np.ndarray]]:
    """A picture of numbers, open for reading.

    Parameters
    ----------
    path : Path
        Folder of one array (y, x, bands), or of an OME-Zarr image (c, y, x).

    Returns
    -------
    shape : (H, W, C)
    chunk_rows : int
    dtype : numpy.dtype
    read : function of (first, last)
        Rows (last - first, W, C).

    Raises
    ------
    InputError
        If it is none, or encoded in a way that is not read.
    EnvironmentProblem
        If Zarr is not installed.
    """
    level, axes = _ome_level(path)
    array = _opened(level)
    bands_first = (axes or _axes_of(array))[:1] == AXES[:1]
    if array.ndim != 3 or array.dtype.kind not in "fu" or 0 in array.shape \
            or axes not in (None, AXES):
        order = f" with the axes {', '.join(axes)}" if axes else ""
        raise InputError(f"{path.name} is an array of shape {array.shape} and type {array.dtype}"
                         f"{order}; "
                         "needed are rows, columns and bands of floats or unsigned integers")

    def read(first: int, last: int) -> np.ndarray:
        try:
            return np.moveaxis(np.asarray(array[:, first:last]), 0, 2) if bands_first \
                else np.asarray(array[first:last])
        except (OSError, ValueError, RuntimeError) as error:
            raise _unreadable(path, error) from None

    height, width, bands = np.roll(array.shape, -1 if bands_first else 0).tolist()
    return ((height, width, bands), (array.shards or array.chunks)[int(bands_first)],
            array.dtype, read)


@contextlib.contextmanager
def zarr_rows(path: Path, height: int, width: int, nm: np.ndarray, half: bool,
              attributes: Mapping[str, Any], white: float = 1.0) -> Iterator[WriteRows]:
    """A function of (first row, pixels (n, W, P)) that writes the next rows of an OME-Zarr image,
    which is there once all of them are written.

    Parameters
    ----------
    path : Path
    height, width : int
    nm : (P,) array
    half : bool
        Half floats, 16 bits; else single floats, 32 bits.
    attributes : dict
        JSON kept with the image, beside its wavelengths.
    white : float
        What viewers show as the brightest.

    Raises
    ------
    EnvironmentProblem
        If it cannot be written, or Zarr is not installed.
    """
    _library()
    with files.whole_folder(path) as unfinished:
        create_picture(unfinished, height, width, nm, half, attributes, white)
        with _rows_of(unfinished, (height, width, nm.size)) as take:
            yield take


def create_picture(folder: Path, height: int, width: int, nm: np.ndarray, half: bool,
                   attributes: Mapping[str, Any], white: float = 1.0) -> None:
    """An OME-Zarr image that holds zeros until it is written to; parameters as of ``zarr_rows``.

    Raises
    ------
    EnvironmentProblem
        If Zarr is not installed.
    """
    zarr = _library()
    zarr.create_group(str(folder), attributes={
        "ome": _ome_metadata(str(attributes.get(QUANTITY, "picture")), nm, white),
        WAVELENGTHS: nm.tolist(), **attributes})
    chunks = (nm.size, CHUNK_PX, CHUNK_PX)
    zarr.create_array(
        str(folder / LEVEL), shape=(nm.size, height, width),
        dtype=np.float16 if half else np.float32, dimension_names=AXES, chunks=chunks,
        shards=(nm.size, CHUNK_PX, CHUNKS_A_SHARD * CHUNK_PX),
        # bytes of equal significance together: smaller by a fifth, and packed in half the time
        compressors=zarr.codecs.BloscCodec(cname="zstd", clevel=1, shuffle="shuffle"))


def _ome_metadata(name: str, nm: np.ndarray, white: float) -> dict[str, Any]:
    """What OME-Zarr 0.5 states of an image, with a channel for each wavelength in its own hue."""
    hues = np.clip((appearance.TO_SRGB @ appearance.adapted_tristimulus(nm, "D65")).T, 0, None)
    hues = np.rint(255 * hues / np.maximum(hues.max(axis=1, keepdims=True), 1e-9)).astype(int)
    shown = {int(np.argmin(np.abs(nm - wavelength))) for wavelength in SHOWN_NM}
    return {
        "version": "0.5",
        "multiscales": [{
            "name": name,
            "axes": [{"name": "c", "type": "channel"}, {"name": "y", "type": "space"},
                     {"name": "x", "type": "space"}],
            "datasets": [{"path": LEVEL, "coordinateTransformations": [
                {"type": "scale", "scale": [1.0, 1.0, 1.0]}]}]}],
        "omero": {"channels": [
            {"label": f"{wavelength:g} nm", "color": "".join(f"{part:02X}" for part in hue),
             "active": index in shown,
             "window": {"min": 0.0, "start": 0.0, "end": white, "max": white}}
            for index, (wavelength, hue) in enumerate(zip(nm, hues, strict=True))]}}


def _ome_level(path: Path) -> tuple[Path, tuple[str, ...] | None]:
    """The array of highest resolution of an OME-Zarr image with its axes; another folder itself,
    and no axes."""
    try:
        about = json.loads((path / METADATA).read_text(encoding="utf-8"))
        image = about["attributes"]["ome"]["multiscales"][0]
        level = str(image["datasets"][0]["path"])
        axes = tuple(str(axis["name"]) for axis in image["axes"])
    except (OSError, ValueError, KeyError, TypeError, IndexError, RecursionError):
        return path, None
    if not PLAIN_NAME.fullmatch(level):
        raise InputError(f"{path.name} names its array {level!r}, which is no folder in it; copy "
                         "or save it again")
    return path / level, axes


def _axes_of(array: Any) -> tuple[str, ...]:
    return tuple(array.metadata.dimension_names or ())


def _opened(path: Path) -> Any:
    _require_plain(path)
    try:
        return _library().open_array(str(path), mode="r")
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise _unreadable(path, error) from None


@contextlib.contextmanager
def _rows_of(folder: Path, shape: tuple[int, int, int]) -> Iterator[WriteRows]:
    """A function that writes the next rows of the array of an image that was created."""
    array = _library().open_array(str(folder / LEVEL), mode="r+")

    def write(first: int, strip: np.ndarray) -> None:
        array[:, first:first + len(strip)] = np.moveaxis(strip, 2, 0)

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
