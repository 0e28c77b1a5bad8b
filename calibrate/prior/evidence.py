"""How well a Gaussian prior explains signals whose bands may have errors in common."""
from __future__ import annotations

from collections.abc import Sequence

import numpy as np

LARGE = 1e300                # beyond the square of any whitened innovation


def log_densities(covariance: np.ndarray, innovation: np.ndarray, patterns: np.ndarray,
                  common: Sequence[float]) -> list[float]:
    """Log density of the innovation (Y,) up to a constant, under a covariance (Y, Y) to which each
    common error squared times ``patterns @ patterns.T`` is added (Y, R); -inf where round-off left
    no density.

    Innovation and patterns are last rows of the matrix that is factorised: those of the factor are
    then whitened, whatever the last elements of the matrix. By Sylvester and Woodbury one factor
    does for all common errors.

    Parameters
    ----------
    covariance : (Y, Y) array
    innovation : (Y,) array
    patterns : (Y, R) array
        Of errors that bands have in common, a unit each.
    common : sequence of float
        Sizes of those errors.
    """
    size, extra = innovation.size, 1 + patterns.shape[1]
    bordered = np.zeros((size + extra, size + extra))
    bordered[:size, :size] = covariance
    bordered[size:, :size] = np.vstack([innovation, patterns.T])
    bordered[range(size, size + extra), range(size, size + extra)] = LARGE
    try:
        lower = np.linalg.cholesky(bordered)    # which reads the lower triangle alone
    except np.linalg.LinAlgError:
        return [-np.inf] * len(common)
    white, columns = lower[size, :size], lower[size + 1:, :size]
    square, along, gram = white @ white, columns @ white, columns @ columns.T
    log_volume, logs = np.log(np.diag(lower)[:size]).sum(), []
    for error in common:
        root = np.linalg.cholesky(np.eye(len(gram)) + error**2 * gram)
        explained = np.linalg.solve(root, error * along)
        logs.append(float(-0.5 * (square - explained @ explained) - log_volume
                          - np.log(np.diag(root)).sum()))
    return logs
