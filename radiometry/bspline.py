"""Clamped uniform cubic B-splines on 400-700 nm (paper Sec. 3.1, Eqs. 2-3)."""
from __future__ import annotations

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import VISIBLE_NM

DEGREE = 3


def knots_nm(coefficients: int) -> np.ndarray:
    """Uniform knots (N + 4,) with the end points repeated (multiplicity 4).

    Parameters
    ----------
    coefficients : int
        N >= 4.

    Raises
    ------
    InputError
        If there are fewer than 4 coefficients.
    """
    if coefficients <= DEGREE:
        raise InputError(f"a cubic B-spline needs at least 4 coefficients; {coefficients} were "
                         "asked for")
    inner = np.linspace(*VISIBLE_NM, coefficients - DEGREE + 1)
    return np.r_[[VISIBLE_NM[0]] * DEGREE, inner, [VISIBLE_NM[1]] * DEGREE]


def basis_matrix(nm: np.ndarray, coefficients: int) -> np.ndarray:
    """Basis functions B (P, N); every row sums to 1 (Eq. 2).

    Parameters
    ----------
    nm : (P,) array
        Within 400-700.
    coefficients : int
        N >= 4.

    Raises
    ------
    InputError
        If there are fewer than 4 coefficients, or a wavelength lies outside.
    """
    knots, nm = knots_nm(coefficients), np.asarray(nm, dtype=float)
    if np.any((nm < knots[0]) | (nm > knots[-1])):
        raise InputError(f"splines cover {knots[0]:g}-{knots[-1]:g} nm, and {nm.min():g}-"
                         f"{nm.max():g} nm are asked for")
    # The last interval includes its end.
    interval = np.clip(np.searchsorted(knots, nm, side="right") - 1, DEGREE, coefficients - 1)
    basis = np.eye(len(knots) - 1)[interval]
    for degree in range(1, DEGREE + 1):  # de Boor's recursion; of an empty interval nothing is left
        width = knots[degree:-1] - knots[:-degree - 1]
        rising = (nm[:, None] - knots[:-degree - 1]) / np.where(width > 0, width, np.inf)
        width = knots[degree + 1:] - knots[1:-degree]
        falling = (knots[degree + 1:] - nm[:, None]) / np.where(width > 0, width, np.inf)
        basis = rising * basis[:, :-1] + falling * basis[:, 1:]
    return np.asarray(basis)
