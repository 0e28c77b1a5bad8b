"""Spectra on another wavelength grid, with their integrals kept.

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
