"""Average a photo down to the size of a render, each output pixel over exactly its own area."""
from __future__ import annotations

import dataclasses

import numpy as np

from spectrabox.radiometry.records.photos import LinearImage

SIZE_RANGE = (0.75, 1.25)  # of the wanted width
ASPECT_ROUND_OFF = 1e-9


def render_size(width: int, height: int, target_width: int) -> tuple[int, int]:
    """Width and height near the wanted width whose aspect is nearest that of a photo.

    Widths from 0.75 to 1.25 of the target are tried; of equal aspects the width nearest the target
    is taken.

    Parameters
    ----------
    width, height : int
        Of the photo.
    target_width : int
    """
    lowest, highest = (max(1, round(share * target_width)) for share in SIZE_RANGE)
    widths = np.arange(lowest, highest + 1)
    heights = np.maximum(1, np.rint(widths * height / width)).astype(int)
    mismatch = np.abs(np.log(widths * height / (heights * width)))
    nearest = mismatch <= mismatch.min() + ASPECT_ROUND_OFF
    best = min(np.flatnonzero(nearest), key=lambda index: abs(int(widths[index]) - target_width))
    return int(widths[best]), int(heights[best])


def bin_image(image: LinearImage, width: int, height: int) -> LinearImage:
    """The photo as (height, width, K), by area-weighted means.

    The variance follows by the squared weights, for independent pixels. A pixel is saturated where
    any that contributes is.

    Parameters
    ----------
    image : LinearImage
    width, height : int
        At most those of the image.
    """
    down = area_weights(image.signal.shape[0], height)
    across = area_weights(image.signal.shape[1], width)
    touched = _weigh(down > 0, image.saturated, across > 0) > 0.5
    return dataclasses.replace(image, signal=_weigh(down, image.signal, across),
                               variance=_weigh(down**2, image.variance, across**2),
                               saturated=touched,
                               sensor_step=image.sensor_step * image.signal.shape[1] / width)


def thumbnail(image: LinearImage, width: int) -> LinearImage:
    """The photo binned to a width, in its own proportions.

    Parameters
    ----------
    image : LinearImage
    width : int
        At most that of the image.
    """
    rows, columns = image.signal.shape[:2]
    return bin_image(image, width, max(round(width * rows / columns), 1))


def area_weights(source: int, target: int) -> np.ndarray:
    """Weights (target, source) of the mean over each target pixel; every row sums to 1.

    Parameters
    ----------
    source, target : int
        Pixels along a side, before and after.
    """
    # In units of 1 / (source x target) of the side all edges are integers, so that no pixel is
    # touched by round-off.
    left, start = np.arange(target)[:, None] * source, np.arange(source) * target
    overlap = np.minimum(left + source, start + target) - np.maximum(left, start)
    return np.maximum(overlap, 0) / source


def _weigh(down: np.ndarray, pixels: np.ndarray, across: np.ndarray) -> np.ndarray:
    """down (h, H) and across (w, W) applied to (H, W, K), in single precision."""
    rows = np.empty((len(down), *pixels.shape[1:]), np.float32)
    for row, weights in zip(rows, down.astype(np.float32), strict=True):
        # The rest of the weights is 0: of large pictures, each row is read once or twice.
        within = slice(*np.flatnonzero(weights)[[0, -1]] + [0, 1])
        some = pixels[within].astype(np.float32, copy=False)
        np.dot(weights[within], some.reshape(len(some), -1), out=row.reshape(-1))
    return np.ascontiguousarray(np.einsum("wx,hxk->hwk", across.astype(np.float32), rows,
                                          optimize=True))
