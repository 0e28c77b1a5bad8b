"""Independent draws of spectra from the learnt prior that reproduce a signal exactly, or within its
noise.

A component is chosen by its posterior weight. Its posterior is Gaussian in the logit (Laplace),
with standard deviations enlarged by the calibrated band factor, so that the draws are as wide as
the calibrated band. Each draw then gets a noise n from its posterior N(R Q^-1 r, R - R Q^-1 R), and
Newton steps along S J' take it to the signal y - n to 1e-10. Noise-free signals (R = 0) are
reproduced to that accuracy; no draw leaves (0, 1).

The projection moves a draw across the directions that the camera sees, where the posterior is
narrow; along the directions that it does not see the draw keeps its place. Within a component the
law is that of Laplace's approximation, not exact: the calibration is what makes the bands hold.
"""
from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from spectrabox.radiometry.bspline import basis_matrix
from spectrabox.radiometry.errors import ConvergenceError, InputError
from spectrabox.radiometry.records import MeasurementOperator
from spectrabox.sampling.measurement import SpectralMeasurement, SpectralSamples, nearest_splines
from spectrabox.sampling.polytope.tilt import is_reachable
from spectrabox.sampling.polytope.tilted_rejection import noise_columns
from spectrabox.sampling.prior.mixture import GRID, LogitMixture, load_prior, reflectance
from spectrabox.sampling.prior.posterior import MISFIT, MixturePosterior, posterior, with_floor
from spectrabox.sampling.prior.smoothness import smoothness_prior

LEVEL = 0.95                    # whose calibrated factor enlarges the draws
SIGNAL_ATOL = 1e-10             # of white
NEWTON_STEPS = 12
LONGEST_STEP = 3.0              # logits
BLOCK = 2048
ROUNDS = 20                     # of drawing again what could not be taken to its signal

FAMILIAR = "Independent draws from the learnt prior; the signal is like those it was calibrated on."
UNFAMILIAR = ("The signal is unlike those of the measured reflectances that the prior was learnt "
              "on: drawn from the wider smoothness prior instead, whose bands are not calibrated.")
TOO_ROUGH = ("Only spectra rougher than any that were measured give the signal: the draws are of "
             "the smoothness prior and come as near to it as they can; check the calibration.")
OUT_OF_REACH = ("No spectrum between 0 and 1 gives the signal; the draws are of the smoothness "
                "prior and come as near to it as they can.")


@dataclass(frozen=True)
class _Component:
    """What draws of one component need: centre (P,), square root of the posterior (P, P), gain (P,
    K), noise law.
    """

    centre: np.ndarray
    root: np.ndarray
    gain: np.ndarray
    noise_mean: np.ndarray
    noise_root: np.ndarray


def sample_prior(measurement: SpectralMeasurement, draws: int, seed: int,
                 prior: LogitMixture | None = None, coefficients: int = 13) -> SpectralSamples:
    """Draw spectra from the learnt prior given one signal.

    Parameters
    ----------
    measurement : SpectralMeasurement
        Its noise covariance should carry photo noise and calibration error; zeros for a hard
        equality.
    draws : int
        T.
    seed : int
        The same seed gives the same draws bit for bit.
    prior : LogitMixture, optional
        The one shipped with the project by default.
    coefficients : int
        N of the splines that are fitted to the draws.

    Returns
    -------
    SpectralSamples
        ``outcome`` says when the signal lies outside what the prior knows and the smoothness prior
        was used.

    Raises
    ------
    InputError
        For a signal or covariance that is none, or no draws.
    """
    spectra, method, outcome = prior_spectra(measurement, draws, seed, prior or load_prior())
    fitted = nearest_splines(spectra, basis_matrix(GRID.nm, coefficients))
    return SpectralSamples(GRID, spectra, fitted, method, float(draws), seed, outcome)


def prior_spectra(measurement: SpectralMeasurement, draws: int, seed: int,
                  prior: LogitMixture) -> tuple[np.ndarray, str, str]:
    """Spectra (T, 61) as `sample_prior` draws them, the method and the outcome, without fitting
    splines.
    """
    check_measurement(measurement, draws)
    response = measurement.response_on(GRID)
    found = posterior(prior, response, measurement.signal[None], measurement.noise_covariance)
    outcome, method = FAMILIAR, "learnt prior"
    if found.surprise[0] > prior.familiar_surprise or found.misfit[0] > allowed_misfit(measurement):
        prior, outcome, method = smoothness_prior(), UNFAMILIAR, "smoothness prior"
        found = posterior(prior, response, measurement.signal[None], measurement.noise_covariance)
        if found.misfit[0] > allowed_misfit(measurement):
            reachable = is_reachable(MeasurementOperator(response, measurement.signal,
                                                         measurement.noise_covariance))
            outcome = TOO_ROUGH if reachable else OUT_OF_REACH
    parts = [_component(prior, found, response, measurement,
                        index) for index in range(prior.weights.size)]
    spectra = _draw(parts, found.weights[0], response, measurement.signal, draws, seed,
                    outcome in (TOO_ROUGH, OUT_OF_REACH))
    return spectra, method, outcome


def allowed_misfit(measurement: SpectralMeasurement) -> float:
    """Distance of signal and fit beyond which a prior does not explain the signal: 0.5 % of white,
    or 4 sigma.
    """
    return max(MISFIT, 4 * float(np.sqrt(np.diag(measurement.noise_covariance).max())))


def check_measurement(measurement: SpectralMeasurement, draws: int) -> None:
    """Raise unless a measurement and a number of draws can be sampled.

    Raises
    ------
    InputError
        With what is wrong.
    """
    if draws < 1:
        raise InputError(f"{draws} draws were asked for; ask for at least 1")
    covariance = measurement.noise_covariance
    for name, values in (("response", measurement.response), ("signal", measurement.signal),
                         ("noise", covariance)):
        if not np.all(np.isfinite(values)):
            raise InputError(f"the {name} of the measurement holds numbers that are not finite; "
                             "measure it again")
    # round-off of a covariance that was computed as a product
    atol = 1e-10 * np.abs(covariance).max()
    if np.abs(covariance - covariance.T).max() > atol or np.linalg.eigvalsh(covariance)[0] < -atol:
        raise InputError("the noise covariance is not symmetric positive semi-definite; state "
                         "variances on the diagonal, or a covariance estimated from repeated "
                         "readings")
    check_bands(measurement.response)


def check_bands(response: np.ndarray) -> None:
    """Raise if two bands respond alike or one sees nothing.

    Raises
    ------
    InputError
    """
    values = np.linalg.svd(response / np.linalg.norm(response, axis=1, keepdims=True), compute_uv=False) \
        if np.all(response.any(axis=1)) else np.zeros(1)
    if values[-1] < 1e-6:
        raise InputError("two bands respond alike, or one sees nothing of 400-700 nm under this "
                         "light; leave one out or measure the sensitivities again")


def _component(prior: LogitMixture, found: MixturePosterior, response: np.ndarray,
               measurement: SpectralMeasurement, index: int) -> _Component:
    centre = found.logits[index, 0]
    p = reflectance(centre)
    jacobian = response * (p * (1 - p))
    base = prior.covariances[index] @ jacobian.T
    prior_of_signal = jacobian @ base
    R = measurement.noise_covariance
    residual = measurement.signal - response @ p + jacobian @ (centre - prior.means[index])
    Q = prior_of_signal + with_floor(R)
    covariance = prior.covariances[index] - base @ np.linalg.solve(Q, base.T)
    values, vectors = np.linalg.eigh((covariance + covariance.T) / 2)
    root = vectors * np.sqrt(np.maximum(values, 0)) * prior.band_factor(LEVEL)
    shrink = R @ np.linalg.inv(prior_of_signal + R + 1e-12 * np.eye(len(R)))
    return _Component(centre, root, base @ np.linalg.inv(prior_of_signal), shrink @ residual,
                      noise_columns((R - shrink @ R + (R - shrink @ R).T) / 2))


def _draw(parts: list[_Component], weights: np.ndarray, response: np.ndarray, signal: np.ndarray,
          draws: int,
          seed: int, approximate: bool) -> np.ndarray:
    sizes = [BLOCK] * (draws // BLOCK) + ([draws % BLOCK] if draws % BLOCK else [])
    seeds = np.random.SeedSequence(seed).spawn(len(sizes))

    def block(job: tuple[int, np.random.SeedSequence]) -> np.ndarray:
        return _block(parts, weights, response, signal, job[0], np.random.default_rng(job[1]),
                      approximate)

    with ThreadPoolExecutor(min(len(sizes), os.cpu_count() or 1)) as pool:
        return np.concatenate(list(pool.map(block, zip(sizes, seeds, strict=True))))


def _block(parts: list[_Component], weights: np.ndarray, response: np.ndarray, signal: np.ndarray,
           draws: int,
           rng: np.random.Generator, approximate: bool) -> np.ndarray:
    out = np.empty((draws, response.shape[1]))
    missing = np.arange(draws)
    for _ in range(ROUNDS):
        chosen = rng.choice(len(parts), size=missing.size, p=weights)
        failed = []
        for index in np.unique(chosen):
            rows = missing[chosen == index]
            out[rows], reached = _of_component(parts[index], response, signal, rows.size, rng)
            failed.append(rows[~reached])
        missing = np.concatenate(failed)
        if not missing.size or approximate:
            return out
    raise ConvergenceError(f"{missing.size} of {draws} draws of the learnt prior did not reach the "
                           "signal; state its noise, or use the method 'uniform'")


def _of_component(part: _Component, response: np.ndarray, signal: np.ndarray, draws: int,
                  rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Reflectances (n, P) of one component at their own signals, and which of them got there."""
    bands = len(signal)
    x = rng.standard_normal((draws, part.root.shape[1])) @ part.root.T + part.centre
    noise = part.noise_mean + rng.standard_normal((draws,
                                                   part.noise_root.shape[1])) @ part.noise_root.T
    target = signal - noise
    # d(signal)/d(step) of every draw is the sum over wavelengths of p (1 - p) times these products.
    products = (response[:, None, :] * part.gain.T).reshape(bands * bands, -1).T
    for _ in range(NEWTON_STEPS):
        p = 1 / (1 + np.exp(-x))  # as `reflectance`, which is safe for any x but three times slower
        residual = target - p @ response.T
        if np.abs(residual).max(initial=0) < SIGNAL_ATOL:
            break
        slopes = ((p - p * p) @ products).reshape(draws, bands, bands)
        step = solve_each(slopes, residual) @ part.gain.T
        longest = np.maximum(step.max(), -step.min())
        if longest > LONGEST_STEP:
            step *= np.minimum(1, LONGEST_STEP / np.maximum(np.abs(step).max(axis=1, keepdims=True),
                                                            1e-12))
        x += step
    p = reflectance(x)
    return p, np.abs(target - p @ response.T).max(axis=1) < 10 * SIGNAL_ATOL


def solve_each(matrices: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solutions (n, K) of n systems (n, K, K); by Cramer's rule for three bands, five times faster
    than LAPACK's calls.

    A singular matrix gives a step of zero.
    """
    if right.shape[1] != 3:
        singular = np.abs(np.linalg.det(matrices)) < 1e-12
        safe = np.where(singular[:, None, None], np.eye(right.shape[1]), matrices)
        return np.where(singular[:, None], 0.0, np.linalg.solve(safe, right[..., None])[..., 0])
    (a, b, c), (d, e, f), (g, h, i) = (tuple(matrices[:, row, column] for column in range(3))
                                       for row in range(3))
    p, q, r = right.T
    first, second, third = e * i - f * h, f * g - d * i, d * h - e * g
    determinant = a * first + b * second + c * third
    inverse = np.divide(1.0, determinant, out=np.zeros_like(determinant),
                        where=np.abs(determinant) > 1e-12)
    return np.stack([first * p + (c * h - b * i) * q + (b * f - c * e) * r,
                     second * p + (a * i - c * g) * q + (c * d - a * f) * r,
                     third * p + (b * g - a * h) * q + (a * e - b * d) * r],
                    axis=1) * inverse[:, None]
