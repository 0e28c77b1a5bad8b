"""What a signal says under the learnt prior: posterior of each component, mean, calibrated bands.

Per component an iterated extended Kalman filter in the logit: with p = reflectance(x) and J = M
diag(p (1 - p)),

    Q = J S J' + R,   x <- mu + S J' Q^-1 (y - M p + J (x - mu))

until x stands still. This is Gauss-Newton on the posterior's logarithm; its Gaussian at the end is
the component's posterior (Laplace), and -r' Q^-1 r / 2 - log det Q / 2 its log evidence. All
signals are treated at once; a component that is far behind after a few steps is given up for a
signal, and weighs nothing.
"""
from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from scipy.special import ndtr, ndtri

from spectrabox.radiometry.shaped import Record
from spectrabox.sampling.prior.mixture import LogitMixture, reflectance

# of the filter; the largest change of a logit that counts as standing still
STEPS, STILL = 25, 1e-6
TRIED, BEHIND = 2, 15.0     # steps before components are compared; nats that give one up
BLOCK = 64                  # signals at a time: what they take then fits the cache
NEGLIGIBLE = 2e-3           # weight of a component that is left out of a signal's posterior
MAX_STEP = 2.0              # logits per step: keeps the linearisation where it is of use
SIGNAL_FLOOR = 1e-3  # of white: the least standard error of a signal taken into the likelihood
# a component that misses the signal by more than 0.5 % of white is given up
MISFIT, PENALTY = 5e-3, 1e5
HERMITE_NODES, HERMITE_WEIGHTS = np.polynomial.hermite_e.hermegauss(9)
BISECTIONS, NEWTON_STEPS = 10, 6
ROOT_2_PI = np.sqrt(2 * np.pi)
USUAL_WIDTH = 0.12          # mean of a 95 % band before calibration
LEVEL = 0.95                # whose calibrated factor enlarges draws, and what is said of them


@dataclass(frozen=True, eq=False)
class MixturePosterior(Record):
    """Posterior of T signals under C components: weights, and mean and variance of the logits."""

    weights: Annotated[np.ndarray, "T C"]
    logits: Annotated[np.ndarray, "C T P"]
    variances: Annotated[np.ndarray, "C T P"]
    misfit: Annotated[np.ndarray, "T"]  # largest |signal - M p|, averaged over the components
    # least r' Q^-1 r over the components: chi-square with K degrees
    surprise: Annotated[np.ndarray, "T"]


@dataclass(frozen=True)
class _Seen:
    """What was measured: response (K, P), signals (T, K), noise (T, K, K) with its floor."""

    relative_response: np.ndarray
    signals: np.ndarray
    noise: np.ndarray


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
    seen = _Seen(relative_response, signals, noise)
    components = list(zip(prior.means, prior.covariances, strict=True))
    shape = (len(components), len(signals))
    logits = np.repeat(prior.means[:, None], len(signals), axis=1)
    variances = np.repeat(np.diagonal(prior.covariances, axis1=1, axis2=2)[:, None], len(signals),
                          axis=1)
    log_weights, everyone = np.log(prior.weights), np.arange(len(signals))
    rough = np.array([log_weights[index] + climb(seen, everyone, *component, logits[index], TRIED)
                      for index, component in enumerate(components)])
    score, misfit, surprise = np.full(shape, -np.inf), np.zeros(shape), np.full(shape, np.inf)
    for index, component in enumerate(components):
        near = np.flatnonzero(rough[index] > rough.max(axis=0) - BEHIND)
        climb(seen, near, *component, logits[index], STEPS)
        variances[index, near], evidence, misfit[index, near], surprise[index, near] = laplace(
            seen, near, *component, logits[index, near])
        score[index, near] = log_weights[index] + evidence \
            - PENALTY * np.maximum(misfit[index, near] - MISFIT, 0)
    weights = np.exp(score - score.max(axis=0))
    weights /= weights.sum(axis=0)
    weights[weights < NEGLIGIBLE] = 0
    weights /= weights.sum(axis=0)
    return MixturePosterior(weights.T, logits, variances, (weights * misfit).sum(axis=0),
                            surprise.min(axis=0))


def with_floor(covariance: np.ndarray) -> np.ndarray:
    """The covariance (..., K, K) with at least 0.1 % of white of independent error per band."""
    return covariance + SIGNAL_FLOOR**2 * np.eye(covariance.shape[-1])


def climb(seen: _Seen, rows: np.ndarray, mean: np.ndarray, covariance: np.ndarray, x: np.ndarray,
          steps: int) -> np.ndarray:
    """Move logits x (T, P) of some rows towards one component's mode, in place.

    Returns the log evidence (n,) of those rows where the last step began.
    """
    evidence, active = np.full(len(x), -np.inf), rows
    for _ in range(steps):
        gain_base, Q, residual = _linearised(seen, active, mean, covariance, x[active])
        solved = np.linalg.solve(Q, residual[..., None])[..., 0]
        evidence[active] = _log_evidence(Q, residual, solved)
        step = mean + np.einsum("tkp,tk->tp", gain_base, solved) - x[active]
        length = np.abs(step).max(axis=1)
        x[active] += step * np.minimum(1, MAX_STEP / np.maximum(length, STILL))[:, None]
        active = active[length > STILL]
        if not active.size:
            break
    return evidence[rows]


def laplace(seen: _Seen, rows: np.ndarray, mean: np.ndarray, covariance: np.ndarray,
            x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Variances (n, P), log evidence (n,), largest misfit (n,) and r' Q^-1 r (n,) of some rows at
    one component's modes x (n, P).
    """
    gain_base, Q, residual = _linearised(seen, rows, mean, covariance, x)
    solved = np.linalg.solve(Q, np.concatenate([gain_base, residual[..., None]], axis=2))
    variance = np.diag(covariance) - np.einsum("tkp,tkp->tp", gain_base, solved[..., :-1])
    surprise = np.einsum("tk,tk->t", residual, solved[..., -1])
    misfit = np.abs(seen.signals[rows] - reflectance(x) @ seen.relative_response.T).max(axis=1)
    return (np.maximum(variance, 1e-8), _log_evidence(Q, residual, solved[..., -1]), misfit,
            surprise)


def _log_evidence(Q: np.ndarray, residual: np.ndarray, solved: np.ndarray) -> np.ndarray:
    return np.asarray(-np.einsum("tk,tk->t", residual, solved) / 2 - np.linalg.slogdet(Q)[1] / 2)


def _linearised(seen: _Seen, rows: np.ndarray, mean: np.ndarray, covariance: np.ndarray,
                x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    p = reflectance(x)
    slope = p * (1 - p)
    jacobian = seen.relative_response * slope[:, None, :]
    gain_base = (jacobian.reshape(-1, x.shape[1]) @ covariance).reshape(jacobian.shape)
    Q = gain_base @ jacobian.transpose(0, 2, 1) + seen.noise[rows]
    residual = seen.signals[rows] - p @ seen.relative_response.T \
        + (slope * (x - mean)) @ seen.relative_response.T
    return gain_base, Q, residual


def mean_and_spread(mixture: MixturePosterior) -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard deviation (T, P) of the reflectance, by nine-point Gauss-Hermite
    quadrature.
    """
    first, second = np.zeros(mixture.logits.shape[1:]), np.zeros(mixture.logits.shape[1:])
    for rows, weights, logits, deviations in _blocks(mixture):
        for node, node_weight in zip(HERMITE_NODES, HERMITE_WEIGHTS / HERMITE_WEIGHTS.sum(),
                                     strict=True):
            values = reflectance(logits + node * deviations)
            first[rows] += node_weight * np.einsum("tc,tcp->tp", weights, values)
            second[rows] += node_weight * np.einsum("tc,tcp->tp", weights, values**2)
    return first, np.sqrt(np.maximum(second - first**2, 1e-12))


def central_band(mixture: MixturePosterior, level: float) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper reflectance (T, P) of the mixture's central band, not yet calibrated."""
    lower, upper = (1 - level) / 2, (1 + level) / 2
    return (reflectance(mixture_quantile(mixture, lower)),
            reflectance(mixture_quantile(mixture, upper)))


def mixture_quantile(mixture: MixturePosterior, probability: float) -> np.ndarray:
    """Quantile (T, P) of the Gaussian mixture in the logit, by bisection, then Newton's steps."""
    quantiles = np.empty(mixture.logits.shape[1:])
    for rows, weights, logits, deviations in _blocks(mixture):
        quantiles[rows] = _quantile(weights, logits, deviations, probability)
    return quantiles


def _quantile(weights: np.ndarray, logits: np.ndarray, deviations: np.ndarray,
              probability: float) -> np.ndarray:
    at = logits + ndtri(probability) * deviations
    # the mixture's quantile lies between its components' quantiles
    possible = weights[..., None] > 0
    low = at.min(axis=1, where=possible, initial=np.inf)
    high = at.max(axis=1, where=possible, initial=-np.inf)
    for step in range(BISECTIONS + NEWTON_STEPS):
        if step <= BISECTIONS:
            x = (low + high) / 2
        z = (x[:, None] - logits) / deviations
        above = np.einsum("tc,tcp->tp", weights, ndtr(z)) - probability
        low, high = np.where(above < 0, x, low), np.where(above < 0, high, x)
        if step >= BISECTIONS:
            density = np.einsum("tc,tcp->tp", weights, np.exp(-z * z / 2) / deviations)
            x = np.clip(x - above * ROOT_2_PI / np.maximum(density, 1e-12), low, high)
    return x


def _blocks(mixture: MixturePosterior) -> Iterator[tuple[np.ndarray, ...]]:
    """Blocks of signals that allow about as many components: their rows (n,), and weights (n, c),
    logits and deviations (n, c, P) of these, the heaviest first.
    """
    counts = np.count_nonzero(mixture.weights, axis=1)
    by_count = np.argsort(counts, kind="stable")
    for start in range(0, by_count.size, BLOCK):
        rows = by_count[start:start + BLOCK]
        heaviest = np.argsort(-mixture.weights[rows], axis=1,
                              kind="stable")[:, :counts[rows[-1]]]
        yield (rows, mixture.weights[rows[:, None], heaviest],
               mixture.logits[heaviest, rows[:, None]],
               np.sqrt(mixture.variances[heaviest, rows[:, None]]))


def calibrated_band(prior: LogitMixture, mixture: MixturePosterior,
                    level: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean (T, P), and lower and upper reflectance (T, P) of the calibrated band, in [0, 1]."""
    mean, _ = mean_and_spread(mixture)
    return mean, *widened(mean, *central_band(mixture, level),
                          band_factors(prior, mixture, level))


def widened(mean: np.ndarray, lower: np.ndarray, upper: np.ndarray,
            factor: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
    """The band (T, P) widened about the mean by factors that broadcast to it, within 0 and 1."""
    return (np.clip(mean - factor * (mean - lower), 0, 1),
            np.clip(mean + factor * (upper - mean), 0, 1))


def band_factors(prior: LogitMixture, mixture: MixturePosterior, level: float) -> np.ndarray:
    """Factors (T, P) by which central bands are widened: the families', by share, for the width."""
    return width_factors(prior, mixture) * prior.band_factor(level, mixture.weights)


def as_drawn(prior: LogitMixture, mixture: MixturePosterior, level: float) -> MixturePosterior:
    """The mixture that draws follow: moved away from its mean logit by the factors of ``level``."""
    factor = band_factors(prior, mixture, level)
    middle = np.einsum("tc,ctp->tp", mixture.weights, mixture.logits)
    return replace(mixture, logits=middle + factor * (mixture.logits - middle),
                   variances=factor**2 * mixture.variances)


def width_factors(prior: LogitMixture, mixture: MixturePosterior) -> np.ndarray:
    """Factors (T, 1) of bands for how wide they are before calibration, 1 for the usual width.

    Of a learnt prior they fall: bands that are wide are too wide rather than too narrow.
    """
    width = 2 * ndtri(0.975) * mean_and_spread(mixture)[1].mean(axis=1, keepdims=True)
    return np.asarray((width / USUAL_WIDTH)**prior.width_power)


def conformal_scores(mean: np.ndarray, lower: np.ndarray, upper: np.ndarray,
                     truth: np.ndarray) -> np.ndarray:
    """The factor (T, P) that each band would have needed to hold the truth."""
    below = (mean - truth) / np.maximum(mean - lower, 1e-4)
    above = (truth - mean) / np.maximum(upper - mean, 1e-4)
    return np.maximum(below, above)
