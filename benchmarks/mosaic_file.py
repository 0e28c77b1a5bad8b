"""The mosaic of an industrial camera that was saved as a plain TIFF or PNG, without the words of a
raw file.

What the file cannot say is given by hand: the colours of the tile, black and white level, exposure.
"""
from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from spectrabox.capture.photo.stored_images import (
    FULL_SCALE,
    LINEAR_BYTES,
    read_header,
    stored_values,
)
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.files import sha256_of
from spectrabox.radiometry.records.photos import RawFrame

COLOURS = "RGB"


def read_mosaic(path: str | os.PathLike[str], pattern: str, *, white_level: float,
                black_level: float = 0.0, exposure_s: float | None = None, iso: float | None = None,
                f_number: float | None = None, camera: str = "") -> RawFrame:
    """Read a mosaic of one band.

    Parameters
    ----------
    pattern :                  colours of the 2 x 2 tile from pixel (0, 0), row by row, as "GBRG";
                               "mono" for none
    white_level, black_level : DN
    exposure_s, camera :       where the file does not say

    Raises
    ------
    InputError
        If the file is no plane of 8 or 16-bit integers, or the pattern is not of R, G and B.
    """
    if pattern != "mono" and (len(pattern) != 4 or set(pattern) != set(COLOURS)):
        raise InputError(f"pattern {pattern!r} is not the four letters of a 2 x 2 tile, as RGGB, "
                         "or mono")
    values, stated_exposure_s, stated_camera = read_plane(path)
    cfa = np.zeros((1, 1), int) if pattern == "mono" else \
        np.array([COLOURS.index(letter) for letter in pattern]).reshape(2, 2)
    return RawFrame(mosaic=values.astype(np.uint16), cfa=cfa,
                    black_level=np.full(cfa.shape, float(black_level)), white_level=white_level,
                    exposure_s=exposure_s or stated_exposure_s, iso=iso, f_number=f_number,
                    camera=camera or stated_camera, file=Path(path).name,
                    sha256=sha256_of(Path(path)))


def read_plane(path: str | os.PathLike[str]) -> tuple[np.ndarray, float | None, str]:
    """Values (H, W) as stored in a file of one band, its exposure in s and its camera.

    Parameters
    ----------
    path : path
        Such as the mosaic of an industrial camera.

    Raises
    ------
    InputError
        If the file is missing or damaged, has several bands, or holds anything but 8 or 16-bit
        integers.
    """
    header = read_header(Path(path))
    bands = header.spec.nchannels
    if bands != 1 or header.kind not in FULL_SCALE:
        raise InputError(f"{header.path.name} has {bands} bands of {header.kind} values; a "
                         "mosaic is one band of 8 or 16-bit integers: save the raw frame without "
                         "demosaicing")
    values, header = stored_values(Path(path), LINEAR_BYTES)
    plane = np.ascontiguousarray(values[..., 0])
    return plane, header.positive("ExposureTime"), header.camera
