"""Photos turned upright, averaged down to fewer pixels, and as pictures for the eye.

How a picture is to be turned to stand upright, as the camera states it (EXIF tag 274, TIFF 6.0).

Photos are decoded as the sensor read them; dark frames and flat fields belong to that frame. What a
person reads pixels from is turned afterwards, once, as other programs show it.
"""


from __future__ import annotations

import dataclasses
import functools
from pathlib import Path

import numpy as np

from spectrabox.capture.photo import raw, stored_images
from spectrabox.radiometry.appearance import encode_srgb
from spectrabox.radiometry.records.photos import LinearImage

AS_READ = 1         # the orientation of a picture that is not turned


def photo_orientation(path: Path) -> int:
    """Orientation of a photo, 1 to 8 as EXIF numbers them; 1 where the file states none.

    Parameters
    ----------
    path : Path

    Raises
    ------
    InputError
        If it is missing or no photo.
    """
    if stored_images.is_image_file(path):
        return stored_images.read_header(path).orientation
    return raw.raw_orientation(path)


def turned(image: LinearImage, orientation: int) -> LinearImage:
    """The photo as it is shown.

    Parameters
    ----------
    image : LinearImage
        As the sensor read it.
    orientation : int
        1 to 8, as EXIF numbers them.
    """
    if orientation == AS_READ:
        return image
    return dataclasses.replace(image, signal=turned_array(image.signal, orientation),
                               variance=turned_array(image.variance, orientation),
                               saturated=turned_array(image.saturated, orientation))


def turned_array(pixels: np.ndarray, orientation: int) -> np.ndarray:
    """Pixels (H, W, ...) as they are shown, read-only; (W, H, ...) of orientations 5 to 8.

    Parameters
    ----------
    pixels : (H, W, ...) array
    orientation : int
        1 to 8, as EXIF numbers them.
    """
    shown = pixels.swapaxes(0, 1) if orientation >= 5 else pixels
    if orientation in (3, 4, 7, 8):
        shown = shown[::-1]
    if orientation in (2, 3, 6, 7):
        shown = shown[:, ::-1]
    shown = np.ascontiguousarray(shown)
    shown.flags.writeable = False       # records then keep it without a copy
    return shown


# ---- binning -------------------------------------------------------------------------------------

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


# ---- a picture for the eye, and for the chart detector, from linear camera signal ----------------

WHITE_PERCENTILE = 99.5
MIN_WHITE = 1e-30
TABLE_SIZE = 65536
SAMPLES = 500_000  # enough to find a percentile


def whites(signal: np.ndarray) -> tuple[float, ...]:
    """What ``signal_rgb8`` shows as full brightness of each of its three bands.

    Parameters
    ----------
    signal : (H, W, K) array
    """
    stride = max(1, int(np.sqrt(signal[..., 0].size / SAMPLES)))
    return tuple(max(float(np.percentile(signal[::stride, ::stride, band], WHITE_PERCENTILE)),
                     MIN_WHITE) for band in _shown_bands(signal))


def _shown_bands(signal: np.ndarray) -> tuple[int, int, int]:
    bands = signal.shape[2]
    return 0, bands // 2, bands - 1


def signal_rgb8(signal: np.ndarray, factor: int = 1,
                white: tuple[float, ...] | None = None) -> np.ndarray:
    """Picture (H, W, 3) uint8, sRGB-encoded, each band scaled to its own brightest parts.

    The scaling removes the green cast of camera signal and lifts underexposed photos; colours are
    not measured by it. Of more than three bands the first, the middle and the last are shown.

    Parameters
    ----------
    signal : (H, W, K) array
        Linear.
    factor : int
        By which the picture is smaller: each of its pixels is the mean of so many squared; rows and
        columns that fill none are left out.
    white : tuple of float or None
        Of ``whites``, of the photo that this is a part of; None: of this itself.
    """
    height, width = (size // factor for size in signal.shape[:2])
    picture = np.empty((height, width, 3), np.uint8)
    for channel, (band, brightest) in enumerate(zip(_shown_bands(signal), white or whites(signal),
                                                    strict=True)):
        plane = signal[..., band]
        if factor > 1:      # three times as fast as a mean over axes
            plane = np.zeros((height, width), np.float32)
            for row, column in np.ndindex(factor, factor):
                plane += signal[row:height * factor:factor, column:width * factor:factor, band]
            plane /= np.float32(factor**2)
        picture[..., channel] = linear_rgb8(plane * np.float32(1 / brightest))
    return picture


def linear_rgb8(linear: np.ndarray) -> np.ndarray:
    """sRGB code values (uint8) of linear values as ``encode_srgb8``, by a table: ten times as fast,
    and off by less than 0.03 of them.

    Parameters
    ----------
    linear : array of any shape
        Clipped to 0 to 1.
    """
    index = linear * np.float32(TABLE_SIZE - 1)
    index += np.float32(0.5)
    np.clip(index, 0, TABLE_SIZE - 1, out=index)
    return np.asarray(_code_values()[index.astype(np.uint16)])


@functools.cache
def _code_values() -> np.ndarray:
    return encode_srgb8(np.arange(TABLE_SIZE) / (TABLE_SIZE - 1))


def encode_srgb8(linear: np.ndarray) -> np.ndarray:
    """sRGB code values (uint8) of linear values (IEC 61966-2-1).

    Parameters
    ----------
    linear : (...) array
        Clipped to 0 to 1.
    """
    return np.rint(255 * encode_srgb(linear)).astype(np.uint8)
