"""The pointwise 90 % band of fitted curves, and draws of the curves where there is a posterior."""
from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from spectrabox.calibrate.chart_calibration import ChartCalibration
from spectrabox.calibrate.prior.curve_posterior import draw_curves
from spectrabox.radiometry.shaped import Record

LEVEL = 0.9
NORMAL_QUANTILE = 1.6449    # of the level, two-sided
DRAWS = 1000


@dataclass(frozen=True, eq=False)
class CurveBand(Record):
    """Band of curves of largest value 1; draws are None for methods without a posterior."""

    lower: Annotated[np.ndarray, "K P"]
    upper: Annotated[np.ndarray, "K P"]
    draws: Annotated[np.ndarray, "T K P"] | None


def curve_band(calibration: ChartCalibration, seed: int = 0) -> CurveBand | None:
    """The band of a calibration's curves; None for measured curves.

    Quantiles of 1000 draws with the method ``prior``, else from the standard error.

    Parameters
    ----------
    calibration : ChartCalibration
    seed : int
        Of the draws.
    """
    fit = calibration.calibration.sensitivity
    if calibration.prior_fit is not None:
        draws = draw_curves(calibration.prior_fit.posterior, len(fit.curves), DRAWS, seed).curves
        lower, upper = np.quantile(draws, [(1 - LEVEL) / 2, (1 + LEVEL) / 2], axis=0)
        return CurveBand(lower, upper, draws)
    if fit.standard_error is None:
        return None
    half = NORMAL_QUANTILE * fit.standard_error
    return CurveBand(np.maximum(fit.curves - half, 0), fit.curves + half, None)
