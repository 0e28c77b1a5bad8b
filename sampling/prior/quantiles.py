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
    weights, centres, deviations = (values.astype(np.float32)
                                    for values in (weights, centres, deviations))
    skews = None if skews is None else skews.astype(np.float32)
    side = 1.0 if probability <= 0.5 else -1.0
    tail = min(probability, 1 - probability)
    own = centres + deviations * stretched(NormalDist().inv_cdf(probability), skews)
    possible = weights[..., None] > 0
    low = own.min(axis=1, where=possible, initial=np.inf)
    high = own.max(axis=1, where=possible, initial=-np.inf)
    x = np.einsum("nc,ncp->np", weights, own)
    tolerance = TOLERANCE * np.einsum("nc,ncp->np", weights, deviations)
    for _ in range(STEPS):
        z = (x[:, None] - centres) / deviations
        slope: float | np.ndarray = 1.0
        if skews is not None:       # undo `stretched`; far out where no z has this value
            inner = np.maximum(1 + skews * z, TINY)
            z, slope = np.log(inner) / skews, 1 / inner
        beyond = np.maximum(np.einsum("nc,ncp->np", weights, ndtr(side * z)), TINY)
        above = (beyond < tail) == (side > 0)       # the quantile lies above x
        low, high = np.where(above, x, low), np.where(above, high, x)
        density = np.einsum("nc,ncp->np", weights, np.exp(-0.5 * z * z) * slope / deviations)
        step = -side * np.log(beyond / tail) * beyond * ROOT_2_PI / np.maximum(density, TINY)
        to = x + step
        to = np.where((to >= low) & (to <= high), to, (low + high) / 2)
        arrived = bool(np.all(np.abs(to - x) <= tolerance))
        x = to
        if arrived:
            break
    return x.astype(float)


def stretched(z: float, skews: np.ndarray | None) -> float | np.ndarray:
    """(e^(skew z) - 1) / skew, in the shape of the skews.

    Parameters
    ----------
    z : float
        Standard normal deviate.
    skews : array or None
    """
    return z if skews is None else np.expm1(skews * z) / skews
