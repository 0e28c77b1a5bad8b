"""Independent draws from the learnt prior that reproduce a signal, one of the METHODS.

A component is chosen by its posterior weight. Its posterior is Gaussian in the logit (Laplace). The
draws are moved away from the mixture's mean by the calibrated band factors, so that they are as
wide as the calibrated band. Each draw then gets a noise n from its posterior N(R Q^-1 r, R - R Q^-1
R), and Newton steps along S J' take it to the signal y - n to 1e-10. Noise-free signals (R = 0) are
reproduced to that accuracy; no draw leaves (0, 1).

The projection moves a draw across the directions that the camera sees, where the posterior is
narrow; along the directions that it does not see the draw stays where it is. Within a component the
law is that of Laplace's approximation, not exact: the calibration is what makes the bands hold.
"""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spectrabox.radiometry.bspline import basis_matrix
from spectrabox.radiometry.errors import ConvergenceError
from spectrabox.radiometry.records import Outcome, SpectralMeasurement, SpectrumSamples
from spectrabox.sampling.checks import check_measurement
from spectrabox.sampling.measurement import MeasurementOperator, nearest_splines, response_on
from spectrabox.sampling.polytope.tilt import is_reachable
from spectrabox.sampling.polytope.tilted_rejection import noise_columns
from spectrabox.sampling.prior.mixture import GRID, LogitMixture, load_prior, reflectance
from spectrabox.sampling.prior.posterior import (
    LEVEL,
    MixturePosterior,
    allowed_misfit,
    band_factors,
    novelty,
    posterior,
    with_floor,
)
from spectrabox.sampling.prior.smoothness import smoothness_prior

SIGNAL_ATOL = 1e-10             # of white
NEWTON_STEPS = 12
MAX_STEP = 3.0                  # logits
BLOCK = 2048
MENTIONED = 0.005               # share of a family that the outcome names
# of drawing again what could not be taken to its signal: where the noise reaches far beyond what a
# reflectance can be, one draw in thirty gets there
ROUNDS = 200


@dataclass(frozen=True)
class _Component:
    """What draws of one component need."""

    centre: np.ndarray          # (P,) logits
    root: np.ndarray            # (P, P) square root of the posterior's covariance
    gain: np.ndarray            # (P, K)
    noise_mean: np.ndarray      # (K,)
    noise_root: np.ndarray      # (K, r)


@dataclass(frozen=True)
class _Target:
    """The posterior of one signal, and what its draws must reproduce."""

    components: list[_Component]
    weights: np.ndarray             # (C,) of the components
    relative_response: np.ndarray   # (K, P)
    signal: np.ndarray              # (K,)
    approximate: bool               # the signal cannot be reached: draws come near to it


@dataclass(frozen=True)
class PriorSpectra:
    """Draws (T, 61), and the families of surfaces that the signal allows, by share."""

    spectra: np.ndarray
    method: str
    outcome: Outcome
    stated: tuple[str, ...]         # families that were stated
    shares: dict[str, float]

    @property
    def sentence(self) -> str:
        """How the draws ended, and what they are conditional on."""
        return sentence_of(self.outcome, self.stated, self.shares)


def sentence_of(outcome: Outcome, stated: tuple[str, ...], shares: dict[str, float]) -> str:
    """An outcome, and what it is conditional on: families stated, and shares of those allowed."""
    if outcome is not Outcome.FAMILIAR:
        return outcome.value
    allowed = sorted(shares, key=lambda name: -shares[name])
    said = ", ".join(f"{name} {100 * shares[name]:.0f} %" for name in allowed
                     if shares[name] >= MENTIONED)
    if stated:
        given = f"Conditional on the surface being {' or '.join(stated)}, as stated"
        return f"{outcome.value} {given}{f': {said}' if len(stated) > 1 else ''}."
    return f"{outcome.value} No family of surfaces was stated; the signal allows {said}."


def sample_prior(measurement: SpectralMeasurement, draws: int, seed: int, coefficients: int = 13,
                 prior: LogitMixture | None = None) -> SpectrumSamples:
    """Spectra drawn from the learnt prior given one signal; see `sampling.methods.draw_spectra`.

    The outcome says when the signal lies outside what the prior knows and the smoothness prior was
    used. ``coefficients`` is the N of the splines that are fitted to the draws.

    Raises
    ------
    InputError
        For a signal or covariance that is none, or no draws.
    ConvergenceError
        If draws do not reach the signal.
    """
    drawn = prior_spectra(measurement, draws, seed, prior or load_prior())
    splines = nearest_splines(drawn.spectra, basis_matrix(GRID.nm, coefficients))
    return SpectrumSamples(GRID, drawn.spectra, splines, drawn.method, float(draws), seed,
                           drawn.outcome, drawn.sentence)


def prior_spectra(measurement: SpectralMeasurement, draws: int, seed: int,
                  prior: LogitMixture) -> PriorSpectra:
    """Spectra as `sample_prior` draws them, without splines.

    Raises
    ------
    InputError, ConvergenceError
        As `sample_prior`.
    """
    check_measurement(measurement, draws)
    relative_response = response_on(measurement, GRID)
    outcome, method = Outcome.FAMILIAR, "learnt prior"
    mixture = _posterior(prior, relative_response, measurement)
    allowed = float(allowed_misfit(measurement.noise_covariance))
    if novelty(prior, mixture, measurement.noise_covariance)[0] > 1:
        prior, outcome, method = smoothness_prior(), Outcome.UNFAMILIAR, "smoothness prior"
        mixture = _posterior(prior, relative_response, measurement)
        if mixture.misfit[0] > allowed:
            operator = MeasurementOperator(relative_response, measurement.signal,
                                           measurement.noise_covariance)
            outcome = Outcome.TOO_ROUGH if is_reachable(operator) else Outcome.OUT_OF_REACH
    chosen = np.flatnonzero(mixture.weights[0])
    factor = band_factors(prior, mixture, LEVEL)[0]
    components = [_component(prior, mixture, relative_response, measurement, factor, int(index))
                  for index in chosen]
    spectra = _draw(_Target(components, mixture.weights[0, chosen], relative_response,
                            measurement.signal,
                            outcome in (Outcome.TOO_ROUGH, Outcome.OUT_OF_REACH)), draws, seed)
    return PriorSpectra(spectra, method, outcome, prior.stated,
                        dict(zip(prior.families, prior.shares(mixture.weights)[0].tolist(),
                                 strict=True)))


def family_shares(prior: LogitMixture, measurement: SpectralMeasurement) -> dict[str, float]:
    """Shares of the families of surfaces that a signal allows, by name."""
    mixture = _posterior(prior, response_on(measurement, GRID), measurement)
    return dict(zip(prior.families, prior.shares(mixture.weights)[0].tolist(), strict=True))


def _posterior(prior: LogitMixture, relative_response: np.ndarray,
               measurement: SpectralMeasurement) -> MixturePosterior:
    return posterior(prior, relative_response, measurement.signal[None],
                     measurement.noise_covariance)


def _component(prior: LogitMixture, mixture: MixturePosterior, relative_response: np.ndarray,
               measurement: SpectralMeasurement, factor: np.ndarray, index: int) -> _Component:
    centre = mixture.logits[index, 0]
    p = reflectance(centre)
    jacobian = relative_response * (p * (1 - p))
    base = prior.covariances[index] @ jacobian.T
    prior_of_signal = jacobian @ base
    R = measurement.noise_covariance
    residual = measurement.signal - relative_response @ p \
        + jacobian @ (centre - prior.means[index])
    Q = prior_of_signal + with_floor(R)
    covariance = prior.covariances[index] - base @ np.linalg.solve(Q, base.T)
    values, vectors = np.linalg.eigh((covariance + covariance.T) / 2)
    middle = mixture.weights[0] @ mixture.logits[:, 0]
    root = factor[:, None] * vectors * np.sqrt(np.maximum(values, 0))
    shrink = R @ np.linalg.inv(prior_of_signal + R + 1e-12 * np.eye(len(R)))
    return _Component(middle + factor * (centre - middle), root,
                      base @ np.linalg.inv(prior_of_signal), shrink @ residual,
                      noise_columns((R - shrink @ R + (R - shrink @ R).T) / 2))


def _draw(target: _Target, draws: int, seed: int) -> np.ndarray:
    sizes = [BLOCK] * (draws // BLOCK) + ([draws % BLOCK] if draws % BLOCK else [])
    seeds = np.random.SeedSequence(seed).spawn(len(sizes))

    return np.concatenate([_block(target, size, np.random.default_rng(seed))
                           for size, seed in zip(sizes, seeds, strict=True)])


def _block(target: _Target, draws: int, rng: np.random.Generator) -> np.ndarray:
    out = np.empty((draws, target.relative_response.shape[1]))
    missing = np.arange(draws)
    for _ in range(ROUNDS):
        chosen = rng.choice(len(target.components), size=missing.size, p=target.weights)
        failed = []
        for index, component in enumerate(target.components):
            rows = missing[chosen == index]
            out[rows], reached = _of_component(target, component, rows.size, rng)
            failed.append(rows[~reached])
        missing = np.concatenate(failed)
        if not missing.size or target.approximate:
            return out
    raise ConvergenceError(f"{missing.size} of {draws} draws of the learnt prior did not reach the "
                           "signal; state its noise, or use the method 'uniform'")


def _of_component(target: _Target, component: _Component, draws: int,
                  rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Reflectances (n, P) of one component at their own signals, and which of them got there."""
    M, bands = target.relative_response, len(target.signal)
    x = rng.standard_normal((draws, component.root.shape[1])) @ component.root.T + component.centre
    noise = rng.standard_normal((draws, component.noise_root.shape[1]))
    wanted = target.signal - (component.noise_mean + noise @ component.noise_root.T)
    # d(signal)/d(step) of every draw is the sum over wavelengths of p (1 - p) times these products.
    products = (M[:, None, :] * component.gain.T).reshape(bands * bands, -1).T
    for _ in range(NEWTON_STEPS):
        p = 1 / (1 + np.exp(-x))  # as `reflectance`, which is safe for any x but three times slower
        residual = wanted - p @ M.T
        if np.abs(residual).max(initial=0) < SIGNAL_ATOL:
            break
        slopes = ((p - p * p) @ products).reshape(draws, bands, bands)
        step = solve_each(slopes, residual) @ component.gain.T
        if np.maximum(step.max(), -step.min()) > MAX_STEP:
            length = np.abs(step).max(axis=1, keepdims=True)
            step *= np.minimum(1, MAX_STEP / np.maximum(length, 1e-12))
        x += step
    p = reflectance(x)
    return p, np.abs(wanted - p @ M.T).max(axis=1) < 10 * SIGNAL_ATOL


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
