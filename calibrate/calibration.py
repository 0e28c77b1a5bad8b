"""A whole calibration: curves, light and scale, from chart photos or from measured curves."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from spectrabox.calibrate.chart_equations import ChartEquations, chart_equations
from spectrabox.calibrate.colour_matrix import matrix_sentences
from spectrabox.calibrate.measured_curves import check_measured_curves
from spectrabox.calibrate.photo_checks import disagreement, light_power, refuse_disagreement
from spectrabox.calibrate.prior.camera_prior import CameraPrior
from spectrabox.calibrate.sensitivity import (
    CHART_ERROR,
    SPLINE_COEFFICIENTS,
    PriorFit,
    default_prior,
    fit_sensitivities,
    fit_with_prior,
    relative_prediction_covariance,
    scale_of_photo,
)
from spectrabox.calibrate.spline_fit import SPLINE_BANDS
from spectrabox.calibrate.trust import chart_colour_differences, doubts, other_reading, sentences
from spectrabox.radiometry.chart import patch_centres_uv
from spectrabox.radiometry.errors import CheckError, InputError
from spectrabox.radiometry.light_scale import scale_from_signals
from spectrabox.radiometry.records import (
    Calibration,
    LightScale,
    Outcome,
    PatchSamples,
    SensitivityFit,
    Spectrum,
    WavelengthGrid,
)
from spectrabox.radiometry.response import response_matrix
from spectrabox.radiometry.shaped import Record

MIN_BANDS = 3
UNKNOWN_IRRADIANCE = np.full(24, np.pi)     # gives a reflectance of 1 a signal without scale


@dataclass(frozen=True, eq=False)
class ChartPhoto(Record):
    """A photo of a chart: its patches, their reflectances, and the light on them."""

    samples: PatchSamples
    reflectances: Annotated[np.ndarray, "24 P"]
    light: Spectrum
    # On each patch for a light spectrum of 1. None: not known, a smooth field is allowed.
    irradiance: Annotated[np.ndarray, "24"] | None = None


@dataclass(frozen=True)
class CalibrationOptions:
    """What an operator may choose of a calibration."""

    method: str = "prior"                       # or one of spline_fit.SPLINE_METHODS
    prior: CameraPrior | None = None            # None: shipped, or smoothness for other bands
    coefficients: int = SPLINE_COEFFICIENTS     # of each band, for "paper" and "nonnegative"
    curves: np.ndarray | None = None            # (K, P) measured; fits none, whatever the method


@dataclass(frozen=True, eq=False)
class ChartCalibration(Record):
    """A calibration with everything that led to it."""

    calibration: Calibration
    scale: LightScale                               # also where the calibration has none
    predicted: Annotated[np.ndarray, "24 K"]
    held_out: Annotated[np.ndarray, "24 K"]         # each patch predicted from the others
    delta_e: Annotated[np.ndarray, "24"]            # CIEDE2000 of each patch, fitted
    held_out_delta_e: Annotated[np.ndarray, "24"]   # the same, the patch left out of the fit
    prior_fit: PriorFit | None                      # of the method "prior"


def calibrate_chart(photos: Sequence[ChartPhoto], grid: WavelengthGrid,
                    options: CalibrationOptions | None = None) -> ChartCalibration:
    """Calibration of a camera and its light from photos of a chart.

    Parameters
    ----------
    photos : sequence of ChartPhoto
        By one camera. Light, scale, predicted signals and colour differences are those of
        the first; more than one needs the method ``prior``. With a known irradiance of the first,
        the calibration carries a light scale.
    grid : WavelengthGrid
        Working grid, of P wavelengths.
    options : CalibrationOptions or None
        None takes the defaults.

    Raises
    ------
    InputError
        If a photo has fewer than 3 bands, several are given to a method that takes one, the method
        is not known, or a light cannot be one (see ``light_power``).
    CheckError
        If no camera explains the patches, or given curves explain them only if the photo is read in
        another way.
    CalibrationError
        If chart and light do not determine the curves (see ``fit_sensitivities``).
    """
    chosen = CalibrationOptions() if options is None else options
    first = photos[0]
    _require_bands(first.samples)
    if len(photos) > 1 and (chosen.curves is not None or chosen.method != "prior"):
        method = chosen.method if chosen.curves is None else "file"
        raise InputError(f"method {method} takes one photo; {len(photos)} photos need method prior")
    power, unseen = light_power(first.light, grid)
    lit = UNKNOWN_IRRADIANCE if first.irradiance is None else first.irradiance
    prior_fit = None
    if chosen.curves is not None:
        fit, scale, predicted = _from_measured(first.samples, first.reflectances, power, lit, grid,
                                               chosen.curves)
        said: tuple[str, ...] = (
            check_measured_curves(_as_equations(first, grid), chosen.curves, grid),)
    elif chosen.method == "prior":
        equations = [_as_equations(photo, grid) for photo in photos]
        prior_fit = prior_calibration(equations, grid, chosen.prior)
        fit, scale = prior_fit.sensitivity, scale_of_photo(prior_fit, 0)
        predicted, said = prior_fit.photos[0].predicted, sentences(prior_fit, grid)
    else:
        fit, scale = fit_sensitivities(first.samples, first.reflectances, power, lit, grid,
                                       chosen.coefficients, method=chosen.method)
        said = (SPLINE_BANDS[chosen.method],)
        predicted = scale.value * _chart_signals(grid, fit.curves, power, first.reflectances, lit)
    held_out = fit.residuals if fit.held_out_residuals is None else fit.held_out_residuals
    assert held_out is not None
    covariance = relative_prediction_covariance(held_out, first.samples)
    without = first.samples.mean * (1 - held_out)
    delta_e, delta_e_without = (
        chart_colour_differences(first.samples.mean, signal, first.reflectances, grid)
        for signal in (predicted, without))
    left_out = ("" if chosen.curves is not None
                else f", {delta_e_without.mean():.2f} for patches left out of the fit")
    checks = (f"chart colour difference {delta_e.mean():.2f} CIEDE2000{left_out}",
              *_checks(fit, covariance, scale), *unseen, *said,
              *matrix_sentences(first.samples.camera_from_xyz, fit.curves, grid))
    calibration = Calibration(fit, first.light, None if first.irradiance is None else scale,
                              covariance, checks, () if prior_fit is None else doubts(prior_fit))
    return ChartCalibration(calibration, scale, predicted, without, delta_e, delta_e_without,
                            prior_fit)


def prior_calibration(photos: list[ChartEquations], grid: WavelengthGrid,
                      prior: CameraPrior | None = None) -> PriorFit:
    """The joint estimate from chart photos, refused where no camera explains them.

    Parameters
    ----------
    photos : list of ChartEquations
        By one camera.
    grid : WavelengthGrid
        Working grid, of P wavelengths.
    prior : CameraPrior or None
        None: see ``default_prior``.

    Raises
    ------
    CheckError
        If the patches disagree with the reference under any camera; it says which photo, and which
        other reading of it would agree.
    """
    joint = fit_with_prior(photos, prior, grid)
    if not joint.disagrees:
        return joint
    known = default_prior(photos, grid) if prior is None else prior
    alone = ([joint] if len(photos) == 1
             else [fit_with_prior([photo], known, grid) for photo in photos])
    for number, (photo, fit) in enumerate(zip(photos, alone, strict=True), start=1):
        if fit.disagrees:
            which = "the chart photo" if len(photos) == 1 else f"chart photo {number}"
            refuse_disagreement(f"no camera explains {which}",
                                disagreement(photo.signal, fit.held_out[0]), fit.chi_square,
                                other_reading(photo, known, grid))
    raise CheckError(f"each of the {len(photos)} chart photos can be explained, but not all by one "
                     f"camera (chi-square {joint.chi_square:.1f} per signal together); check that "
                     "the camera and its settings were the same, and that each photo has the "
                     "spectrum of its own light")


def calibration_from_curves(grid: WavelengthGrid, curves: np.ndarray, light: Spectrum,
                            relative_error: float) -> Calibration:
    """Calibration from measured curves alone, without a chart photo.

    Parameters
    ----------
    grid : WavelengthGrid
        Working grid, of P wavelengths.
    curves : (K, P) array
        Measured sensitivities, the largest value of all bands being 1.
    light : Spectrum
    relative_error : float
        Within which predicted signals are taken to be right, independent in each band.
    """
    covariance = np.eye(len(curves)) * relative_error**2
    note = ("sensitivities taken as given; predicted signals assumed right within "
            f"{relative_error:.1%} a band")
    return Calibration(_measured_curves(grid, curves, None), light, None, covariance, (note,))


def _require_bands(samples: PatchSamples) -> None:
    bands = samples.mean.shape[1]
    if bands < MIN_BANDS:
        raise InputError(f"the photo has {bands} band{'s' * (bands > 1)}; {MIN_BANDS} or more "
                         "are needed: stack photos that were taken through different filters into "
                         "one of several bands")


def _as_equations(photo: ChartPhoto, grid: WavelengthGrid) -> ChartEquations:
    """A photo as equations, with a field where the illumination of the chart is not known."""
    power, _ = light_power(photo.light, grid)
    if photo.irradiance is None:
        return chart_equations(photo.samples, photo.reflectances, power, UNKNOWN_IRRADIANCE, grid,
                           positions=patch_centres_uv())
    return chart_equations(photo.samples, photo.reflectances, power, photo.irradiance, grid)


def _from_measured(samples: PatchSamples, reflectances: np.ndarray, power: np.ndarray,
                   irradiance: np.ndarray, grid: WavelengthGrid,
                   curves: np.ndarray) -> tuple[SensitivityFit, LightScale, np.ndarray]:
    unscaled = _chart_signals(grid, curves, power, reflectances, irradiance)
    scale = scale_from_signals(samples.mean, unscaled, CHART_ERROR, "chart photo")
    return _measured_curves(grid, curves, scale.residuals), scale, scale.value * unscaled


def _chart_signals(grid: WavelengthGrid, curves: np.ndarray, power: np.ndarray,
                   reflectances: np.ndarray, irradiance: np.ndarray) -> np.ndarray:
    return reflectances @ response_matrix(grid, curves, power).T * (irradiance / np.pi)[:, None]


def _measured_curves(grid: WavelengthGrid, curves: np.ndarray,
                     residuals: np.ndarray | None) -> SensitivityFit:
    return SensitivityFit(grid, curves, None, None, None, None, residuals, None, None,
                          "measured curves from a file", Outcome.CONVERGED)


def _checks(fit: SensitivityFit, covariance: np.ndarray, scale: LightScale) -> tuple[str, ...]:
    checks = [f"relative error of predicted signals {np.sqrt(np.diag(covariance)).max():.1%} in "
              "the worst band, from patches left out of the fit"]
    if fit.condition_number is not None:
        checks.append(f"condition number {fit.condition_number:.4g}")
    if scale.standard_error is not None:
        checks.append("signal of a perfect reflector (light scale times curves) known to "
                      f"{scale.standard_error / scale.value:.2%} in each band")
    return tuple(checks)
