"""Clamped uniform cubic B-splines on 400-700 nm (paper Sec. 3.1, Eqs. 2-3)."""
from __future__ import annotations

import numpy as np
from scipy.interpolate import BSpline
from scipy.optimize import lsq_linear

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import VISIBLE_NM

DEGREE = 3


def knots_nm(coefficients: int) -> np.ndarray:
    """Uniform knots with the end points repeated (multiplicity 4), for N >= 4 coefficients."""
    if coefficients <= DEGREE:
        raise InputError(f"a cubic B-spline needs at least 4 coefficients; {coefficients} were "
                         "asked for")
    inner = np.linspace(*VISIBLE_NM, coefficients - DEGREE + 1)
    return np.r_[[VISIBLE_NM[0]] * DEGREE, inner, [VISIBLE_NM[1]] * DEGREE]


def basis_matrix(nm: np.ndarray, coefficients: int) -> np.ndarray:
    """Basis functions B (P, N) at wavelengths ``nm`` within 400-700; every row sums to 1 (Eq.
    2).
    """
    return BSpline.design_matrix(np.asarray(nm, dtype=float), knots_nm(coefficients),
                                 DEGREE).toarray()


def fit_reflectance(nm: np.ndarray, reflectance: np.ndarray, coefficients: int) -> np.ndarray:
    """Coefficients (N,) in [0, 1] whose spline is nearest to ``reflectance`` (P,) in the
    least-squares sense.
    """
    return lsq_linear(basis_matrix(nm, coefficients), reflectance, bounds=(0.0, 1.0)).x
