"""The factor between a rendering and a photo, carried from one exposure to another."""
from __future__ import annotations

import dataclasses

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records import CommonError, LightScale, LinearImage

SAME_SETTING = 1e-6
# Of the times that cameras state: 1/125, 1/60.
DIAL_DIGITS = (1, 1.25, 1.3, 1.5, 1.6, 2, 2.5, 3, 3.2, 4, 5, 6, 6.4, 8)
MAX_FRACTION_S = 0.26
MAX_ROUNDING_STOPS = 0.1     # 1/60 s is 1/64 s, by 0.093
# causes of errors that all bands of a photo share
REPEATABILITY = "light and shutter repeat"
ROUNDED_EXPOSURES = "rounded exposures"
DRIFT = "drift of the light"
LAMP_AT_CHART = "lamp position at chart"


def exposure_product(photo: LinearImage, name: str) -> float:
    """Exposure time x ISO / f-number squared, to which a linear signal is proportional.

    Parameters
    ----------
    photo : LinearImage
    name : str
        Of the photo, for errors.

    Raises
    ------
    InputError
        If the photo does not say how it was exposed.
    """
    if photo.exposure_s is None:
        raise InputError(f"{name} states no exposure time, so its signal cannot be compared with "
                         "the chart photo's; take the scale from a known material instead ([scale] "
                         "from = \"material\")")
    iso = photo.iso if photo.iso is not None else 1.0
    f_number = photo.f_number if photo.f_number else 1.0
    return photo.exposure_s * iso / f_number**2


def exposure_ratio(before: LinearImage, after: LinearImage) -> float:
    """Exposure of a photo relative to that of another, by their stated settings.

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
            raise InputError(f"only one of {before.source} and {after.source} states its "
                             f"{setting}; shoot both with the same camera settings")
    return exposure_product(after, after.source) / exposure_product(before, before.source)


def rounding_error(before: LinearImage, after: LinearImage) -> float:
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


def scale_for_photo(scale: LightScale, calibrated_on: LinearImage, photo: LinearImage,
                    compared: bool = False) -> LightScale:
    """The light scale of another photo under the same light, by the ratio of exposures.

    Parameters
    ----------
    scale : LightScale
        Of the photo ``calibrated_on``.
    calibrated_on, photo : LinearImage
        For their exposures.
    compared : bool
        Whether a reference in both photos will tell how the exposures compare
        (``light_drift.scale_after_drift``), so that the rounding of stated settings is no error.

    Raises
    ------
    InputError
        As ``exposure_ratio``.
    """
    ratio = exposure_ratio(calibrated_on, photo)
    rounded = 0.0 if compared else rounding_error(calibrated_on, photo)
    error = None if scale.standard_error is None else scale.standard_error * ratio
    how = (scale.source if abs(ratio - 1) < SAME_SETTING
           else f"{scale.source}, times {ratio:.4g} for the exposure")
    if rounded > SAME_SETTING:
        how += f", which is known to {rounded:.1%} as cameras round the settings they state"
    carried = LightScale(scale.value * ratio, error, scale.residuals, how, scale.common_errors)
    return with_common_error(carried, ROUNDED_EXPOSURES, rounded)


def with_common_error(scale: LightScale, cause: str, relative: float) -> LightScale:
    """The scale with one more error, independent of its others, that all bands share.

    Parameters
    ----------
    scale : LightScale
    cause : str
    relative : float
        Standard error; 0 leaves the scale as it is.
    """
    if relative == 0:
        return scale
    error = scale.standard_error
    if error is not None:
        error = float(np.hypot(error, relative * scale.value))
    return dataclasses.replace(scale, standard_error=error, common_errors=(
        *scale.common_errors, CommonError(cause, relative)))


def error_of_each_band(scale: LightScale) -> float:
    """Relative standard error of the scale in one band without what all bands share; 0 where
    nobody stated it.
    """
    if scale.standard_error is None:
        return 0.0
    common = sum(error.relative**2 for error in scale.common_errors)
    return float(np.sqrt(max((scale.standard_error / scale.value) ** 2 - common, 0.0)))


def scale_from_signals(measured: np.ndarray, predicted: np.ndarray, relative_error: float,
                       source: str) -> LightScale:
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
    """
    weight = 1 / (relative_error * measured) ** 2
    curvature = np.sum(weight * predicted**2)
    value = np.sum(weight * measured * predicted) / curvature
    residuals = 1 - value * predicted / measured
    misfit = max(np.sum(weight * (measured - value * predicted) ** 2) / max(measured.size - 1, 1),
                 1.0)
    regions = len(measured)
    pulls = np.sum(weight * predicted * (measured - value * predicted), axis=1) / curvature
    by_region = np.sum(pulls**2) * regions / max(regions - 1, 1)
    return LightScale(float(value), float(np.sqrt(max(misfit / curvature, by_region))), residuals,
                      source)


def light_drift(before: np.ndarray, after: np.ndarray,
                relative_error: float) -> tuple[np.ndarray, np.ndarray]:
    """Change of the light between two photos of the same neutral reference.

    Parameters
    ----------
    before, after : (R, K) arrays
        Signals of the same R neutral regions, divided by their exposures (see
        ``exposure_product``).
    relative_error : float
        Of each signal.

    Returns
    -------
    ratio : (K,) after / before in each band; all alike is a change of level, else of colour
    standard_error : (K,)
        From the scatter over the regions, and never below what ``relative_error`` says.
    """
    logs = np.log(after / before)
    ratio = np.exp(logs.mean(axis=0))
    scatter = logs.std(axis=0, ddof=1) if len(logs) > 1 else np.zeros(logs.shape[1])
    return ratio, ratio * np.maximum(scatter, np.sqrt(2) * relative_error) / np.sqrt(len(logs))
