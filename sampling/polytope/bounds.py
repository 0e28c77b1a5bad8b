"""Lowest and highest reflectance at each wavelength over every spectrum of the class that fits a
measurement.

The class is B c with c in [0, 1]^N. Without noise the set {A c = y} is a polytope and the extremes
are exact linear programmes. With noise the confidence set |R^-1/2 (A c - y)|^2 <= chi-square
quantile with K degrees of freedom is an ellipsoid in signal space. Here it is replaced by the box
around it whose sides are the eigen-directions of R (2 K half-planes): the bounds can only be wider
than those of the ellipsoid, at most sqrt(K) times as far from y in signal.

Signals are treated all at once by `simplex.highest`; what it leaves, sets thinner than round-off,
goes to a general solver one programme at a time.
"""
from __future__ import annotations

from typing import Any

import numpy as np
from scipy.special import chdtri

from spectrabox.radiometry.errors import ConvergenceError, InputError
from spectrabox.sampling.polytope import simplex, tilt
from spectrabox.sampling.spectral_measurement import MeasurementOperator, check_noise


def reflectance_bounds(operator: MeasurementOperator, basis: np.ndarray,
                       level: float = 0.95) -> tuple[np.ndarray, np.ndarray]:
    """Smallest and largest B c (P,) over the coefficients that fit one signal; see
    `bounds_of_many`.

    Parameters
    ----------
    operator : MeasurementOperator
        ``A`` (K, N), signal ``y`` (K,) and its noise covariance; zeros for a hard equality.
    basis : (P, N) array
    level : float
    """
    lower, upper = bounds_of_many(operator.A, operator.y[None], operator.noise_covariance[None],
                                  basis, level)
    return lower[0], upper[0]


def bounds_of_many(A: np.ndarray, signals: np.ndarray, noise_covariance: np.ndarray,
                   basis: np.ndarray,
                   level: float = 0.95) -> tuple[np.ndarray, np.ndarray]:
    """Smallest and largest B c over the coefficients that fit each of S signals.

    Parameters
    ----------
    A : (K, N) array
        From coefficients to signal.
    signals : (S, K) array
    noise_covariance : (S, K, K) array
        Zeros for a hard equality.
    basis : (P, N) array
        Rows of B at the wavelengths wanted.
    level : float
        Probability that the noise stays within the confidence set; not used where R = 0.

    Returns
    -------
    lower, upper : (S, P) arrays
        Where no coefficients fit, all half-planes are moved apart by `widening`, the least that
        lets some fit.

    Raises
    ------
    InputError, CalibrationError
        See `polytope.tilt.check_operator`; also for a level outside 0 to 1 or a basis of another
        size.
    ConvergenceError
        If the solver fails.
    """
    if basis.ndim != 2 or basis.shape[1] != A.shape[1]:
        raise InputError(f"the basis has shape {basis.shape}; (P, {A.shape[1]}) is needed, as A "
                         "has that many coefficients")
    directions, centre, half_width = signal_boxes(A, signals, noise_covariance, level)
    lower, upper, ends = _extremes(directions, centre, half_width, basis)
    if (empty := np.flatnonzero(ends == simplex.SolveStatus.EMPTY)).size:
        some = directions[empty], centre[empty]
        wider = half_width[empty] + widenings(*some, half_width[empty])[:, None]
        lower[empty], upper[empty], ends[empty] = _extremes(*some, wider, basis)
    for row in np.flatnonzero(ends != simplex.SolveStatus.DONE):
        lower[row], upper[row] = bounds_of_one(directions[row], centre[row], half_width[row], basis)
    return lower, upper


def signal_boxes(A: np.ndarray, signals: np.ndarray, noise_covariance: np.ndarray,
                 level: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The boxes {c : |directions c - centre| <= half_width} around the confidence sets, their sides
    the eigen-directions of the noise: directions (S, K, N), centres and half-widths (S, K).

    Parameters
    ----------
    A : (K, N) array
    signals : (S, K) array
    noise_covariance : (S, K, K) array
    level : float

    Raises
    ------
    InputError, CalibrationError
        As `bounds_of_many`.
    """
    tilt.check_operator(MeasurementOperator(A, signals[0], noise_covariance[0]))
    if not np.all(np.isfinite(signals)):
        raise InputError("y of the measurement holds numbers that are not finite; measure or fit "
                         "that band again, or leave it out")
    check_noise(noise_covariance)
    if not 0 < level < 1:
        raise InputError(f"a level of {level} was asked for; it is a probability between 0 and 1")
    variances, directions = np.linalg.eigh(noise_covariance)
    turn = directions.transpose(0, 2, 1)
    radius = np.sqrt(chdtri(variances.shape[1], 1 - level))
    return (turn @ A, (turn @ signals[..., None])[..., 0],
            radius * np.sqrt(np.maximum(variances, 0)))


def widenings(directions: np.ndarray, centre: np.ndarray, half_width: np.ndarray) -> np.ndarray:
    """Least signal (S,) by which every half-plane must move out for some coefficients in [0, 1] to
    fit; 0 where they do, within the tolerance of the general solver, and where the walk stalls.

    Parameters
    ----------
    directions, centre, half_width : (S, K, N), (S, K) and (S, K) arrays
        From `signal_boxes`.
    """
    count, bands, coefficients = directions.shape
    away = np.abs(centre).max(axis=1)      # c = 0 fits once the planes moved so far
    largest = away + np.abs(directions).sum(axis=2).max(axis=1)
    # Variables: c, the widening t, and what is left of both half-planes of each direction.
    ones, identity = np.ones((count, bands, 1)), np.broadcast_to(np.eye(bands),
                                                                 (count, bands, bands))
    none = np.zeros_like(identity)
    A = np.concatenate([np.concatenate([directions, -ones, identity, none], axis=2),
                        np.concatenate([directions, ones, none, -identity], axis=2)], axis=1)
    y = np.concatenate([centre + half_width, centre - half_width], axis=1)
    upper = np.ones((count, A.shape[2]))
    upper[:, coefficients] = away
    upper[:, coefficients + 1:] = np.tile(2 * (largest[:, None] + half_width), 2)
    values, ends = simplex.highest(A, y, upper, -np.eye(1, A.shape[2], coefficients))
    slack = np.where(ends == simplex.SolveStatus.DONE, -values[:, 0], 0.0)
    # The solver's tolerance again, or the set could come out empty.
    return np.where(slack > LP_ATOL, slack + LP_ATOL, 0.0)


def _extremes(directions: np.ndarray, centre: np.ndarray, half_width: np.ndarray,
              basis: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lowest and highest B c (S, P), and how the walks ended."""
    count, bands, coefficients = directions.shape
    # One more variable for each side of a box: the distance from its lower end.
    sides = np.broadcast_to(-np.eye(bands), (count, bands, bands))
    columns = np.concatenate([directions, sides], axis=2)
    upper = np.concatenate([np.ones((count, coefficients)), 2 * half_width], axis=1)
    functions = np.hstack([basis, np.zeros((len(basis), bands))])
    values, ends = simplex.highest(columns, centre - half_width, upper,
                           np.vstack([functions, -functions[::-1]]))
    # Not -values: a bound of 0 must not read -0.
    return 0.0 - values[:, :len(basis) - 1:-1], values[:, :len(basis)], ends


# ---- linear programmes ---------------------------------------------------------------------------
# Bounds of one signal by a general solver, HiGHS: one linear programme for each of them.
#
# For sets that are too thin for `simplex.highest`, and for its tests.

LP_ATOL = 1e-7  # the solver's tolerance on every constraint


def bounds_of_one(directions: np.ndarray, centre: np.ndarray, half_width: np.ndarray,
                  basis: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Smallest and largest B c (P,) over one box, its sides moved apart where nothing fits.

    Parameters
    ----------
    directions, centre, half_width : (K, N), (K,) and (K,) arrays
        Of one signal, from `signal_boxes`.
    basis : (P, N) array
        Rows of B at the wavelengths wanted.

    Raises
    ------
    ConvergenceError
        If the solver fails.
    """
    wider = half_width + widening(directions, centre, half_width)
    try:
        return linear_programmes(directions, centre, wider, basis)
    except ConvergenceError:
        # Within reach by `widening`, and empty by round-off, as of perfect white.
        return linear_programmes(directions, centre, wider + LP_ATOL, basis)


def widening(directions: np.ndarray, centre: np.ndarray, half_width: np.ndarray,
             options: dict[str, float] | None = None) -> float:
    """Least signal by which every half-plane must move out for some coefficients in [0, 1] to fit,
    and the solver's tolerance; 0 where they do.

    Parameters
    ----------
    directions, centre, half_width : (K, N), (K,) and (K,) arrays
        Of one signal.
    options : dict, optional
        Of HiGHS.

    Raises
    ------
    ConvergenceError
        If the solver fails.
    """
    matrix, coefficients = np.vstack([directions, -directions]), directions.shape[1]
    slack = _least(np.r_[np.zeros(coefficients), 1.0], [(0, 1)] * coefficients + [(0, None)],
                   {"A_ub": np.c_[matrix, -np.ones(len(matrix))],
                    "b_ub": np.r_[centre + half_width, half_width - centre]}, options)
    # The tolerance again, or the set could come out empty.
    return slack + LP_ATOL if slack > LP_ATOL else 0.0


def linear_programmes(directions: np.ndarray, centre: np.ndarray, half_width: np.ndarray,
                      basis: np.ndarray, options: dict[str, float] | None = None
                      ) -> tuple[np.ndarray, np.ndarray]:
    """Smallest and largest B c (P,) over one box, which is not empty.

    Parameters
    ----------
    directions, centre, half_width : (K, N), (K,) and (K,) arrays
        Of one signal.
    basis : (P, N) array
    options : dict, optional
        Of HiGHS.

    Raises
    ------
    ConvergenceError
        If the solver fails.
    """
    constraints = _half_planes(directions, centre, half_width)
    lower = np.array([_least(function, (0, 1), constraints, options) for function in basis])
    upper = np.array([-_least(-function, (0, 1), constraints, options) for function in basis])
    return lower, upper


def _half_planes(directions: np.ndarray, centre: np.ndarray,
                 half_width: np.ndarray) -> dict[str, np.ndarray]:
    # Exact directions go in as equalities: as pairs of half-planes at zero distance the solver's
    # tolerance opens them.
    exact = half_width == 0
    loose = ~exact
    ranges = {"A_ub": np.vstack([directions[loose], -directions[loose]]),
              "b_ub": np.r_[centre[loose] + half_width[loose], half_width[loose] - centre[loose]]}
    equalities = {"A_eq": directions[exact], "b_eq": centre[exact]}
    return (ranges if loose.any() else {}) | (equalities if exact.any() else {})


def _least(cost: np.ndarray, limits: Any, constraints: dict[str, Any],
           options: dict[str, float] | None) -> float:
    from scipy.optimize import linprog  # 0.2 s to import, and rarely needed

    solution = linprog(cost, bounds=limits, method="highs-ds", options=options, **constraints)
    if solution.status != 0:
        raise ConvergenceError("the linear programme of the bounds was not solved "
                               f"({solution.message.strip()}); state a larger noise of the signal")
    return float(solution.fun)
