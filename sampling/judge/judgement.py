"""Recovered spectra judged against the truth by the same measures, whoever recovered them."""
from __future__ import annotations

from typing import Any

import numpy as np

from spectrabox.radiometry.bspline import basis_matrix
from spectrabox.radiometry.errors import ConvergenceError
from spectrabox.radiometry.grid import grid_from_nm
from spectrabox.radiometry.records import SpectralMeasurement
from spectrabox.sampling.draw_methods import METHODS, draw_spectra
from spectrabox.sampling.judge.spectrum_scores import (
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
from spectrabox.sampling.spline_measurement import spline_operator
from spectrabox.sampling.summary import TAIL_DRAWS

LEVEL = 0.95
BAND_DRAWS = round(2 * TAIL_DRAWS / (1 - LEVEL))        # fewer give no band, for us as for others
GREEDY = "Belcour-style greedy"
Estimate = tuple[np.ndarray, np.ndarray | None]      # mean (61,) and draws (T, 61), if any
POINT_MEASURES = (("rmse", "RMSE"), ("rmse_best_scale", "scaled"), ("spectral_angle", "angle"))
BAND_MEASURES = (("coverage", "95 % holds"), ("whole_curve", "whole"), ("width", "width"),
                 ("sharpness", "50 % w."), ("winkler", "Winkler"))


def judged(nm: np.ndarray, truth: np.ndarray, estimate: np.ndarray, lights: tuple[str, ...],
           draws: np.ndarray | None = None) -> dict[str, Any]:
    """Measures of one recovered spectrum.

    Parameters
    ----------
    nm : (P,)
    truth, estimate : (P,)
    lights : names
        Of the colour differences.
    draws : (T, P), optional
        What the estimate is the mean of. The measures of a band are None for fewer than 1000.

    Returns
    -------
    dict
        ``rmse``, ``rmse_best_scale`` (after the one best factor), ``spectral_angle`` (radians),
        ``delta_e00`` by light; ``coverage`` (share of wavelengths in the 95 % band),
        ``whole_curve`` (whether the widened band that holds 95 % of whole draws holds the whole
        truth), ``width``, ``sharpness`` (of the 50 % band), ``winkler``.
    """
    differences = delta_e00_under(lights, grid_from_nm(nm), estimate[None], truth[None])
    measures: dict[str, Any] = {
        "rmse": float(rmse(estimate, truth)),
        "spectral_angle": float(spectral_angle(estimate, truth)),
        "rmse_best_scale": float(rmse(best_scale(estimate, truth) * estimate, truth)),
        "delta_e00": {light: float(values[0]) for light, values in differences.items()},
        **dict.fromkeys(key for key, _ in BAND_MEASURES)}
    if draws is not None and len(draws) >= BAND_DRAWS:
        lower, upper = np.quantile(draws, [(1 - LEVEL) / 2, (1 + LEVEL) / 2], axis=0)
        widest = curve_band(draws, LEVEL)
        measures |= {
            "coverage": coverage(lower, upper, truth), "width": float(np.mean(upper - lower)),
            "whole_curve": bool(np.all((truth >= widest[0]) & (truth <= widest[1]))),
            "sharpness": sharpness(draws), "winkler": winkler_score(lower, upper, truth, LEVEL)}
    return measures


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
           with_baselines: bool) -> dict[str, dict[str, Any]]:
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
    dict
        The measures of `judged`, by method.
    """
    by_method: dict[str, Estimate | None] = {
        **estimates(measurement, tuple(METHODS)[::-1], draws, seed, coefficients, prior)}
    if with_baselines:
        by_method |= baselines(measurement, draws, seed, coefficients)
    columns = np.searchsorted(PRIOR_GRID.nm, nm)
    return {name: judged(nm, truth, estimate[0][columns], lights,
                         None if estimate[1] is None else estimate[1][:, columns])
            for name, estimate in by_method.items() if estimate is not None}


def means(rows: list[dict[str, Any]], lights: tuple[str, ...]) -> list[dict[str, Any]]:
    """One row a method: its measures averaged over the regions of ``rows``, those of a band where
    there is one.
    """
    averages = []
    for method in dict.fromkeys(row["method"] for row in rows):
        mine = [row for row in rows if row["method"] == method]
        values = {key: [float(row[key]) for row in mine if row[key] is not None]
                  for key, _ in (*POINT_MEASURES, *BAND_MEASURES)}
        averages.append({
            "region": f"mean of {len(mine)}", "method": method,
            **{key: float(np.mean(some)) if some else None for key, some in values.items()},
            "delta_e00": {light: float(np.mean([row["delta_e00"][light] for row in mine]))
                          for light in lights}})
    return averages


def judgement_text(rows: list[dict[str, Any]], lights: tuple[str, ...]) -> str:
    """A table of judged spectra, one a row: keys ``region``, ``method`` and those of ``judged``."""
    widths = [max(6, *(len(row[key]) for row in rows)) for key in ("region", "method")]
    head = (f"{'region':<{widths[0]}} {'method':<{widths[1]}} "
            + " ".join(f"{label:>7}" for _, label in POINT_MEASURES)
            + "".join(f" {'dE ' + light:>9}" for light in lights)
            + "".join(f" {label:>10}" for _, label in BAND_MEASURES))
    lines = [head]
    for row in rows:
        cells = [f"{row['region']:<{widths[0]}} {row['method']:<{widths[1]}}",
                 *(f"{row[key]:7.4f}" for key, _ in POINT_MEASURES),
                 *(f"{row['delta_e00'][light]:9.2f}" for light in lights),
                 *(f"{_cell(row[key]):>10}" for key, _ in BAND_MEASURES)]
        lines.append(" ".join(cells))
    return "\n".join(lines)


def _cell(value: float | bool | None) -> str:
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.3f}"
