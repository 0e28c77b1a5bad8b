"""Camera sensitivities from the patches of chart photos: one interface for every method.

``prior`` joins the photo with a prior learnt from measured cameras (prior_fit.py); ``paper``,
``nonnegative`` and ``smooth`` know nothing of other cameras (spline_fit.py).
"""
from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from spectrabox.calibrate import (
    chart_equations,
    chart_photo,
    copy_errors,
    held_out_patches,
    spline_fit,
)
from spectrabox.calibrate.prior import camera_prior, curve_posterior, prior_fit
from spectrabox.radiometry import errors, shaped
from spectrabox.radiometry.covariance import block_diagonal
from spectrabox.radiometry.records import calibration, spectra
from spectrabox.radiometry.records.photos import PatchSamples

METHODS = ("prior", *spline_fit.SPLINE_METHODS)
CHART_ERROR = 0.01           # relative: one chart against the published average
FLOOR = 0.005                # of the brightest patch: stray light and black level
DIM_PATCH = 0.03             # of the brightest patch: darker ones say nothing of relative errors
ILL_POSED_CONDITION = 100.0
SPLINE_WORDS = {"paper": "splines with zero ends, paper Eqs. 18-20",
                "nonnegative": "non-negative splines with zero ends",
                "smooth": "non-negative splines, smoothness by cross-validation"}


@dataclass(frozen=True, eq=False)
class PriorFit(shaped.Record):
    """The joint estimate; ``photos`` and ``held_out`` are in the order of the photos given."""

    sensitivity: calibration.SensitivityFit
    posterior: prior_fit.CurvePosterior
    photos: tuple[curve_posterior.PhotoState, ...]
    held_out: tuple[np.ndarray, ...]                # (I, K) signals predicted from other patches
    prior_share: Annotated[np.ndarray, "K P"]       # of the prior's standard deviation, left; 0-1
    families: tuple[tuple[str, float], ...]         # members and probability, likeliest first
    patch_error: chart_equations.PatchError  # disagreement of patches and model
    chi_square: float                               # per datum, about 1 where everything agrees
    without: held_out_patches.PatchesWithout  # of the first photo, then the excluded
    explained: copy_errors.Explained  # what was left of the signals of all photos

    @property
    def model_error(self) -> float:
        """Relative disagreement of patches and model in one band."""
        return self.patch_error.whole

    @property
    def disagrees(self) -> bool:
        """Whether no camera explains the photos."""
        return self.model_error > chart_photo.WORST_MODEL_ERROR \
            or self.chi_square > chart_photo.WORST_CHI_SQUARE


def default_prior(photos: list[chart_equations.ChartEquations],
                  grid: spectra.WavelengthGrid) -> camera_prior.CameraPrior:
    """The shipped prior where it has the photos' number of bands, else one of smoothness alone.

    Parameters
    ----------
    photos : list of ChartEquations
    grid : WavelengthGrid
        Working grid, of P wavelengths.
    """
    shipped = camera_prior.shipped_prior()
    return shipped if photos[0].signal.shape[1] == shipped.bands else camera_prior.smooth_prior(
        photos, grid)


def require_fit_for(photos: list[chart_equations.ChartEquations],
                    prior: camera_prior.CameraPrior) -> None:
    """Refuse photos that no fit with a prior can use.

    Parameters
    ----------
    photos : list of ChartEquations
    prior : CameraPrior

    Raises
    ------
    CalibrationError
        If a photo holds too few patches, or two bands have the same signals.
    InputError
        If the prior's cameras have another number of bands than the photos.
    """
    for photo in photos:
        chart_photo.require_usable(photo.signal, filtered=photo.filter is not None)
        if photo.signal.shape[1] != prior.bands:
            raise errors.InputError(
                f"the prior is for cameras of {prior.bands} bands, the photo has "
                f"{photo.signal.shape[1]}; give a prior made from such cameras, or "
                "none")


def fit_with_prior(photos: list[chart_equations.ChartEquations], prior: camera_prior.CameraPrior,
                   grid: spectra.WavelengthGrid, *,
                   model_errors: tuple[float, ...] = prior_fit.MODEL_ERRORS,
                   excluded: chart_equations.ChartEquations | None = None) -> PriorFit:
    """Curves, exposure, field and glare from chart photos of one camera, with calibrated errors.

    Parameters
    ----------
    photos : list of ChartEquations
        Any number. Charts, lights and exposures may differ. Field, glare and exposure are each
        photo's own, unless ``relative_exposure_sd`` ties an exposure to that of the first.
    prior : CameraPrior
    grid : WavelengthGrid
        Working grid, of P wavelengths.
    model_errors : tuple of float
        Relative errors of patches against the model that are held possible.
    excluded : ChartEquations or None
        Patches of the first photo that no fit is to use.

    Raises
    ------
    CalibrationError
        If the photos hold too few patches, or two bands have the same signals.
    InputError
        If the prior holds another number of bands than the photos.
    """
    require_fit_for(photos, prior)
    posterior = prior_fit.posterior_of_curves(photos, prior, grid, model_errors=model_errors)
    held_out, chi_square, without, explained = prior_fit.held_out_signals(
        photos, prior, grid, posterior, excluded)
    coefficients, covariance, peak = curve_posterior.curve_moments(posterior, prior.bands)
    states = curve_posterior.photo_states(posterior, curve_posterior.relit(posterior, photos),
                                          coefficients, peak)
    shares = curve_posterior.prior_share(curve_posterior.camera_alone(posterior, prior.bands),
                                         prior)
    shares[:,
           np.all([chart_photo.unlit(photo.power / grid.weights_nm)
                   for photo in photos], axis=0)] = 1.0
    fit = sensitivity_fit(photos[0], posterior.basis, coefficients, covariance,
                          states[0].predicted, held_out[0], grid,
                          f"joint estimate with a Gaussian mixture prior ({prior.source})")
    order = np.argsort(-posterior.families)
    families = tuple((prior.members[index], float(posterior.families[index])) for index in order)
    return PriorFit(fit, posterior, tuple(states), tuple(held_out), shares, families,
                    posterior.model_error, chi_square, without, explained)


def sensitivity_fit(photo: chart_equations.ChartEquations, basis: np.ndarray,
                    coefficients: np.ndarray, covariance: np.ndarray, predicted: np.ndarray,
                    held_out: np.ndarray, grid: spectra.WavelengthGrid,
                    method: str) -> calibration.SensitivityFit:
    """Curves of largest value 1 of a posterior, with their errors and one photo's residuals.

    Parameters
    ----------
    photo : ChartEquations
    basis : (P, N) array
        Of the posterior.
    coefficients, covariance : (K, N) and (D, D) arrays
        Of the posterior, from ``curve_moments``.
    predicted, held_out : (I, K) arrays
        Signals of the photo's patches: fitted, and each predicted from the other patches.
    grid : WavelengthGrid
        Working grid, of P wavelengths.
    method : str
        In words, for the report.
    """
    error = np.sqrt(curve_posterior.curve_variance(basis, covariance, len(coefficients)))
    return calibration.SensitivityFit(
        grid, coefficients @ basis.T, basis, coefficients, covariance, error,
        1 - predicted / photo.signal, 1 - held_out / photo.signal,
        spline_fit.condition_number(photo.reflectances * photo.power,
                                    grid), method, spectra.Outcome.CONVERGED)


def fit_sensitivities(
    patches: PatchSamples, reflectances: np.ndarray, light: np.ndarray, irradiance: np.ndarray,
    grid: spectra.WavelengthGrid, coefficients: int = spline_fit.SPLINE_COEFFICIENTS, *,
    method: str, used: np.ndarray | None = None
) -> tuple[calibration.SensitivityFit, calibration.LightScale, held_out_patches.PatchesWithout]:
    """Sensitivities of largest value 1 by splines, band after band, and the factor divided out.

    Parameters
    ----------
    patches : PatchSamples
        mean (I, K) signal.
    reflectances : (I, P) array
    light : (P,) array
        Spectrum of the light, any unit; the light scale is relative to it.
    irradiance : (I,) array
        Irradiance on each patch for a light spectrum of 1; constant where unknown.
    grid : WavelengthGrid
        Working grid, of P wavelengths.
    coefficients : int
        Spline coefficients a band, with the two zero ends; of ``paper`` and ``nonnegative`` only.
    method : str
        One of ``SPLINE_METHODS``; for ``prior`` see ``fit_with_prior``.
    used : (I,) bool array or None
        Patches that the fit may use, in the bands that are not clipped; None for all.

    Returns
    -------
    SensitivityFit
        With residuals, and residuals of each patch when it is left out of the fit.
    LightScale
        signal = value x irradiance / pi x integral of sensitivity, light and reflectance.
    PatchesWithout

    Raises
    ------
    CalibrationError
        If the light leaves fewer independent directions than coefficients, a band does not respond,
        or two are alike.
    InputError
        If the method is not known.
    """
    if method not in spline_fit.SPLINE_METHODS:
        raise errors.InputError(f"method {method!r} is not known; known are {', '.join(METHODS)}")
    used = np.ones(len(patches.mean), bool) if used is None else used
    chart_photo.require_usable(patches.mean[used])
    readable, signal = used[:, None] & ~patches.clipped, patches.mean
    rows = reflectances * (light * grid.weights_nm) * (irradiance / np.pi)[:, None]
    sigma = _patch_sigma(patches)
    basis, fit = spline_fit.band_fits(method, rows, signal, sigma, grid, coefficients, readable)
    solved, spread = fit(readable)
    without, spread_without = (np.array(each) for each in zip(*(
        fit(readable & rest[:, None]) for rest in ~np.eye(len(signal), dtype=bool)), strict=True))
    curves, design = solved @ basis.T, rows @ basis
    peak = float(curves.max())
    dead = np.flatnonzero(curves.max(axis=1) <= 1e-9 * max(peak, 0))
    if dead.size:
        raise errors.CalibrationError(f"band {dead[0] + 1} does not respond to the chart; "
                               "check that photo and light belong together")
    error = np.sqrt(np.clip(np.einsum("pn,knm,pm->kp", basis, spread, basis), 0, None)) / peak
    residuals = 1 - design @ solved.T / signal
    held_out = 1 - np.einsum("in,ikn->ik", design, without) / signal
    condition = spline_fit.condition_number(rows[readable.any(axis=1)], grid, coefficients)
    made = calibration.SensitivityFit(
        grid, curves / peak, basis, solved / peak, block_diagonal(*spread) / peak**2, error,
        residuals, held_out, condition, SPLINE_WORDS[method],
        spectra.Outcome.ILL_POSED if condition > ILL_POSED_CONDITION
        else spectra.Outcome.CONVERGED)
    covariance = relative_prediction_covariance(held_out, patches)
    # Of a band's mean relative residual over held-out patches: errors of bands are independent.
    relative = np.sqrt(np.trace(covariance) / len(covariance) / len(held_out))
    scale = calibration.LightScale(peak, float(peak * relative), residuals, "chart photo")
    # the exposure is that of the curves, and no glare is fitted
    factor, fixed = irradiance / np.pi, np.zeros((signal.shape[1],) * 2)
    return made, scale, held_out_patches.PatchesWithout(
        basis, light * grid.weights_nm, factor[:, None, None] * without, np.zeros(signal.shape),
        np.array([block_diagonal(*one**2 * of_patch, fixed)
                  for one, of_patch in zip(factor, spread_without, strict=True)]),
        signal, np.einsum("ik,kl->ikl", sigma**2, np.eye(signal.shape[1])), patches.clipped)


def relative_prediction_covariance(fit_residuals: np.ndarray, patches: PatchSamples,
                                   excluded: np.ndarray | None = None) -> np.ndarray:
    """Covariance (K, K) of (photo - predicted) / photo for a surface that was not in the fit.

    From the residuals of patches that were left out, about zero and over patches bright enough to
    have a relative error, in their bands that are not clipped; it holds the error of curves, chart
    and light together, for reflectances like the chart's.

    Parameters
    ----------
    fit_residuals : (I, K) array
        (photo - predicted) / photo, each patch left out of its own fit.
    patches : PatchSamples
    excluded : (I,) bool array, optional
        Patches that the operator leaves out: they may be none of the chart's.
    """
    bright = (patches.mean > DIM_PATCH * patches.mean.max(axis=0)).all(axis=1)
    readable = ~patches.clipped[bright]
    if excluded is not None:
        readable &= ~excluded[bright, None].astype(bool)
    used = np.where(readable, fit_residuals[bright], 0.0)
    return used.T @ used / np.sqrt(np.outer(*2 * [readable.sum(axis=0)]))


def _patch_sigma(patches: PatchSamples) -> np.ndarray:
    noise = np.einsum("ikk->ik", patches.covariance_of_mean)
    brightest = patches.mean.max(axis=0)
    return np.sqrt(noise + (CHART_ERROR * patches.mean) ** 2 + (FLOOR * brightest) ** 2)
