"""The factor between a rendering and a photo, carried from one exposure to another."""
from __future__ import annotations

import numpy as np

from radiometry.errors import InputError
from radiometry.records import LightScale, LinearImage

SAME_SETTING = 1e-6


def exposure_product(photo: LinearImage, name: str) -> float:
    """Exposure time x ISO / f-number squared, to which a linear signal is proportional.

    Raises
    ------
    InputError
        If the photo does not say how it was exposed.
    """
    if photo.exposure_s is None:
        raise InputError(f"{name} states no exposure time, so its signal cannot be compared with the chart photo's; "
                         "take the scale from a known material instead ([scale] from = \"material\")")
    iso = photo.iso if photo.iso is not None else 1.0
    f_number = photo.f_number if photo.f_number else 1.0
    return photo.exposure_s * iso / f_number**2


def scale_for_photo(scale: LightScale, calibrated_on: LinearImage, photo: LinearImage) -> LightScale:
    """The light scale of another photo under the same light, by the ratio of exposures.

    Raises
    ------
    InputError
        If only one of the two photos states an ISO or f-number, or either states no exposure time.
    """
    for setting in ("iso", "f_number"):
        if (getattr(calibrated_on, setting) is None) != (getattr(photo, setting) is None):
            raise InputError(f"only one of {calibrated_on.source} and {photo.source} states its {setting}; "
                             "shoot both with the same camera settings")
    ratio = exposure_product(photo, photo.source) / exposure_product(calibrated_on, calibrated_on.source)
    error = None if scale.standard_error is None else scale.standard_error * ratio
    how = scale.source if abs(ratio - 1) < SAME_SETTING else f"{scale.source}, times {ratio:.4g} for the exposure"
    return LightScale(scale.value * ratio, error, scale.residuals, how)


def scale_from_signals(measured: np.ndarray, predicted: np.ndarray, relative_error: float, source: str) -> LightScale:
    """Closed-form weighted least squares of measured (R, K) against predicted (R, K), all known to ``relative_error``.

    The signal is linear in the light: a render at 2.5 times the light is 2.5 times the image.
    """
    weight = 1 / (relative_error * measured) ** 2
    curvature = np.sum(weight * predicted**2)
    value = np.sum(weight * measured * predicted) / curvature
    residuals = 1 - value * predicted / measured
    misfit = max(np.sum(weight * (measured - value * predicted) ** 2) / max(measured.size - 1, 1), 1.0)
    return LightScale(float(value), float(np.sqrt(misfit / curvature)), residuals, source)
