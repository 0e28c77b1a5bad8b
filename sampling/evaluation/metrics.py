"""How good a recovered spectrum and its band are, against the truth."""
from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from spectrabox.radiometry.appearance import ciede2000, lab_from_xyz
from spectrabox.radiometry.grid import interpolation_matrix, visible_grid
from spectrabox.radiometry.records.spectra import WavelengthGrid
from spectrabox.radiometry.spectra import named_spectra

TINY = 1e-12


def rmse(estimate: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Root-mean-square error (n,) of each spectrum (n, P).

    Parameters
    ----------
    estimate : (n, P) array
        Reflectances.
    truth : (n, P) array
        True reflectances.
    """
    return np.sqrt(np.mean((estimate - truth)**2, axis=-1))


def spectral_angle(estimate: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Angle (n,) in radians between spectra (n, P): 0 for equal shapes, whatever their level; a
    right one to black.

    Parameters
    ----------
    estimate : (n, P) array
        Reflectances.
    truth : (n, P) array
        True reflectances.
    """
    product = np.sum(estimate * truth, axis=-1)
    lengths = np.linalg.norm(estimate, axis=-1) * np.linalg.norm(truth, axis=-1)
    return np.arccos(np.clip(product / np.maximum(lengths, TINY), -1, 1))


def coverage(lower: np.ndarray, upper: np.ndarray, truth: np.ndarray) -> float:
    """Fraction of wavelengths at which bands (n, P) hold the truth.

    Parameters
    ----------
    lower : (n, P) array
        Lower end of the bands.
    upper : (n, P) array
        Upper end of the bands.
    truth : (n, P) array
        True reflectances.
    """
    return float(np.mean((truth >= lower) & (truth <= upper)))


def curve_coverage(lower: np.ndarray, upper: np.ndarray, truth: np.ndarray) -> float:
    """Fraction of curves that lie wholly within their bands (n, P).

    Parameters
    ----------
    lower : (n, P) array
        Lower end of the bands.
    upper : (n, P) array
        Upper end of the bands.
    truth : (n, P) array
        True reflectances.
    """
    return float(np.mean(np.all((truth >= lower) & (truth <= upper), axis=-1)))


def winkler_score(lower: np.ndarray, upper: np.ndarray, truth: np.ndarray,
                  level: float = 0.95) -> float:
    """Mean width plus 2 / (1 - level) times what the truth lies outside (Gneiting and Raftery 2007,
    Eq. 43).

    Parameters
    ----------
    lower : (n, P) array
        Lower end of the bands.
    upper : (n, P) array
        Upper end of the bands.
    truth : (n, P) array
        True reflectances.
    level : float
        Probability of the band, 0 to 1.
    """
    outside = np.maximum(lower - truth, 0) + np.maximum(truth - upper, 0)
    return float(np.mean(upper - lower + 2 / (1 - level) * outside))


def coverage_error(inside: np.ndarray) -> float:
    """Standard error of a coverage from which curves (n, P) bool held the truth where: curves are
    independent.

    Parameters
    ----------
    inside : (n, P) bool array
        Whether each band held the truth.
    """
    per_curve = inside.mean(axis=1)
    if len(per_curve) < 2:
        return float("nan")
    return float(per_curve.std(ddof=1) / np.sqrt(len(per_curve)))


def sharpness(spectra: np.ndarray) -> float:
    """Mean width of the central 50 % band of draws (T, P), whatever the truth is (Gneiting et al.
    2007, Sec. 3.3).

    Parameters
    ----------
    spectra : (T, P) array
        Reflectances.
    """
    lower, upper = np.quantile(spectra, [0.25, 0.75], axis=0)
    return float(np.mean(upper - lower))


def curve_band(spectra: np.ndarray, level: float = 0.95) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper (P,) of a band that holds that share of whole draws (T, P): the pointwise
    band, widened about the mean by one factor.

    Parameters
    ----------
    spectra : (T, P) array
        Reflectances.
    level : float
        Probability of the band, 0 to 1.
    """
    mean = spectra.mean(axis=0)
    lower, upper = np.quantile(spectra, [(1 - level) / 2, (1 + level) / 2], axis=0)
    below, above = np.maximum(mean - lower, TINY), np.maximum(upper - mean, TINY)
    factor = np.quantile(np.max(np.maximum((mean - spectra) / below, (spectra - mean) / above),
                                axis=1), level)
    return mean - factor * below, mean + factor * above


def best_scale(estimate: np.ndarray, truth: np.ndarray) -> float:
    """The one factor that brings an estimate (P,) nearest to the truth, as for a picture of unknown
    exposure.

    Parameters
    ----------
    estimate : (n, P) array
        Reflectances.
    truth : (n, P) array
        True reflectances.
    """
    return float(estimate @ truth / max(estimate @ estimate, TINY))


def delta_e00_under(lights: Sequence[str], grid: WavelengthGrid, estimate: np.ndarray,
                    truth: np.ndarray) -> dict[str, np.ndarray]:
    """CIEDE2000 differences (n,) of reflectances (n, P) under each light, by its name (CIE 1931 2
    degree observer).

    Integrated over the grid alone; white is a reflectance of 1, to whose colour the eye is taken to
    be adapted.

    Parameters
    ----------
    lights : sequence of str
        CIE names.
    grid : WavelengthGrid
        Of P wavelengths.
    estimate : (n, P) array
        Reflectances.
    truth : (n, P) array
        True reflectances.
    """
    fine = visible_grid(1)
    differences = {}
    for name in lights:
        relative_response = named_spectra.relative_response(
            "CIE 1931 2 Degree Standard Observer", name, fine) \
            @ interpolation_matrix(grid.nm, fine.nm)
        differences[name] = ciede2000(
            *(lab_from_xyz(np.maximum(spectra @ relative_response.T, 0), np.ones(3))
              for spectra in (estimate, truth)))
    return differences
