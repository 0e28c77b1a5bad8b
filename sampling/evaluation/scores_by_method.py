"""Recovered spectra judged against the truth by the same measures, whoever recovered them."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from spectrabox.radiometry.bspline import basis_matrix
from spectrabox.radiometry.errors import ConvergenceError
from spectrabox.radiometry.grid import grid_from_nm
from spectrabox.radiometry.records.spectra import SpectralMeasurement
from spectrabox.sampling.draw_methods import METHODS, draw_spectra
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
from spectrabox.sampling.prior.mixture import PRIOR_GRID, LogitMixture
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
    whole_curve : bool, optional
        Whether the widened band that holds 95 % of whole draws holds the whole truth; a share in
        means.
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
    """The scores of a method in a region, or their means over regions."""

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


def estimates(measurement: SpectralMeasurement, methods: tuple[str, ...], draws: int, seed: int,
              coefficients: int, prior: LogitMixture | None = None) -> dict[str, Estimate]:
    """Mean and draws by method for one signal; a method that has no draws is left out."""
    by_method: dict[str, Estimate] = {}
    for method in methods:
        try:
            spectra = draw_spectra(measurement, method, draws, seed, coefficients, prior).spectra
        except ConvergenceError:
            continue
        by_method[method] = (spectra.mean(axis=0), spectra)
    return by_method


def baselines(measurement: SpectralMeasurement, draws: int, seed: int,
              coefficients: int) -> dict[str, Estimate | None]:
    """Single spectra of other authors, and a greedy sampler's mean and draws; None if it has none.
    """
    c, _ = greedy_draws(spline_operator(measurement, coefficients), draws, seed)
    spectra = c @ basis_matrix(PRIOR_GRID.nm, coefficients).T
    greedy = (spectra.mean(axis=0), spectra) if len(spectra) else None
    singles = {name: (spectrum, None) for name, spectrum in baseline_spectra(measurement).items()}
    return {**singles, GREEDY: greedy}


def beside(measurement: SpectralMeasurement, nm: np.ndarray, truth: np.ndarray,
           lights: tuple[str, ...], draws: int, seed: int, coefficients: int, prior: LogitMixture,
           with_baselines: bool) -> dict[str, SpectrumScores]:
    """Our methods, and other authors', on one signal, judged against the truth.

    Nine parameters: what is judged, by what measures, and how to draw.

    Parameters
    ----------
    measurement : SpectralMeasurement
    nm, truth : (P,) arrays
        Some of the 61 wavelengths, and the reflectance there.
    lights : names
        Of the colour differences.
    draws, seed, coefficients, prior
        See `sampling.draw_methods.draw_spectra`.
    with_baselines : bool
        Whether other authors' methods are judged too.

    Returns
    -------
    dict of SpectrumScores
        By method.
    """
    by_method: dict[str, Estimate | None] = {
        **estimates(measurement, tuple(METHODS)[::-1], draws, seed, coefficients, prior)}
    if with_baselines:
        by_method |= baselines(measurement, draws, seed, coefficients)
    columns = np.searchsorted(PRIOR_GRID.nm, nm)
    return {name: judged(nm, truth, estimate[0][columns], lights,
                         None if estimate[1] is None else estimate[1][:, columns])
            for name, estimate in by_method.items() if estimate is not None}


def means(rows: Sequence[ScoredSpectrum]) -> list[ScoredSpectrum]:
    """One row a method: its scores averaged over the regions of ``rows``, those of a band where
    there is one.
    """
    averages = []
    for method in dict.fromkeys(row.method for row in rows):
        mine = [row.scores for row in rows if row.method == method]
        angle, plain, scaled = (float(np.mean([getattr(one, name) for one in mine]))
                                for name in ("spectral_angle", "rmse", "rmse_best_scale"))
        banded = [one for one in mine if one.coverage is not None]
        of_band = {name: float(np.mean([getattr(one, name) for one in banded]))
                   for name, _ in BAND_SCORES} if banded else {}
        differences = {light: float(np.mean([one.delta_e00[light] for one in mine]))
                       for light in mine[0].delta_e00}
        averages.append(ScoredSpectrum(f"mean of {len(mine)}", method, SpectrumScores(
            plain, angle, scaled, differences, **of_band)))
    return averages


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
