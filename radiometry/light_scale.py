"""The factor between a rendering and a photo, carried from one exposure to another, and the drift
of the light between two photos, from neutral references in both.
"""
from __future__ import annotations

import numpy as np
from scipy.special import chdtri

from spectrabox.radiometry.error_model import DRIFT, ROUNDED_EXPOSURES, with_common_error
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records.calibration import LightDrift, LightScale
from spectrabox.radiometry.records.photos import LinearImage

SAME_SETTING = 1e-6
# Of the times that cameras state: 1/125, 1/60.
DIAL_DIGITS = (1, 1.25, 1.3, 1.5, 1.6, 2, 2.5, 3, 3.2, 4, 5, 6, 6.4, 8)
MAX_FRACTION_S = 0.26
MAX_ROUNDING_STOPS = 0.1     # 1/60 s is 1/64 s, by 0.093
NOTABLE_ROUNDING = 0.001
SIGNIFICANCE = 1e-3         # of a change of colour, falsely in one pair of photos of a thousand


def exposure_ratio(before: LinearImage, after: LinearImage) -> float:
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
            raise InputError(f"only one of {before.source} and {after.source} states its "
                             f"{setting}; shoot both with the same camera settings")
    exposures = []
    for photo in (after, before):
        if photo.exposure_s is None:
            raise InputError(f"{photo.source} states no exposure time, so its signal cannot be "
                             "compared with the chart photo's; take the scale from a known "
                             "material instead ([scale] from = \"material\")")
        iso = photo.iso if photo.iso is not None else 1.0
        exposures.append(photo.exposure_s * iso / (photo.f_number or 1.0)**2)
    return exposures[0] / exposures[1]


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


def scale_from_signals(measured: np.ndarray, predicted: np.ndarray, relative_error: float,
                       source: str, readable: np.ndarray | None = None) -> LightScale:
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
    return LightScale(float(value), float(np.sqrt(max(misfit / curvature, by_region))), residuals,
                      source)


def light_drift(before: np.ndarray, after: np.ndarray,
                relative_error: float) -> tuple[np.ndarray, np.ndarray]:
    """Change of the light between two photos of the same neutral reference.

    Parameters
    ----------
    before, after : (R, K) arrays
        Signals of the same R neutral regions, divided by their exposures (see
        ``exposure_ratio``).
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


def drift_between(chart_photo: LinearImage, chart_signals: np.ndarray, object_photo: LinearImage,
                  object_signals: np.ndarray, relative_error: float) -> LightDrift:
    """Drift of the light from signals of the same references in two photos.

    Parameters
    ----------
    chart_photo, object_photo : LinearImage
        For their exposures.
    chart_signals, object_signals : (R, K) arrays
        Of the same R neutral references, at the same angle to the light.
    relative_error : float
        Of each signal: how well a reference returns to its position and angle.

    Raises
    ------
    InputError
        If the photos show different numbers of references, or one does not say how it was exposed,
        or says less of it than the other.
    """
    if chart_signals.shape != object_signals.shape:
        raise InputError(f"the chart photo names {len(chart_signals)} references and the object "
                         f"photo {len(object_signals)}; name the same ones in both, in one order")
    before, after = chart_signals, object_signals / exposure_ratio(chart_photo, object_photo)
    ratio, error = light_drift(before, after, relative_error)
    # A reference that is brighter is so in all bands: its error is common to them, that of
    # colour is not.
    relative = error / ratio
    level = float(np.exp(np.log(ratio).mean()))
    level_error = float(level * relative.max())
    colour = ratio / level - 1
    colour_error = _colour_error(before, after, relative_error)
    changed = bool(np.sum((colour / colour_error) ** 2)
                   > chdtri(max(len(ratio) - 1, 1), SIGNIFICANCE))
    return LightDrift(ratio, error, level, level_error, colour, changed,
                      _sentence(level, level_error, colour, changed,
                                rounding_error(chart_photo, object_photo)))


def scale_after_drift(scale: LightScale, drift: LightDrift) -> LightScale:
    """The light scale of the object photo after a drift of the light's level, errors included.

    Parameters
    ----------
    scale : LightScale
        By the exposures alone.
    drift : LightDrift
    """
    error = None if scale.standard_error is None else scale.standard_error * drift.level
    drifted = LightScale(scale.value * drift.level, error, scale.residuals,
                         f"{scale.source}, times {drift.level:.4g} for the light's drift",
                         scale.common_errors)
    return with_common_error(drifted, DRIFT, drift.level_error / drift.level)


def _colour_error(before: np.ndarray, after: np.ndarray, relative_error: float) -> np.ndarray:
    """Standard error of each band's log ratio relative to the bands' mean.

    From its scatter over the references, at least the stated error.
    """
    logs = np.log(after / before)
    own = logs - logs.mean(axis=1, keepdims=True)
    scatter = own.std(axis=0, ddof=1) if len(own) > 1 else np.zeros(logs.shape[1])
    free = np.sqrt(1 - 1 / logs.shape[1])  # the common mean takes one of K degrees of freedom
    return np.maximum(scatter / free, np.sqrt(2) * relative_error) / np.sqrt(len(own))


def _sentence(level: float, error: float, colour: np.ndarray, changed: bool, rounded: float) -> str:
    word = "brighter" if level > 1 else "dimmer"
    sentence = (f"the light was {abs(level - 1):.2%} {word} in the object photo than in the chart "
                f"photo (standard error {error:.2%}); the light scale takes it into account")
    if rounded > NOTABLE_ROUNDING:
        sentence += f"; {rounded:.1%} of it may be how the camera rounds the exposures it states"
    if changed:
        sentence += (f"; its colour changed by up to {np.abs(colour).max():.2%}, which widens "
                     "every error: let the lamp warm up, take both photos closer in time, or "
                     "measure its spectrum at both")
    return sentence
