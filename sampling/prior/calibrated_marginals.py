"""Marginal distributions of posterior draws (posterior_draws.py), to second order, without draws.

A draw of one component is x0 = m + F dz, dz normal with the component's covariance S, F the
calibrated factors about the mixture's mean. Then it is moved along the gain K until its signal is
the measured one less its noise. The centre m is moved there first, to m'. With J the signal's
slope at m' and J K = 1, a draw is m' + dx + K a with

    dx = (1 - K J) F dz - K n,      a_k = -1/2 sum_q M_kq p''(m'_q) (dx_q^2)

The second term is what the bend of the logit adds: the signal of x0 changes with dx^2 although J dx
is what it should be, and the move along K makes up for it. It is a quadratic form in a normal
vector, so its mean, its variance and the third cumulant that it gives are known from the covariance
C of dx: with H = -(C o C) (M p'')', o by element,

    mean K E(a),    variance K (-1/2 M p'' H) K',    third cumulant 3 K_p. H_p.

They make a skewed marginal distribution (quantiles.py) at each wavelength.

Where errors multiply, n bends the signal as a normal K n in the logit does (posterior_draws.py), so
that this part of dx, of covariance C' = K N K', takes nothing back: C o C less C' o C' is what
stands for C o C.
"""
from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from spectrabox.radiometry.grid import grid_from_nm, interpolation_matrix
from spectrabox.sampling.prior import level, mixture_posterior
from spectrabox.sampling.prior.mixture import PRIOR_GRID, LogitMixture, reflectance
from spectrabox.sampling.summary import READING_ERROR

# of a centre to its signal; it begins near, but where errors multiply
NEWTON_STEPS, MORE_STEPS = 3, 6
MAX_STEP = 2.0              # logits
SIGNALS = 32                # at a time, with some twenty components each: as well
PAIRS = 64                  # of component and signal at a time: their covariances fit the cache
# Covariances are smooth: their squares are integrated over every third wavelength.
COARSE = slice(0, None, 3)
BETWEEN = interpolation_matrix(PRIOR_GRID.nm[COARSE], PRIOR_GRID.nm)
MIN_SKEW, MAX_SKEW = 1e-6, 0.5      # the least is none
MIN_VARIANCE = 1e-8


@dataclass(frozen=True)
class _Pairs:
    """Components that signals allow, n pairs, those of one signal together."""

    signal: np.ndarray          # (n,) row
    component: np.ndarray       # (n,)
    weight: np.ndarray          # (n,)
    with_level: np.ndarray      # (n, P), and
    stretch: np.ndarray         # (n,) of the covariance of the component (level.py)
    factor: np.ndarray          # (n, P)
    base: np.ndarray            # (n, K, P) J S at the mode
    seen: np.ndarray            # (n, K, P) Q^-1 J S: S less base' seen is the covariance of dz
    noise: np.ndarray           # (n, K, K) of n
    centre: np.ndarray          # (n, P) m'


def marginal_moments(prior: LogitMixture, relative_response: np.ndarray, signals: np.ndarray,
                     covariance: np.ndarray, mixture: mixture_posterior.MixturePosterior,
                     relative: mixture_posterior.RelativeErrors | None = None
                     ) -> tuple[mixture_posterior.MixturePosterior, np.ndarray]:
    """The mixture of skewed components that draws follow, and the covariance (T, P, P') of their
    reflectances, linearised, between all wavelengths and every third, `COARSE`.

    Parameters
    ----------
    prior : LogitMixture
    relative_response : (K, P) array
    signals : (T, K) array
    covariance : (T, K, K) array
        Of the signals' noise.
    mixture : MixturePosterior
        Of these signals.
    relative : RelativeErrors, optional
        With which it was solved.
    """
    if len(signals) > SIGNALS:
        blocks = [slice(start, start + SIGNALS) for start in range(0, len(signals), SIGNALS)]
        parts, covariances = zip(*(
            marginal_moments(prior, relative_response, signals[rows], covariance[rows],
                             mixture.rows(rows),
                             None if relative is None else relative.rows(rows))
            for rows in blocks), strict=True)
        logits, variances, skews = (np.concatenate([getattr(part, name) for part in parts], axis=1)
                                    for name in ("logits", "variances", "skews"))
        return (replace(mixture, logits=logits, variances=variances, skews=skews),
                np.concatenate(covariances))
    pairs = _pairs(prior, relative_response, signals, covariance, mixture, relative)
    p = reflectance(pairs.centre)
    slope = p * (1 - p)
    # the pairs of a signal follow one another, and every signal has some
    first = np.flatnonzero(np.diff(pairs.signal, prepend=-1))
    away = p - np.add.reduceat(pairs.weight[:, None] * p, first, axis=0)[pairs.signal]
    own, half, gain = _moved(prior, relative_response, pairs, slope)
    bend = relative_response * (slope * (1 - 2 * p))[:, None, :]                    # M p''
    coarse_bend = (relative_response @ BETWEEN) * (slope * (1 - 2 * p))[:, None, COARSE]
    H = np.empty_like(gain)
    along = gain @ pairs.noise
    of_noise = np.zeros_like(own) if relative is None else np.sum(along * gain, axis=2)
    together = np.zeros((len(signals), PRIOR_GRID.nm.size, BETWEEN.shape[1]))
    # What follows is of single precision: with doubles it takes twice as long.
    coarse = prior.covariances[:, :, COARSE].astype(np.float32)
    turned_bend = coarse_bend.astype(np.float32).transpose(0, 2, 1)
    root = np.sqrt(pairs.weight)[:, None]
    slopes, aways = (root * slope).astype(np.float32), (root * away).astype(np.float32)
    for start in range(0, len(p), PAIRS):
        rows = slice(start, start + PAIRS)
        C = _covariances(coarse[pairs.component[rows]], pairs, half, gain, rows)
        H[rows] = -np.square(C) @ turned_bend[rows]
        if relative is not None:
            own_part = along[rows].astype(np.float32) @ gain[rows, COARSE].astype(
                np.float32).transpose(0, 2, 1)
            H[rows] += np.square(own_part) @ turned_bend[rows]
        C *= slopes[rows, :, None]
        C *= slopes[rows, None, COARSE]
        C += aways[rows, :, None] * aways[rows, None, COARSE]
        at = np.flatnonzero(np.diff(pairs.signal[rows], prepend=-1))
        together[pairs.signal[rows][at]] += np.add.reduceat(C, at, axis=0)
    mean = pairs.centre + (gain @ (-0.5 * (bend @ (own - of_noise)[..., None])))[..., 0]
    variance = own + np.sum((gain @ (-0.5 * (coarse_bend @ H[:, COARSE]))) * gain, axis=2)
    third = 3 * np.sum(gain * H, axis=2)
    return _skewed(mixture, pairs, mean, np.maximum(variance, MIN_VARIANCE), third), together


def next_readings_nm(covariance: np.ndarray, standard_deviation: np.ndarray) -> np.ndarray:
    """Wavelengths (T,) whose reading would take most off the total variance of each spectrum.

    As `summary.next_measurement_nm`, all at once.

    Parameters
    ----------
    covariance : (T, 61, 21) array
        From `marginal_moments`, between all wavelengths and every third.
    standard_deviation : (T, 61) array
    """
    reduction = np.square(covariance) @ grid_from_nm(PRIOR_GRID.nm[COARSE]).weights_nm \
        / (standard_deviation**2 + READING_ERROR**2)
    return np.asarray(PRIOR_GRID.nm[np.argmax(reduction, axis=1)])


def _skewed(mixture: mixture_posterior.MixturePosterior, pairs: _Pairs, mean: np.ndarray,
            variance: np.ndarray, third: np.ndarray) -> mixture_posterior.MixturePosterior:
    """The mixture with components of these means, variances and third cumulants (n, P)."""
    skew = np.clip(third / variance**1.5 / 3, -MAX_SKEW, MAX_SKEW)
    skew = np.where(np.abs(skew) < MIN_SKEW, MIN_SKEW, skew)
    growth = np.expm1(skew**2)
    deviation = np.sqrt(variance * skew**2 / (growth * (1 + growth)))
    logits, variances = mixture.logits.copy(), mixture.variances.copy()
    skews = np.full(logits.shape, MIN_SKEW)
    chosen = pairs.component, pairs.signal
    # The centre of a skewed component is its median.
    logits[chosen] = mean - deviation * np.expm1(skew**2 / 2) / skew
    variances[chosen], skews[chosen] = deviation**2, skew
    return replace(mixture, logits=logits, variances=variances, skews=skews)


def _pairs(prior: LogitMixture, relative_response: np.ndarray, signals: np.ndarray,
           covariance: np.ndarray, mixture: mixture_posterior.MixturePosterior,
           relative: mixture_posterior.RelativeErrors | None) -> _Pairs:
    signal, component = np.nonzero(mixture.weights)
    seen, R, floored = mixture_posterior.seen_by(component, signal, mixture, relative_response,
                                                 signals, covariance, relative)
    mode = mixture.logits[component, signal]
    p = reflectance(mode)
    slope = p * (1 - p)
    jacobian = relative_response * slope[:, None, :]
    base = np.empty_like(jacobian)
    for index in range(len(prior.weights)):
        rows = component == index
        base[rows] = jacobian[rows] @ prior.covariances[index]
    with_level = prior.with_level[component]
    stretch = mixture.stretch[signal, component]
    base = level.with_stretch(base, jacobian, with_level, stretch)
    means = prior.means[component] + mixture.shift[signal, component, None] * with_level
    of_signal = base @ jacobian.transpose(0, 2, 1)
    residual = seen - p @ relative_response.T + (slope * (mode - means)) @ relative_response.T
    # As `posterior_draws._component` has them.
    shrink = R @ np.linalg.inv(of_signal + R + 1e-12 * np.eye(R.shape[1]))
    wanted = seen - (shrink @ residual[..., None])[..., 0]
    factor = mixture_posterior.band_factors(prior, mixture, mixture_posterior.LEVEL)[signal]
    middle = np.einsum("tc,ctp->tp", mixture.weights, mixture.logits)[signal]
    centre = middle + factor * (mode - middle)
    for _ in range(NEWTON_STEPS if relative is None else MORE_STEPS):
        p = reflectance(centre)
        slopes = (relative_response * (p * (1 - p))[:, None, :]) @ base.transpose(0, 2, 1)
        missing = (wanted - p @ relative_response.T)[..., None]
        step = (np.linalg.solve(slopes, missing).transpose(0, 2, 1) @ base)[:, 0]
        length = np.abs(step).max(axis=1, keepdims=True)
        centre += step * np.minimum(1, MAX_STEP / np.maximum(length, MAX_STEP))
    return _Pairs(signal, component, mixture.weights[signal, component], with_level, stretch,
                  factor, base, np.linalg.solve(of_signal + floored, base), R - shrink @ R, centre)


def _moved(prior: LogitMixture, relative_response: np.ndarray, pairs: _Pairs,
           slope: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The diagonal (n, P) of C, a (n, P, K) with C = F S F + a K' + K a', and K (n, P, K)."""
    turned = pairs.base.transpose(0, 2, 1)
    jacobian = relative_response * slope[:, None, :]
    gain = turned @ np.linalg.inv(jacobian @ turned)
    scaled = jacobian * pairs.factor[:, None, :]
    seen = np.empty_like(scaled)
    for index in range(len(prior.weights)):
        rows = pairs.component == index
        seen[rows] = scaled[rows] @ prior.covariances[index]
    seen = level.with_stretch(seen, scaled, pairs.with_level, pairs.stretch)
    seen -= (scaled @ turned) @ pairs.seen
    seen *= pairs.factor[:, None, :]
    # (1 - K J) F S F (1 - K J)' + K N K', multiplied out
    half = gain @ (0.5 * (jacobian @ seen.transpose(0, 2, 1) + pairs.noise)) \
        - seen.transpose(0, 2, 1)
    own = np.diagonal(prior.covariances, axis1=1, axis2=2)[pairs.component] \
        + pairs.stretch[:, None] * pairs.with_level**2 \
        - np.einsum("nkp,nkp->np", pairs.base, pairs.seen)
    return (np.maximum(pairs.factor**2 * own + 2 * np.einsum("npk,npk->np", half, gain),
                       MIN_VARIANCE), half, gain)


def _covariances(S: np.ndarray, pairs: _Pairs, half: np.ndarray, gain: np.ndarray,
                 rows: slice) -> np.ndarray:
    """C (n, P, P') of some pairs, single precision, between all wavelengths and coarse ones, from
    the prior's S (n, P, P').
    """
    factor, turned = pairs.factor[rows, :, None], pairs.base[rows].transpose(0, 2, 1)
    single = factor.astype(np.float32)
    C = S * single
    C *= single[:, COARSE, 0][:, None]
    level = factor * pairs.with_level[rows, :, None]
    left = np.concatenate([-factor * turned, half[rows], gain[rows],
                           pairs.stretch[rows, None, None] * level], axis=2, dtype=np.float32)
    right = np.concatenate([factor * pairs.seen[rows].transpose(0, 2, 1), gain[rows], half[rows],
                            level], axis=2, dtype=np.float32)[:, COARSE]
    C += left @ right.transpose(0, 2, 1)
    return C
