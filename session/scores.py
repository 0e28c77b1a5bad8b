"""How near recovered spectra came to measured truths."""
from __future__ import annotations

import numpy as np

from spectrabox.radiometry.appearance import delta_e00
from spectrabox.radiometry.records import SpectrumSamples, SpectrumSummary
from spectrabox.session.store.results import Scores


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
