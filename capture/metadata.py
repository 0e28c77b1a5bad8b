"""What a photo file says of its exposure and camera, as exact numbers (exifread).

Nominal exposure times are rounded by the cameras themselves (1/125 is 1/128); the ratio of two photos is exact only
where the exposure was left alone.
"""
from __future__ import annotations

import hashlib
import logging
import struct
from dataclasses import dataclass
from fractions import Fraction
from numbers import Rational
from pathlib import Path
from typing import Any

import exifread

from radiometry.errors import InputError

MAKE_TAGS = ("Image Make",)
MODEL_TAGS = ("Image Model",)
SERIAL_TAGS = ("EXIF BodySerialNumber", "Image Tag 0xC62F")  # 0xC62F: CameraSerialNumber of DNG files
EXPOSURE_TAGS = ("EXIF ExposureTime", "Image ExposureTime")
F_NUMBER_TAGS = ("EXIF FNumber", "Image FNumber")
ISO_TAGS = ("EXIF ISOSpeedRatings", "EXIF PhotographicSensitivity", "Image ISOSpeedRatings")
BLACK_TAG = "BlackLevel"  # tag 0xC61A of DNG files, in whichever directory holds the mosaic


@dataclass(frozen=True)
class PhotoMetadata:
    """What the file states; None and the empty string where it does not."""

    exposure_s: Fraction | None
    f_number: Fraction | None
    iso: float | None
    make: str
    model: str
    serial: str
    black_level: tuple[Fraction, ...] | None  # DN, as the DNG tag lists them

    @property
    def camera(self) -> str:
        """Make, model and serial number as far as known, in one line."""
        model = self.model if not self.make or self.model.startswith(self.make) else f"{self.make} {self.model}"
        return f"{model.strip()} {self.serial}".strip()


def photo_metadata(path: Path) -> PhotoMetadata:
    """Read the metadata of a raw, TIFF or JPEG file; every field is empty where the file has no EXIF.

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
    except (LookupError, ValueError, TypeError, OverflowError, struct.error) as error:  # as exifread meets damaged tags
        raise InputError(f"photo {path.name} has damaged metadata ({error}); "
                         "copy it from the camera card again") from error
    finally:
        logger.setLevel(level)
    black: Any = next((tag.values for name, tag in tags.items() if name.endswith(BLACK_TAG)), [])
    iso = _number(tags, ISO_TAGS)
    return PhotoMetadata(
        exposure_s=_number(tags, EXPOSURE_TAGS), f_number=_number(tags, F_NUMBER_TAGS),
        iso=None if iso is None else float(iso),
        make=_text(tags, MAKE_TAGS), model=_text(tags, MODEL_TAGS), serial=_text(tags, SERIAL_TAGS),
        black_level=tuple(_fractions(black)) or None)


def file_sha256(path: Path) -> str:
    """SHA-256 of the file's content, in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _text(tags: dict[str, Any], names: tuple[str, ...]) -> str:
    found = next((tags[name] for name in names if name in tags), None)
    return "" if found is None else str(found.printable).strip().strip("\0").strip()


def _number(tags: dict[str, Any], names: tuple[str, ...]) -> Fraction | None:
    """The first positive value; cameras write 0 or 0/0 for unknown."""
    values = [value for name in names if name in tags for value in _fractions(tags[name].values)[:1]]
    return next((value for value in values if value > 0), None)


def _fractions(values: Any) -> list[Fraction]:
    """The values of a tag, without any that is not a fraction (text, or a denominator of 0)."""
    return [Fraction(int(value.numerator), int(value.denominator)) for value in values
            if isinstance(value, Rational) and value.denominator != 0]
