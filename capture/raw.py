"""Camera raw files to the mosaic as the sensor gave it (LibRaw through rawpy).

Nothing is scaled, demosaiced or turned: LibRaw's own development rescales by the brightest pixel of each frame, clips
negative values and rotates, so none of it can be used to measure.
"""
from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path

import numpy as np
import rawpy

from capture.metadata import PhotoMetadata, file_sha256, photo_metadata
from radiometry.errors import InputError
from radiometry.records import RawFrame

COLOUR_INDEX = {"R": 0, "G": 1, "B": 2}
TROUBLE = ("unexpected end of file", "data corrupted", "corrupt")  # what LibRaw prints where it goes on regardless


def read_raw(path: str | os.PathLike[str]) -> RawFrame:
    """Decode the visible mosaic of a Bayer raw file, in sensor orientation.

    Raises
    ------
    InputError
        If the file is missing, empty, cut short or no camera raw, or if its sensor has no 2 x 2 Bayer pattern.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"photo {path} does not exist; check its name in session.toml")
    if path.stat().st_size == 0:
        raise InputError(f"raw photo {path.name} is empty (0 bytes); copy it from the camera card again")
    with _open(path) as raw:
        _require_bayer(raw, path)
        visible = np.ascontiguousarray(raw.raw_image_visible).copy()
        metadata = photo_metadata(path)
        cfa, black_level = _tile(raw, metadata)
        exposure_s = metadata.exposure_s or raw.other.shutter_speed
        iso, f_number = metadata.iso or raw.other.iso_speed, metadata.f_number or raw.other.aperture
        white_level = float(raw.white_level)
    if not white_level > black_level.max():
        raise InputError(f"raw photo {path.name} states a white level of {white_level:g} DN, not above its black level "
                         f"of {black_level.max():g} DN; convert it with the camera maker's software or Adobe DNG")
    visible.flags.writeable = False
    return RawFrame(mosaic=visible, cfa=cfa, black_level=black_level, white_level=white_level,
                    exposure_s=_known(exposure_s), iso=_known(iso), f_number=_known(f_number),
                    camera=metadata.camera, file=path.name, sha256=file_sha256(path))


@contextmanager
def _open(path: Path) -> Iterator[rawpy.RawPy]:
    """The unpacked file, every complaint of LibRaw turned into an InputError."""
    try:
        with _captured_stderr() as complaints:
            raw = rawpy.imread(os.fspath(path))
            raw.unpack()
    except rawpy.LibRawFileUnsupportedError as error:
        raise InputError(f"photo {path.name} is no camera raw that LibRaw {_libraw_version()} knows; "
                         "give a raw file, a DNG, or a linear EXR or TIFF") from error
    except (rawpy.LibRawError, rawpy.NotSupportedError) as error:
        raise InputError(f"raw photo {path.name} cannot be read to its end ({_sentence(error)}); "
                         "it is cut short or damaged: copy it from the camera card again") from error
    with raw:
        if any(word in line.lower() for line in complaints for word in TROUBLE):
            raise InputError(f"raw photo {path.name} holds fewer pixels than it promises ({complaints[0]}); "
                             "it is cut short or damaged: copy it from the camera card again")
        yield raw


@contextmanager
def _captured_stderr() -> Iterator[list[str]]:
    """LibRaw prints straight to file descriptor 2; the lines appear in the list when the block ends."""
    lines: list[str] = []
    kept = os.dup(2)
    with tempfile.TemporaryFile() as sink:
        os.dup2(sink.fileno(), 2)
        try:
            yield lines
        finally:
            os.dup2(kept, 2)
            os.close(kept)
            sink.seek(0)
            lines += sink.read().decode(errors="replace").splitlines()


def _require_bayer(raw: rawpy.RawPy, path: Path) -> None:
    colours = raw.color_desc.decode(errors="replace")
    try:
        tile = raw.raw_pattern if raw.raw_type == rawpy.RawType.Flat else None
    except NotImplementedError as error:  # a filter code that rawpy does not know
        raise InputError(f"raw photo {path.name} has an unknown colour filter pattern ({error}); a 2 x 2 Bayer pattern "
                         "is needed: develop it elsewhere to a linear EXR or TIFF and give that") from error
    if tile is not None and tile.shape == (2, 2) and raw.num_colors == 3 and set(colours[:3]) == set("RGB"):
        return
    if raw.raw_type != rawpy.RawType.Flat:
        found = "full-colour pixels (Foveon, linear DNG or a reduced raw size)"
    elif tile is None or raw.num_colors == 1:
        found = "no colour filter pattern (a monochrome sensor)"
    else:
        found = f"a {tile.shape[0]} x {tile.shape[1]} pattern of {raw.num_colors} colours ({colours})"
    raise InputError(f"raw photo {path.name} has {found}; a 2 x 2 Bayer pattern of red, green and blue is needed: "
                     "develop it elsewhere to a linear EXR or TIFF and give that")


def _tile(raw: rawpy.RawPy, metadata: PhotoMetadata) -> tuple[np.ndarray, np.ndarray]:
    """Colour and black level (2, 2) of the tile that starts at the first visible pixel.

    LibRaw lists black levels by colour (R, G1, B, G2) and drops their fractions. The DNG tag lists them by position;
    it is taken where it agrees with LibRaw up to the fraction.
    """
    sizes = raw.sizes
    colour = np.array([[raw.raw_color(sizes.top_margin + y, sizes.left_margin + x) for x in (0, 1)] for y in (0, 1)])
    letters = raw.color_desc.decode()
    cfa = np.vectorize(lambda index: COLOUR_INDEX[letters[index]])(colour)
    black_level = np.asarray(raw.black_level_per_channel, dtype=float)[colour]
    stated = metadata.black_level
    if stated is not None and len(stated) in (1, 4):
        by_position = np.broadcast_to(np.array([float(level) for level in stated]), 4).reshape(2, 2)
        if np.all(np.abs(by_position - black_level) < 1):
            black_level = by_position
    return cfa, black_level


def _known(value: float | Fraction | None) -> float | None:
    """LibRaw gives 0 for what the file does not say."""
    return float(value) if value else None


def _sentence(error: Exception) -> str:
    first = error.args[0] if error.args else ""
    return first.decode(errors="replace") if isinstance(first, bytes) else str(first)


def _libraw_version() -> str:
    return ".".join(map(str, rawpy.libraw_version))
