"""What a signal says under the learnt prior: posterior of each component, mean, calibrated bands.

Per component an iterated extended Kalman filter in the logit: with p = reflectance(x) and J = M
diag(p (1 - p)),

    Q = J S J' + R,   x <- mu + S J' Q^-1 (y - M p + J (x - mu))

until x stands still. This is Gauss-Newton on the posterior's logarithm; its Gaussian at the end is
the component's posterior (Laplace), and -r' Q^-1 r / 2 - log det Q / 2 its log evidence. All
signals are treated at once.
"""
from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from scipy.special import ndtr, ndtri

from spectrabox.radiometry.shaped import Record
from spectrabox.sampling.prior.mixture import LogitMixture, reflectance

# of the filter; the largest change of a logit that counts as standing still
STEPS, STILL = 25, 1e-6
MAX_STEP = 2.0              # logits per step: keeps the linearisation where it is of use
SIGNAL_FLOOR = 1e-3  # of white: the least standard error of a signal taken into the likelihood
# a component that misses the signal by more than 0.5 % of white is given up
MISFIT, PENALTY = 5e-3, 1e5
HERMITE_NODES, HERMITE_WEIGHTS = np.polynomial.hermite_e.hermegauss(9)
BISECTIONS = 30


@dataclass(frozen=True, eq=False)
class MixturePosterior(Record):
    """Posterior of T signals under C components: weights, and mean and variance of the logits."""

    weights: Annotated[np.ndarray, "T C"]
    logits: Annotated[np.ndarray, "C T P"]
    variances: Annotated[np.ndarray, "C T P"]
    misfit: Annotated[np.ndarray, "T"]  # largest |signal - M p|, averaged over the components
    # least r' Q^-1 r over the components: chi-square with K degrees
    surprise: Annotated[np.ndarray, "T"]


def posterior(prior: LogitMixture, relative_response: np.ndarray, signals: np.ndarray,
              covariance: np.ndarray) -> MixturePosterior:
    """Posterior of T signals, all at once.

    Parameters
    ----------
    prior : LogitMixture
    relative_response : (K, P) array
        On the prior's wavelengths, rows summing to 1.
    signals : (T, K) array
        Relative to white.
    covariance : (T, K, K) or (K, K) array
        Of the signals' noise; 0.1 % of white is added.
    """
    noise = np.broadcast_to(with_floor(covariance), (len(signals), *covariance.shape[-2:]))
    parts = [component_posterior(relative_response, signals, noise, mean, spread)
             for mean, spread in zip(prior.means, prior.covariances, strict=True)]
    logits, variances, evidence, misfit, surprise = (np.array(part)
                                                     for part in zip(*parts, strict=True))
    score = np.log(prior.weights)[:, None] + evidence - PENALTY * np.maximum(misfit - MISFIT, 0)
    weights = np.exp(score - score.max(axis=0))
    weights /= weights.sum(axis=0)
    return MixturePosterior(weights.T, logits, variances, (weights * misfit).sum(axis=0),
                            surprise.min(axis=0))


def with_floor(covariance: np.ndarray) -> np.ndarray:
    """The covariance (..., K, K) with at least 0.1 % of white of independent error per band."""
    return covariance + SIGNAL_FLOOR**2 * np.eye(covariance.shape[-1])


def component_posterior(relative_response: np.ndarray, signals: np.ndarray, noise: np.ndarray,
                        mean: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, ...]:
    """Logits (T, P), variances (T, P), log evidence (T,), largest misfit (T,) and r' Q^-1 r (T,) of
    one component.
    """
    x = np.tile(mean, (len(signals), 1))
    active = np.arange(len(signals))
    for _ in range(STEPS):
        gain_base, Q, residual = _linearised(relative_response, signals[active], noise[active],
                                             mean, covariance, x[active])
        target = mean + np.einsum("tkp,tk->tp", gain_base,
                                  np.linalg.solve(Q, residual[..., None])[..., 0])
        step = target - x[active]
        length = np.abs(step).max(axis=1)
        x[active] += step * np.minimum(1, MAX_STEP / np.maximum(length, STILL))[:, None]
        active = active[length > STILL]
        if not active.size:
            break
    gain_base, Q, residual = _linearised(relative_response, signals, noise, mean, covariance, x)
    solved = np.linalg.solve(Q, np.concatenate([gain_base, residual[..., None]], axis=2))
    variance = np.diag(covariance) - np.einsum("tkp,tkp->tp", gain_base, solved[..., :-1])
    surprise = np.einsum("tk,tk->t", residual, solved[..., -1])
    evidence = -surprise / 2 - np.linalg.slogdet(Q)[1] / 2
    misfit = np.abs(signals - reflectance(x) @ relative_response.T).max(axis=1)
    return x, np.maximum(variance, 1e-8), evidence, misfit, surprise


def _linearised(relative_response: np.ndarray, signals: np.ndarray, noise: np.ndarray,
                mean: np.ndarray, covariance: np.ndarray,
                x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    p = reflectance(x)
    slope = p * (1 - p)
    jacobian = relative_response * slope[:, None, :]
    gain_base = (jacobian.reshape(-1, x.shape[1]) @ covariance).reshape(jacobian.shape)
    Q = gain_base @ jacobian.transpose(0, 2, 1) + noise
    residual = signals - p @ relative_response.T + (slope * (x - mean)) @ relative_response.T
    return gain_base, Q, residual


def mean_and_spread(mixture: MixturePosterior) -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard deviation (T, P) of the reflectance, by nine-point Gauss-Hermite
    quadrature.
    """
    deviations = np.sqrt(mixture.variances)
    first, second = np.zeros(mixture.logits.shape[1:]), np.zeros(mixture.logits.shape[1:])
    for node, node_weight in zip(HERMITE_NODES, HERMITE_WEIGHTS / HERMITE_WEIGHTS.sum(),
                                 strict=True):
        values = reflectance(mixture.logits + node * deviations)
        first += node_weight * np.einsum("tc,ctp->tp", mixture.weights, values)
        second += node_weight * np.einsum("tc,ctp->tp", mixture.weights, values**2)
    return first, np.sqrt(np.maximum(second - first**2, 1e-12))


def central_band(mixture: MixturePosterior, level: float) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper reflectance (T, P) of the mixture's central band, not yet calibrated."""
    lower, upper = (1 - level) / 2, (1 + level) / 2
    return (reflectance(mixture_quantile(mixture, lower)),
            reflectance(mixture_quantile(mixture, upper)))


def mixture_quantile(mixture: MixturePosterior, probability: float) -> np.ndarray:
    """Quantile (T, P) of the Gaussian mixture in the logit, by bisection to 1e-8 of its width."""
    deviations = np.sqrt(mixture.variances)
    at = mixture.logits + ndtri(probability) * deviations
    # the mixture's quantile lies between its components' quantiles
    low, high = at.min(axis=0), at.max(axis=0)
    weights = mixture.weights.T[..., None]
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        below = (weights * ndtr((middle - mixture.logits) / deviations)).sum(axis=0) < probability
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return (low + high) / 2


def calibrated_band(prior: LogitMixture, mean: np.ndarray, lower: np.ndarray, upper: np.ndarray,
                    factor: float) -> tuple[np.ndarray, np.ndarray]:
    """The band widened about the mean by ``factor``, within 0 and 1."""
    return (np.clip(mean - factor * (mean - lower), 0, 1),
            np.clip(mean + factor * (upper - mean), 0, 1))


def conformal_scores(mean: np.ndarray, lower: np.ndarray, upper: np.ndarray,
                     truth: np.ndarray) -> np.ndarray:
    """The factor (T, P) that each band would have needed to hold the truth."""
    below = (mean - truth) / np.maximum(mean - lower, 1e-4)
    above = (truth - mean) / np.maximum(upper - mean, 1e-4)
    return np.maximum(below, above)
