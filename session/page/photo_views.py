"""Photos for the page: tiles for the eye at every scale, and signals under the pointer."""
from __future__ import annotations

import itertools
import tempfile
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from spectrabox.capture.develop.developed import open_any
from spectrabox.capture.photo import preview, raw, region_edges, regions, stored_images
from spectrabox.capture.photo.image_writers import write_jpeg, write_png
from spectrabox.capture.photo.linear import signal_alone, tile_step
from spectrabox.measure.pictures.shown_photo import PhotoLook, camera_look
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records.photos import LinearImage

MAX_OPEN = 3            # photos kept decoded
TILE = 512              # px, a side of a tile
MAX_TILES = 400         # encoded, of each photo
MAX_CELLS = 32          # a side, in which the part of a rectangle that is not clipped is sought
MAX_HALVINGS = 12       # of a photo of a million pixels a side nothing else is left
FileKey = tuple[Path, int, int, int]    # with its orientation, time and length
# how a photo is shown; of a scene, whose light is another everywhere, only relative to white
RAW, CAMERA, CALIBRATED, RELATIVE = "raw", "camera", "calibrated", "relative"
Kept = TypeVar("Kept")


@dataclass(frozen=True)
class PhotoFile:
    """A photo's file, and how it is turned."""

    path: Path
    orientation: int = preview.AS_READ      # as EXIF numbers it


class OpenPhoto:
    """A photo's signal, without what takes longer: its noise and where it is clipped.

    Parameters
    ----------
    signal : (H, W, K) array
        Linear.
    step : float
        Pixels of the sensor a side of one of these.
    camera_from_xyz : (3, 3) array or None
        The camera's own matrix, by which it is shown before there is a calibration.
    """

    def __init__(self, signal: np.ndarray, step: float,
                 camera_from_xyz: np.ndarray | None) -> None:
        self.signal, self.step = signal, step
        self._white = preview.whites(signal)    # what is shown as full brightness of each band
        self.camera = camera_look(camera_from_xyz, self._white) \
            if signal.shape[2] == len(self._white) else None
        self.tiles: dict[tuple[str, int, int, int], bytes] = {}     # as files by look
        self._halved = {0: signal}      # the signal, so many times

    def reduced(self, halvings: int) -> np.ndarray:
        """The signal, halved so many times."""
        if halvings not in self._halved:
            self._halved[halvings] = halved(self.reduced(halvings - 1))
        return self._halved[halvings]

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels of the sensor."""
        height, width = self.signal.shape[:2]
        return round(width * self.step), round(height * self.step)

    def picture(self, look: PhotoLook | None, halvings: int, top: int, left: int) -> np.ndarray:
        """A tile (h, w, 3) uint8 by a look; None: bands as the camera read them."""
        cut = self.reduced(halvings)[top:top + TILE, left:left + TILE]
        if look is None:
            return preview.signal_rgb8(cut, white=self._white)
        y_px, x_px = ((start + np.arange(count) + 0.5) * 2**halvings * self.step - 0.5
                      for start, count in zip((top, left), cut.shape[:2], strict=True))
        return look.rgb8(cut, x_px, y_px)

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
        self._looks: dict[Path, tuple[str, PhotoLook]] = {}     # of a calibration, with their names
        self._numbers = itertools.count(1)
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
                                                        image.camera_from_xyz))
            _kept(self._clipped, key, lambda: image.saturated)

    def calibrate(self, looks: Mapping[Path, PhotoLook], kind: str = CALIBRATED) -> None:
        """Show photos in the colours of their calibration from now on, and no others.

        Parameters
        ----------
        looks : mapping
            By the photos' paths.
        kind : {"calibrated", "relative"}
            Whether they are those of swatches, or as bright as the photo allows.
        """
        with self._lock:
            for path, look in looks.items():
                known = self._looks.get(path)
                if known is None or known[1] is not look:
                    self._looks[path] = f"{kind}-{next(self._numbers)}", look
            for path in {*self._looks} - {*looks}:
                del self._looks[path]

    def look(self, path: Path) -> str:
        """Name of the calibrated look of a photo, another for each calibration; empty where there
        is none.
        """
        return self._looks[path][0] if path in self._looks else ""

    def described(self, file: PhotoFile) -> dict[str, object]:
        """How large a photo is, and how its tiles lie: each has ``tile`` pixels a side, one of
        which is ``step`` pixels of the sensor where nothing is halved.
        """
        photo = self.photo(file)
        height, width, bands = photo.signal.shape
        return {"size": photo.size, "bands": bands, "tile": TILE, "step": photo.step,
                "pixels": (width, height), "camera": photo.camera is not None}

    def tile(self, file: PhotoFile, halvings: int, column: int, row: int,
             look: str = RAW) -> bytes:
        """A tile of the photo, smaller at its right and lower edge: a PNG of the pixels as they
        are, or a JPEG of the photo halved so many times; both sRGB, and tagged.

        Parameters
        ----------
        file : PhotoFile
        halvings, column, row : int
        look : str
            "raw" for the bands as the camera read them, each to its own brightest parts; else the
            calibration's colours, and before there is one the camera's own.

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
        with self._lock:
            name, by = self._looks.get(file.path, (CAMERA, photo.camera))
            if look == RAW or by is None:
                name, by = RAW, None
            key = name, halvings, column, row
            if key not in photo.tiles:
                shown = photo.picture(by, halvings, top, left)
                for old in list(photo.tiles)[:-MAX_TILES]:
                    del photo.tiles[old]
                photo.tiles[key] = encoded(shown, write_jpeg, ".jpg") if halvings else \
                    encoded(shown, write_png, ".png")
            return photo.tiles[key]

    def unclipped(self, file: PhotoFile, rect: Sequence[float]) -> list[float] | None:
        """The largest rectangle [x0, y0, x1, y1] inside another that holds no clipped pixel; None
        where there is none that is large enough for a region.

        Parameters
        ----------
        file : PhotoFile
        rect : (x0, y0, x1, y1)
            In pixels of the sensor.

        Raises
        ------
        InputError
            If the photo cannot be read.
        """
        step, clipped = self.photo(file).step, self.clipped(file)
        height, width = clipped.shape[:2]
        x0, x1 = (int(np.clip(round((at + 0.5) / step), 0, width)) for at in sorted(rect[::2]))
        y0, y1 = (int(np.clip(round((at + 0.5) / step), 0, height)) for at in sorted(rect[1::2]))
        side = max(-(-max(x1 - x0, y1 - y0) // MAX_CELLS), 1)
        rows, columns = (y1 - y0) // side, (x1 - x0) // side
        if not rows or not columns:
            return None
        cells = clipped[y0:y0 + rows * side, x0:x0 + columns * side].reshape(
            rows, side, columns, side, -1)
        largest = region_edges.largest_rectangle(np.logical_not(cells.any(axis=(1, 3, 4))))
        if largest is None:
            return None
        left, top, right, bottom = largest
        if (right - left) * (bottom - top) * side**2 < 2 * regions.MIN_PIXELS:
            return None
        return [(x0 + left * side) * step, (y0 + top * side) * step,
                (x0 + right * side) * step - 1, (y0 + bottom * side) * step - 1]

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
    if not stored_images.is_image_file(file.path):
        frame, *further = raw.decode(file.path)
        if not further:
            signal = preview.turned_array(signal_alone(frame), file.orientation)
            return OpenPhoto(signal, float(tile_step(frame.cfa, frame.file)),
                             frame.camera_from_xyz)
    image = preview.turned(open_any(file.path, not_linear=True), file.orientation)
    return OpenPhoto(image.signal, image.sensor_step, image.camera_from_xyz)
