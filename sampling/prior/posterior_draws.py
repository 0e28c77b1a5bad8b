"""Independent draws from the learnt prior that reproduce a signal.

A component is chosen by its posterior weight. Its posterior is Gaussian in the logit (Laplace). The
draws are moved away from the mixture's mean by the calibrated band factors, so that they are as
wide as the calibrated band. Each draw then gets a noise n from its posterior N(R Q^-1 r, R - R Q^-1
R), and Newton steps along S J' take it to the signal y - n to 1e-10. Noise-free signals (R = 0) are
reproduced to that accuracy; no draw leaves (0, 1).

Where errors multiply, a component has a signal w and a noise n of its own (`seen_by`), and a draw
goes to the signal of the logits c - K n: c are those of its centre, moved to w, and J K = 1 there.
To first order that is w - n, and never beyond black and white, where so wide an error would reach.

The projection moves a draw across the directions that the camera sees, where the posterior is
narrow; along the directions that it does not see the draw stays where it is. Within a component the
law is that of Laplace's approximation, not exact: the calibration is what makes the bands hold.
"""
from __future__ import annotations

from collections.abc import Callable

import numpy as np

from spectrabox.radiometry.errors import ConvergenceError
from spectrabox.sampling.polytope.tilted_rejection import noise_columns
from spectrabox.sampling.prior import mixture_posterior
from spectrabox.sampling.prior.mixture import LogitMixture, reflectance

SIGNAL_ATOL = 1e-10             # of white
NEWTON_STEPS = 12
CENTRE_STEPS, SINGULAR = 30, 1e12       # of a centre to its signal; where no step is to be found
MAX_STEP = 3.0                  # logits
BLOCK = 2048
# Maximum number of redraws of what did not reach its signal: where the noise reaches far beyond
# what a reflectance can be, one draw in thirty gets there.
MAX_REDRAWS = 200


def draw_reflectances(prior: LogitMixture, mixture: mixture_posterior.MixturePosterior,
                      relative_response: np.ndarray, signal: np.ndarray, noise: np.ndarray,
                      draws: int, seed: int, *, approximate: bool = False,
                      relative: mixture_posterior.RelativeErrors | None = None) -> np.ndarray:
    """Reflectances (T, 61) drawn from the posterior of one signal.

    Parameters
    ----------
    prior : LogitMixture
    mixture : MixturePosterior
        Of the one signal under this prior.
    relative_response : (K, 61) array
        Of the measurement, on the prior's wavelengths.
    signal : (K,) array
    noise : (K, K) array
        Its covariance.
    draws, seed : int
        T; the same seed gives the same draws bit for bit.
    approximate : bool
        The signal cannot be reached: take draws that come near to it.
    relative : RelativeErrors, optional
        Of the one signal, with which its posterior was solved.

    Raises
    ------
    ConvergenceError
        If draws do not reach the signal.
    """
    chosen = np.flatnonzero(mixture.weights[0])
    factor = mixture_posterior.band_factors(prior, mixture, mixture_posterior.LEVEL)[0]
    seen = mixture_posterior.seen_by(chosen, np.zeros(chosen.size, int), mixture, relative_response,
                                     signal[None], noise[None], relative)
    samplers = [_component_sampler(prior, mixture, relative_response, factor, int(index), *each,
                                   bent=relative is not None)
                for index, *each in zip(chosen, *seen, strict=True)]
    spectra = np.empty((draws, relative_response.shape[1]))
    blocks = range(0, draws, BLOCK)
    for start, own_seed in zip(blocks, np.random.SeedSequence(seed).spawn(len(blocks)),
                               strict=True):
        rng = np.random.default_rng(own_seed)
        missing = np.arange(start, min(start + BLOCK, draws))
        for _ in range(MAX_REDRAWS):
            number = rng.choice(chosen.size, size=missing.size, p=mixture.weights[0, chosen])
            failed = []
            for index, sampler in enumerate(samplers):
                rows = missing[number == index]
                spectra[rows], reached = sampler(rows.size, rng)
                failed.append(rows[~reached])
            missing = np.concatenate(failed)
            if not missing.size or approximate:
                break
        else:
            raise ConvergenceError(f"{missing.size} of {min(BLOCK, draws - start)} draws of the "
                                   "learnt prior did not reach the signal; state its noise, or use "
                                   "the method 'uniform'")
    return spectra


def _component_sampler(prior: LogitMixture, mixture: mixture_posterior.MixturePosterior,
                       relative_response: np.ndarray, factor: np.ndarray, index: int,
                       signal: np.ndarray, R: np.ndarray, floored: np.ndarray, *, bent: bool
                       ) -> Callable[[int, np.random.Generator], tuple[np.ndarray, np.ndarray]]:
    """A function of a number of draws that gives reflectances (n, P) of one component at signals of
    their own, and which of them got there.
    """
    centre = mixture.logits[index, 0]
    p = reflectance(centre)
    jacobian = relative_response * (p * (1 - p))
    with_level, stretch = prior.with_level[index], mixture.stretch[0, index]
    own = prior.covariances[index] + stretch * np.outer(with_level, with_level)
    base = own @ jacobian.T
    prior_of_signal = jacobian @ base
    residual = signal - relative_response @ p \
        + jacobian @ (centre - prior.means[index] - mixture.shift[0, index] * with_level)
    Q = prior_of_signal + floored
    covariance = own - base @ np.linalg.solve(Q, base.T)
    values, vectors = np.linalg.eigh((covariance + covariance.T) / 2)
    middle = mixture.weights[0] @ mixture.logits[:, 0]
    root = factor[:, None] * vectors * np.sqrt(np.maximum(values, 0))
    shrink = R @ np.linalg.inv(prior_of_signal + R + 1e-12 * np.eye(len(R)))
    wanted = signal - shrink @ residual
    start = middle + factor * (centre - middle)
    noise_root = noise_columns((R - shrink @ R + (R - shrink @ R).T) / 2)
    gain = base @ np.linalg.inv(prior_of_signal)
    moved = _bent(relative_response, start, base, wanted, noise_root) if bent else None

    def signals(draws: int, rng: np.random.Generator) -> np.ndarray:
        """Signals (n, K) that draws go to."""
        noise = rng.standard_normal((draws, noise_root.shape[1]))
        if moved is None:
            return np.asarray(wanted - noise @ noise_root.T)
        logits, by_noise = moved
        return np.asarray(reflectance(logits - noise @ by_noise.T) @ relative_response.T)

    def sampler(draws: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        logits = rng.standard_normal((draws, root.shape[1])) @ root.T + start
        return _at_signals(logits, signals(draws, rng), relative_response, gain)

    return sampler


def _bent(relative_response: np.ndarray, logits: np.ndarray, base: np.ndarray, wanted: np.ndarray,
          noise_root: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Logits (P,) near to some that give a signal (K,), along base (P, K), and by how much noise
    (K, r) moves them (P, r); None where they cannot.
    """
    for _ in range(CENTRE_STEPS):
        p = reflectance(logits)
        slope = (relative_response * (p * (1 - p))) @ base
        missing = wanted - relative_response @ p
        if np.linalg.cond(slope) > SINGULAR:
            return None
        if np.abs(missing).max() < SIGNAL_ATOL:
            return logits, base @ np.linalg.solve(slope, noise_root)
        step = base @ np.linalg.solve(slope, missing)
        logits = logits + step * min(1.0, MAX_STEP / max(float(np.abs(step).max()), 1e-12))
    return None


def _at_signals(x: np.ndarray, wanted: np.ndarray, relative_response: np.ndarray,
                gain: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Reflectances (n, P) of logits moved along the gain (P, K) until they give signals (n, K), and
    which of them do.
    """
    M, (draws, bands) = relative_response, wanted.shape
    # d(signal)/d(step) of every draw is the sum over wavelengths of p (1 - p) times these products.
    products = (M[:, None, :] * gain.T).reshape(bands * bands, -1).T
    for _ in range(NEWTON_STEPS):
        p = 1 / (1 + np.exp(-x))  # as `reflectance`, which is safe for any x but three times slower
        residual = wanted - p @ M.T
        if np.abs(residual).max(initial=0) < SIGNAL_ATOL:
            break
        slopes = ((p - p * p) @ products).reshape(draws, bands, bands)
        step = solve_each(slopes, residual) @ gain.T
        if np.maximum(step.max(), -step.min()) > MAX_STEP:
            length = np.abs(step).max(axis=1, keepdims=True)
            step *= np.minimum(1, MAX_STEP / np.maximum(length, 1e-12))
        x = x + step
    p = reflectance(x)
    return p, np.abs(wanted - p @ M.T).max(axis=1) < 10 * SIGNAL_ATOL


def solve_each(matrices: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solutions (n, K) of n systems (n, K, K); by Cramer's rule for three bands, five times faster
    than LAPACK's calls.

    A singular matrix gives a step of zero.

    Parameters
    ----------
    matrices : (n, K, K) array
    right : (n, K) array
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
