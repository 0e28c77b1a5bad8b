"""The maximum-entropy tilt: the box density exp(h.c) that fits a measurement, found by convex
optimisation.

Independent coordinates with densities proportional to exp(h_j c_j) on [0, 1], h = A' theta, have
log-partition sum_j logZ(h_j) and means m(h_j). The theta that minimises

    F(theta) = sum_j logZ(h_j) - theta.y + theta' R theta / 2

has gradient A m(h) - y + R theta = 0: the means reproduce y, up to the noise covariance R. F is
convex. With R > 0 it always has a minimum; with R = 0 only if y lies strictly inside the zonotope A
[0, 1]^N, so that a theta running away means that no reflectance in [0, 1] gives this signal, or
that just one on the edge of the box does.
"""
from __future__ import annotations

import numpy as np

from spectrabox.radiometry import errors
from spectrabox.sampling.spectral_measurement import MeasurementOperator, check_noise

# |h| under which the closed forms lose digits and three terms of the series do not
SERIES_BELOW = 1e-2
# of the whitened signal, which is of order 1; the sampler is exact at any theta
GRADIENT_ATOL = 1e-8
NEWTON_STEPS = 200
EDGE = 1e6               # h of a coefficient that noise-free signals pin to within 1e-6 of 0 or 1
HALVINGS = 60
# theta of a signal out of reach squares at every step; beyond this it would overflow
RUNAWAY = 1e30


def max_entropy_tilt(operator: MeasurementOperator) -> tuple[np.ndarray, bool]:
    """Theta (K,) of the tilt of ``operator``, by damped Newton with a line search, rows whitened;
    and whether some coefficients in [0, 1] give the signal without noise.

    Parameters
    ----------
    operator : MeasurementOperator
        ``A`` (K, N), signal ``y`` (K,) relative to white, and its noise covariance (K, K).

    Raises
    ------
    InputError, CalibrationError
        See `check_operator`.
    ConvergenceError
        If no tilt exists: the signal is out of reach, or on the edge of what can be reached, and R
        does not cover it.
    """
    check_operator(operator)
    u, singular_values, vt = np.linalg.svd(operator.A, full_matrices=False)
    whiten = (u / singular_values).T
    theta, residual = _newton(vt, whiten @ operator.y, whiten @ operator.noise_covariance
                              @ whiten.T)
    h, noisy = theta @ vt, bool(operator.noise_covariance.any())
    if residual > GRADIENT_ATOL or (np.abs(h).max() > EDGE and not noisy):
        raise errors.ConvergenceError(_no_tilt(operator, is_reachable(operator)))
    # without noise the means reproduce the signal themselves
    return whiten.T @ theta, not noisy or is_reachable(operator)


def tilt_moments(h: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Log-partition, mean and variance of the density proportional to exp(h c) on [0, 1], for every
    h.

    Parameters
    ----------
    h : array
        Slopes, of any shape.
    """
    small = np.abs(h) < SERIES_BELOW
    a = np.where(small, 1.0, np.abs(h))
    rest = -np.expm1(-a)
    log_z = np.where(h > 0, a, 0.0) + np.log(rest / a)
    mean = 1 / rest - 1 / a
    mean = np.where(h > 0, mean, 1 - mean)
    variance = (1 / a)**2 - np.exp(-a) / rest**2
    s = np.where(small, h, 0.0)
    return (np.where(small, s / 2 + s**2 / 24, log_z),
            np.where(small, 0.5 + s / 12 - s**3 / 720, mean),
            np.where(small, 1 / 12 - s**2 / 240, variance))


def is_reachable(operator: MeasurementOperator) -> bool:
    """Whether some coefficients in [0, 1] give exactly ``operator.y`` (to the 1e-7 of the LP
    solver, rows whitened).

    Parameters
    ----------
    operator : MeasurementOperator
        ``A`` (K, N), signal ``y`` (K,) relative to white, and its noise covariance (K, K).
    """
    from scipy.optimize import linprog  # 0.3 s to import, and few signals need it

    u, singular_values, vt = np.linalg.svd(operator.A, full_matrices=False)
    solution = linprog(np.zeros(vt.shape[1]), A_eq=vt, b_eq=(operator.y @ u) / singular_values,
                       bounds=(0, 1))
    return bool(solution.status == 0)


def check_operator(operator: MeasurementOperator) -> None:
    """Raise if no spectrum can be sampled from ``operator``.

    Parameters
    ----------
    operator : MeasurementOperator
        ``A`` (K, N), signal ``y`` (K,) relative to white, and its noise covariance (K, K).

    Raises
    ------
    InputError
        For numbers that are not finite, fewer coefficients than bands, or a noise covariance that
        is none.
    CalibrationError
        If A is rank deficient.
    """
    bands, coefficients = operator.A.shape
    for name, values in (("A", operator.A), ("y", operator.y),
                         ("noise_covariance", operator.noise_covariance)):
        if not np.all(np.isfinite(values)):
            raise errors.InputError(f"{name} of the measurement holds numbers that are not finite; "
                             "measure or fit that band again, or leave it out")
    if coefficients < bands:
        raise errors.InputError(
            f"{bands} bands over-determine {coefficients} coefficients: nothing is "
            f"left to sample; use at least {bands} coefficients")
    check_noise(operator.noise_covariance)
    null_space(operator)


def _newton(A: np.ndarray, y: np.ndarray, R: np.ndarray) -> tuple[np.ndarray, float]:
    """Theta (K,) and the largest gradient there, for A (K, N) with orthonormal rows."""
    theta = np.zeros(y.size)
    value, gradient, hessian = _objective(theta, A, y, R)
    for _ in range(NEWTON_STEPS):
        if np.abs(gradient).max() < GRADIENT_ATOL / 100 or np.abs(theta).max() > RUNAWAY:
            break
        # A tiny ridge, relative: far out on the way to an unreachable signal all variances vanish.
        step = -np.linalg.solve(hessian + 1e-12 * np.trace(hessian) * np.eye(y.size), gradient)
        # slack: round-off of F, or the search stalls near the minimum
        length, slack = 1.0, 1e-13 * (1 + abs(value))
        for _ in range(HALVINGS):
            trial = _objective(theta + length * step, A, y, R)
            if trial[0] <= value + 1e-4 * length * gradient @ step + slack:
                break
            length /= 2
        theta = theta + length * step
        value, gradient, hessian = trial
    return theta, float(np.abs(gradient).max())


def _objective(theta: np.ndarray, A: np.ndarray, y: np.ndarray,
               R: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    log_z, mean, variance = tilt_moments(theta @ A)
    value = log_z.sum() - theta @ y + theta @ R @ theta / 2
    return value, A @ mean - y + R @ theta, (A * variance) @ A.T + R


def _no_tilt(operator: MeasurementOperator, reachable: bool) -> str:
    signal = ", ".join(f"{value:.4g}" for value in operator.y)
    if reachable:
        return (f"the signal ({signal}) lies on the edge of what reflectances between 0 and 1 can "
                "give, where one spectrum fits it and there is nothing to draw from; state the "
                "noise of the signal")
    return (f"no {operator.A.shape[1]} coefficients between 0 and 1 give the signal ({signal}); "
            "state the noise of the signal, use more coefficients, or check the light scale")


# ---- null space ----------------------------------------------------------------------------------
# Directions in coefficient space that the camera cannot see (paper Sec. 3.2, Eq. 5).
#
# Bounds on the coefficients are not handled here; see tilted_rejection.py.

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
        raise errors.CalibrationError(
            f"the {operator.A.shape[0]} camera channels carry only {rank} independent responses "
            f"(smallest / largest singular value {weakest:.1e}); "
            "refit the sensitivities or check that the light covers 400-700 nm")
    return np.asarray(vt[rank:].T)
