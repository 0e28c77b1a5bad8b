"""Camera raw files to the mosaic as the sensor gave it (LibRaw through rawpy).

Nothing is scaled, demosaiced or turned: LibRaw's own development rescales by the brightest pixel of
each frame, clips negative values and rotates, so none of it can be used to measure.
"""
from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import rawpy

from spectrabox.capture.photo.black_level import departures, full_colour_black, tile_of
from spectrabox.capture.photo.metadata import JPEG_XL, LOSSY_JPEG, PhotoMetadata, photo_metadata
from spectrabox.capture.photo.opcodes import stated_corrections
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.files import require_utf8_name, sha256_of
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.records.photos import RawFrame
from spectrabox.radiometry.system.archives import require_room

LIBRAW_VERSION = ".".join(map(str, rawpy.libraw_version))
# orientation as EXIF numbers it, by the bits of LibRaw's flip: 1 left and right exchanged, 2 top
# and bottom, 4 first rows and columns
ORIENTATIONS = (1, 2, 4, 3, 5, 8, 6, 7)
RAW_BYTES, FULL_COLOUR_BYTES = 20, 16     # that decoding takes for each sample, at its worst
MAX_BLACK_SPREAD = 0.02     # of the white level: in cameras positions differ by less than 0.1 %
# What LibRaw prints where it goes on regardless.
TROUBLE = ("unexpected end of file", "data corrupted", "corrupt")


def read_raw(path: str | os.PathLike[str]) -> RawFrame:
    """The visible mosaic of a Bayer, X-Trans or monochrome raw file, in sensor orientation.

    Parameters
    ----------
    path : path

    Raises
    ------
    InputError
        If the file is missing, empty, cut short, contradicts itself or is no camera raw, or if it
        holds full-colour pixels or another colour filter pattern.
    """
    frame, *further = decode(path)
    if further:
        raise InputError(f"raw photo {frame.file} holds full-colour pixels (a linear DNG) and no "
                         "mosaic; give the camera's own raw file")
    return frame


def decode(path: str | os.PathLike[str]) -> tuple[RawFrame, ...]:
    """As ``read_raw``, a frame; of a linear DNG three, one for each colour: it holds every colour
    at every pixel, as a converter or a phone wrote them.

    Parameters
    ----------
    path : path

    Raises
    ------
    InputError
    """
    path = Path(path)
    _require_file(path)
    if path.stat().st_size == 0:
        raise InputError(f"raw photo {path.name} is empty (0 bytes); copy it from the camera card "
                         "again")
    metadata = photo_metadata(path)
    _require_consistent(metadata, path)
    _require_known_compression(metadata, path)
    with _open(path) as raw:
        _require_known_sensor(raw, metadata, path)
        exposure: dict[str, Any] = {
            # LibRaw gives 0 for what the file does not state
            "exposure_s": float(metadata.exposure_s or raw.other.shutter_speed) or None,
            "iso": float(metadata.iso or raw.other.iso_speed) or None,
            "f_number": float(metadata.f_number or raw.other.aperture) or None,
            "camera": metadata.camera, "file": path.name, "sha256": sha256_of(path),
            "taken_at": metadata.taken_at, **_colour_matrix(raw, metadata)}
        full_colour = raw.raw_type == rawpy.RawType.Stack
        white_level = _white_levels(raw, metadata) if full_colour else \
            np.array([float(raw.white_level)])
        departing = departures(raw, metadata, path.name)
        if full_colour:
            black_level = full_colour_black(raw, metadata)
        else:
            cfa, black_level = tile_of(raw, metadata, departing)
            _require_plausible_tile(cfa, black_level, white_level[0], path)
        if not np.all(white_level > black_level.max()):
            raise InputError(f"raw photo {path.name} states a white level of "
                             f"{white_level.min():g} DN, not above its black level of "
                             f"{black_level.max():g} DN; convert it with the camera maker's "
                             "software or Adobe DNG")
        stated = _stated(raw, metadata, departing, not full_colour, path.name)
        if full_colour:
            require_room(path.name, raw.sizes.raw_width, raw.sizes.raw_height, 3,
                         FULL_COLOUR_BYTES)
            planes = [raw.raw_image_visible[..., band].copy() for band in range(3)]
            tiles = [(np.array([[band]]), black_level[band].reshape(1, 1)) for band in range(3)]
        else:
            visible = np.ascontiguousarray(raw.raw_image_visible)
            planes = [visible.copy() if np.shares_memory(visible, raw.raw_image) else visible]
            tiles = [(cfa, black_level)]
    for plane in planes:
        plane.flags.writeable = False   # the record then keeps it without a copy
    return tuple(RawFrame(mosaic=plane, cfa=cfa, black_level=black, white_level=float(white),
                          **exposure, **stated)
                 for plane, (cfa, black), white in zip(planes, tiles, white_level, strict=True))


def _white_levels(raw: rawpy.RawPy, metadata: PhotoMetadata) -> np.ndarray:
    """White level (3,) of full-colour pixels, DN: that of each plane where the file states them."""
    stated = np.array([float(level) for level in metadata.white_levels[:3]])
    return stated if stated.size == 3 else np.full(3, float(raw.white_level))


def _stated(raw: rawpy.RawPy, metadata: PhotoMetadata,
            departing: tuple[np.ndarray, np.ndarray] | None, mosaic: bool,
            name: str) -> dict[str, Any]:
    """What a DNG states of corrections: those to apply, and findings of these and of the others."""
    sizes = raw.sizes
    maps, findings = stated_corrections(metadata.opcode_lists, (sizes.height, sizes.width), mosaic,
                                        name)
    limit = metadata.linear_limit if 0 < metadata.linear_limit < 1 else 1.0
    stated: dict[str, Any] = {"gain_maps": maps, "linear_limit": limit}
    if departing is not None:
        rows, columns = departing
        stated |= {"black_rows": rows[sizes.top_margin:sizes.top_margin + sizes.height],
                   "black_columns": columns[sizes.left_margin:sizes.left_margin + sizes.width]}
        findings += (Finding("file.black-delta", Severity.INFO),)
    if metadata.baseline_exposure:
        findings += (Finding("file.baseline-exposure", Severity.NOTE, values={
            "stops": metadata.baseline_exposure}),)
    if limit < 1:
        findings += (Finding("file.linear-limit", Severity.INFO, values={"limit": limit}),)
    return {**stated, "findings": findings}


def visible_size(path: str | os.PathLike[str]) -> tuple[int, int]:
    """Width and height in pixels of what ``decode`` gives of a raw file, from its header alone.

    Parameters
    ----------
    path : path

    Raises
    ------
    InputError
        If it is no camera raw.
    """
    with _open(Path(path), unpack=False) as raw:
        return raw.sizes.width, raw.sizes.height


def raw_orientation(path: str | os.PathLike[str]) -> int:
    """Orientation of a raw file, 1 to 8 as EXIF numbers them, from its header alone.

    LibRaw knows it of every format; EXIF readers do not.

    Parameters
    ----------
    path : path

    Raises
    ------
    InputError
        If it is no camera raw.
    """
    with _open(Path(path), unpack=False) as raw:
        return ORIENTATIONS[raw.sizes.flip & 7]


def _require_file(path: Path) -> None:
    if not path.is_file():
        raise InputError(f"photo {path} does not exist; correct its name")


@contextmanager
def _open(path: Path, unpack: bool = True) -> Iterator[rawpy.RawPy]:
    """The file, unpacked, every complaint of LibRaw turned into an InputError."""
    require_utf8_name(path)
    _require_file(path)
    try:
        with _captured_stderr() as complaints:
            raw = rawpy.imread(os.fspath(path))
            if unpack:
                require_room(path.name, raw.sizes.raw_width, raw.sizes.raw_height, 1, RAW_BYTES)
                raw.unpack()
    except rawpy.LibRawFileUnsupportedError as error:
        raise InputError(f"photo {path.name} is no camera raw that LibRaw {LIBRAW_VERSION} knows; "
                         "give a raw file, a DNG, or a linear EXR or TIFF") from error
    except (rawpy.LibRawError, rawpy.NotSupportedError) as error:
        reason = error.args[0] if error.args else ""
        reason = reason.decode(errors="replace") if isinstance(reason, bytes) else reason
        raise InputError(f"raw photo {path.name} cannot be read to its end ({reason}); it is cut "
                         "short or damaged: copy it from the camera card again") from error
    with raw:
        if any(word in line.lower() for line in complaints for word in TROUBLE):
            raise InputError(f"raw photo {path.name} holds fewer pixels than it promises "
                             f"({complaints[0]}); it is cut short or damaged: copy it from the "
                             "camera card again")
        yield raw


@contextmanager
def _captured_stderr() -> Iterator[list[str]]:
    """LibRaw prints straight to file descriptor 2; the lines appear in the list when the block
    ends.
    """
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


def _require_consistent(metadata: PhotoMetadata, path: Path) -> None:
    """Refuse an uncompressed mosaic whose stated size is not that of its strips: LibRaw would shear
    the picture.
    """
    if metadata.stated_bytes is not None and metadata.stated_bytes[0] != metadata.stated_bytes[1]:
        raise InputError(f"raw photo {path.name} states a size of {metadata.stated_bytes[0]} bytes "
                         f"and holds {metadata.stated_bytes[1]}; it is damaged: copy it from the "
                         "camera card again")


def _require_known_compression(metadata: PhotoMetadata, path: Path) -> None:
    """Refuse, by its name, a compression that is not read, or not as the sensor's signal."""
    if metadata.is_dng and metadata.compression == LOSSY_JPEG:
        raise InputError(f"raw photo {path.name} is a DNG with lossy compression (JPEG): its "
                         "values passed a tone curve and are rounded to 8 bits; give the camera's "
                         "own raw file, or convert that without lossy compression")
    if metadata.is_dng and metadata.compression == JPEG_XL:
        raise InputError(f"raw photo {path.name} is a DNG compressed as JPEG XL, which LibRaw "
                         f"{LIBRAW_VERSION} does not read; choose lossless JPEG in the camera "
                         "(iPhone: Settings > Camera > Formats > Pro Default > JPEG Lossless), or "
                         "convert it with Adobe DNG Converter for an older version of DNG")


def _require_known_sensor(raw: rawpy.RawPy, metadata: PhotoMetadata, path: Path) -> None:
    colours = raw.color_desc.decode(errors="replace")
    try:
        tile = raw.raw_pattern if raw.raw_type == rawpy.RawType.Flat else None
    except NotImplementedError as error:  # a filter code that rawpy does not know
        raise InputError(f"raw photo {path.name} has an unknown colour filter pattern ({error}); "
                         "Bayer, X-Trans and monochrome are known: develop it elsewhere to a "
                         "linear EXR or TIFF and give that") from error
    if raw.raw_type == rawpy.RawType.Flat:
        if raw.num_colors == 1:
            return
        if raw.num_colors == 3 and set(colours[:3]) == set(
                "RGB") and tile is not None and tile.shape in ((2, 2), (6, 6)):
            return
        pixels = "no colour filter pattern" if tile is None else \
            f"a {tile.shape[0]} x {tile.shape[1]} pattern of {raw.num_colors} colours ({colours})"
    elif metadata.is_dng and raw.num_colors == 3:
        return
    elif metadata.is_dng and metadata.is_linear_dng:
        raise InputError(f"raw photo {path.name} is a linear DNG of {metadata.samples_per_pixel} "
                         "planes, samples a pixel; those of 3 are known, red, green and blue: "
                         "write these three alone, as a linear DNG, EXR or 16-bit TIFF, and any "
                         "further plane, infrared say, as a file of its own")
    else:
        pixels = "full-colour pixels (Foveon, or a reduced raw size)"
    raise InputError(f"raw photo {path.name} has {pixels}; Bayer, X-Trans and monochrome sensors "
                     "and linear DNG are known: develop it elsewhere to a linear EXR or TIFF and "
                     "give that")


def _require_plausible_tile(cfa: np.ndarray, black_level: np.ndarray, white_level: float,
                            path: Path) -> None:
    """Refuse what only damage makes: a colour too often or too rarely, black levels far apart."""
    counts = np.bincount(cfa.ravel(), minlength=3) / cfa.size
    bayer, x_trans = (0.25, 0.5, 0.25), (8 / 36, 20 / 36, 8 / 36)
    if cfa.max() > 0 and not any(np.allclose(counts, known) for known in (bayer, x_trans)):
        raise InputError(f"raw photo {path.name} states the colour filters {cfa.tolist()} (0 red, "
                         "1 green, 2 blue), neither Bayer nor X-Trans; it is damaged: copy it from "
                         "the camera card again")
    if np.ptp(black_level) > MAX_BLACK_SPREAD * white_level:
        raise InputError(f"raw photo {path.name} states black levels from {black_level.min():g} to "
                         f"{black_level.max():g} DN, too far apart for one sensor; it is damaged: "
                         "copy it from the camera card again")


def _colour_matrix(raw: rawpy.RawPy, metadata: PhotoMetadata) -> dict[str, Any]:
    """The matrix (3, 3) from X, Y, Z to R, G, B in daylight, of any scale: that by which LibRaw
    knows the camera, else the one that a DNG states.
    """
    matrix = np.array(raw.rgb_xyz_matrix, dtype=float)[:3]
    if raw.num_colors != 3:
        return {}
    if matrix.any():
        return {"camera_from_xyz": matrix}
    stated = np.array([float(number) for number in metadata.daylight_matrix])
    if stated.size != 9 or np.linalg.matrix_rank(stated.reshape(3, 3)) < 3:
        return {}
    return {"camera_from_xyz": stated.reshape(3, 3), "matrix_of_file": True}
