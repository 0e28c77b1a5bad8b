"""Files of a camera's colour profile for programs of colour management."""
from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from spectrabox.radiometry.files import whole_file, write_text_whole
from spectrabox.radiometry.profiles.colour_table import colour_table
from spectrabox.radiometry.profiles.icc_profile import PCS_WHITE, camera_profile_bytes
from spectrabox.radiometry.profiles.ocio_config import clf_text, ocio_config_text

FORMS = {".icc": "an ICC input profile", ".clf": "a Common LUT Format file to ACES2065-1",
         ".ocio": "an OpenColorIO configuration"}


def write_profile(path: Path, camera: str, matrix: np.ndarray,
                  xyz: Callable[[np.ndarray], np.ndarray]) -> tuple[Path, ...]:
    """Write a profile in the form that the file's ending names.

    Parameters
    ----------
    path : Path
        Ends in one of ``FORMS``. The Common LUT Format file that a configuration names is written
        beside it under its name.
    camera : str
        As programs list it.
    matrix : (3, 3) array
        From signals relative to white to X, Y, Z under D50.
    xyz : function
        From signals (n, 3) relative to white to X, Y, Z (n, 3) under D50, for the table.

    Returns
    -------
    tuple of Path
        That were written.
    """
    table = colour_table(xyz, PCS_WHITE)
    if path.suffix.lower() == ".icc":
        with whole_file(path) as unfinished:
            unfinished.write_bytes(camera_profile_bytes(camera, matrix, table))
        return (path,)
    clf = path.with_suffix(".clf")
    write_text_whole(clf, clf_text(camera, table))
    if path.suffix.lower() == ".clf":
        return (clf,)
    write_text_whole(path, ocio_config_text(camera, clf.name, matrix))
    return path, clf
