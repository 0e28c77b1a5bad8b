"""Photos for the page: a picture for the eye, parts of it, and signals under the pointer."""
from __future__ import annotations

import io
import tempfile
import threading
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from spectrabox.capture.develop.developed import open_any
from spectrabox.capture.photo.image_files import write_png
from spectrabox.capture.photo.preview import preview_rgb8
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records import LinearImage

MAX_OPEN = 3            # photos kept decoded
MAX_SIDE = 1600         # px, of the picture that is shown whole
MAX_CROP = 800          # px, of a part


@dataclass(frozen=True)
class OpenPhoto:
    """A decoded photo, and the picture of it whose pixels are its own."""

    image: LinearImage
    rgb8: np.ndarray

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels of the sensor."""
        height, width = self.image.signal.shape[:2]
        return round(width * self.image.sensor_step), round(height * self.image.sensor_step)


class PhotoViews:
    """Photos that are shown, each decoded once while its file is unchanged."""

    def __init__(self) -> None:
        self._open: dict[tuple[Path, int, int], OpenPhoto] = {}
        self._lock = threading.Lock()

    def photo(self, path: Path) -> OpenPhoto:
        """The photo of a file.

        Raises
        ------
        InputError
            If it cannot be read.
        """
        try:
            found = path.stat()
        except OSError as error:
            raise InputError(f"{path.name} cannot be read ({error.strerror})") from None
        key = (path, found.st_mtime_ns, found.st_size)
        with self._lock:        # of two that ask for one photo the second waits for it
            if key not in self._open:
                image = open_any(path, not_linear=True)
                kept = list(self._open.items())[-(MAX_OPEN - 1):]
                self._open = {**dict(kept), key: OpenPhoto(image, preview_rgb8(image))}
            return self._open[key]

    def whole(self, path: Path) -> bytes:
        """PNG of the photo, at most ``MAX_SIDE`` pixels a side."""
        photo = self.photo(path)
        factor = max(1, int(np.ceil(max(photo.rgb8.shape[:2]) / MAX_SIDE)))
        return png(photo.rgb8 if factor == 1 else preview_rgb8(photo.image, factor))

    def part(self, path: Path, left: float, top: float, side: float) -> bytes:
        """PNG of a square of the photo, its pixels as they are.

        Parameters
        ----------
        left, top, side : float
            In pixels of the sensor; what lies outside the photo is black.
        """
        photo = self.photo(path)
        step = photo.image.sensor_step
        first_row, first_column = round(top / step), round(left / step)
        count = min(max(round(side / step), 1), MAX_CROP)
        cut = np.zeros((count, count, 3), np.uint8)
        height, width = photo.rgb8.shape[:2]
        rows = np.arange(max(first_row, 0), min(first_row + count, height))
        columns = np.arange(max(first_column, 0), min(first_column + count, width))
        if rows.size and columns.size:
            cut[np.ix_(rows - first_row, columns - first_column)] = photo.rgb8[np.ix_(rows,
                                                                                      columns)]
        return png(cut)

    def value(self, path: Path, x: float, y: float) -> dict[str, object]:
        """Signal and clipping of each band at a pixel of the sensor.

        Raises
        ------
        InputError
            If it lies outside the photo.
        """
        photo = self.photo(path)
        step = photo.image.sensor_step
        row, column = int((y + 0.5) / step), int((x + 0.5) / step)
        height, width = photo.rgb8.shape[:2]
        if not (0 <= row < height and 0 <= column < width and x > -0.5 and y > -0.5):
            raise InputError(f"({x:.0f}, {y:.0f}) lies outside the photo of {photo.size[0]} x "
                             f"{photo.size[1]} pixels")
        return {"x": x, "y": y,
                "signal": [float(value) for value in photo.image.signal[row, column]],
                "saturated": [bool(value) for value in photo.image.saturated[row, column]]}


def png(rgb8: np.ndarray) -> bytes:
    """A picture (H, W, 3) uint8 as a PNG file in memory."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "picture.png"
        write_png(path, np.ascontiguousarray(rgb8))
        return io.BytesIO(path.read_bytes()).getvalue()
