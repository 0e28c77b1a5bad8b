"""What a photo file says of its exposure and camera, as exact numbers (exifread).

Nominal exposure times are rounded by the cameras themselves (1/125 is 1/128); the ratio of two
photos is exact only where the exposure was left alone.
"""
from __future__ import annotations

import logging
import re
import struct
from dataclasses import dataclass
from fractions import Fraction
from numbers import Rational
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import exifread

from spectrabox.radiometry.errors import InputError

MAKE_TAGS = ("Image Make",)
MODEL_TAGS = ("Image Model",)
# 0xC62F: CameraSerialNumber of DNG files
SERIAL_TAGS = ("EXIF BodySerialNumber", "Image Tag 0xC62F")
EXPOSURE_TAGS = ("EXIF ExposureTime", "Image ExposureTime")
F_NUMBER_TAGS = ("EXIF FNumber", "Image FNumber")
ISO_TAGS = ("EXIF ISOSpeedRatings", "EXIF PhotographicSensitivity", "Image ISOSpeedRatings")
TAKEN_TAGS = ("EXIF DateTimeOriginal", "Image DateTimeOriginal", "Image DateTime")
# Tags of DNG files, in whichever directory holds the mosaic: by number, of BlackLevel by name too,
# which other raws have
BLACK_TAG, BLACK, BLACK_REPEAT = "BlackLevel", 0xC61A, 0xC619
ACTIVE_AREA, MASKED_AREAS = 0xC68D, 0xC68E
BLACK_DELTAS = (0xC61B, 0xC61C)  # BlackLevelDeltaH, BlackLevelDeltaV
WHITE, SAMPLES_PER_PIXEL = 0xC61D, 277
OPCODE_LISTS = (0xC740, 0xC741, 0xC74E)     # OpcodeList1 to 3
# of the first directory: stops, and share of the range
BASELINE_EXPOSURE, LINEAR_LIMIT = 0xC62A, 0xC62E
DNG_VERSION_TAG = "Image Tag 0xC612"
# ColorMatrix1 and 2, each with its CalibrationIlluminant, of the first directory
MATRIX_TAGS = (("Image Tag 0xC621", "Image Tag 0xC65A"), ("Image Tag 0xC622", "Image Tag 0xC65B"))
DAYLIGHTS = (21, 22, 20, 23, 1, 9, 10, 11)      # as EXIF numbers lights: D65 and those next to it
EXIF_TIME = re.compile(r"([12]\d{3}):(\d\d):(\d\d) (\d\d:\d\d:\d\d)")
COMPRESSION, PHOTOMETRY = 259, 262      # tags of TIFF
# TIFF's types of numbers: letter of struct, and numbers a value
NUMBER_TYPES = {1: ("B", 1), 3: ("H", 1), 4: ("L", 1), 5: ("L", 2), 6: ("b", 1), 7: ("B", 1),
                8: ("h", 1), 9: ("l", 1), 10: ("l", 2), 16: ("Q", 1), 17: ("q", 1)}
RAW_PHOTOMETRY = (32803, 34892)  # colour filter array, full-colour pixels
LEVEL_TAGS = {BLACK, BLACK_REPEAT, WHITE}
RAW_TAGS = {COMPRESSION, PHOTOMETRY, ACTIVE_AREA, MASKED_AREAS, SAMPLES_PER_PIXEL, *LEVEL_TAGS,
            *BLACK_DELTAS}
EXPOSURE_OF_DNG = {BASELINE_EXPOSURE, LINEAR_LIMIT}
UNCOMPRESSED = 1
BIG_TIFF = 43
MAX_TAG_BYTES, MAX_OPCODE_BYTES = 1_000_000, 100_000_000
MAX_ENTRIES = 10_000        # of a directory
LOSSY_JPEG, JPEG_XL = 34892, 52546      # of DNG 1.4 and 1.7
_Tags = dict[int, list[Fraction]]


@dataclass(frozen=True)
class PhotoMetadata:
    """What the file states; None and the empty string where it does not."""

    exposure_s: Fraction | None
    f_number: Fraction | None
    iso: float | None
    make: str
    model: str
    serial: str
    black_level: tuple[Fraction, ...] | None        # DN, as the DNG tag lists them
    black_repeat: tuple[int, int] = (1, 1)          # rows, columns, from the first active pixel
    active_origin: tuple[int, int] = (0, 0)         # row, column of that pixel in the whole mosaic
    masked_areas: tuple[tuple[int, ...], ...] = ()  # top, left, bottom, right in the whole mosaic
    is_dng: bool = False
    black_columns: tuple[Fraction, ...] = ()        # DN, to add to black in each active column
    black_rows: tuple[Fraction, ...] = ()           # the same of each active row
    white_levels: tuple[Fraction, ...] = ()         # DN, of each sample of a pixel, or of all
    samples_per_pixel: int = 1                      # of a DNG
    is_linear_dng: bool = False                     # full-colour or monochrome pixels, no mosaic
    baseline_exposure: float = 0.0                  # stops, by which programs brighten a DNG
    linear_limit: float = 1.0                       # of the range up to which a DNG is linear
    opcode_lists: tuple[bytes, bytes, bytes] = (b"", b"", b"")  # of a DNG, as it holds them
    stated_bytes: tuple[int, int] | None = None     # of a plain mosaic: by its size, by its strips
    compression: int | None = None                  # TIFF's number for that of a DNG's pixels
    taken_at: str = ""                              # "2026-11-23 14:05:09", by the camera's clock
    daylight_matrix: tuple[Fraction, ...] = ()      # of a DNG: 9 numbers, from X, Y, Z to R, G, B

    @property
    def camera(self) -> str:
        """Make, model and serial number as far as known, in one line."""
        model = (self.model if not self.make or self.model.startswith(self.make)
                 else f"{self.make} {self.model}")
        return f"{model.strip()} {self.serial}".strip()


def photo_metadata(path: Path) -> PhotoMetadata:
    """Metadata of a raw, TIFF or JPEG file; every field is empty where the file has no EXIF.

    Parameters
    ----------
    path : Path

    Raises
    ------
    InputError
        If the metadata are damaged.
    """
    logger = logging.getLogger("exifread")
    level = logger.level
    logger.setLevel(logging.CRITICAL)  # it would report each unknown tag
    try:
        with path.open("rb") as file:
            tags = exifread.process_file(file, details=False)
            mosaic, opcodes = _raw_directory(file, _fractions(_values(tags, "Image SubIFDs"))) \
                if DNG_VERSION_TAG in tags else ({}, (b"", b"", b""))
            first = _tiff_header(file) if DNG_VERSION_TAG in tags else None
            exposure = {} if first is None else _numbers_of(file, *first, EXPOSURE_OF_DNG)
    # as exifread meets damaged tags
    except (LookupError, ValueError, TypeError, OverflowError, struct.error, EOFError) as error:
        raise InputError(f"photo {path.name} has damaged metadata ({error}); "
                         "copy it from the camera card again") from error
    finally:
        logger.setLevel(level)
    iso = _number(tags, ISO_TAGS)
    area, masked = (tuple(int(value) for value in mosaic.get(tag, []))
                    for tag in (ACTIVE_AREA, MASKED_AREAS))
    return PhotoMetadata(
        exposure_s=_number(tags, EXPOSURE_TAGS), f_number=_number(tags, F_NUMBER_TAGS),
        iso=None if iso is None else float(iso),
        make=_text(tags, MAKE_TAGS), model=_text(tags, MODEL_TAGS), serial=_text(tags, SERIAL_TAGS),
        black_level=tuple(mosaic.get(BLACK) or _fractions(_values(tags, BLACK_TAG))) or None,
        black_repeat=_sides(mosaic.get(BLACK_REPEAT, [])),
        active_origin=(area[0], area[1]) if len(area) == 4 else (0, 0),
        masked_areas=tuple(masked[index:index + 4] for index in range(0, len(masked) - 3, 4)),
        is_dng=DNG_VERSION_TAG in tags,
        black_columns=tuple(mosaic.get(BLACK_DELTAS[0], [])),
        black_rows=tuple(mosaic.get(BLACK_DELTAS[1], [])),
        white_levels=tuple(mosaic.get(WHITE, [])),
        samples_per_pixel=int(_first(mosaic, SAMPLES_PER_PIXEL, 1)),
        is_linear_dng=_first(mosaic, PHOTOMETRY, 0) == RAW_PHOTOMETRY[1],
        baseline_exposure=float(_first(exposure, BASELINE_EXPOSURE, 0)),
        linear_limit=float(_first(exposure, LINEAR_LIMIT, 1)), opcode_lists=opcodes,
        stated_bytes=_stated_bytes(tags),
        compression=int(mosaic[COMPRESSION][0]) if mosaic.get(COMPRESSION) else None,
        taken_at=_taken_at(_text(tags, TAKEN_TAGS)), daylight_matrix=_daylight_matrix(tags))


def _first(tags: _Tags, tag: int, default: int) -> Fraction:
    """First number of a tag."""
    return next(iter(tags.get(tag, [])), Fraction(default))


def _sides(numbers: list[Fraction]) -> tuple[int, int]:
    """Rows and columns of the tile that black levels repeat in."""
    whole = [int(number) for number in numbers]
    return (whole[0], whole[1]) if len(whole) == 2 and min(whole) > 0 else (1, 1)


def _taken_at(text: str) -> str:
    """The time of a tag as ISO 8601 writes its date; empty where the tag holds none."""
    stated = EXIF_TIME.match(text)
    return f"{stated[1]}-{stated[2]}-{stated[3]} {stated[4]}" if stated else ""


def _values(tags: dict[str, Any], ending: str) -> Any:
    return next((tag.values for name, tag in tags.items() if name.endswith(ending)), [])


def _stated_bytes(tags: dict[str, Any]) -> tuple[int, int] | None:
    """Bytes of an uncompressed mosaic in the first directory, from its size and from its strips."""
    names = ("PhotometricInterpretation", "Compression", "ImageWidth", "ImageLength",
             "BitsPerSample", "StripByteCounts")
    listed = [_fractions(tags[f"Image {name}"].values) if f"Image {name}" in tags else []
              for name in names]
    if not all(listed) or listed[0][0] not in RAW_PHOTOMETRY or listed[1][0] != UNCOMPRESSED:
        return None
    width, height = int(listed[2][0]), int(listed[3][0])
    return height * -(-width * int(sum(listed[4])) // 8), int(sum(listed[5]))


def stated_levels(path: Path) -> tuple[tuple[float, ...], tuple[int, int], tuple[float, ...]]:
    """The levels that a TIFF states for its values, in units of the file, in the tags of a DNG
    (Adobe DNG 1.4): multispectral cameras and scanners write them. None of them in other files.

    Parameters
    ----------
    path : Path

    Returns
    -------
    black : tuple of float
        Of the samples of each pixel of a tile; empty: not stated.
    repeat : (rows, columns)
        Of the tile, from the first pixel.
    white : tuple of float
        Of each sample of a pixel, or one for all; empty likewise.
    """
    with path.open("rb") as file:
        tiff = _tiff_header(file)
        tags = {} if tiff is None else _numbers_of(file, *tiff, LEVEL_TAGS)
    black, white = (tuple(map(float, tags.get(tag, []))) for tag in (BLACK, WHITE))
    return black, _sides(tags.get(BLACK_REPEAT, [])), white


class _Layout(NamedTuple):
    """How a TIFF writes numbers: byte order as ``struct`` names it, and whether it is a BigTIFF,
    whose counts and offsets have 8 bytes.
    """

    order: str
    big: bool

    @property
    def offset(self) -> str:
        return f"{self.order}{'Q' if self.big else 'L'}"


def _tiff_header(file: BinaryIO) -> tuple[_Layout, int] | None:
    """Layout, and offset of the first directory; None of what is no TIFF."""
    file.seek(0)
    start = file.read(16)
    order = {b"II": "<", b"MM": ">"}.get(start[:2])
    if order is None or len(start) < 8:
        return None
    layout = _Layout(order, struct.unpack(f"{order}H", start[2:4])[0] == BIG_TIFF)
    at = 8 if layout.big else 4
    if len(start) < at + struct.calcsize(layout.offset):
        return None
    return layout, struct.unpack_from(layout.offset, start, at)[0]


def _raw_directory(file: BinaryIO, directories_below: list[Fraction]
                   ) -> tuple[_Tags, tuple[bytes, bytes, bytes]]:
    """Numbers of the tags that say how the raw pixels of a DNG are stored, and its lists of
    opcodes, in the first directory or one below it (TIFF 6.0, p. 14); exifread reads none below.
    """
    tiff = _tiff_header(file)
    if tiff is None:
        return {}, (b"", b"", b"")
    for offset in (tiff[1], *map(int, directories_below)):
        tags = _numbers_of(file, tiff[0], offset, RAW_TAGS)
        if _first(tags, PHOTOMETRY, 0) in RAW_PHOTOMETRY:
            lists = _directory(file, tiff[0], offset, set(OPCODE_LISTS))
            first, second, third = (lists.get(tag, (0, b""))[1] for tag in OPCODE_LISTS)
            return tags, (first, second, third)
    return {}, (b"", b"", b"")


def _numbers_of(file: BinaryIO, layout: _Layout, offset: int, wanted: set[int]) -> _Tags:
    """Numbers of some tags in one directory."""
    tags = {}
    for tag, (kind, content) in _directory(file, layout, offset, wanted).items():
        letter, parts = NUMBER_TYPES[kind]
        count = len(content) // struct.calcsize(f"{layout.order}{letter}")
        numbers = struct.unpack(f"{layout.order}{count}{letter}", content)
        tags[tag] = [Fraction(value) / below for value, below in zip(
            numbers[::parts], numbers[1::parts] if parts == 2 else [1] * count, strict=True)
            if below]
    return tags


def _directory(file: BinaryIO, layout: _Layout, offset: int,
               wanted: set[int]) -> dict[int, tuple[int, bytes]]:
    """Type and content of some tags in one directory; none where the file is cut short, as LibRaw
    says.
    """
    counts, width = ("Q", 20) if layout.big else ("H", 12)
    file.seek(offset)
    start = file.read(struct.calcsize(f"{layout.order}{counts}"))
    if len(start) < struct.calcsize(f"{layout.order}{counts}"):
        return {}
    entries = file.read(width * min(struct.unpack(f"{layout.order}{counts}", start)[0],
                                    MAX_ENTRIES))
    held = struct.calcsize(layout.offset)
    tags = {}
    for tag, kind, count, inline in struct.iter_unpack(
            f"{layout.order}HH{layout.offset[1]}{held}s", entries[:len(entries) // width * width]):
        letter, parts = NUMBER_TYPES.get(kind, ("", 0)) if tag in wanted else ("", 0)
        if not letter:
            continue
        size = count * parts * struct.calcsize(f"{layout.order}{letter}")
        if size > (MAX_OPCODE_BYTES if tag in OPCODE_LISTS else MAX_TAG_BYTES):
            continue
        if size > held:
            file.seek(struct.unpack(layout.offset, inline)[0])
            inline = file.read(size)
        if len(inline) >= size:
            tags[tag] = kind, inline[:size]
    return tags


def _daylight_matrix(tags: dict[str, Any]) -> tuple[Fraction, ...]:
    """The colour matrix of a DNG whose light is nearest to D65; empty without one of daylight."""
    matrices = {int(light[0]): tuple(_fractions(tags[matrix].values))
                for matrix, of_light in MATRIX_TAGS if matrix in tags and of_light in tags
                if (light := _fractions(tags[of_light].values))}
    return next((matrices[light] for light in DAYLIGHTS if len(matrices.get(light, ())) == 9), ())


def _text(tags: dict[str, Any], names: tuple[str, ...]) -> str:
    tag = next((tags[name] for name in names if name in tags), None)
    return "" if tag is None else str(tag.printable).strip().strip("\0").strip()


def _number(tags: dict[str, Any], names: tuple[str, ...]) -> Fraction | None:
    """The first positive value; cameras write 0 or 0/0 for unknown."""
    values = [value for name in names if name in tags
              for value in _fractions(tags[name].values)[:1]]
    return next((value for value in values if value > 0), None)


def _fractions(values: Any) -> list[Fraction]:
    """The values of a tag, without any that is not a fraction (text, or a denominator of 0)."""
    return [Fraction(int(value.numerator), int(value.denominator)) for value in values
            if isinstance(value, Rational) and value.denominator != 0]
