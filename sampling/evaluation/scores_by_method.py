"""Recovered spectra judged against the truth by the same measures, whoever recovered them."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from spectrabox.radiometry.bspline import basis_matrix
from spectrabox.radiometry.grid import grid_from_nm
from spectrabox.radiometry.records.spectra import SpectralMeasurement
from spectrabox.sampling.evaluation.metrics import (
    best_scale,
    coverage,
    curve_band,
    delta_e00_under,
    rmse,
    sharpness,
    spectral_angle,
    winkler_score,
)
from spectrabox.sampling.prior.mixture import PRIOR_GRID
from spectrabox.sampling.published.baselines import baseline_spectra, greedy_draws
from spectrabox.sampling.spectral_measurement import spline_operator
from spectrabox.sampling.summary import TAIL_DRAWS

LEVEL = 0.95
BAND_DRAWS = round(2 * TAIL_DRAWS / (1 - LEVEL))        # fewer give no band, for us as for others
GREEDY = "Belcour-style greedy"
Estimate = tuple[np.ndarray, np.ndarray | None]      # mean (61,) and draws (T, 61), if any
POINT_SCORES = (("rmse", "RMSE"), ("rmse_best_scale", "scaled"), ("spectral_angle", "angle"))
BAND_SCORES = (("coverage", "95 % holds"), ("whole_curve", "whole"), ("width", "width"),
                 ("sharpness", "50 % w."), ("winkler", "Winkler"))


@dataclass(frozen=True)
class SpectrumScores:
    """How near one recovered spectrum is to the truth; those of a band are None without one.

    Attributes
    ----------
    rmse, rmse_best_scale : float
        The second after the one best factor.
    spectral_angle : float
        In radians.
    delta_e00 : dict of float
        CIEDE2000 by light.
    coverage : float, optional
        Share of wavelengths in the 95 % band.
    whole_curve : bool or float, optional
        Whether the widened band that holds 95 % of whole draws holds the whole truth; as a mean,
        of what share.
    width, sharpness, winkler : float, optional
        Of the 95 % band; width of the 50 % band; interval score.
    """

    rmse: float
    spectral_angle: float
    rmse_best_scale: float
    delta_e00: dict[str, float]
    coverage: float | None = None
    whole_curve: bool | float | None = None
    width: float | None = None
    sharpness: float | None = None
    winkler: float | None = None


@dataclass(frozen=True)
class ScoredSpectrum:
    """The scores of a method for a signal or a region, or their means."""

    region: str
    method: str
    scores: SpectrumScores


def judged(nm: np.ndarray, truth: np.ndarray, estimate: np.ndarray, lights: tuple[str, ...],
           draws: np.ndarray | None = None) -> SpectrumScores:
    """Scores of one recovered spectrum.

    Parameters
    ----------
    nm : (P,)
    truth, estimate : (P,)
    lights : names
        Of the colour differences.
    draws : (T, P), optional
        What the estimate is the mean of. Fewer than 1000 give no band.
    """
    differences = delta_e00_under(lights, grid_from_nm(nm), estimate[None], truth[None])
    scores = SpectrumScores(
        float(rmse(estimate, truth)), float(spectral_angle(estimate, truth)),
        float(rmse(best_scale(estimate, truth) * estimate, truth)),
        {light: float(values[0]) for light, values in differences.items()})
    if draws is None or len(draws) < BAND_DRAWS:
        return scores
    lower, upper = np.quantile(draws, [(1 - LEVEL) / 2, (1 + LEVEL) / 2], axis=0)
    widest = curve_band(draws, LEVEL)
    return replace(scores, coverage=coverage(lower, upper, truth),
                   whole_curve=bool(np.all((truth >= widest[0]) & (truth <= widest[1]))),
                   width=float(np.mean(upper - lower)), sharpness=sharpness(draws),
                   winkler=winkler_score(lower, upper, truth, LEVEL))


def baselines(measurement: SpectralMeasurement, draws: int, seed: int,
              coefficients: int) -> dict[str, Estimate | None]:
    """Single spectra of other authors, and a greedy sampler's mean and draws; None if it has none.
    """
    c, _ = greedy_draws(spline_operator(measurement, coefficients), draws, seed)
    spectra = c @ basis_matrix(PRIOR_GRID.nm, coefficients).T
    greedy = (spectra.mean(axis=0), spectra) if len(spectra) else None
    singles = {name: (spectrum, None) for name, spectrum in baseline_spectra(measurement).items()}
    return {**singles, GREEDY: greedy}


def judgement_text(rows: Sequence[ScoredSpectrum]) -> str:
    """A table of judged spectra, one a row."""
    widths = [max(6, *(len(row.region) for row in rows)), max(6, *(len(row.method)
                                                                   for row in rows))]
    lights = tuple(rows[0].scores.delta_e00)
    lines = [f"{'region':<{widths[0]}} {'method':<{widths[1]}} "
             + " ".join(f"{label:>7}" for _, label in POINT_SCORES)
             + "".join(f" {'dE ' + light:>9}" for light in lights)
             + "".join(f" {label:>10}" for _, label in BAND_SCORES)]
    for row in rows:
        cells = [f"{row.region:<{widths[0]}} {row.method:<{widths[1]}}",
                 *(f"{getattr(row.scores, name):7.4f}" for name, _ in POINT_SCORES),
                 *(f"{row.scores.delta_e00[light]:9.2f}" for light in lights),
                 *(f"{_cell(getattr(row.scores, name)):>10}" for name, _ in BAND_SCORES)]
        lines.append(" ".join(cells))
    return "\n".join(lines)


def _cell(value: float | bool | None) -> str:
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.3f}"
