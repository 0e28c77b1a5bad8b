"""What a perfect white reads in a photo, told by a ColorChecker in it."""
from __future__ import annotations

import numpy as np

from spectrabox.measure.camera import measure_chart
from spectrabox.radiometry.chart import CLASSIC
from spectrabox.radiometry.charts.references import reference_reflectances
from spectrabox.radiometry.errors import ChartNotFoundError, CheckError, InputError
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.records.photos import LinearImage, PhotoKind


def white_of_chart(photo: LinearImage, relative_response: np.ndarray) -> np.ndarray:
    """What a perfect white in the chart's place reads in each band (K,).

    From the lightest patch of no colour that is not clipped, and its usual reflectance. How the
    light changes from there over the photo is not seen.

    Parameters
    ----------
    photo : LinearImage
    relative_response : (K, 301) array
        On FINE_GRID; rows sum to 1.

    Raises
    ------
    ChartNotFoundError, CheckError, ClippedPhotoError
        As ``measure_chart``.
    """
    reflectances = reference_reflectances(None, CLASSIC, FINE_GRID)
    samples = measure_chart(photo, CLASSIC, reflectances, FINE_GRID)
    lightest = next(patch for patch in CLASSIC.neutrals if not samples.clipped[patch].any())
    return np.asarray(samples.mean[lightest] / (relative_response @ reflectances[lightest]))


def photo_white(photo: LinearImage, relative_response: np.ndarray,
                remedy: str) -> np.ndarray | None:
    """The same, or None of a photo without a chart whose values may be shares of white already.

    Parameters
    ----------
    photo : LinearImage
    relative_response : (K, 301) array
    remedy : str
        How white is stated, for the error.

    Raises
    ------
    InputError
        If no chart tells the white of a camera's raw photo, whose values are shares of what its
        sensor can hold; or the photo is decoded from sRGB, whose values are no camera's.
    """
    if photo.kind is PhotoKind.PROCESSED:
        raise InputError(f"{photo.source} was decoded from sRGB: its values are what a camera's "
                         "processing made for a screen, and no camera saw them. Take its colours "
                         "as they are, from the file itself (--encoded, encoded=True)")
    try:
        return white_of_chart(photo, relative_response)
    except (ChartNotFoundError, CheckError) as error:
        if photo.kind is not PhotoKind.RAW:
            return None
        raise InputError(f"{photo.source} is a raw photo: its values are shares of what the sensor "
                         "can hold and not of white, and no chart in it tells what white reads "
                         f"({str(error).partition(';')[0]}). {remedy}") from None
