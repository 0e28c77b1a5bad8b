"""Hyperspectral pictures of any known format, read apart from what judges by them."""
from __future__ import annotations

from pathlib import Path

import numpy as np

from spectrabox.capture.photo.image_rows import open_channels
from spectrabox.radiometry.spectra.formats.spectral_exr import MAGIC
from spectrabox.sampling.evaluation.cubes import Cube, cube_of_channels, open_cube


def open_picture(path: Path, wavelengths: np.ndarray | None, variable: str | None) -> Cube:
    """A hyperspectral picture of any known format, an EXR being one by what it begins with."""
    if path.is_file():
        with path.open("rb") as file:
            if file.read(len(MAGIC)) == MAGIC:
                return cube_of_channels(path.name, *open_channels(path))
    return open_cube(path, wavelengths, variable)
