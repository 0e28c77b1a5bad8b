"""The camera's own curves and their band, read off a calibration."""
from __future__ import annotations

from dataclasses import replace

import numpy as np

from spectrabox.calibrate.chart_calibration import ChartCalibration
from spectrabox.calibrate.prior import curve_posterior
from spectrabox.radiometry.records.calibration import SensitivityFit

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
    coefficients, covariance, _ = curve_posterior.curve_moments(alone, bands)
    return replace(
        fit, curves=coefficients @ alone.basis.T, coefficients=coefficients,
        covariance=covariance, standard_error=np.sqrt(
            curve_posterior.curve_variance(alone.basis, covariance, bands)))


def curve_draws(calibration: ChartCalibration, seed: int = 0) -> np.ndarray | None:
    """1000 draws (T, K, P) of the camera's curves of largest value 1; None by methods without a
    posterior.

    Parameters
    ----------
    calibration : ChartCalibration
    seed : int
    """
    if calibration.prior_fit is None:
        return None
    bands = len(calibration.calibration.sensitivity.curves)
    return curve_posterior.draw_curves(
        curve_posterior.camera_alone(calibration.prior_fit.posterior, bands), bands, DRAWS, seed)


def curve_band(calibration: ChartCalibration,
               draws: np.ndarray | None) -> tuple[np.ndarray, np.ndarray] | None:
    """Lower and upper end (K, P) of the pointwise 90 % band of the camera's curves; None for
    measured curves.

    Quantiles of the draws where there are any, else from the standard error.

    Parameters
    ----------
    calibration : ChartCalibration
    draws : (T, K, P) array or None
        From ``curve_draws``.
    """
    fit = calibration.calibration.sensitivity
    if draws is not None:
        lower, upper = np.quantile(draws, [(1 - LEVEL) / 2, (1 + LEVEL) / 2], axis=0)
        return lower, upper
    if fit.standard_error is None:
        return None
    half = NORMAL_QUANTILE * fit.standard_error
    return np.maximum(fit.curves - half, 0), fit.curves + half
