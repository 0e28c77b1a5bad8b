"""Lowest and highest reflectance at each wavelength over every spectrum of the class that fits a
measurement.

The class is B c with c in [0, 1]^N. Without noise the set {A c = y} is a polytope and the extremes
are exact linear programmes. With noise the confidence set |R^-1/2 (A c - y)|^2 <= chi-square
quantile with K degrees of freedom is an ellipsoid in signal space. Here it is replaced by the box
around it whose sides are the eigen-directions of R (2 K half-planes): the bounds can only be wider
than those of the ellipsoid, at most sqrt(K) times as far from y in signal.
"""
from __future__ import annotations

from typing import Any

import numpy as np
from scipy.optimize import linprog
from scipy.stats import chi2

from spectrabox.radiometry.errors import ConvergenceError, InputError
from spectrabox.sampling.measurement import MeasurementOperator
from spectrabox.sampling.polytope.simplex import Polytope, extremes
from spectrabox.sampling.polytope.tilt import check_operator

LP_ATOL = 1e-7  # the solver's tolerance on every constraint


def reflectance_bounds(operator: MeasurementOperator, basis: np.ndarray,
                       level: float = 0.95) -> tuple[np.ndarray, np.ndarray]:
    """Smallest and largest B c over the coefficients that fit.

    Parameters
    ----------
    operator : MeasurementOperator
        ``A`` (K, N), signal ``y`` (K,) and its noise covariance; zeros for a hard equality.
    basis : (P, N) array
        Rows of B at the wavelengths wanted.
    level : float
        Probability that the noise stays within the confidence set; not used where R = 0.

    Returns
    -------
    lower, upper : (P,) arrays
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
    if basis.ndim != 2 or basis.shape[1] != operator.A.shape[1]:
        raise InputError(f"the basis has shape {basis.shape}; (P, {operator.A.shape[1]}) is "
                         "needed, as A has that many coefficients")
    box = widened_box(operator, level)
    directions, centre, half_width = box
    # One more variable for each side of the box that has a width: the distance from its lower end.
    loose = half_width > 0
    columns = np.hstack([directions, -np.eye(len(centre))[:, loose]])
    upper = np.concatenate([np.ones(basis.shape[1]), 2 * half_width[loose]])
    functions = np.hstack([basis, np.zeros((len(basis), int(loose.sum())))])
    bounds = extremes(Polytope(columns, centre - half_width, upper), functions)
    if bounds is not None:
        return bounds
    try:
        return linear_programmes(box, basis)
    except ConvergenceError:
        # Within reach by `widening`, and empty by round-off, as of perfect white.
        return linear_programmes((directions, centre, half_width + LP_ATOL), basis)


def linear_programmes(box: tuple[np.ndarray, np.ndarray, np.ndarray], basis: np.ndarray,
                      options: dict[str, float] | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Smallest and largest B c over a signal box by a general solver, one programme each.

    For sets that are too thin for `simplex.extremes`, and for its tests.

    Parameters
    ----------
    box : (K, N), (K,) and (K,) arrays
        From `signal_box` or `widened_box`.
    basis : (P, N) array
    options : dict, optional
        Of HiGHS.

    Raises
    ------
    ConvergenceError
        If the solver fails.
    """
    constraints = _half_planes(*box)
    lower = np.array([_minimum(row, constraints, options) for row in basis])
    upper = np.array([-_minimum(-row, constraints, options) for row in basis])
    return lower, upper


def widening(operator: MeasurementOperator, level: float = 0.95) -> float:
    """Least signal by which every half-plane must move out for some coefficients in [0, 1] to fit;
    0 where they do.
    """
    directions, centre, half_width = signal_box(operator, level)
    matrix = np.vstack([directions, -directions])
    limits = np.r_[centre + half_width, half_width - centre]
    coefficients = operator.A.shape[1]
    cost = np.r_[np.zeros(coefficients), 1.0]
    solution = linprog(cost, A_ub=np.c_[matrix, -np.ones(len(matrix))], b_ub=limits,
                       bounds=[(0, 1)] * coefficients + [(0, None)])
    if solution.status != 0:
        raise ConvergenceError(_failure(solution.message))
    return float(solution.fun) if solution.fun > LP_ATOL else 0.0


def widened_box(operator: MeasurementOperator,
                level: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The `signal_box`, moved apart by `widening` where no coefficients fit."""
    directions, centre, half_width = signal_box(operator, level)
    slack = widening(operator, level)
    # The solver's tolerance again, or the set could come out empty.
    return directions, centre, half_width + (slack + LP_ATOL if slack > 0 else 0.0)


def signal_box(operator: MeasurementOperator,
               level: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows D A (K, N), their centres D y (K,) and half-widths (K,), D the eigen-directions of the
    noise covariance.
    """
    check_operator(operator)
    if not 0 < level < 1:
        raise InputError(f"a level of {level} was asked for; it is a probability between 0 and 1")
    variances, directions = np.linalg.eigh(operator.noise_covariance)
    radius = np.sqrt(chi2.ppf(level, variances.size))
    return (directions.T @ operator.A, directions.T @ operator.y,
            radius * np.sqrt(np.maximum(variances, 0)))


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


def _minimum(row: np.ndarray, constraints: dict[str, Any],
             options: dict[str, float] | None) -> float:
    solution = linprog(row, bounds=(0, 1), method="highs-ds", options=options, **constraints)
    if solution.status != 0:
        raise ConvergenceError(_failure(solution.message))
    return float(solution.fun)


def _failure(message: str) -> str:
    return (f"the linear programme of the bounds was not solved ({message.strip()}); state a "
            "larger noise of the signal")
