"""From a mixture of Gaussians on curves to what later stages read.

Curves, their covariance, their band, draws and the light scale.
"""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated

import numpy as np
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from spectrabox.calibrate.chart_equations import (
    ChartEquations,
    nuisance_sd,
    nuisance_starts,
    predicted_signal,
    unlit_design,
)
from spectrabox.calibrate.prior.camera_prior import CameraPrior
from spectrabox.calibrate.prior.prior_fit import CurvePosterior
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records import Calibration, ChartWhite
from spectrabox.radiometry.shaped import Record

ROUND_OFF = 1e-9             # of the largest value


@dataclass(frozen=True, eq=False)
class CurveDraws(Record):
    """Draws of all curves together, each scaled to a largest value of 1.

    A later stage averages over them.
    """

    curves: Annotated[np.ndarray, "T K P"]
    seed: int


@dataclass(frozen=True, eq=False)
class PhotoState(Record):
    """What one photo contained besides the chart.

    signal = scale x field x irradiance / pi x integral of sensitivity, light and reflectance, +
    glare

    ``scale_error`` is that of scale times curves, in the signal of a perfect reflector: scale
    and curves alone are known less well, but their errors cancel in every predicted signal.
    """

    scale: float
    scale_error: float
    field: Annotated[np.ndarray, "I"]
    glare: Annotated[np.ndarray, "K"]
    glare_error: Annotated[np.ndarray, "K"]
    predicted: Annotated[np.ndarray, "I K"]
    white: ChartWhite


@dataclass(frozen=True, eq=False)
class CurveMoments(Record):
    """Curves of largest value 1 with their covariance (D = K N), and the peak divided out."""

    coefficients: Annotated[np.ndarray, "K N"]
    covariance: Annotated[np.ndarray, "D D"]
    peak: float


def curve_moments(posterior: CurvePosterior, bands: int) -> CurveMoments:
    """Mean and covariance of the mixture, divided by the largest value.

    Where the mean dips below zero it is raised to zero and everything that varies with it moves
    along, so that what the photo says stays fitted. The covariance is that of the mixture without
    this constraint.

    Parameters
    ----------
    posterior : CurvePosterior
    bands : int
        K, of the camera.
    """
    size = bands * posterior.basis.shape[1]
    mean, covariance = mixture_moments(posterior.weights, posterior.means, posterior.covariances)
    mean, covariance = nonnegative(mean[:size], covariance[:size, :size]), covariance[:size, :size]
    coefficients = mean.reshape(bands, -1)
    curves = coefficients @ posterior.basis.T
    peak = float(curves.max())
    scaling = _scaling(coefficients / peak, posterior.basis) / peak
    return CurveMoments(coefficients / peak, scaling @ covariance @ scaling.T, peak)


def draw_curves(posterior: CurvePosterior, bands: int, draws: int, seed: int) -> CurveDraws:
    """Independent draws (T, K, P) of the posterior, negative values set to zero.

    Parameters
    ----------
    posterior : CurvePosterior
    bands : int
        K, of the camera.
    draws : int
        T.
    seed : int
        Stored with the draws.
    """
    rng = np.random.default_rng(seed)
    size = bands * posterior.basis.shape[1]
    counts = rng.multinomial(draws, posterior.weights)
    with threadpool_limits(1, "blas"):  # see fit_with_prior
        stacked = [mean[:size] + rng.standard_normal((count, size))
                   @ _root(covariance[:size, :size]).T
                   for count, mean, covariance in zip(counts, posterior.means,
                                                      posterior.covariances, strict=True) if count]
    coefficients = np.vstack(stacked).reshape(draws, bands, -1)
    curves = np.clip(rng.permutation(coefficients), 0, None) @ posterior.basis.T
    return CurveDraws(curves / curves.max(axis=(1, 2), keepdims=True), seed)


def sensitivity_draws(calibration: Calibration, draws: int, seed: int) -> np.ndarray:
    """Draws (T, K, P) of all curves together from the covariance that a calibration carries.

    One Gaussian in place of the mixture that ``draw_curves`` draws from; negative values are set to
    zero and each draw has a largest value of 1, so that a later stage can average over what is not
    known of the camera.

    Parameters
    ----------
    calibration : Calibration
        From a fit to a chart photo.
    draws : int
        T.
    seed : int

    Raises
    ------
    InputError
        If the calibration carries no covariance: measured curves from a file.
    """
    fit = calibration.sensitivity
    if fit.coefficients is None or fit.covariance is None or fit.basis is None:
        raise InputError(f"the sensitivities ({fit.method}) carry no covariance to draw from; "
                         "fit them to a chart photo")
    normal = np.random.default_rng(seed).standard_normal((draws, fit.coefficients.size))
    coefficients = (fit.coefficients.ravel()
                    + normal @ _root(fit.covariance).T).reshape(draws, *fit.coefficients.shape)
    curves = np.clip(coefficients @ fit.basis.T, 0, None)
    return curves / curves.max(axis=(1, 2), keepdims=True)


def prior_share(posterior: CurvePosterior, prior: CameraPrior, moments: CurveMoments) -> np.ndarray:
    """Share (K, P) of each curve's prior uncertainty that the photo left, 0 to 1.

    Standard deviation after over before, both of curves divided by their largest value, for the
    photo never tells exposure from sensitivity.

    Parameters
    ----------
    posterior : CurvePosterior
    prior : CameraPrior
        With which the posterior was made.
    moments : CurveMoments
        Of the posterior.
    """
    spread = np.sqrt(prior.weights)[:, None] * (prior.means - prior.weights @ prior.means)
    of_level = np.bincount(prior.level, prior.weights,
                           minlength=len(prior.widening)) * prior.widening**2
    # In a logarithmic state a curve that turns out dark had room to: its variance beforehand is
    # that of the mean camera, not of the dark curve.
    slope = np.maximum(prior.slope(prior.state(moments.coefficients.ravel() * moments.peak)),
                       prior.slope(prior.means[-1]))
    before = np.outer(slope, slope) * (
        spread.T @ spread + np.einsum("l,lij->ij", of_level, prior.covariances()))
    scaling = _scaling(moments.coefficients, posterior.basis) / moments.peak
    after, prior_variance = (curve_variance(posterior.basis, covariance, prior.bands)
                             for covariance in (moments.covariance, scaling @ before @ scaling.T))
    floor = 1e-6 * prior_variance.max()
    return np.clip(np.sqrt(after / np.maximum(prior_variance, floor)), 0,
                   1) * (prior_variance > floor)


def curve_variance(basis: np.ndarray, covariance: np.ndarray, bands: int) -> np.ndarray:
    """Variance (K, P) of each curve at each wavelength.

    Parameters
    ----------
    basis : (P, N) array
    covariance : (K N, K N) array
        Of all coefficients, band after band.
    bands : int
        K.
    """
    blocks = covariance.reshape(bands, basis.shape[1], bands, basis.shape[1])
    return np.array([np.clip(np.einsum("pn,pn->p", basis @ blocks[band, :, band], basis), 0, None)
                     for band in range(bands)])


def photo_states(posterior: CurvePosterior, photos: list[ChartEquations],
                 moments: CurveMoments) -> list[PhotoState]:
    """Exposure, field and glare of every photo, and the signals that follow.

    Parameters
    ----------
    posterior : CurvePosterior
    photos : list of ChartEquations
        In the order in which the posterior was made.
    moments : CurveMoments
        Of the posterior.
    """
    bands = len(moments.coefficients)
    size = moments.coefficients.size
    mean, covariance = mixture_moments(posterior.weights, posterior.means, posterior.covariances)
    states = []
    for photo, (index, stop) in zip(photos, pairwise(size + nuisance_starts(photos)), strict=True):
        nuisance = mean[index + 1:stop]
        terms = photo.field_terms.shape[1]
        design = unlit_design(photo, posterior.basis)
        predicted, _ = predicted_signal(photo, design, moments.coefficients * moments.peak,
                                        mean[index], nuisance)
        scale = float(np.exp(mean[index]) * moments.peak)
        error = _white_error(photo, posterior.basis, moments.coefficients * moments.peak,
                             covariance, index)
        glare, glare_error = np.zeros((2, bands))
        if photo.glare:
            glare = nuisance[terms:]
            glare_error = np.sqrt(np.diag(covariance)[index + 1 + terms:stop])
        white = _white(photo, posterior.basis, moments.coefficients * moments.peak, mean,
                       covariance, index)
        states.append(PhotoState(scale, scale * error, np.exp(photo.field_terms @ nuisance[:terms]),
                                 glare, glare_error, predicted.reshape(-1, bands), white))
    return states


def _white(photo: ChartEquations, basis: np.ndarray, coefficients: np.ndarray, mean: np.ndarray,
           covariance: np.ndarray, index: int) -> ChartWhite:
    """White signal, field and glare with their covariance; ``index`` is of the log exposure."""
    bands, terms = len(coefficients), photo.field_terms.shape[1]
    power = photo.power @ basis
    white = coefficients @ power
    jacobian = np.zeros((2 * bands + terms, len(covariance)))
    jacobian[:bands, :coefficients.size] = np.kron(np.eye(bands), power) / white[:, None]
    jacobian[:bands, index] = 1.0
    count = nuisance_sd(photo).size
    jacobian[bands:bands + count, index + 1:index + 1 + count] = np.eye(count)
    nuisance = mean[index + 1:index + 1 + count]
    glare = nuisance[terms:] if photo.glare else np.zeros(bands)
    return ChartWhite(np.exp(mean[index]) * white, nuisance[:terms], glare,
                      jacobian @ covariance @ jacobian.T)


def _white_error(photo: ChartEquations, basis: np.ndarray, coefficients: np.ndarray,
                 covariance: np.ndarray, index: int) -> float:
    """Relative standard error of the signal of a perfect reflector in one band.

    Errors of the bands are independent, each from its own patches' noise: the error of the mean
    over bands alone would promise twice too much of each. Bands count by their signal, for the
    relative error of a dark band says little. ``index`` is that of the photo's log exposure.
    """
    bands = len(coefficients)
    power = photo.power @ basis
    white = coefficients @ power
    jacobian = np.zeros((bands, len(covariance)))
    jacobian[:, :coefficients.size] = np.kron(np.eye(bands), power)
    jacobian[:, index] = white
    variance = np.einsum("kz,zy,ky->k", jacobian, covariance, jacobian)
    return float(np.sqrt(variance.sum() / np.sum(white**2)))


def nonnegative(mean: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """The most likely vector (D,) of a Gaussian that has no negative entry.

    Entries are held at zero in turn, and what is correlated with them moves along.

    Parameters
    ----------
    mean : (D,) array
    covariance : (D, D) array
    """
    tolerance = ROUND_OFF * np.abs(mean).max()
    held = np.zeros(mean.size, bool)
    moved = mean
    for _ in range(mean.size):
        negative = moved < -tolerance
        if not negative.any():
            break
        held |= negative
        block = covariance[np.ix_(held, held)]
        ridge = 1e-10 * np.trace(block) / len(block) * np.eye(len(block))
        moved = mean - covariance[:, held] @ np.linalg.solve(block + ridge, mean[held])
        moved[held] = 0.0
    return np.clip(moved, 0, None)


def _scaling(coefficients: np.ndarray, basis: np.ndarray) -> np.ndarray:
    """Derivative (D, D) of curves / largest value by the curves, at a largest value of 1."""
    curves = coefficients @ basis.T
    band, at = np.unravel_index(np.argmax(curves), curves.shape)
    at_peak = np.zeros(coefficients.shape)
    at_peak[band] = basis[at]
    return np.eye(coefficients.size) - np.outer(coefficients.ravel(), at_peak.ravel())


def mixture_moments(weights: np.ndarray, means: np.ndarray | Sequence[np.ndarray],
                    covariances: np.ndarray | Sequence[np.ndarray]
                    ) -> tuple[np.ndarray, np.ndarray]:
    """Mean (Z,) and covariance (Z, Z) of a mixture of Gaussians.

    Parameters
    ----------
    weights : (C,) array
        Of any sum.
    means : (C, Z) array
    covariances : (C, Z, Z) array
    """
    shares = weights / np.sum(weights)
    mean = shares @ np.asarray(means)
    offset = (means - mean) * np.sqrt(shares)[:, None]
    within = np.einsum("c,cij->ij", shares, np.asarray(covariances))
    return mean, within + offset.T @ offset


def _root(covariance: np.ndarray) -> np.ndarray:
    """Symmetric factor; rounding may leave variances below zero, which are none."""
    variances, directions = np.linalg.eigh(covariance)
    return directions * np.sqrt(np.clip(variances, 0, None))
