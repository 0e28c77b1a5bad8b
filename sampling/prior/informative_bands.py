"""Many bands as the few that the prior and the noise tell apart.

Surfaces are smooth: 36 bands of an LED lamp differ along some 12 directions by more than a share of
the noise. Signals of as many bands, estimated from all, say what all say, and a posterior of them
costs a fraction. Unlike measure/surfaces/independent_bands.py this knows how reflectances vary.
"""
from __future__ import annotations

import numpy as np
from scipy.linalg import qr

from spectrabox.sampling.prior.mixture_posterior import with_floor

VISIBLE = 0.1   # of the noise: a direction along which surfaces differ less says nothing


def informative_bands(covariance: np.ndarray, relative_response: np.ndarray,
                      noise: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The gain (r, K) that estimates the signals of some bands from those of all, and the response
    (r, P) that belongs to it; of independent bands, ones and the response itself.

    As many bands are taken as directions in which surfaces differ by more than a share of the
    noise, those first that say most; generalised least squares estimates them.

    Parameters
    ----------
    covariance : (P, P) array
        Of reflectances.
    relative_response : (K, P) array
        Rows summing to 1.
    noise : (K, K) array
        Covariance of a signal's errors.
    """
    signals = relative_response @ covariance @ relative_response.T
    whitening = np.linalg.inv(np.linalg.cholesky(with_floor(noise)))
    variances, directions = np.linalg.eigh(whitening @ signals @ whitening.T)
    count = int(np.sum(variances > VISIBLE**2))
    if count == len(signals):
        return np.eye(count), relative_response
    roots = directions * np.sqrt(np.maximum(variances, 0))
    scale = np.linalg.norm(whitening, axis=0)[:, None]
    order = qr((scale * np.linalg.solve(whitening, roots)).T, mode="economic", pivoting=True)[2]
    chosen = np.sort(order[:count])
    sums = np.linalg.solve(signals[np.ix_(chosen, chosen)], signals[chosen]).T      # (K, r)
    missed = signals - sums @ signals[chosen]
    weighted = np.linalg.solve(with_floor(noise) + missed, sums)
    gain = np.linalg.solve(sums.T @ weighted, weighted.T)
    response = gain @ relative_response
    white = response.sum(axis=1, keepdims=True)
    return gain / white, response / white
