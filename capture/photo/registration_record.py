"""The motion of a photo against another, as a record: apart from what estimates it with OpenCV."""
from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from spectrabox.radiometry.shaped import Record

STILL_PX = 0.5              # less than this is no motion


@dataclass(frozen=True, eq=False)
class Registration(Record):
    """From pixels of the first photo to those of another: ``matrix @ (x, y, 1)``."""

    matrix: Annotated[np.ndarray, "2 3"]    # a turn and a shift, full resolution
    shift_px: float                         # of the middle of the photo
    correlation: float                      # of the edges of both photos, 0 to 1
    residual_px: float | None               # median over parts of the photo; None: none tells
    chart_px: float | None                  # rms of the chart's corners; None: not in both photos

    def moved(self, points_px: np.ndarray) -> np.ndarray:
        """Points (..., 2) of the first photo in the pixels of the other."""
        return points_px if self.still else np.asarray(
            points_px @ self.matrix[:, :2].T + self.matrix[:, 2])

    @property
    def still(self) -> bool:
        """Whether the photo moved by less than half a pixel."""
        return self.shift_px < STILL_PX
