"""Photos for the page: a picture for the eye, parts of it, and signals under the pointer."""
from __future__ import annotations

import tempfile
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from spectrabox.capture.develop.developed import open_any
from spectrabox.capture.photo.image_writers import write_jpeg, write_png
from spectrabox.capture.photo.linear import signal_alone, tile_step
from spectrabox.capture.photo.orientation import AS_READ, turned, turned_array
from spectrabox.capture.photo.preview import signal_rgb8, whites
from spectrabox.capture.photo.raw import decode
from spectrabox.capture.photo.stored_images import is_image_file
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records.photos import LinearImage, RawFrame

MAX_OPEN = 3            # photos kept decoded
MAX_SIDE = 1600         # px, of the picture that is shown whole
MAX_CROP = 800          # px, of a part
FileKey = tuple[Path, int, int, int]    # with its orientation, time and length
Kept = TypeVar("Kept")


@dataclass(frozen=True)
class PhotoFile:
    """A photo's file, and how it is turned."""

    path: Path
    orientation: int = AS_READ      # as EXIF numbers it


@dataclass(frozen=True)
class OpenPhoto:
    """A photo's signal, without what takes longer: its noise and where it is clipped."""

    signal: np.ndarray      # (H, W, K) linear
    step: float             # pixels of the sensor a side of one of these
    white: tuple[float, ...]    # what is shown as full brightness of each band

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels of the sensor."""
        height, width = self.signal.shape[:2]
        return round(width * self.step), round(height * self.step)

    def cell(self, x: float, y: float) -> tuple[int, int] | None:
        """Row and column of a pixel of the sensor; None outside the photo."""
        row, column = int((y + 0.5) / self.step), int((x + 0.5) / self.step)
        height, width = self.signal.shape[:2]
        inside = 0 <= row < height and 0 <= column < width and x > -0.5 and y > -0.5
        return (row, column) if inside else None


class PhotoViews:
    """Photos that are shown, each decoded once while its file is unchanged."""

    def __init__(self) -> None:
        self._photos: dict[FileKey, OpenPhoto] = {}
        self._clipped: dict[FileKey, np.ndarray] = {}
        self._lock = threading.Lock()

    def photo(self, file: PhotoFile) -> OpenPhoto:
        """The photo of a file.

        Raises
        ------
        InputError
            If it cannot be read.
        """
        key = _key(file)
        with self._lock:        # of two that ask for one photo the second waits for it
            return _kept(self._photos, key, lambda: _opened(file))

    def clipped(self, file: PhotoFile) -> np.ndarray:
        """Which bands (H, W, K) of a photo are clipped; worked out when it is first asked for.

        Raises
        ------
        InputError
            If it cannot be read.
        """
        key = _key(file)
        with self._lock:
            return _kept(self._clipped, key, lambda: turned_array(
                open_any(file.path, not_linear=True).saturated, file.orientation))

    def keep(self, file: PhotoFile, image: LinearImage) -> None:
        """Take a photo that has been developed elsewhere in place of decoding it again.

        Parameters
        ----------
        file : PhotoFile
        image : LinearImage
            Of this file alone, turned, without dark frame or flat field.
        """
        key = _key(file)
        with self._lock:
            _kept(self._photos, key, lambda: OpenPhoto(image.signal, image.sensor_step,
                                                       whites(image.signal)))
            _kept(self._clipped, key, lambda: image.saturated)

    def whole(self, file: PhotoFile) -> bytes:
        """JPEG of the photo, at most ``MAX_SIDE`` pixels a side."""
        photo = self.photo(file)
        factor = max(1, int(np.ceil(max(photo.signal.shape[:2]) / MAX_SIDE)))
        return encoded(signal_rgb8(photo.signal, factor, photo.white), write_jpeg, ".jpg")

    def part(self, file: PhotoFile, left: float, top: float, side: float) -> bytes:
        """PNG of a square of the photo, its pixels as they are.

        Parameters
        ----------
        left, top, side : float
            In pixels of the sensor; what lies outside the photo is black.
        """
        photo = self.photo(file)
        first_row, first_column = round(top / photo.step), round(left / photo.step)
        count = min(max(round(side / photo.step), 1), MAX_CROP)
        cut = np.zeros((count, count, 3), np.uint8)
        height, width = photo.signal.shape[:2]
        rows = slice(max(first_row, 0), min(first_row + count, height))
        columns = slice(max(first_column, 0), min(first_column + count, width))
        if rows.start < rows.stop and columns.start < columns.stop:
            shown = photo.signal[rows, columns]
            cut[rows.start - first_row:rows.stop - first_row,
                columns.start - first_column:columns.stop - first_column] = signal_rgb8(
                    shown, white=photo.white)
        return encoded(cut, write_png, ".png")

    def value(self, file: PhotoFile, x: float, y: float) -> dict[str, object]:
        """Signal and clipping of each band at a pixel of the sensor.

        Raises
        ------
        InputError
            If it lies outside the photo.
        """
        photo = self.photo(file)
        at = photo.cell(x, y)
        if at is None:
            raise InputError(f"({x:.0f}, {y:.0f}) lies outside the photo of {photo.size[0]} x "
                             f"{photo.size[1]} pixels")
        return {"x": x, "y": y, "signal": [float(value) for value in photo.signal[at]],
                "saturated": [bool(value) for value in self.clipped(file)[at]]}


def encoded(rgb8: np.ndarray, write: Callable[[Path, np.ndarray], None], suffix: str) -> bytes:
    """A picture (H, W, 3) uint8 as a file in memory."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"picture{suffix}"
        write(path, np.ascontiguousarray(rgb8))
        return path.read_bytes()


def _key(file: PhotoFile) -> FileKey:
    try:
        stat = file.path.stat()
    except OSError as error:
        raise InputError(f"{file.path.name} cannot be read ({error.strerror})") from None
    return file.path, file.orientation, stat.st_mtime_ns, stat.st_size


def _kept(known: dict[FileKey, Kept], key: FileKey, make: Callable[[], Kept]) -> Kept:
    """What is known of a file, or made now; of others the latest few are kept."""
    if key not in known:
        value = make()
        for old in list(known)[:-(MAX_OPEN - 1)]:
            del known[old]
        known[key] = value
    return known[key]


def _opened(file: PhotoFile) -> OpenPhoto:
    """A raw's signal alone, which takes half the time; any other file as it is opened elsewhere."""
    if not is_image_file(file.path):
        frame = decode(file.path)
        if isinstance(frame, RawFrame):
            signal = turned_array(signal_alone(frame), file.orientation)
            return OpenPhoto(signal, float(tile_step(frame.cfa, frame.file)), whites(signal))
    image = turned(open_any(file.path, not_linear=True), file.orientation)
    return OpenPhoto(image.signal, image.sensor_step, whites(image.signal))
