"""The measured angular profile of a lamp: radiance by angle from its normal, 1 straight ahead.

A scene gives it to an area light as ``<string name="profile" value="lamp.csv"/>`` in the <emitter>.
It is what a spectroradiometer reads that looks at the lamp from several angles. A luminaire file
(IES) states intensity instead: divide by the cosine of the angle. The transport engine weighs every
path with it; Mitsuba has no such light.
"""
from __future__ import annotations

from pathlib import Path

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.files import read_text
from spectrabox.radiometry.system.words import is_number

STEP_DEG = 0.5
TABLE_DEG = np.arange(0.0, 90.0 + STEP_DEG / 2, STEP_DEG)
ROUND = 1e-6
COLUMNS = (2, 3)


def read_profile(path: Path) -> np.ndarray:
    """Relative radiance (181,) at ``TABLE_DEG``, 1 straight ahead.

    Linear between the angles; the last value holds up to 90 degrees.

    Parameters
    ----------
    path : Path
        File of rows "angle in degrees, radiance"; a first row may name them, and a third column
        may state standard errors.

    Raises
    ------
    InputError
        If rows are no pairs of numbers, the angles do not rise from 0 to at most 90, or a radiance
        is negative.
    """
    try:
        # Latin-1 holds every byte: a name in any alphabet may stand in the first row
        text = read_text(path, "latin-1")
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}); give the lamp's "
                         "profile") from None
    rows = [line.split(",") for line in text.splitlines() if line.strip("\xef\xbb\xbf ")]
    if rows and not is_number(rows[0][0]):
        rows = rows[1:]
    if len(rows) < 2 or not all(len(row) in COLUMNS and all(map(is_number, row)) for row in rows):
        raise InputError(f"{path.name}: a lamp's profile needs two rows or more of an angle in "
                         "degrees and a radiance, with a comma between them")
    angle, radiance = np.array([row[:2] for row in rows], dtype=float).T
    if not (np.all(np.diff(angle) > 0) and abs(angle[0]) < ROUND and angle[-1] <= 90 + ROUND):
        raise InputError(f"{path.name}: the angles of a lamp's profile must rise from 0 (straight "
                         "ahead) to at most 90")
    if radiance.min() < 0 or not radiance[0] > 0 or not np.isfinite(radiance).all():
        raise InputError(f"{path.name}: the radiances of a lamp's profile must be finite and not "
                         "negative, and positive straight ahead")
    return np.interp(TABLE_DEG, angle, radiance / radiance[0])


def profile_text(angle_deg: np.ndarray, radiance: np.ndarray, standard_error: np.ndarray) -> str:
    """A profile as ``read_profile`` reads it.

    Parameters
    ----------
    angle_deg, radiance, standard_error : (J,) arrays
    """
    rows = [f"{angle:.4g},{value:.6g},{error:.3g}" for angle, value, error in
            zip(angle_deg, radiance, standard_error, strict=True)]
    return "\n".join(["angle_deg,radiance,standard_error", *rows]) + "\n"


def relative_radiance(table: np.ndarray, cosine: np.ndarray) -> np.ndarray:
    """Value of a profile, 0 or more, of the shape of ``cosine``.

    Parameters
    ----------
    table : (181,) array
        At ``TABLE_DEG``.
    cosine : array
        Of the angle from the lamp's normal.
    """
    return np.interp(np.degrees(np.arccos(np.clip(cosine, 0.0, 1.0))), TABLE_DEG, table)
