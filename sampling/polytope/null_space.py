"""Directions in coefficient space that the camera cannot see (paper Sec. 3.2, Eq. 5).

Bounds on the coefficients are not handled here; see tilted_rejection.py.
"""
from __future__ import annotations

import numpy as np

from spectrabox.radiometry.errors import CalibrationError
from spectrabox.sampling.spline_measurement import MeasurementOperator

# about sqrt(float64 eps): smaller singular values are round-off in A, not information
RANK_RTOL = 1e-8


def null_space(operator: MeasurementOperator) -> np.ndarray:
    """Orthonormal directions (N, D) in coefficient space that the camera cannot see (Eq. 5).

    Parameters
    ----------
    operator : MeasurementOperator
        ``A`` (K, N) maps coefficients to camera signal; D = N - min(K, N).

    Raises
    ------
    CalibrationError
        If two channels respond alike, so that A has lower rank than its shape allows.
    """
    _, singular_values, vt = np.linalg.svd(operator.A)
    # Not >=: a matrix of zeros must have rank 0.
    rank = np.count_nonzero(singular_values > RANK_RTOL * singular_values[0])
    if rank < singular_values.size:
        weakest = singular_values[-1] / singular_values[0] if rank else 0.0
        raise CalibrationError(
            f"the {operator.A.shape[0]} camera channels carry only {rank} independent responses "
            f"(smallest / largest singular value {weakest:.1e}); "
            "refit the sensitivities or check that the light covers 400-700 nm")
    return np.asarray(vt[rank:].T)
