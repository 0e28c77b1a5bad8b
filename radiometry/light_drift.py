"""Drift of the light from chart photo to object photo, from neutral references in both."""
from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from spectrabox.radiometry.covariance import chi_square_beyond
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.light_scale import (
    DRIFT,
    exposure_ratio,
    light_drift,
    rounding_error,
    with_common_error,
)
from spectrabox.radiometry.records import LightScale, LinearImage
from spectrabox.radiometry.shaped import Record

NOTABLE_ROUNDING = 0.001
SIGNIFICANCE = 1e-3         # of a change of colour, falsely in one pair of photos of a thousand


@dataclass(frozen=True, eq=False)
class LightDrift(Record):
    """Change of the light from the chart photo to the object photo."""

    ratio: Annotated[np.ndarray, "K"]               # object / chart in each band
    standard_error: Annotated[np.ndarray, "K"]
    level: float                                    # common to all bands
    level_error: float
    colour: Annotated[np.ndarray, "K"]              # ratio / level - 1
    colour_changed: bool                            # beyond what the errors explain
    sentence: str


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
                   > chi_square_beyond(SIGNIFICANCE, max(len(ratio) - 1, 1)))
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


def drift_covariance(drift: LightDrift) -> np.ndarray:
    """Relative covariance (K, K) of predicted signals by a change of colour that no scale undoes.

    Parameters
    ----------
    drift : LightDrift
    """
    return np.outer(drift.colour,
                    drift.colour) if drift.colour_changed else np.zeros((drift.ratio.size,) * 2)


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
    said = (f"the light was {abs(level - 1):.2%} {word} in the object photo than in the chart "
            f"photo (standard error {error:.2%}); the light scale takes it into account")
    if rounded > NOTABLE_ROUNDING:
        said += f"; {rounded:.1%} of it may be how the camera rounds the exposures it states"
    if changed:
        said += (f"; its colour changed by up to {np.abs(colour).max():.2%}, which widens every "
                 "error: let the lamp warm up, take both photos closer in time, or measure its "
                 "spectrum at both")
    return said
