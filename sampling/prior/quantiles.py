"""Quantiles of many mixtures at once, of normal or skewed components.

A skewed component is a shifted lognormal distribution: centre + deviation (e^(skew z) - 1) / skew,
z standard normal. Its median is its centre, its skewness 3 skew to first order; a skew of 0 is the
normal distribution. Newton's steps on the logarithm of the nearer tail, which bends little, reach a
quantile of the mixture in about six; it lies between the quantiles of the components. Single
precision tells it to 1e-6 deviations.
"""
from __future__ import annotations

from statistics import NormalDist

import numpy as np
from scipy.special import ndtr

ROOT_2_PI = np.sqrt(2 * np.pi)
STEPS = 40                  # most of them
TOLERANCE = 1e-4            # of a deviation: the error after such a step is about 1e-7
FEW = 0.6                   # share that still moves, below which the others are left out
TINY = 1e-30


def quantiles(weights: np.ndarray, centres: np.ndarray, deviations: np.ndarray,
              skews: np.ndarray | None, probability: float) -> np.ndarray:
    """Quantile (n, P) of each of n x P mixtures.

    Parameters
    ----------
    weights : (n, C) array
        Of the components, rows summing to 1; those of weight 0 count for nothing.
    centres, deviations : (n, C, P) arrays
    skews : (n, C, P) array, optional
        Not 0; None for normal components.
    probability : float
        Between 0 and 1.
    """
    shape = centres.shape[0], centres.shape[2]

    def flat(values: np.ndarray) -> np.ndarray:         # (C, n P)
        return values.astype(np.float32).transpose(1, 0, 2).reshape(values.shape[1], -1)
    weights = np.repeat(weights.T.astype(np.float32), shape[1], axis=1)
    centres, deviations = flat(centres), flat(deviations)
    skews = None if skews is None else flat(skews)
    side = 1.0 if probability <= 0.5 else -1.0
    tail = min(probability, 1 - probability)
    own = centres + deviations * stretched(NormalDist().inv_cdf(probability), skews)
    low = own.min(axis=0, where=weights > 0, initial=np.inf)
    high = own.max(axis=0, where=weights > 0, initial=-np.inf)
    x = np.einsum("cm,cm->m", weights, own)
    tolerance = TOLERANCE * np.einsum("cm,cm->m", weights, deviations)
    quantile, index = x.astype(float), np.arange(x.size)
    for _ in range(STEPS):
        z = (x - centres) / deviations
        slope: float | np.ndarray = 1.0
        if skews is not None:       # undo `stretched`; far out where no z has this value
            inner = np.maximum(1 + skews * z, TINY)
            z, slope = np.log(inner) / skews, 1 / inner
        beyond = np.maximum(np.einsum("cm,cm->m", weights, ndtr(side * z)), TINY)
        above = (beyond < tail) == (side > 0)       # the quantile lies above x
        low, high = np.where(above, x, low), np.where(above, high, x)
        density = np.einsum("cm,cm->m", weights, np.exp(-0.5 * z * z) * slope / deviations)
        step = -side * np.log(beyond / tail) * beyond * ROOT_2_PI / np.maximum(density, TINY)
        to = x + step
        to = np.where((to >= low) & (to <= high), to, (low + high) / 2)
        quantile[index] = to
        moving = np.abs(to - x) > tolerance
        if not moving.any():
            break
        # most have arrived after four steps: the others go on without them
        kept = moving if moving.mean() < FEW else slice(None)
        x, low, high, tolerance, index = (each[kept] for each in (to, low, high, tolerance, index))
        weights, centres, deviations = (each[:, kept] for each in (weights, centres, deviations))
        skews = None if skews is None else skews[:, kept]
    return quantile.reshape(shape)


def stretched(z: float, skews: np.ndarray | None) -> float | np.ndarray:
    """(e^(skew z) - 1) / skew, in the shape of the skews.

    Parameters
    ----------
    z : float
        Standard normal deviate.
    skews : array or None
    """
    return z if skews is None else np.expm1(skews * z) / skews
