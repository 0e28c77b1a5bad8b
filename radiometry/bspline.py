"""Clamped uniform cubic B-splines on 400-700 nm (paper Sec. 3.1, Eqs. 2-3)."""
from __future__ import annotations

import numpy as np
from scipy.interpolate import BSpline

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
        If there are fewer than 4 coefficients.
    """
    return BSpline.design_matrix(np.asarray(nm, dtype=float), knots_nm(coefficients),
                                 DEGREE).toarray()
