"""How good a recovered spectrum and its band are, against the truth."""
from __future__ import annotations

import numpy as np


def rmse(estimate: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Root-mean-square error (n,) of each spectrum (n, P)."""
    return np.sqrt(np.mean((estimate - truth)**2, axis=-1))


def spectral_angle(estimate: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Angle (n,) in radians between spectra (n, P): 0 for equal shapes, whatever their level."""
    product = np.sum(estimate * truth, axis=-1)
    return np.arccos(np.clip(product / np.linalg.norm(estimate, axis=-1) / np.linalg.norm(truth, axis=-1), -1, 1))


def coverage(lower: np.ndarray, upper: np.ndarray, truth: np.ndarray) -> float:
    """Fraction of wavelengths at which bands (n, P) hold the truth."""
    return float(np.mean((truth >= lower) & (truth <= upper)))


def curve_coverage(lower: np.ndarray, upper: np.ndarray, truth: np.ndarray) -> float:
    """Fraction of curves that lie wholly within their bands (n, P)."""
    return float(np.mean(np.all((truth >= lower) & (truth <= upper), axis=-1)))


def winkler_score(lower: np.ndarray, upper: np.ndarray, truth: np.ndarray, level: float = 0.95) -> float:
    """Mean width plus 2 / (1 - level) times what the truth lies outside (Gneiting and Raftery 2007, Eq. 43)."""
    outside = np.maximum(lower - truth, 0) + np.maximum(truth - upper, 0)
    return float(np.mean(upper - lower + 2 / (1 - level) * outside))


def coverage_error(inside: np.ndarray) -> float:
    """Standard error of a coverage from which curves (n, P) bool held the truth where: curves are independent."""
    per_curve = inside.mean(axis=1)
    return float(per_curve.std(ddof=1) / np.sqrt(len(per_curve))) if len(per_curve) > 1 else float("nan")
