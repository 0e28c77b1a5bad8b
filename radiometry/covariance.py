"""What makes a matrix a covariance, covariances of independent parts, and how far noise goes."""
from __future__ import annotations

import math

import numpy as np

HALVINGS = 200      # of an interval of floats, until nothing lies between its ends
ROUND_OFF = 1e-10   # of the largest entry: a few eps, as of a covariance computed as a product


def is_covariance(matrix: np.ndarray, rtol: float = ROUND_OFF) -> bool:
    """Whether a matrix, or every one of many, is symmetric and positive semi-definite, up to
    round-off.

    Parameters
    ----------
    matrix : (..., K, K) array
    rtol : float
        Relative to the largest entry: of the asymmetry, and of eigenvalues below 0.
    """
    if not np.all(np.isfinite(matrix)):
        return False
    atol = rtol * np.abs(matrix).max(axis=(-2, -1), initial=0)
    skew = np.abs(matrix - np.swapaxes(matrix, -2, -1)).max(axis=(-2, -1), initial=0)
    return bool(np.all(skew <= atol)
                and np.all(np.linalg.eigvalsh(matrix).min(axis=-1, initial=0) >= -atol))


def block_diagonal(*blocks: np.ndarray) -> np.ndarray:
    """Matrix (sum of rows, sum of columns) with the blocks on its diagonal and 0 elsewhere."""
    rows, columns = np.cumsum([(0, 0), *(block.shape for block in blocks)], axis=0).T
    whole = np.zeros((rows[-1], columns[-1]))
    for block, row, column in zip(blocks, rows[:-1], columns[:-1], strict=True):
        whole[row:row + block.shape[0], column:column + block.shape[1]] = block
    return whole


def error_patterns(covariance: np.ndarray) -> np.ndarray:
    """Independent errors (Q, K) of one standard deviation each that have this covariance together.

    Parameters
    ----------
    covariance : (K, K) array
        Of rank Q.
    """
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray((vectors * np.sqrt(np.maximum(values, 0))).T[values > 0])


def chi_square_beyond(probability: float, degrees: int) -> float:
    """The value that a chi-square variable exceeds with that probability.

    SciPy has it too, but its special functions take 0.2 s to import, a fifth of what a command that
    needs this one number may take.

    Parameters
    ----------
    probability : float
        Between 0 and 1.
    degrees : int
        Of freedom, 1 or more.
    """
    low, high = 0.0, 1.0
    while chance_beyond(high, degrees) > probability:
        low, high = high, 2 * high
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        if middle in (low, high):
            break
        low, high = (middle, high) if chance_beyond(middle, degrees) > probability \
            else (low, middle)
    return high


def chance_beyond(x: float, degrees: int) -> float:
    """Probability that a chi-square variable exceeds x > 0 (Abramowitz and Stegun 26.4.4, 26.4.5).
    """
    half = x / 2
    odd = degrees % 2
    terms = (math.exp(power * math.log(half) - math.lgamma(power + 1) - half)
             for power in (index + odd / 2 for index in range(degrees // 2)))
    return (math.erfc(math.sqrt(half)) if odd else 0.0) + math.fsum(terms)


def symmetric(covariance: np.ndarray) -> np.ndarray:
    """The covariance (N, N) without what round-off made of its two halves.

    Parameters
    ----------
    covariance : (N, N) array
    """
    return np.asarray((covariance + covariance.T) / 2)
