"""Shape-preserving cubic interpolation, so that reading a spectrum does not wait for SciPy.

Fritsch and Butland, SIAM J. Sci. Stat. Comput. 5 (1984) 300: slopes are harmonic means of the two
secants beside a knot, 0 where these differ in sign; end slopes by the three-point formula of Moler
(Numerical Computing with MATLAB, 2004, Sec. 3.6), limited to keep the shape. The curve never leaves
the range of its neighbouring samples. SciPy's ``PchipInterpolator`` is the same curve.
"""
from __future__ import annotations

import numpy as np


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
