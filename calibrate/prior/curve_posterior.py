"""From a mixture of Gaussians on curves to what later stages read.

Curves, their covariance, their band, draws and the light scale.
"""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Annotated

import numpy as np

from spectrabox.calibrate import chart_equations
from spectrabox.calibrate.prior import camera_prior, prior_fit
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records import calibration as calibration_records
from spectrabox.radiometry.shaped import Record

ROUND_OFF = 1e-9             # of the largest value
GLARE_SIGMA = 3.0            # of a band: nearer to 0 none is claimed


@dataclass(frozen=True, eq=False)
class PhotoState(Record):
    """What one photo contained besides the chart.

    signal = scale x field x irradiance / pi x integral of sensitivity, light and reflectance, +
    the glare of ``white``

    ``scale_error`` is that of scale times curves, in the signal of a perfect reflector: scale
    and curves alone are known less well, but their errors cancel in every predicted signal.
    """

    scale: float
    scale_error: float
    field: Annotated[np.ndarray, "I"]
    predicted: Annotated[np.ndarray, "I K"]
    white: calibration_records.ChartWhite
    filter: calibration_records.Filter | None = None    # that the photo was taken through

    @property
    def light_scale(self) -> calibration_records.LightScale:
        """Of the photo, without residuals."""
        return calibration_records.LightScale(self.scale, self.scale_error, None, "chart photo")

    @property
    def certain_glare(self) -> np.ndarray:
        """Size of the glare (K,) in the bands where it is beyond chance, else 0."""
        size = np.abs(self.white.glare)
        return np.where(size > GLARE_SIGMA * self.white.glare_error, size, 0.0)


def camera_alone(posterior: prior_fit.CurvePosterior, bands: int) -> prior_fit.CurvePosterior:
    """The camera's own curves, without what the first photo's light departs by from its statement.

    A fit hands on the curves that give a photo's signals together with the stated light. Nuisances
    are left out.

    Parameters
    ----------
    posterior : CurvePosterior
    bands : int
        K, of the camera.
    """
    if not posterior.lights:
        return posterior
    light, size = posterior.lights[0], bands * posterior.basis.shape[1]
    means, covariances = [], []
    for mean, covariance in zip(posterior.means, posterior.covariances, strict=True):
        dimmer = np.tile(np.exp(-light.logarithm(mean)), bands)
        own, change = mean[:size] * dimmer, np.zeros((size, mean.size))
        change[:, :size] = np.diag(dimmer)
        change[:, light.own] = -own[:, None] * np.tile(light.terms, (bands, 1))
        means.append(own)
        covariances.append(change @ covariance @ change.T)
    return replace(posterior, means=np.array(means), covariances=np.array(covariances), lights=())


def relit(posterior: prior_fit.CurvePosterior,
          photos: list[chart_equations.ChartEquations]) -> list[chart_equations.ChartEquations]:
    """Photos under the lights that give their signals together with the curves of a posterior:
    those of the first photo's light as it is stated.

    Parameters
    ----------
    posterior : CurvePosterior
    photos : list of ChartEquations
        In the order in which the posterior was made.
    """
    if not posterior.lights:
        return photos
    mean = posterior.weights @ posterior.means
    first = posterior.lights[0].logarithm(mean)
    return [replace(photo, power=photo.power * (posterior.basis @ np.exp(light.logarithm(mean)
                                                                         - first)))
            for photo, light in zip(photos, posterior.lights, strict=True)]


def curve_moments(posterior: prior_fit.CurvePosterior,
                  bands: int) -> tuple[np.ndarray, np.ndarray, float]:
    """Coefficients (K, N) of the mixture's mean curves at a largest value of 1, their covariance
    (K N, K N), and the peak that was divided out.

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
    return (coefficients / peak,
            _scaled(coefficients / peak, posterior.basis, covariance / peak**2), peak)


def draw_curves(posterior: prior_fit.CurvePosterior, bands: int, draws: int,
                seed: int) -> np.ndarray:
    """Independent draws (T, K, P) of all curves together, negative values set to zero.

    Each draw has a largest value of 1; a later stage averages over them.

    Parameters
    ----------
    posterior : CurvePosterior
    bands : int
        K, of the camera.
    draws : int
        T.
    seed : int
    """
    rng = np.random.default_rng(seed)
    size = bands * posterior.basis.shape[1]
    counts = rng.multinomial(draws, posterior.weights)
    stacked = [mean[:size] + rng.standard_normal((count, size))
               @ _root(covariance[:size, :size]).T
               for count, mean, covariance in zip(counts, posterior.means,
                                                  posterior.covariances, strict=True) if count]
    coefficients = np.vstack(stacked).reshape(draws, bands, -1)
    curves = np.clip(rng.permutation(coefficients), 0, None) @ posterior.basis.T
    return np.asarray(curves / curves.max(axis=(1, 2), keepdims=True))


def sensitivity_draws(calibration: calibration_records.Calibration, draws: int,
                      seed: int) -> np.ndarray:
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


def prior_share(posterior: prior_fit.CurvePosterior,
                prior: camera_prior.CameraPrior) -> np.ndarray:
    """Share (K, P) of each curve's prior uncertainty that the photo left, 0 to 1.

    Standard deviation after over before, both of curves divided by their largest value, for the
    photo never tells exposure from sensitivity.

    Parameters
    ----------
    posterior : CurvePosterior
    prior : CameraPrior
        With which the posterior was made.
    """
    coefficients, covariance, peak = curve_moments(posterior, prior.bands)
    spread = np.sqrt(prior.weights)[:, None] * (prior.means - prior.weights @ prior.means)
    of_level = np.bincount(prior.level, prior.weights,
                           minlength=len(prior.widening)) * prior.widening**2
    # In a logarithmic state a curve that turns out dark had room to: its variance beforehand is
    # that of the mean camera, not of the dark curve.
    slope = np.maximum(prior.slope(prior.state(coefficients.ravel() * peak)),
                       prior.slope(prior.means[-1]))
    before = np.outer(slope, slope) * (
        spread.T @ spread + np.einsum("l,lij->ij", of_level, prior.covariances()))
    after, prior_variance = (
        curve_variance(posterior.basis, each, prior.bands) for each in (
            covariance, _scaled(coefficients, posterior.basis, before / peak**2)))
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


def photo_states(posterior: prior_fit.CurvePosterior, photos: list[chart_equations.ChartEquations],
                 coefficients: np.ndarray, peak: float) -> list[PhotoState]:
    """Exposure, field and glare of every photo, and the signals that follow.

    Parameters
    ----------
    posterior : CurvePosterior
    photos : list of ChartEquations
        In the order in which the posterior was made.
    coefficients, peak : (K, N) array and float
        Of the posterior, from ``curve_moments``.
    """
    curves = coefficients * peak
    bands, size = len(curves), curves.size
    mean, covariance = mixture_moments(posterior.weights, posterior.means, posterior.covariances)
    states = []
    for photo, (index, stop) in zip(photos,
                                    pairwise(size + chart_equations.nuisance_starts(photos)),
                                    strict=True):
        modes = photo.modes(posterior.basis)
        of_filter = slice(stop - modes.shape[1], stop)
        terms, own = photo.field_terms.shape[1], mean[index + 1:of_filter.start]
        predicted, _ = chart_equations.predicted_signal(
            photo, chart_equations.unlit_design(photo, posterior.basis), curves, mean[index],
            mean[index + 1:stop], modes)
        glare = own[terms:] if photo.glare else np.zeros(bands)
        # white in each band, and its derivative by curves, log exposure and the filter
        power = photo.power @ posterior.basis
        change = curves * power * chart_equations.passed_slope(modes @ mean[of_filter])
        power = power * chart_equations.passed(modes @ mean[of_filter])
        white = curves @ power
        of_white = np.zeros((bands, len(covariance)))
        of_white[:, :size] = np.kron(np.eye(bands), power)
        of_white[:, index] = white
        of_white[:, of_filter] = change @ modes
        # Errors of the bands are independent, each from its own patches' noise: that of the mean
        # over bands would promise twice too much of each. A dark band's says little: by signal.
        variance = np.einsum("kz,zy,ky->k", of_white, covariance, of_white)
        relative = np.sqrt(variance.sum() / np.sum(white**2))
        # the log of white, then field and glare
        jacobian = np.zeros((2 * bands + terms, len(covariance)))
        jacobian[:bands] = of_white / white[:, None]
        jacobian[bands:bands + own.size, index + 1:of_filter.start] = np.eye(own.size)
        scale = float(np.exp(mean[index]) * peak)
        states.append(PhotoState(
            scale, float(scale * relative), np.exp(photo.field_terms @ own[:terms]),
            predicted.reshape(-1, bands),
            calibration_records.ChartWhite(np.exp(mean[index]) * white, own[:terms], glare,
                                           jacobian @ covariance @ jacobian.T),
            None if photo.filter is None else _fitted_filter(
                photo.filter, mean[of_filter], covariance[of_filter, of_filter],
                _scaled_rows(coefficients, posterior.basis,
                             covariance[of_filter, :size] / peak))))
    return states


def _fitted_filter(filter: calibration_records.Filter, errors: np.ndarray, covariance: np.ndarray,
                   with_curves: np.ndarray) -> calibration_records.Filter:
    """The filter whose errors (E,) are known, and what further errors of the same kind do to it."""
    error = filter.modes @ errors
    passed = chart_equations.passed(error)
    return calibration_records.Filter(
        filter.name, filter.transmittance * passed,
        filter.modes * (chart_equations.passed_slope(error) / passed)[:, None], covariance,
        with_curves)


def nonnegative(mean: np.ndarray, covariance: np.ndarray, count: int | None = None) -> np.ndarray:
    """The most likely vector (D,) of a Gaussian that has no negative entry.

    Entries are held at zero in turn, and what is correlated with them moves along.

    Parameters
    ----------
    mean : (D,) array
    covariance : (D, D) array
    count : int or None
        How many entries, the first ones, cannot be negative; None for all.
    """
    bounded = slice(count)
    tolerance = ROUND_OFF * np.abs(mean[bounded]).max()
    held = np.zeros(mean.size, bool)
    moved = mean
    for _ in range(mean[bounded].size):
        negative = moved < -tolerance
        negative[moved[bounded].size:] = False
        if not negative.any():
            break
        held |= negative
        block = covariance[np.ix_(held, held)]
        ridge = 1e-10 * np.trace(block) / len(block) * np.eye(len(block))
        moved = mean - covariance[:, held] @ np.linalg.solve(block + ridge, mean[held])
        moved[held] = 0.0
    return np.concatenate([np.clip(moved[bounded], 0, None), moved[moved[bounded].size:]])


def _scaled(coefficients: np.ndarray, basis: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Covariance (D, D) of curves / largest value from that of the curves, at a largest value of 1.
    """
    rows = _scaled_rows(coefficients, basis, covariance)
    return _scaled_rows(coefficients, basis, rows.T)


def _scaled_rows(coefficients: np.ndarray, basis: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """The same of rows (n, D) of a covariance with something else."""
    band, at = np.unravel_index(np.argmax(coefficients @ basis.T), (len(coefficients), len(basis)))
    nodes = basis.shape[1]
    at_peak = rows[:, band * nodes:(band + 1) * nodes] @ basis[at]
    return np.asarray(rows - np.outer(at_peak, coefficients.ravel()))


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
