"""Many bands as the few that do not depend on each other.

Three channels under one narrow lamp see nearly the same part of the spectrum, and of 36 bands many
are sums of others. What they say of a reflectance is then said by a few of them, whose signals are
estimated from all by generalised least squares. Nothing is lost but the check that bands which
repeat each other agree.
"""
from __future__ import annotations

import numpy as np

# of a band's response, that no sum of the others gives: below, the others give its signal too
DEPENDENT = 0.02
# of reflectances along one direction of unit length on a grid of 1 nm, at most: they vary by 0.2
# over 50 nm. What a sum leaves out of a band errs by this times what it leaves out.
ALONG_A_DIRECTION = 0.2 * 50**0.5


def independent_bands(response: np.ndarray, covariance: np.ndarray
                      ) -> tuple[np.ndarray, np.ndarray]:
    """Indices (r,) of bands that do not depend on each other, in order, and the gain (r, K) that
    estimates their signals from those of all; all bands and ones where none depends.

    Parameters
    ----------
    response : (K, P) array
        To reflectances.
    covariance : (K, K) array
        Of the signals' errors.
    """
    bands = len(response)
    left = response / np.maximum(np.linalg.norm(response, axis=1, keepdims=True),
                                 np.finfo(float).tiny)
    chosen: list[int] = []
    # Gram-Schmidt, the band that is least like those before first; as in a pivoted QR
    for _ in range(bands):
        length = np.linalg.norm(left, axis=1)
        band = int(np.argmax(length))
        if length[band] < DEPENDENT:
            break
        chosen.append(band)
        direction = left[band] / length[band]
        left = left - np.outer(left @ direction, direction)
    if len(chosen) in (0, bands):
        return np.arange(bands), np.eye(bands)
    order = np.sort(chosen)
    sums = np.linalg.lstsq(response[order].T, response.T, rcond=None)[0].T      # (K, r)
    missed = ALONG_A_DIRECTION * np.linalg.norm(response - sums @ response[order], axis=1)
    weighted = np.linalg.solve(covariance + np.diag(missed**2), sums)
    return order, np.linalg.solve(sums.T @ weighted, weighted.T)
