"""The camera's own curves and their band, read off a calibration."""
from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from spectrabox.calibrate.chart_calibration import ChartCalibration
from spectrabox.calibrate.prior import curve_posterior
from spectrabox.radiometry.records.calibration import SensitivityFit
from spectrabox.radiometry.shaped import Record

LEVEL = 0.9                 # of the band of curves
NORMAL_QUANTILE = 1.6449    # of that level, two-sided
DRAWS = 1000                # of the curves


def camera_curves(calibration: ChartCalibration) -> SensitivityFit:
    """The camera's curves by themselves, for use under any light.

    Those of a calibration belong to its stated light: together they give the chart's signals. Where
    the fit infers that another light shone the camera's own curves are others.

    Parameters
    ----------
    calibration : ChartCalibration
    """
    fit, joint = calibration.calibration.sensitivity, calibration.prior_fit
    if joint is None or not joint.posterior.lights:
        return fit
    bands = len(fit.curves)
    alone = curve_posterior.camera_alone(joint.posterior, bands)
    moments = curve_posterior.curve_moments(alone, bands)
    return replace(
        fit, curves=moments.coefficients @ alone.basis.T, coefficients=moments.coefficients,
        covariance=moments.covariance, standard_error=np.sqrt(
            curve_posterior.curve_variance(alone.basis, moments.covariance, bands)))


@dataclass(frozen=True, eq=False)
class CurveBand(Record):
    """Band of curves of largest value 1; draws are None for methods without a posterior."""

    lower: Annotated[np.ndarray, "K P"]
    upper: Annotated[np.ndarray, "K P"]
    draws: Annotated[np.ndarray, "T K P"] | None


def curve_band(calibration: ChartCalibration, seed: int = 0) -> CurveBand | None:
    """The pointwise 90 % band of the camera's curves; None for measured curves.

    Quantiles of 1000 draws with the method ``prior``, else from the standard error.

    Parameters
    ----------
    calibration : ChartCalibration
    seed : int
        Of the draws.
    """
    fit = calibration.calibration.sensitivity
    if calibration.prior_fit is not None:
        draws = curve_posterior.draw_curves(
            curve_posterior.camera_alone(calibration.prior_fit.posterior, len(fit.curves)),
            len(fit.curves), DRAWS, seed)
        lower, upper = np.quantile(draws, [(1 - LEVEL) / 2, (1 + LEVEL) / 2], axis=0)
        return CurveBand(lower, upper, draws)
    if fit.standard_error is None:
        return None
    half = NORMAL_QUANTILE * fit.standard_error
    return CurveBand(np.maximum(fit.curves - half, 0), fit.curves + half, None)
