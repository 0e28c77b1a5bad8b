"""Wavelength grids in nm, B-splines on them, and spectra resampled from one grid to another.

Spectra on another wavelength grid, with their integrals kept.

Evenly spaced samples are interpolated with Sprague's quintic, as CIE 167:2005 recommends and
colour-science does; uneven ones with a shape-preserving cubic, where CIE 167 asks for a cubic
spline: it does not overshoot at lines. Onto a coarser grid each value is the mean of the
interpolated curve over its step, so that the sum of values times steps is the integral.
"""


from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records.spectra import WavelengthGrid

VISIBLE_NM = (400.0, 700.0)  # the range used throughout, as in the paper (Sec. 3.1)
NM_ROUNDING = 1e-6


def trapezoid_weights_nm(nm: np.ndarray) -> np.ndarray:
    """Weights (P,) such that ``weights @ f(nm)`` is the trapezoid rule, for ascending
    wavelengths.

    Parameters
    ----------
    nm : (P,) array
        Ascending, P >= 2.
    """
    gaps = np.diff(nm)
    weights = np.zeros_like(nm, dtype=float)
    weights[:-1] += gaps / 2
    weights[1:] += gaps / 2
    return weights


def grid_from_nm(nm: np.ndarray) -> WavelengthGrid:
    """Grid of the given ascending wavelengths, (P,) in nm, P >= 2.

    Parameters
    ----------
    nm : (P,) array
        Ascending, P >= 2.

    Raises
    ------
    ValueError
        If the wavelengths are not strictly ascending.
    """
    nm = np.asarray(nm, dtype=float)
    if nm.size < 2 or not np.all(np.diff(nm) > 0):
        raise ValueError("a wavelength grid needs at least two strictly ascending wavelengths")
    return WavelengthGrid(nm, trapezoid_weights_nm(nm))


def interpolation_matrix(from_nm: np.ndarray, to_nm: np.ndarray) -> np.ndarray:
    """Matrix (P', P) that interpolates values linearly from wavelengths (P,) to others (P',).

    Beyond the ends the first and the last value hold.

    Parameters
    ----------
    from_nm : (P,) array
        Ascending.
    to_nm : (P',) array
    """
    start = np.clip(np.searchsorted(from_nm, to_nm, side="right") - 1, 0, from_nm.size - 2)
    along = np.clip(to_nm, from_nm[0], from_nm[-1]) - from_nm[start]
    slope = 1 / (from_nm[start + 1] - from_nm[start])
    # an array (P, P'), transposed: BLAS sums in another order over another layout
    weights, columns = np.zeros((from_nm.size, len(to_nm))), np.arange(len(to_nm))
    weights[start, columns], weights[start + 1, columns] = 1 - slope * along, slope * along
    return weights.T


def at_whole_steps(nm: np.ndarray, step_nm: float) -> np.ndarray:
    """Whether each wavelength (P,) is a whole number of steps from the first.

    Parameters
    ----------
    nm : (P,) array
    step_nm : float
    """
    return np.abs(np.remainder(nm - nm[0] + step_nm / 2, step_nm) - step_nm / 2) < NM_ROUNDING


def visible_grid(step_nm: float = 1.0) -> WavelengthGrid:
    """400 to 700 nm in steps of ``step_nm``, which must divide 300.

    Parameters
    ----------
    step_nm : float
        Must divide 300.
    """
    intervals = round((VISIBLE_NM[1] - VISIBLE_NM[0]) / step_nm)
    return grid_from_nm(np.linspace(*VISIBLE_NM, intervals + 1))


FINE_GRID = visible_grid()       # on which everything is integrated


# ---- clamped uniform cubic B-splines on 400-700 nm (paper Sec. 3.1, Eqs. 2-3) --------------------

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


# ---- spectra on another wavelength grid, with their integrals kept -------------------------------

EVEN_RTOL = 1e-6
Curve = Callable[[np.ndarray], np.ndarray]
# Two points added at each end by the polynomial that Sprague's formula asks for (CIE 167:2005,
# table V).
BOUNDARY = np.array([[884, -1960, 3033, -2648, 1080, -180], [508, -540, 488, -367, 144, -24],
                     [-24, 144, -367, 488, -540, 508], [-180, 1080, -2648, 3033, -1960, 884]]) / 209
# Coefficients of the quintic between the third and fourth of six neighbours, by power of the
# position.
QUINTIC = np.array([[0, 0, 24, 0, 0, 0], [2, -16, 0, 16, -2, 0], [-1, 16, -30, 16, -1, 0],
                    [-9, 39, -70, 66, -33, 7], [13, -64, 126, -124, 61, -12],
                    [-5, 25, -50, 50, -25, 5]]) / 24


def resampled(nm: np.ndarray, values: np.ndarray, target_nm: np.ndarray,
              name: str) -> tuple[np.ndarray, str]:
    """Values (P',) at ``target_nm``, and the rule that was used as a sentence.

    Parameters
    ----------
    nm, values : (P,) arrays
    target_nm : (P',) array
        Evenly spaced, within the range of ``nm``.
    name : str
        Of the spectrum, for errors.

    Raises
    ------
    InputError
        If the samples do not cover the target, or the target is not evenly spaced. Nothing is
        extrapolated.
    """
    steps = np.diff(target_nm)
    if target_nm.size < 2 or np.any(steps <= 0) or np.ptp(steps) > EVEN_RTOL * steps.mean():
        raise InputError("the wavelengths asked for must ascend in even steps, such as 400:700:5")
    if target_nm[0] < nm[0] - 1e-6 or target_nm[-1] > nm[-1] + 1e-6:
        raise InputError(f"{name} covers {nm[0]:g}-{nm[-1]:g} nm; "
                         f"{target_nm[0]:g}-{target_nm[-1]:g} nm is asked for: ask for less, or "
                         "measure the missing part")
    even = nm.size >= 6 and np.ptp(np.diff(nm)) <= EVEN_RTOL * np.diff(nm).mean()
    rule = "Sprague's quintic (CIE 167)" if even else "shape-preserving cubic (uneven samples)"
    curve: Curve = partial(sprague if even else pchip, nm, values)
    step = float(steps.mean())
    if step <= np.diff(nm).mean() * (1 + EVEN_RTOL):
        return curve(np.clip(target_nm, nm[0], nm[-1])), rule
    return _step_means(nm, curve, target_nm,
                       step), f"{rule}, then the mean over each {step:g} nm step"


def sprague(nm: np.ndarray, values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Sprague's quintic through evenly spaced samples.

    Parameters
    ----------
    nm, values : (P,) arrays
        P >= 6.
    at : (Q,) array
        Wavelengths within their range.
    """
    extended = np.concatenate([BOUNDARY[:2] @ values[:6], values, BOUNDARY[2:] @ values[-6:]])
    position = (at - nm[0]) / (nm[-1] - nm[0]) * (nm.size - 1)
    left = np.clip(np.floor(position).astype(int), 0, nm.size - 2)
    neighbours = extended[left[:, None] + np.arange(6)]
    powers = (position - left)[:, None] ** np.arange(6)
    return np.einsum("ij,jk,ik->i", powers, QUINTIC, neighbours)


def _step_means(nm: np.ndarray, curve: Curve, target_nm: np.ndarray, step: float) -> np.ndarray:
    """Mean of the curve over each step; steps at the ends that reach beyond the samples are cut
    there.
    """
    nodes, weights = np.polynomial.legendre.leggauss(4)  # exact for the quintic between two samples
    means = np.empty(target_nm.size)
    for index, centre in enumerate(target_nm):
        low, high = max(centre - step / 2, nm[0]), min(centre + step / 2, nm[-1])
        edges = np.concatenate([[low], nm[(nm > low) & (nm < high)], [high]])
        half = np.diff(edges)[:, None] / 2
        at = (edges[:-1, None] + half) + half * nodes

        means[index] = np.sum(half * weights * curve(at.ravel()).reshape(at.shape)) / (high - low)
    return means


# ---- pchip ---------------------------------------------------------------------------------------
# Shape-preserving cubic interpolation, so that reading a spectrum does not wait for SciPy.
#
# Fritsch and Butland, SIAM J. Sci. Stat. Comput. 5 (1984) 300: slopes are harmonic means of the
# two secants beside a knot, 0 where these differ in sign; end slopes by the three-point formula of
# Moler (Numerical Computing with MATLAB, 2004, Sec. 3.6), limited to keep the shape. The curve
# never leaves the range of its neighbouring samples. SciPy's ``PchipInterpolator`` is the same
# curve.

def pchip(x: np.ndarray, y: np.ndarray, at: np.ndarray) -> np.ndarray:
    """The curve (..., Q) through samples, at positions within their range.

    Parameters
    ----------
    x : (P,) array
        Ascending, P >= 2.
    y : (..., P) array
    at : (Q,) array
        Within ``x``.
    """
    y = np.asarray(y, dtype=float)
    step = np.diff(x)
    secant = np.diff(y, axis=-1) / step
    slope = _slopes(step, secant)
    piece = np.clip(np.searchsorted(x, at, side="right") - 1, 0, len(x) - 2)
    offset, width, mean = at - x[piece], step[piece], secant[..., piece]
    before, after = slope[..., piece], slope[..., piece + 1]
    bend = (before + after - 2 * mean) / width
    cubic = y[..., piece] + offset * (before + offset * ((mean - before) / width - bend
                                                         + offset * bend / width))
    return np.asarray(cubic)


def _slopes(step: np.ndarray, secant: np.ndarray) -> np.ndarray:
    """Slopes (..., P) at the knots."""
    if step.size == 1:
        return np.concatenate([secant, secant], axis=-1)
    left, right = secant[..., :-1], secant[..., 1:]
    monotone = left * right > 0
    of_left, of_right = step[:-1] + 2 * step[1:], 2 * step[:-1] + step[1:]
    inverse = (of_left / np.where(monotone, left, 1.0) + of_right / np.where(monotone, right, 1.0))
    inner = np.where(monotone, (of_left + of_right) / inverse, 0.0)
    first = _end_slope(step[0], step[1], secant[..., :1], secant[..., 1:2])
    last = _end_slope(step[-1], step[-2], secant[..., -1:], secant[..., -2:-1])
    return np.concatenate([first, inner, last], axis=-1)


def _end_slope(step: float, next_step: float, secant: np.ndarray,
               next_secant: np.ndarray) -> np.ndarray:
    """Slope (..., 1) at an end of the curve."""
    slope = ((2 * step + next_step) * secant - step * next_secant) / (step + next_step)
    slope = np.where(np.sign(slope) == np.sign(secant), slope, 0.0)
    overshoots = (np.sign(secant) != np.sign(next_secant)) & (np.abs(slope) > 3 * np.abs(secant))
    return np.where(overshoots, 3 * secant, slope)
