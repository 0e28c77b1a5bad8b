"""A picture for the eye, and for the chart detector, from linear camera signal."""
from __future__ import annotations

import numpy as np

from spectrabox.radiometry.records import LinearImage

WHITE_PERCENTILE = 99.5
MIN_WHITE = 1e-30
TABLE_SIZE = 65536
SAMPLES = 500_000  # enough to find a percentile


def preview_rgb8(image: LinearImage, factor: int = 1) -> np.ndarray:
    """Picture (H, W, 3) uint8, sRGB-encoded, each band scaled to its own brightest parts.

    The scaling removes the green cast of camera signal and lifts underexposed photos; colours are
    not measured by it. Of more than three bands the first, the middle and the last are shown.

    Parameters
    ----------
    image : LinearImage
    factor : int
        By which the picture is smaller: each of its pixels is the mean of so many squared; rows and
        columns that fill none are left out.
    """
    bands = image.signal.shape[2]
    shown = (0, bands // 2, bands - 1)
    stride = max(1, int(np.sqrt(image.signal[..., 0].size / SAMPLES)))
    height, width = (size // factor for size in image.signal.shape[:2])
    picture = np.empty((height, width, 3), np.uint8)
    for channel, band in enumerate(shown):
        plane = image.signal[..., band]
        white = max(float(np.percentile(plane[::stride, ::stride], WHITE_PERCENTILE)), MIN_WHITE)
        picture[..., channel] = _encoded(_reduced(plane, factor), white)
    return picture


def _reduced(plane: np.ndarray, factor: int) -> np.ndarray:
    """Means of squares of ``factor`` pixels a side."""
    if factor == 1:
        return plane
    height, width = (size // factor for size in plane.shape)
    whole = plane[:height * factor, :width * factor]
    return np.asarray(whole.reshape(height, factor, width, factor).mean(axis=(1, 3)))


def _encoded(plane: np.ndarray, white: float) -> np.ndarray:
    """As ``encode_srgb8`` of plane / white, from a table: ten times as fast, and off by less than
    0.03 code values.
    """
    table = encode_srgb8(np.arange(TABLE_SIZE) / (TABLE_SIZE - 1))
    index = plane * np.float32((TABLE_SIZE - 1) / white)
    index += np.float32(0.5)
    np.clip(index, 0, TABLE_SIZE - 1, out=index)
    return table[index.astype(np.uint16)]


def encode_srgb8(linear: np.ndarray) -> np.ndarray:
    """sRGB code values (uint8) of linear values (IEC 61966-2-1).

    Parameters
    ----------
    linear : (...) array
        Clipped to 0 to 1.
    """
    clipped = np.clip(linear, 0, 1)
    encoded = np.where(clipped <= 0.0031308, 12.92 * clipped, 1.055 * clipped ** (1 / 2.4) - 0.055)
    return np.rint(255 * encoded).astype(np.uint8)
