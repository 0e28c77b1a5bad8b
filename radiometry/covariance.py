"""What makes a matrix a covariance, and covariances of independent parts."""
from __future__ import annotations

import numpy as np

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


def common_variance(covariance: np.ndarray, pattern: np.ndarray) -> np.ndarray:
    """The largest variance (...) of a common factor of ``pattern`` that covariances (..., K, K)
    hold.

    Parameters
    ----------
    covariance : (..., K, K) array
    pattern : (K,) array
    """
    solved = np.linalg.solve(with_rank(covariance, 1e-12), pattern[:, None])[..., 0]
    return np.asarray(1 / (solved @ pattern))


def largest_share(covariance: np.ndarray, part: np.ndarray) -> np.ndarray:
    """The largest share (...), up to 1, of a covariance that others (..., K, K) hold as a part.

    Parameters
    ----------
    covariance, part : (..., K, K) arrays
    """
    values, vectors = np.linalg.eigh(covariance)
    least = ROUND_OFF * values[..., -1:] + np.finfo(float).tiny
    root = vectors / np.sqrt(np.maximum(values, least))[..., None, :]
    ratios = np.linalg.eigvalsh(np.swapaxes(root, -1, -2) @ part @ root)
    return np.asarray(1 / np.maximum(ratios[..., -1], 1))


def with_rank(covariance: np.ndarray, rtol: float) -> np.ndarray:
    """Covariances (..., K, K) with some variance in every direction.

    Parameters
    ----------
    covariance : (..., K, K) array
    rtol : float
        Of its trace.
    """
    least = rtol * np.trace(covariance, axis1=-2, axis2=-1) + np.finfo(float).tiny
    return np.asarray(covariance + least[..., None, None] * np.eye(covariance.shape[-1]))


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


def symmetric_root(covariance: np.ndarray) -> np.ndarray:
    """The symmetric matrix (K, K) whose square is a covariance.

    Parameters
    ----------
    covariance : (K, K) array
    """
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray((vectors * np.sqrt(np.maximum(values, 0))) @ vectors.T)


def symmetric(covariance: np.ndarray) -> np.ndarray:
    """The covariance (N, N) without what round-off made of its two halves.

    Parameters
    ----------
    covariance : (N, N) array
    """
    return np.asarray((covariance + covariance.T) / 2)
