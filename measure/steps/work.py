"""What a step is lent beside its capture and the records before it."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from spectrabox.capture.photo.image_writers import write_png
from spectrabox.measure import extras, opened_photos
from spectrabox.radiometry.findings import Finding
from spectrabox.radiometry.records.spectra import Progress


@dataclass(frozen=True)
class Work:
    """Open photos, the place where Mitsuba renders, and where files go."""

    photos: opened_photos.OpenPhotos                  # shared by the steps of one run
    progress: Progress
    device: str = "auto"                # "auto", "cpu" or "cuda"
    folder: Path | None = None          # takes the step's pictures; None: none are made
    checkpoints: Path | None = None     # takes what a stopped trace goes on from

    def write_picture(self, name: str, drawn: Callable[[], np.ndarray]) -> tuple[Finding, ...]:
        """A PNG among the step's pictures, if any are made.

        Parameters
        ----------
        name : str
        drawn : callable
            Draws the picture (H, W, 3) uint8.

        Returns
        -------
        tuple of Finding
            Why there is none, where that failed: spectra need no picture.
        """
        folder = self.folder
        if folder is None:
            return ()
        _, failed = extras.attempt(f"picture {name!r}",
                                   lambda: write_png(folder / f"{name}.png", drawn()), None)
        return () if failed is None else (extras.to_keep(failed),)

    def checkpoint(self, name: str) -> Path | None:
        """The file that a stopped trace is kept in."""
        return None if self.checkpoints is None else self.checkpoints / name
