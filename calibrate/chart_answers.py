"""The answer to one chart photo: curves with their 90 % band and the figures that say whether to
trust them.
"""
from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from spectrabox.calibrate.calibration import ChartCalibration, ChartShot, calibrate_chart
from spectrabox.calibrate.prior.camera_prior import CameraPrior
from spectrabox.calibrate.prior.curve_posterior import draw_curves
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records import PatchSamples, Spectrum, WavelengthGrid
from spectrabox.radiometry.shaped import Record

LEVEL = 0.9
NORMAL_QUANTILE = 1.6449
DRAWS = 1000
MIN_BANDS = 3


@dataclass(frozen=True, eq=False)
class ChartAnswer(Record):
    """Curves of largest value 1 and their pointwise 90 % band; band and draws are None for measured
    curves.
    """

    made: ChartCalibration
    curves: Annotated[np.ndarray, "K P"]
    lower: Annotated[np.ndarray, "K P"] | None
    upper: Annotated[np.ndarray, "K P"] | None
    draws: Annotated[np.ndarray, "T K P"] | None
    delta_e: Annotated[np.ndarray, "I"]             # CIEDE2000 of each patch, fitted
    held_out_delta_e: Annotated[np.ndarray, "I"]    # the same, the patch left out of the fit


def answer_chart(samples: PatchSamples, reflectances: np.ndarray, light: Spectrum,
                 grid: WavelengthGrid, *, method: str | None = None,
                 prior: CameraPrior | None = None, curves: np.ndarray | None = None,
                 irradiance: np.ndarray | None = None, more: tuple[ChartShot, ...] = (),
                 seed: int = 0) -> ChartAnswer:
    """Everything that one chart photo, or several, say of a camera.

    Parameters
    ----------
    reflectances : (24, P) array
    method, prior, curves
        As in ``calibration_from_chart``.
    irradiance : (24,) array or None
        On each patch for a light spectrum of 1; None: not known, a smooth field is allowed.
    more : tuple of ChartShot
        Further photos by the same camera; colour differences are of the first.

    Raises
    ------
    InputError
        If the photo has fewer than 3 bands; others as of ``calibrate_chart``.
    """
    bands = samples.mean.shape[1]
    if bands < MIN_BANDS:
        raise InputError(f"the photo has {bands} band{'s' * (bands > 1)}; {MIN_BANDS} or more "
                         "are needed: stack photos that were taken through different filters into "
                         "one of several bands")
    even = np.full(len(samples.mean), np.pi)
    made = calibrate_chart(samples, reflectances, light, even if irradiance is None else irradiance,
                           grid, method=method, prior=prior, curves=curves,
                           scaled=irradiance is not None, more=more)
    fit = made.calibration.sensitivity
    draws = lower = upper = None
    if made.found is not None:
        draws = draw_curves(made.found.posterior, len(fit.curves), DRAWS, seed).curves
        lower, upper = np.quantile(draws, [(1 - LEVEL) / 2, (1 + LEVEL) / 2], axis=0)
    elif fit.standard_error is not None:
        lower = np.maximum(fit.curves - NORMAL_QUANTILE * fit.standard_error, 0)
        upper = fit.curves + NORMAL_QUANTILE * fit.standard_error
    return ChartAnswer(made, fit.curves, lower, upper, draws, made.delta_e, made.held_out_delta_e)


def facts_of(result: ChartAnswer, grid: WavelengthGrid) -> dict[str, Any]:
    """The answer as plain numbers for a script."""
    calibration, found = result.made.calibration, result.made.found
    facts: dict[str, Any] = {
        "wavelengths_nm": grid.nm.tolist(), "sensitivities": result.curves.tolist(),
        "lower": None if result.lower is None else result.lower.tolist(),
        "upper": None if result.upper is None else result.upper.tolist(),
        "level": LEVEL, "condition_number": calibration.sensitivity.condition_number,
        "chart_delta_e00": float(result.delta_e.mean()),
        "held_out_delta_e00": float(result.held_out_delta_e.mean()),
        "chart_delta_e00_patches": result.delta_e.tolist(),
        "light_scale": result.made.scale.value,
        "light_scale_standard_error": result.made.scale.standard_error,
        "method": calibration.sensitivity.method, "checks": list(calibration.checks),
        "outcome": calibration.sensitivity.outcome.value}
    if found is not None:
        facts |= {"model_error": found.model_error, "chi_square": found.chi_square,
                  "prior_share": found.prior_share.tolist(), "photos": len(found.photos),
                  "field": found.photos[0].field.tolist(), "glare": found.photos[0].glare.tolist(),
                  "nearest_cameras": [{"cameras": members, "probability": share}
                                      for members, share in found.families]}
    return facts
