"""Bounds of one signal by a general solver, HiGHS: one linear programme for each of them.

For sets that are too thin for `simplex.highest`, and for its tests.
"""
from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from spectrabox.radiometry.errors import ConvergenceError

LP_ATOL = 1e-7  # the solver's tolerance on every constraint


@dataclass(frozen=True)
class SignalBoxes:
    """{c : |directions c - centre| <= half_width} of S signals."""

    directions: np.ndarray      # (S, K, N)
    centre: np.ndarray          # (S, K)
    half_width: np.ndarray      # (S, K)

    def of(self, rows: np.ndarray, more: np.ndarray | float = 0.0) -> SignalBoxes:
        """Some of the boxes, half-widths larger by ``more``."""
        return SignalBoxes(self.directions[rows], self.centre[rows], self.half_width[rows] + more)


def bounds_of_one(boxes: SignalBoxes, row: int,
                  basis: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Smallest and largest B c (P,) over one of the boxes, moved apart where nothing fits.

    Parameters
    ----------
    boxes : SignalBoxes
        Of S signals.
    row : int
        Which signal.
    basis : (P, N) array
        Rows of B at the wavelengths wanted.

    Raises
    ------
    ConvergenceError
        If the solver fails.
    """
    box = boxes.of(np.array([row]), widening(boxes, row))
    try:
        return linear_programmes(box, basis)
    except ConvergenceError:
        # Within reach by `widening`, and empty by round-off, as of perfect white.
        return linear_programmes(box.of(np.array([0]), LP_ATOL), basis)


def widening(boxes: SignalBoxes, row: int, options: dict[str, float] | None = None) -> float:
    """Least signal by which every half-plane must move out for some coefficients in [0, 1] to fit,
    and the solver's tolerance; 0 where they do.

    Parameters
    ----------
    boxes : SignalBoxes
        Of S signals.
    row : int
        Which signal.
    options : dict, optional
        Of HiGHS.

    Raises
    ------
    ConvergenceError
        If the solver fails.
    """
    directions, centre, half_width = (values[row] for values in (boxes.directions, boxes.centre,
                                                                 boxes.half_width))
    matrix, coefficients = np.vstack([directions, -directions]), directions.shape[1]
    slack = _least(np.r_[np.zeros(coefficients), 1.0], [(0, 1)] * coefficients + [(0, None)],
                   {"A_ub": np.c_[matrix, -np.ones(len(matrix))],
                    "b_ub": np.r_[centre + half_width, half_width - centre]}, options)
    # The tolerance again, or the set could come out empty.
    return slack + LP_ATOL if slack > LP_ATOL else 0.0


def linear_programmes(box: SignalBoxes, basis: np.ndarray,
                      options: dict[str, float] | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Smallest and largest B c (P,) over one box, which is not empty.

    Parameters
    ----------
    box : SignalBoxes
        Of one signal.
    basis : (P, N) array
    options : dict, optional
        Of HiGHS.

    Raises
    ------
    ConvergenceError
        If the solver fails.
    """
    constraints = _half_planes(box.directions[0], box.centre[0], box.half_width[0])
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
