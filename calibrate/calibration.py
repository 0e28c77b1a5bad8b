"""A whole calibration: curves, light and scale, from a chart photo or from measured curves."""
from __future__ import annotations

import numpy as np

from calibrate.sensitivity import fit_sensitivities, relative_prediction_covariance
from radiometry.light_scale import scale_from_signals
from radiometry.records import Calibration, LightScale, Outcome, PatchSamples, SensitivityFit, Spectrum, WavelengthGrid
from radiometry.response import response_matrix
from radiometry.spectrum_files import spectrum_on_grid

CHART_ERROR = 0.01  # relative error of a patch against its published reflectance


def calibration_from_chart(samples: PatchSamples, reflectances: np.ndarray, light: Spectrum, irradiance: np.ndarray,
                           grid: WavelengthGrid, *, coefficients: int, curves: np.ndarray | None,
                           scaled: bool) -> tuple[Calibration, np.ndarray]:
    """Calibration from a chart photo, and the signal (24, K) that it predicts for the patches.

    Parameters
    ----------
    reflectances : (24, P) array
    irradiance : (24,) array
        On each patch for a light spectrum of 1; pi everywhere where the geometry is unknown.
    coefficients : int
        Of the spline of each band.
    curves : (K, P) array or None
        Measured sensitivities; None fits them.
    scaled : bool
        Whether the irradiance is that of the real geometry, so that a light scale follows.
    """
    power = spectrum_on_grid(light, grid)
    if curves is None:
        fit, scale = fit_sensitivities(samples, reflectances, power, irradiance, grid, coefficients)
        held_out = fit.held_out_residuals
    else:
        unscaled = _chart_signals(grid, curves, power, reflectances, irradiance)
        scale = scale_from_signals(samples.mean, unscaled, CHART_ERROR, "chart photo")
        fit, held_out = _measured_curves(grid, curves, scale.residuals), scale.residuals
    assert held_out is not None
    predicted = scale.value * _chart_signals(grid, fit.curves, power, reflectances, irradiance)
    covariance = relative_prediction_covariance(held_out, samples)
    return Calibration(fit, light, scale if scaled else None, covariance, _checks(fit, covariance, scale)), predicted


def calibration_from_curves(grid: WavelengthGrid, curves: np.ndarray, light: Spectrum,
                            relative_error: float) -> Calibration:
    """Calibration from measured curves alone; predicted signals are taken to be right within ``relative_error``."""
    covariance = np.eye(len(curves)) * relative_error**2
    note = f"sensitivities taken as given; predicted signals assumed right within {relative_error:.1%} a band"
    return Calibration(_measured_curves(grid, curves, None), light, None, covariance, (note,))


def _chart_signals(grid: WavelengthGrid, curves: np.ndarray, power: np.ndarray, reflectances: np.ndarray,
                   irradiance: np.ndarray) -> np.ndarray:
    return reflectances @ response_matrix(grid, curves, power).T * (irradiance / np.pi)[:, None]


def _measured_curves(grid: WavelengthGrid, curves: np.ndarray, residuals: np.ndarray | None) -> SensitivityFit:
    return SensitivityFit(grid, curves, None, None, None, None, residuals, None, None, "measured curves from a file",
                          Outcome.CONVERGED)


def _checks(fit: SensitivityFit, covariance: np.ndarray, scale: LightScale) -> tuple[str, ...]:
    checks = [f"relative error of predicted signals {np.sqrt(np.diag(covariance)).max():.1%} in the worst band, "
              "from patches left out of the fit"]
    if fit.condition_number is not None:
        checks.append(f"condition number {fit.condition_number:.0f}")
    if scale.standard_error is not None:
        checks.append(f"light scale known to {scale.standard_error / scale.value:.2%}")
    return tuple(checks)
