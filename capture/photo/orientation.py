"""How a picture is to be turned to stand upright, as the camera states it (EXIF tag 274, TIFF 6.0).

Photos are decoded as the sensor read them; dark frames and flat fields belong to that frame. What a
person reads pixels from is turned afterwards, once, as other programs show it.
"""
from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from spectrabox.capture.photo.raw import raw_orientation
from spectrabox.capture.photo.stored_images import is_image_file, read_header
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
    if is_image_file(path):
        return read_header(path).orientation
    return raw_orientation(path)


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
