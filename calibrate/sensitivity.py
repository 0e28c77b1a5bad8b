"""Camera sensitivities from the 24 patches of a chart photo (paper Eqs. 18-20), kept non-negative.

The paper solves for 10 spline coefficients a band with zero ends and no sign constraint; under a light of 1 % noise
that answer swings below zero. Here the same splines with zero ends are fitted with non-negative coefficients, and with
weights: every patch to 1 % of its signal, for the chart itself is not known better than that.
"""
from __future__ import annotations

import numpy as np
from scipy.linalg import block_diag
from scipy.optimize import nnls

from radiometry.bspline import basis_matrix
from radiometry.errors import CalibrationError
from radiometry.records import LightScale, Outcome, PatchSamples, SensitivityFit, WavelengthGrid

CHART_ERROR = 0.01           # relative: one chart against the published average
FLOOR = 0.005                # of the brightest patch: stray light and black level
DIM_PATCH = 0.03             # of the brightest patch: darker ones say nothing of relative errors
ILL_POSED_CONDITION = 100.0


def fit_sensitivities(patches: PatchSamples, reflectances: np.ndarray, light: np.ndarray, irradiance: np.ndarray,
                      grid: WavelengthGrid, coefficients: int = 10) -> tuple[SensitivityFit, LightScale]:
    """Sensitivities with their largest value 1, and the factor that was divided out.

    Parameters
    ----------
    patches : PatchSamples
        mean (24, K) signal.
    reflectances : (24, P) array
    light : (P,) array
        Spectrum of the light, any unit; the light scale is relative to it.
    irradiance : (24,) array
        Irradiance on each patch for a light spectrum of 1; constant where unknown.
    grid : WavelengthGrid
    coefficients : int
        Spline coefficients a band, with the two zero ends.

    Returns
    -------
    SensitivityFit
        With residuals, and residuals of each patch when it is left out of the fit.
    LightScale
        signal = value x irradiance / pi x integral of sensitivity, light and reflectance.

    Raises
    ------
    CalibrationError
        If the light leaves fewer independent directions than coefficients, or a band does not respond.
    """
    basis = basis_matrix(grid.nm, coefficients)[:, 1:-1]  # b_400 c = b_700 c = 0
    design = (reflectances * (light * grid.weights_nm) * (irradiance / np.pi)[:, None]) @ basis
    condition = np.linalg.cond(design)
    if not np.isfinite(condition) or condition > 1e8:
        raise CalibrationError(f"the chart under this light cannot determine {coefficients} coefficients "
                               f"(condition number {condition:.1e}); check that the light covers 400-700 nm")
    sigma = _patch_sigma(patches)
    solved = [_solve_band(design, patches.mean[:, band], sigma[:, band]) for band in range(patches.mean.shape[1])]
    raw = np.array([solution for solution, _ in solved])
    peak = (basis @ raw.T).max()
    if np.any(raw.max(axis=1) <= 0):
        dead = np.flatnonzero(raw.max(axis=1) <= 0)
        raise CalibrationError(f"band {dead[0]} does not respond to the chart; "
                               "check that photo and light belong together")
    covariance = block_diag(*(block for _, block in solved)) / peak**2
    curves, padded = (basis @ raw.T).T / peak, np.pad(raw / peak, ((0, 0), (1, 1)))
    error = np.array([np.sqrt(np.einsum("pn,nm,pm->p", basis, block / peak**2, basis)) for _, block in solved])
    residuals = 1 - design @ raw.T / patches.mean
    held_out = _held_out_residuals(design, patches.mean, sigma)
    outcome = Outcome.ILL_POSED if condition > ILL_POSED_CONDITION else Outcome.CONVERGED
    fit = SensitivityFit(grid, curves, basis_matrix(grid.nm, coefficients), padded,
                         _pad_covariance(covariance, raw.shape), error, residuals, held_out, float(condition),
                         "non-negative splines with zero ends", outcome)
    return fit, _light_scale(peak, residuals, held_out, patches)


def relative_prediction_covariance(fit_residuals: np.ndarray, patches: PatchSamples) -> np.ndarray:
    """Covariance (K, K) of (photo - predicted) / photo for a surface that was not in the fit.

    From the residuals of patches that were left out, about zero and over patches bright enough to have a relative
    error; it holds the error of curves, chart and light together, for reflectances like the chart's.
    """
    bright = (patches.mean > DIM_PATCH * patches.mean.max(axis=0)).all(axis=1)
    used = fit_residuals[bright]
    return used.T @ used / len(used)


def _patch_sigma(patches: PatchSamples) -> np.ndarray:
    noise = np.einsum("ikk->ik", patches.covariance_of_mean)
    brightest = patches.mean.max(axis=0)
    return np.sqrt(noise + (CHART_ERROR * patches.mean) ** 2 + (FLOOR * brightest) ** 2)


def _solve_band(design: np.ndarray, signal: np.ndarray, sigma: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Non-negative coefficients (N,) and their covariance over those that are not held at zero."""
    weighted = design / sigma[:, None]
    solution, norm = nnls(weighted, signal / sigma)
    free = solution > 0
    covariance = np.zeros((solution.size,) * 2)
    freedom = max(signal.size - np.count_nonzero(free), 1)
    misfit = max(norm**2 / freedom, 1.0)  # never surer than the stated patch errors
    covariance[np.ix_(free, free)] = misfit * np.linalg.pinv(weighted[:, free].T @ weighted[:, free])
    return solution, covariance


def _held_out_residuals(design: np.ndarray, mean: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    residuals = np.empty_like(mean)
    for patch in range(len(mean)):
        rest = np.arange(len(mean)) != patch
        for band in range(mean.shape[1]):
            solution, _ = nnls(design[rest] / sigma[rest, band, None], mean[rest, band] / sigma[rest, band])
            residuals[patch, band] = 1 - design[patch] @ solution / mean[patch, band]
    return residuals


def _light_scale(peak: float, residuals: np.ndarray, held_out: np.ndarray, patches: PatchSamples) -> LightScale:
    """The scale's standard error is that of the mean relative residual of held-out patches, one a patch."""
    covariance = relative_prediction_covariance(held_out, patches)
    relative = np.sqrt(covariance.mean() / len(held_out))
    return LightScale(float(peak), float(peak * relative), residuals, "chart photo")


def _pad_covariance(covariance: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Add the zero rows and columns of the two fixed ends of each band."""
    bands, free = shape
    inner = (np.arange(bands)[:, None] * (free + 2) + np.arange(1, free + 1)).ravel()
    padded = np.zeros((bands * (free + 2),) * 2)
    padded[np.ix_(inner, inner)] = covariance
    return padded
