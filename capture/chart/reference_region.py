"""Signals of neutral references that an operator outlined in a photo."""
from __future__ import annotations

import numpy as np

from spectrabox.capture.chart.patches import pixels_inside
from spectrabox.radiometry.errors import CheckError, ClippedPhotoError, InputError
from spectrabox.radiometry.records import LinearImage

MIN_PIXELS = 16
CLIPPED_LIMIT = 0.01        # of the pixels of a region
MIN_SIGNAL_TO_NOISE = 10    # of a region's mean


def region_signals(image: LinearImage, corners_px: np.ndarray) -> np.ndarray:
    """Mean signal (R, K) inside each of R quadrilaterals.

    Parameters
    ----------
    image : LinearImage
    corners_px : (R, 4, 2) array
        Corner after corner, in pixels of the whole photo.

    Raises
    ------
    InputError
        If a quadrilateral has no four corners, leaves the photo or holds fewer than 16 pixels.
    ClippedPhotoError
        If more than 1 % of a region is saturated.
    CheckError
        If a region is too dark to be compared.
    """
    quads = np.asarray(corners_px, dtype=float)
    if quads.ndim != 3 or quads.shape[1:] != (4, 2) or not np.all(np.isfinite(quads)):
        raise InputError("a reference region is written as four corners [[x, y], [x, y], [x, y], "
                         "[x, y]] in pixels of the photo, going round")
    height, width = image.signal.shape[:2]
    means = []
    for number, quad in enumerate(quads, start=1):
        name = f"photo {image.source}: reference region {number}"
        size = np.array([width, height]) * image.sensor_step
        if np.any(quad < -0.5) or np.any(quad > size - 0.5):
            raise InputError(f"{name} leaves the photo of {round(size[0])} x {round(size[1])} "
                             "pixels; correct its corners")
        y, x = pixels_inside(quad, image.sensor_step, height, width)
        if y.size < MIN_PIXELS:
            raise InputError(f"{name} holds {y.size} pixels, {MIN_PIXELS} are needed; outline more "
                             "of the reference, corner after corner")
        clipped = float(image.saturated[y, x].any(axis=1).mean())
        if clipped > CLIPPED_LIMIT:
            raise ClippedPhotoError(f"{name} is saturated in {clipped:.0%} of its pixels; expose "
                                    "less, or use a darker reference")
        mean = image.signal[y, x].mean(axis=0, dtype=float)
        noise = np.sqrt(image.variance[y, x].mean(axis=0, dtype=float) / y.size)
        if np.any(mean < MIN_SIGNAL_TO_NOISE * noise) or np.any(mean <= 0):
            raise CheckError(f"{name} is too dark (signal {mean.min():.2g}, noise "
                             f"{noise.max():.1g}); use a lighter reference or expose more")
        means.append(mean)
    return np.array(means)
