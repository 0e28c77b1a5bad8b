"""EXR, TIFF, PNG and JPEG as they are stored: header and values (OpenImageIO).

Camera raws do not pass here: this library opens a DNG as a grey TIFF.
"""
from __future__ import annotations

import os
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from spectrabox.capture.photo import metadata, processed_photos
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.files import require_utf8_name
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.records.photos import PhotoKind
from spectrabox.radiometry.system import archives, words

EXR_START = b"\x76\x2f\x31\x01"
PICTURE_STARTS = (EXR_START, b"\x89PNG", b"\xff\xd8\xff")  # not of TIFF, which may begin a raw
TIFF_STARTS = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
IMAGE_SUFFIXES = (".exr", ".tif", ".tiff", ".png", ".jpg", ".jpeg")
LINEAR_FORMATS = ("openexr", "tiff")
FULL_SCALE = {"uint8": 255, "uint16": 65535}  # of integer files
FLOATS = ("half", "float", "double")          # hold the signal itself
MAX_PICTURES = 20       # of one file, that are counted
NOT_BANDS = ("A", "ALPHA", "Z", "DEPTH")
VARIANCE, SATURATED = "variance.", "saturated."  # channels of a developed photo, of each band
# memory that decoding takes, besides a value in the type of its file, by what is made of it
LINEAR_BYTES, ENCODED_BYTES = 8, 16
MAX_SIGNAL = 1e9                    # its square is a variance, which single precision must hold


@dataclass(frozen=True)
class PictureHeader:
    """What a picture states of itself.

    Parameters
    ----------
    path : Path
    spec : oiio.ImageSpec
    file_format : str
        As OpenImageIO names it.
    further : tuple of (width, height)
        Of further pictures in the file, which are not read.
    """

    path: Path
    spec: oiio.ImageSpec
    file_format: str
    further: tuple[tuple[int, int], ...] = ()

    @property
    def kind(self) -> str:
        """Type of its values."""
        return str(self.spec.format)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the photo; of a developed one, whose pixels are tiles of colour
        filters, in pixels of the sensor.
        """
        step = self.spec.get_float_attribute("spectrabox:sensor_step", 1.0)
        return round(self.spec.width * step), round(self.spec.height * step)

    @property
    def orientation(self) -> int:
        """1 to 8 as EXIF numbers them; 1 where none is stated."""
        stated = self.spec.get_int_attribute("Orientation", 1)
        return stated if 1 <= stated <= 8 else 1

    @property
    def photo_kind(self) -> PhotoKind:
        """Where its pixels come from, as a developed photo states it."""
        return PhotoKind.__members__.get(self.words("spectrabox:kind"), PhotoKind.LINEAR_FILE)

    @property
    def camera(self) -> str:
        """Maker and model."""
        return f"{self.words('Make')} {self.words('Model')}".strip()

    @cached_property
    def names(self) -> list[str]:
        """Of all channels; an InputError if they are no text."""
        try:
            return list(self.spec.channelnames)
        except UnicodeDecodeError:
            raise InputError(f"photo {self.path.name} has channels whose names are no text; export "
                             "it again") from None

    @property
    def bands(self) -> list[int]:
        """Indices of the channels to use, R, G and B first; alpha and depth are left out, and what
        a developed photo states of its bands.
        """
        short = [name.split(".")[-1].upper() for name in self.names]
        bands = [index for index, name in enumerate(self.names)
                 if short[index] not in NOT_BANDS and not name.startswith((VARIANCE, SATURATED))]
        own = [short[index] for index in bands]
        if not {"R", "G", "B"} <= set(own):
            return bands
        named = [bands[own.index(name)] for name in "RGB"]
        return named + [index for index in bands if index not in named]

    def words(self, name: str) -> str:
        """A text of the header, empty where there is none."""
        try:
            text: str = self.spec.get_string_attribute(name)
        except UnicodeDecodeError:      # a name of a camera in another alphabet decides nothing
            return ""
        return text

    def positive(self, name: str) -> float | None:
        """A number of the header; None where there is none above 0."""
        value = self.spec.get_float_attribute(name, 0.0)
        return value if value > 0 else None

    @cached_property
    def levels(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Black level (a, b, K) of a tile of pixels from the first one, and white level (K,), in
        units of the file, that a TIFF states of the bands to use; None where it states none, or
        those of its format.

        Raises
        ------
        InputError
            If they contradict each other.
        """
        if self.file_format != "tiff":
            return None
        channels, bands = self.spec.nchannels, self.bands
        stated_black, repeat, stated_white = metadata.stated_levels(self.path)
        rows, columns = repeat if stated_black else (1, 1)
        black, white = np.array(stated_black or (0.0,)), np.array(stated_white or (
            float(self.full_scale()),))
        if black.size not in (rows * columns, rows * columns * channels) \
                or white.size not in (1, channels):
            raise InputError(f"photo {self.path.name} states {black.size} black levels for a tile "
                             f"of {rows} x {columns} pixels and {white.size} white levels, and has "
                             f"{channels} samples a pixel; export it again")
        black = np.broadcast_to(black.reshape(rows, columns, -1),
                                (rows, columns, channels))[..., bands]
        white = np.broadcast_to(white, channels)[bands].astype(float)
        if not black.any() and np.all(white == self.full_scale()):
            return None
        if np.any(white <= black):
            raise InputError(f"photo {self.path.name} states a white level of {white.min():g}, not "
                             f"above its black level of {black.max():g}; export it again")
        return black, white

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What its tags state of its values, which is applied, and pictures that are not read."""
        findings = []
        if self.levels is not None:
            black, white = self.levels
            findings.append(Finding("file.levels", Severity.INFO, values={
                "black": [float(level) for level in black.mean(axis=(0, 1))],
                "white": [float(level) for level in white]}))
        if self.further:
            width, height = max(self.further, key=lambda size: size[0] * size[1])
            own = self.spec.width, self.spec.height
            findings.append(Finding(
                "file.further-pictures", Severity.WARN if width * height > own[0] * own[1]
                else Severity.NOTE, values={"count": len(self.further), "width": own[0],
                                            "height": own[1], "largest_width": width,
                                            "largest_height": height}))
        return tuple(findings)

    def full_scale(self) -> int:
        """What white of the format reads in a file of linear values: 1 for floats.

        Raises
        ------
        NotLinearError
            If the values are not proportional to light.
        InputError
            If nobody states their full scale.
        """
        kind, tiff = self.kind, self.file_format == "tiff"
        encoded = kind in FULL_SCALE and "srgb" in self.words("oiio:ColorSpace").lower()
        if self.file_format not in LINEAR_FORMATS or kind == "uint8" or encoded:
            what = f"a {self.file_format.upper()}"
            if tiff and kind == "uint8":
                what = "an 8-bit TIFF"
            if tiff and encoded:
                what += " tagged sRGB"
            raise processed_photos.processed_error(self.path.name, what, decoded=True)
        if kind not in (*FULL_SCALE, *FLOATS):
            raise InputError(f"photo {self.path.name} holds {kind} values, whose full scale nobody "
                             "states; export it as a linear EXR or a 16-bit TIFF")
        return FULL_SCALE.get(kind, 1)


def apply_levels(values: np.ndarray, black: np.ndarray, white: np.ndarray, first_row: int = 0,
                 scale: float = 1.0) -> None:
    """Bring values to signal, 0 at black and 1 at white, in place.

    Parameters
    ----------
    values : (h, W, K) float array
    black, white : (a, b, K) and (K,) arrays
        As of ``PictureHeader.levels``.
    first_row : int
        Of the picture, that they begin with.
    scale : float
        The file's value of 1 of theirs.
    """
    rows, columns, _ = black.shape
    for y, x in np.ndindex(rows, columns):
        lowest = black[y, x] / scale
        part = values[(y - first_row) % rows::rows, x::columns]
        part -= lowest.astype(values.dtype)
        part /= (white / scale - lowest).astype(values.dtype)


def is_image_file(path: Path) -> bool:
    """Whether a file is for this module: by its suffix, else by what it begins with.

    Parameters
    ----------
    path : Path
    """
    if path.suffix.lower() in IMAGE_SUFFIXES:
        return True
    if not path.is_file():
        return False
    return _first_bytes(path).startswith(PICTURE_STARTS)


def _first_bytes(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(8)


def stored_values(path: Path, working_bytes: float) -> tuple[np.ndarray, PictureHeader]:
    """All channels (H, W, C) of a picture in the type and order of its file.

    Parameters
    ----------
    path : Path
    working_bytes : float
        That the caller takes for each value besides.

    Raises
    ------
    InputError
        If it is missing, damaged, or takes more memory to decode than is the limit.
    """
    file = _opened(path)
    spec = file.spec()
    require_decodable(path, spec, spec.height, working_bytes)
    # in the type of the file: asking for floats would scale integers
    values = file.read_image("unknown")
    failed, trouble = file.has_error, words.reason_of(file)
    further: list[tuple[int, int]] = []
    while len(further) < MAX_PICTURES and file.seek_subimage(len(further) + 1, 0):
        other = file.spec()
        further.append((other.width, other.height))
    file.close()
    if values is None or failed:
        raise InputError(f"photo {path.name} cannot be read to its end ({trouble}); copy or "
                         "export it again")
    return values, PictureHeader(path, spec, file.format_name(), tuple(further))


def require_decodable(path: Path, spec: oiio.ImageSpec, rows: int, working_bytes: float) -> None:
    """Refuse, by its header, a picture that takes too much memory to decode.

    Parameters
    ----------
    path : Path
    spec : oiio.ImageSpec
    rows : int
        That are decoded at once.
    working_bytes : float
        For each value besides.

    Raises
    ------
    InputError
    """
    if spec.deep or spec.depth > 1:
        raise InputError(f"photo {path.name} is a deep picture or a volume, of several samples a "
                         "pixel; export it as a flat one")
    archives.require_room(path.name, spec.width, rows, spec.nchannels,
                          spec.pixel_bytes(True) / max(spec.nchannels, 1) + working_bytes)


def read_header(path: Path) -> PictureHeader:
    """What a picture states of itself; nothing but its header is read.

    Parameters
    ----------
    path : Path

    Raises
    ------
    InputError
        If it is missing or no picture.
    """
    file = _opened(path)
    return PictureHeader(path, file.spec(), file.format_name())


def stated_bands(path: Path) -> tuple[str, ...]:
    """Names of an EXR's bands, capitals, in the order in which they are read; none of other files.

    Parameters
    ----------
    path : Path

    Raises
    ------
    InputError
        If it is damaged.
    """
    if not path.is_file() or not _first_bytes(path).startswith(EXR_START):
        return ()
    header = read_header(path)
    return tuple(header.names[index].split(".")[-1].upper() for index in header.bands)


def _opened(path: Path) -> oiio.ImageInput:
    if not path.is_file():
        raise InputError(f"photo {path} does not exist; correct its name")
    file = open_as_stored(path)
    if file is None:
        raise InputError(f"photo {path.name} is no readable image ({words.reason_of(oiio)}); "
                         "give a camera raw, or a linear EXR or TIFF")
    return file


def open_as_stored(path: Path) -> oiio.ImageInput | None:
    """A picture's open file; None where it is no EXR, TIFF, PNG or JPEG, or is damaged.

    Parameters
    ----------
    path : Path
    """
    require_utf8_name(path)
    # OpenImageIO would try all its formats, some of which read gigabytes to their end
    if not _first_bytes(path).startswith((*PICTURE_STARTS, *TIFF_STARTS)):
        return None
    as_stored = oiio.ImageSpec()
    # else a TIFF's bands come multiplied by its alpha
    as_stored.attribute("oiio:UnassociatedAlpha", 1)
    return oiio.ImageInput.open(os.fspath(path), as_stored)


def require_finite(name: str, signal: np.ndarray) -> None:
    """Raise where a signal (H, W, K) holds values that are no numbers, or too large to square.

    Parameters
    ----------
    name : str
        Of the photo, for the message.
    signal : (H, W, K) array

    Raises
    ------
    InputError
    """
    bad = np.count_nonzero(~np.isfinite(signal))
    if bad:
        raise InputError(f"photo {name} has {bad} of {signal.size} values that are NaN or "
                         "infinite; export it again without them, nothing is guessed in their "
                         "place")
    largest = float(np.abs(signal).max(initial=0))
    if largest > MAX_SIGNAL:
        raise InputError(f"photo {name} holds values up to {largest:.2g}, beyond "
                         f"{MAX_SIGNAL:.0e}; scale it so that white is near 1")
