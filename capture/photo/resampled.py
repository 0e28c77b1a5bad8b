"""A photo in the pixels of another, by linear interpolation, and where it is uncertain there."""
from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np

from spectrabox.radiometry.records import LinearImage

ROWS_AT_ONCE = 64
TOLERATED = 0.05        # of the signal: what a pixel may err by since it is off its position


def resampled(photo: LinearImage, matrix: np.ndarray, x_px: np.ndarray,
              y_px: np.ndarray) -> tuple[LinearImage, np.ndarray]:
    """A photo as another's pixels show it, which are moved against its own.

    A pixel is the mean of the four around it by their weights w, its variance the sum of w^2 times
    theirs: as little as a quarter half-way between four, and neighbours then share noise. Clipped
    are those of which any of the four is, and those beyond the photo.

    Parameters
    ----------
    photo : LinearImage
    matrix : (2, 3) array
        From pixels (x, y, 1) of the other photo to those of this one.
    x_px, y_px : (W,), (H,) arrays
        Columns and rows of the other photo, at full resolution.

    Returns
    -------
    image : LinearImage
        Of H x W pixels.
    off_px : (H, W) array
        What interpolation smears a straight edge by, in pixels of the image: 2 w (1 - w), half a
        pixel at most.
    """
    step, shape = photo.sensor_step, (y_px.size, x_px.size, photo.signal.shape[2])
    last = np.array(photo.signal.shape[1::-1])[:, None, None] - 1
    signal, variance = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    saturated, off_px = np.zeros(shape, bool), np.zeros(shape[:2], np.float32)
    for start in range(0, y_px.size, ROWS_AT_ONCE):
        rows = slice(start, start + ROWS_AT_ONCE)
        across, down, shift = matrix.T[:, :, None, None]
        at = (across * x_px + down * y_px[rows, None] + shift + 0.5) / step - 0.5
        low = np.clip(np.floor(at), 0, last - 1).astype(int)
        share = np.clip(at - low, 0, 1).astype(np.float32)
        off_px[rows] = np.max(2 * share * (1 - share), axis=0)
        for right, below in product((0, 1), repeat=2):
            x, y = low[0] + right, low[1] + below
            weight = np.where(right, share[0], 1 - share[0]) * np.where(below, share[1],
                                                                        1 - share[1])
            signal[rows] += weight[..., None] * photo.signal[y, x]
            variance[rows] += weight[..., None]**2 * photo.variance[y, x]
            saturated[rows] |= photo.saturated[y, x] & (weight > 0)[..., None]
        saturated[rows] |= np.any((at < -0.5) | (at > last + 0.5), axis=0)[..., None]
    for array in (signal, variance, saturated):
        array.flags.writeable = False       # records then keep it without a copy
    return replace(photo, signal=signal, variance=variance, saturated=saturated), off_px


def uncertain_edges(image: LinearImage, off_px: np.ndarray | float) -> np.ndarray:
    """Pixels (H, W) at edges so high that the signal is uncertain if they are off their position:
    by more than a standard error of noise, and more than 5 % of the signal.

    Parameters
    ----------
    image : LinearImage
    off_px : (H, W) array or float
        In its pixels.
    """
    uncertain = np.zeros(image.signal.shape[:2], bool)
    for band in range(image.signal.shape[2]):
        signal = image.signal[..., band]
        slope = np.hypot(*np.gradient(signal))
        uncertain |= (off_px * slope)**2 > image.variance[..., band] + (TOLERATED * signal)**2
    return uncertain
