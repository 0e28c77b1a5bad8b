"""The factor between a rendering and a photo, carried from one exposure to another."""
from __future__ import annotations

import numpy as np

from spectrabox.radiometry import error_model, errors
from spectrabox.radiometry.records import calibration, photos

SAME_SETTING = 1e-6
# Of the times that cameras state: 1/125, 1/60.
DIAL_DIGITS = (1, 1.25, 1.3, 1.5, 1.6, 2, 2.5, 3, 3.2, 4, 5, 6, 6.4, 8)
MAX_FRACTION_S = 0.26
MAX_ROUNDING_STOPS = 0.1     # 1/60 s is 1/64 s, by 0.093


def exposure_ratio(before: photos.LinearImage, after: photos.LinearImage) -> float:
    """Exposure of a photo relative to that of another, by their stated settings.

    A linear signal is proportional to exposure time x ISO / f-number squared.

    Parameters
    ----------
    before, after : LinearImage

    Raises
    ------
    InputError
        If only one of the two photos states an ISO or f-number, or either states no exposure time.
    """
    for setting in ("iso", "f_number"):
        if (getattr(before, setting) is None) != (getattr(after, setting) is None):
            raise errors.InputError(f"only one of {before.source} and {after.source} states its "
                             f"{setting}; shoot both with the same camera settings")
    exposures = []
    for photo in (after, before):
        if photo.exposure_s is None:
            raise errors.InputError(
                f"{photo.source} states no exposure time, so its signal cannot be "
                "compared with the chart photo's; take the scale from a known "
                "material instead ([scale] from = \"material\")")
        iso = photo.iso if photo.iso is not None else 1.0
        exposures.append(photo.exposure_s * iso / (photo.f_number or 1.0)**2)
    return exposures[0] / exposures[1]


def rounding_error(before: photos.LinearImage, after: photos.LinearImage) -> float:
    """Relative error of ``exposure_ratio`` by the rounding of stated settings.

    A camera states 1/60 s for 1/64 s, f/11 for f/11.3: the error is the difference to the ratio of
    the nearest thirds of a stop. It is 0 at equal settings, and of times where one of them is on no
    dial: those are measured or exact.

    Parameters
    ----------
    before, after : LinearImage
    """
    stops = 0.0
    if before.exposure_s and after.exposure_s and _on_dial(before.exposure_s) and _on_dial(
        after.exposure_s):
        stops += _off_third(after.exposure_s) - _off_third(before.exposure_s)
    if before.f_number and after.f_number:
        stops -= _off_third(after.f_number**2) - _off_third(before.f_number**2)
    return float(abs(2**stops - 1))


def _on_dial(exposure_s: float) -> bool:
    shown = exposure_s if exposure_s > MAX_FRACTION_S else 1 / exposure_s
    digits = shown / 10 ** np.floor(np.log10(shown) + SAME_SETTING)
    return bool(np.any(np.abs(np.array(DIAL_DIGITS) / digits - 1) < SAME_SETTING))


def _off_third(value: float) -> float:
    """Stops from the nearest third of a stop; 0 where further than cameras round (half stops)."""
    stops = float(np.log2(value))
    off = stops - round(3 * stops) / 3
    return off if abs(off) < MAX_ROUNDING_STOPS else 0.0


def scale_for_photo(scale: calibration.LightScale, calibrated_on: photos.LinearImage,
                    photo: photos.LinearImage) -> calibration.LightScale:
    """The light scale of another photo under the same light, by the ratio of exposures.

    Parameters
    ----------
    scale : LightScale
        Of the photo ``calibrated_on``.
    calibrated_on, photo : LinearImage
        For their exposures.

    Raises
    ------
    InputError
        As ``exposure_ratio``.
    """
    ratio = exposure_ratio(calibrated_on, photo)
    rounded = rounding_error(calibrated_on, photo)
    error = None if scale.standard_error is None else scale.standard_error * ratio
    how = (scale.source if abs(ratio - 1) < SAME_SETTING
           else f"{scale.source}, times {ratio:.4g} for the exposure")
    if rounded > SAME_SETTING:
        how += f", which is known to {rounded:.1%} as cameras round the settings they state"
    carried = calibration.LightScale(scale.value * ratio, error, scale.residuals, how,
                                     scale.common_errors)
    return error_model.with_common_error(carried, error_model.ROUNDED_EXPOSURES, rounded)


def scale_from_signals(measured: np.ndarray, predicted: np.ndarray, relative_error: float,
                       source: str, readable: np.ndarray | None = None) -> calibration.LightScale:
    """Closed-form weighted least squares of measured against predicted signals.

    The signal is linear in the light: a render at 2.5 times the light is 2.5 times the image. The
    standard error is the largest of three: by ``relative_error``, by the scatter of all signals,
    and by that of the regions. Errors of the bands of a region are correlated where its position,
    angle or paint is not as predicted; the bands then count as one signal.

    Parameters
    ----------
    measured, predicted : (R, K) arrays
    relative_error : float
        Of every signal.
    source : str
        Stored with the scale.
    readable : (R, K) bool array or None
        Signals that count; None for all.
    """
    readable = np.ones(measured.shape, bool) if readable is None else readable
    weight = readable / (relative_error * measured) ** 2
    curvature = np.sum(weight * predicted**2)
    value = np.sum(weight * measured * predicted) / curvature
    residuals = 1 - value * predicted / measured
    misfit = max(np.sum(weight * (measured - value * predicted) ** 2)
                 / max(np.count_nonzero(readable) - 1, 1), 1.0)
    regions = len(measured)
    pulls = np.sum(weight * predicted * (measured - value * predicted), axis=1) / curvature
    by_region = np.sum(pulls**2) * regions / max(regions - 1, 1)
    return calibration.LightScale(float(value), float(np.sqrt(max(misfit / curvature, by_region))),
                                  residuals, source)
