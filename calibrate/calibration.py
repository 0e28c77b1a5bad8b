"""A whole calibration: curves, light and scale, from a chart photo or from measured curves."""
from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from spectrabox.calibrate.chart_photo import ChartPhoto, chart_photo
from spectrabox.calibrate.measured_curves import check_measured_curves
from spectrabox.calibrate.photo_checks import light_power, refuse_disagreement
from spectrabox.calibrate.prior.camera_prior import CameraPrior
from spectrabox.calibrate.sensitivity import (
    SPLINE_COEFFICIENTS,
    PriorFit,
    default_prior,
    fit_sensitivities,
    fit_with_prior,
    relative_prediction_covariance,
    scale_of_photo,
)
from spectrabox.calibrate.spline_fit import SPLINE_BANDS
from spectrabox.calibrate.trust import chart_colour_differences, other_reading, sentences
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

CHART_ERROR = 0.01  # relative error of a patch against its published reflectance


@dataclass(frozen=True, eq=False)
class ChartShot(Record):
    """One more photo of a chart by the same camera: any light, exposure and chart of I patches."""

    samples: PatchSamples
    reflectances: Annotated[np.ndarray, "I P"]
    light: Spectrum
    # None: not known, a smooth field is allowed
    irradiance: Annotated[np.ndarray, "I"] | None = None


@dataclass(frozen=True, eq=False)
class ChartCalibration(Record):
    """A calibration with everything that led to it."""

    calibration: Calibration
    scale: LightScale  # also where the geometry is unknown and the calibration has none
    predicted: Annotated[np.ndarray, "I K"]
    held_out: Annotated[np.ndarray, "I K"]          # each patch predicted from the others
    delta_e: Annotated[np.ndarray, "I"]             # CIEDE2000 of each patch, fitted
    held_out_delta_e: Annotated[np.ndarray, "I"]    # the same, the patch left out of the fit
    found: PriorFit | None                          # of the method ``prior``


def calibration_from_chart(
        samples: PatchSamples, reflectances: np.ndarray, light: Spectrum, irradiance: np.ndarray,
        grid: WavelengthGrid, *, coefficients: int = SPLINE_COEFFICIENTS,
        curves: np.ndarray | None = None, scaled: bool = False, method: str | None = None,
        prior: CameraPrior | None = None,
        patch_places: np.ndarray | None = None) -> tuple[Calibration, np.ndarray]:
    """Calibration from a chart photo, and the signal (24, K) that it predicts for the patches.

    Parameters
    ----------
    reflectances : (24, P) array
    irradiance : (24,) array
        On each patch for a light spectrum of 1; pi everywhere where the geometry is unknown.
    coefficients : int
        Of the spline of each band, for the methods ``paper`` and ``nonnegative``.
    curves : (K, P) array or None
        Measured sensitivities; None fits them.
    scaled : bool
        Whether the irradiance is that of the real geometry, so that a light scale follows.
    method : str or None
        One of ``calibrate.sensitivity.METHODS``; None takes ``prior``.
    prior : CameraPrior or None
        None takes the one that comes with the project, or smoothness alone for cameras of other
        bands.
    patch_places : (24, 2) array or None
        Of the patches on the chart, for a smooth illumination field; None takes the printed chart's
        where the geometry is unknown and allows no field where it is known.

    Raises
    ------
    CheckError
        If no camera explains the patches, or given curves explain them only if the photo is read in
        another way.
    CalibrationError, InputError
        See ``fit_sensitivities`` and ``light_power``.
    """
    made = calibrate_chart(samples, reflectances, light, irradiance, grid,
                           coefficients=coefficients, curves=curves, scaled=scaled, method=method,
                           prior=prior, patch_places=patch_places)
    return made.calibration, made.predicted


def calibrate_chart(samples: PatchSamples, reflectances: np.ndarray, light: Spectrum,
                    irradiance: np.ndarray, grid: WavelengthGrid, *,
                    coefficients: int = SPLINE_COEFFICIENTS, curves: np.ndarray | None = None,
                    scaled: bool = False, method: str | None = None,
                    prior: CameraPrior | None = None, patch_places: np.ndarray | None = None,
                    more: tuple[ChartShot, ...] = ()) -> ChartCalibration:
    """The same with the joint estimate and the light scale whether or not the geometry is known.

    ``more`` are further photos for the method ``prior``; light, scale and predicted signals stay
    those of the first.

    Raises
    ------
    InputError
        If further photos are given to a method that takes one.
    """
    if more and (curves is not None or method not in (None, "prior")):
        raise InputError(f"method {method or 'file'} takes one photo; {1 + len(more)} photos need "
                         "method prior")
    power, unseen = light_power(light, grid)
    places = patch_centres_uv() if patch_places is None and not scaled else patch_places
    found = None
    said: tuple[str, ...] = ()
    if curves is not None:
        fit, scale, predicted = _from_measured(samples, reflectances, power, irradiance, grid,
                                               curves)
        said = (check_measured_curves(chart_photo(samples, reflectances, power, irradiance, grid,
                                                  places=places), curves, grid),)
    elif method in (None, "prior"):
        first = chart_photo(samples, reflectances, power, irradiance, grid, places=places)
        found = prior_calibration([first, *(_further(shot, grid) for shot in more)], grid, prior)
        fit, scale, predicted = (found.sensitivity, scale_of_photo(found, 0),
                                 found.photos[0].predicted)
        said = sentences(found, grid)
    else:
        assert method is not None
        fit, scale = fit_sensitivities(samples, reflectances, power, irradiance, grid, coefficients,
                                       method=method)
        said = (SPLINE_BANDS[method],)
        predicted = scale.value * _chart_signals(grid, fit.curves, power, reflectances, irradiance)
    held_out = fit.residuals if fit.held_out_residuals is None else fit.held_out_residuals
    assert held_out is not None
    covariance = relative_prediction_covariance(held_out, samples)
    without = samples.mean * (1 - held_out)
    delta_e, delta_e_without = (chart_colour_differences(samples.mean, signal, reflectances, grid)
                                for signal in (predicted, without))
    checks = (f"chart colour difference {delta_e.mean():.2f} CIEDE2000"
              + ("" if curves is not None else f", {delta_e_without.mean():.2f} for patches left "
                 "out of the fit"), *_checks(fit, covariance, scale), *unseen, *said)
    calibration = Calibration(fit, light, scale if scaled else None, covariance, checks)
    return ChartCalibration(calibration, scale, predicted, without, delta_e, delta_e_without, found)


def prior_calibration(photos: list[ChartPhoto], grid: WavelengthGrid,
                      prior: CameraPrior | None = None) -> PriorFit:
    """The joint estimate from chart photos, refused where no camera explains them.

    Raises
    ------
    CheckError
        If the patches disagree with the reference under any camera; it says which photo, and which
        other reading of it would agree.
    """
    found = fit_with_prior(photos, prior, grid)
    if not found.disagrees:
        return found
    known = default_prior(photos, grid) if prior is None else prior
    alone = [found] if len(photos) == 1 else [fit_with_prior([photo], known, grid)
                                              for photo in photos]
    for number, (photo, one) in enumerate(zip(photos, alone, strict=True), start=1):
        if one.disagrees:
            which = "the chart photo" if len(photos) == 1 else f"chart photo {number}"
            refuse_disagreement(f"no camera explains {which}", one.model_error, one.chi_square,
                                other_reading(photo, known, grid))
    raise CheckError(f"each of the {len(photos)} chart photos can be explained, but not all by one "
                     f"camera (chi-square {found.chi_square:.1f} per signal together); check that "
                     "the camera and its settings were the same, and that each photo has the "
                     "spectrum of its own light")


def calibration_from_curves(grid: WavelengthGrid, curves: np.ndarray, light: Spectrum,
                            relative_error: float) -> Calibration:
    """Calibration from measured curves alone; predicted signals are taken to be right within
    ``relative_error``.
    """
    covariance = np.eye(len(curves)) * relative_error**2
    note = ("sensitivities taken as given; predicted signals assumed right within "
            f"{relative_error:.1%} a band")
    return Calibration(_measured_curves(grid, curves, None), light, None, covariance, (note,))


def _further(shot: ChartShot, grid: WavelengthGrid) -> ChartPhoto:
    """One more photo as equations; a field is allowed where the illumination of a printed chart is
    not known.
    """
    power, _ = light_power(shot.light, grid)
    count = len(shot.samples.mean)
    even = np.full(count, np.pi) if shot.irradiance is None else shot.irradiance
    places = patch_centres_uv() if shot.irradiance is None and count == len(
        patch_centres_uv()) else None
    return chart_photo(shot.samples, shot.reflectances, power, even, grid, places=places)


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
        checks.append(f"light scale and curves together, as a band reads white, known to "
                      f"{scale.standard_error / scale.value:.2%}")
    return tuple(checks)
