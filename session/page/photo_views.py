"""Photos for the page: tiles for the eye at every scale, and signals under the pointer."""
from __future__ import annotations

import tempfile
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

import numpy as np

from spectrabox.capture.develop.developed import open_any
from spectrabox.capture.photo import preview
from spectrabox.capture.photo.image_writers import write_jpeg, write_png
from spectrabox.capture.photo.linear import signal_alone, tile_step
from spectrabox.capture.photo.raw import decode
from spectrabox.capture.photo.stored_images import is_image_file
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records.photos import LinearImage, RawFrame

MAX_OPEN = 3            # photos kept decoded
TILE = 512              # px, a side of a tile
MAX_TILES = 400         # encoded, of each photo
MAX_HALVINGS = 12       # of a photo of a million pixels a side nothing else is left
FileKey = tuple[Path, int, int, int]    # with its orientation, time and length
Kept = TypeVar("Kept")


@dataclass(frozen=True)
class PhotoFile:
    """A photo's file, and how it is turned."""

    path: Path
    orientation: int = preview.AS_READ      # as EXIF numbers it


@dataclass(frozen=True)
class OpenPhoto:
    """A photo's signal, without what takes longer: its noise and where it is clipped."""

    signal: np.ndarray      # (H, W, K) linear
    step: float             # pixels of the sensor a side of one of these
    white: tuple[float, ...]    # what is shown as full brightness of each band
    # made as they are asked for: the signal halved so many times, and tiles as files
    halved: dict[int, np.ndarray] = field(default_factory=dict)
    tiles: dict[tuple[int, int, int], bytes] = field(default_factory=dict)

    def reduced(self, halvings: int) -> np.ndarray:
        """The signal, halved so many times."""
        if halvings == 0:
            return self.signal
        if halvings not in self.halved:
            self.halved[halvings] = halved(self.reduced(halvings - 1))
        return self.halved[halvings]

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
            return _kept(self._clipped, key, lambda: preview.turned_array(
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
                                                       preview.whites(image.signal)))
            _kept(self._clipped, key, lambda: image.saturated)

    def described(self, file: PhotoFile) -> dict[str, object]:
        """How large a photo is, and how its tiles lie: each has ``tile`` pixels a side, one of
        which is ``step`` pixels of the sensor where nothing is halved.
        """
        photo = self.photo(file)
        height, width, bands = photo.signal.shape
        return {"size": photo.size, "bands": bands, "tile": TILE, "step": photo.step,
                "pixels": (width, height)}

    def tile(self, file: PhotoFile, halvings: int, column: int, row: int) -> bytes:
        """A tile of the photo, smaller at its right and lower edge: a PNG of the pixels as they
        are, or a JPEG of the photo halved so many times.

        Raises
        ------
        InputError
            If the photo has no such tile.
        """
        photo = self.photo(file)
        height, width = (-(-side // 2**max(halvings, 0)) for side in photo.signal.shape[:2])
        top, left = row * TILE, column * TILE
        if not (0 <= halvings <= MAX_HALVINGS and 0 <= top < height and 0 <= left < width):
            raise InputError(f"the photo of {photo.size[0]} x {photo.size[1]} pixels has no such "
                             "tile")
        key = halvings, column, row
        with self._lock:
            if key not in photo.tiles:
                cut = photo.reduced(halvings)[top:top + TILE, left:left + TILE]
                shown = preview.signal_rgb8(cut, white=photo.white)
                for old in list(photo.tiles)[:-MAX_TILES]:
                    del photo.tiles[old]
                photo.tiles[key] = encoded(shown, write_jpeg, ".jpg") if halvings else \
                    encoded(shown, write_png, ".png")
            return photo.tiles[key]

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


def halved(signal: np.ndarray) -> np.ndarray:
    """Means of two by two pixels of a signal (H, W, K); an odd last row or column stands twice."""
    height, width = signal.shape[:2]
    if height % 2 or width % 2:
        signal = np.pad(signal, ((0, height % 2), (0, width % 2), (0, 0)), "edge")
    total = signal[::2, ::2] + signal[1::2, ::2]
    total += signal[::2, 1::2]
    total += signal[1::2, 1::2]
    total *= 0.25
    return total


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
            signal = preview.turned_array(signal_alone(frame), file.orientation)
            return OpenPhoto(signal, float(tile_step(frame.cfa, frame.file)),
                             preview.whites(signal))
    image = preview.turned(open_any(file.path, not_linear=True), file.orientation)
    return OpenPhoto(image.signal, image.sensor_step, preview.whites(image.signal))
