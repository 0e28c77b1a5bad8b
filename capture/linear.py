"""From a mosaic to linear camera signal, without demosaicing: each 2 x 2 tile becomes one pixel."""
from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from capture.image_files import is_image_file, read_linear_file
from capture.noise import photon_transfer
from capture.raw import read_raw
from radiometry.records import LinearImage, PhotoKind, RawFrame

CLIP_FRACTION = 0.98  # of the white level: above it sensors are no longer linear
BANDS = 3


def open_photo(path: str | os.PathLike[str]) -> LinearImage:
    """Linear signal of a camera raw or of a linear EXR or TIFF, told apart by suffix, else by content.

    Raises
    ------
    InputError
        If the file cannot be read as either, or does not hold linear signal.
    """
    return read_linear_file(path) if is_image_file(Path(path)) else linear_image(read_raw(path))


def linear_image(frame: RawFrame) -> LinearImage:
    """Signal (DN - black) / (white - black) of each 2 x 2 tile: red, the mean of both greens, blue.

    Negative signals stay, so that means over dark areas are unbiased. A pixel is saturated where any contributing
    sample reaches 0.98 of the white level. The variance comes from the photo itself (capture/noise.py).
    """
    height, width = frame.mosaic.shape[0] // 2, frame.mosaic.shape[1] // 2
    signal = np.zeros((height, width, BANDS), np.float32)
    saturated = np.zeros((height, width, BANDS), bool)
    variance_of_rounding = np.zeros(BANDS)
    for (y, x), band in np.ndenumerate(frame.cfa):
        samples = frame.mosaic[y:2 * height:2, x:2 * width:2]
        share = 1 / np.count_nonzero(frame.cfa == band)
        black = float(frame.black_level[y, x])
        plane = samples - np.float32(black)
        plane *= np.float32(share / (frame.white_level - black))
        signal[..., band] += plane
        saturated[..., band] |= samples >= CLIP_FRACTION * frame.white_level
        variance_of_rounding[band] += (share / (frame.white_level - black)) ** 2
    noise = photon_transfer(signal, saturated, quantum=np.sqrt(variance_of_rounding))
    variance = noise.variance(signal)
    for array in (signal, saturated, variance):
        array.flags.writeable = False  # the record then keeps them without a copy
    return LinearImage(signal=signal, variance=variance, saturated=saturated, sensor_step=2.0,
                       exposure_s=frame.exposure_s, iso=frame.iso, f_number=frame.f_number, kind=PhotoKind.RAW,
                       camera=frame.camera, source=frame.file, sha256=frame.sha256)
