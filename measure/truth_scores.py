"""How near recovered spectra came to measured truths."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spectrabox.radiometry.appearance import delta_e00
from spectrabox.radiometry.records import SpectrumSamples, SpectrumSummary


@dataclass(frozen=True)
class Scores:
    """How near a recovered spectrum came to a measured truth, over 400-700 nm."""

    rmse_mean: float                  # reflectance, mean of the samples
    # reflectance, the one spectrum of inverse rendering; None of a flat sample
    rmse_inverse_rendering: float | None
    coverage: float  # share of wavelengths at which the band at the session's level holds the truth
    coverage_95: float                # the same for the 95 % band
    coverage_bounds: float            # the same for the exact bounds
    band_width: float                 # mean width of the band, reflectance
    # CIEDE2000 under D65, 2 degree observer, mean of the samples against truth
    delta_e00_mean: float


def score(truth: np.ndarray, inverse_rendering: np.ndarray | None, summary: SpectrumSummary,
          samples: SpectrumSamples) -> Scores:
    """Scores of one material over the summary's grid.

    Parameters
    ----------
    truth : (P,) reflectance
    inverse_rendering : (P,) reflectance or None
        The one spectrum of inverse rendering, where there is one.
    """
    lower, upper = (np.interp(summary.grid.nm, samples.grid.nm, ends)
                    for ends in np.quantile(samples.spectra, [0.025, 0.975], axis=0))
    return Scores(
        rmse_mean=_rmse(summary.mean, truth),
        rmse_inverse_rendering=None if inverse_rendering is None
        else _rmse(inverse_rendering, truth),
        coverage=_share_inside(truth, summary.lower, summary.upper),
        coverage_95=_share_inside(truth, lower, upper),
        coverage_bounds=_share_inside(truth, summary.bound_lower, summary.bound_upper),
        band_width=float(np.mean(summary.upper - summary.lower)),
        delta_e00_mean=delta_e00(summary.grid.nm, summary.mean, truth))


def _rmse(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.sqrt(np.mean((a - b) ** 2)))


def _share_inside(truth: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> float:
    return float(np.mean((truth >= lower) & (truth <= upper)))
