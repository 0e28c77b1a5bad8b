"""Draws behind one surface's signal, and what they say, for every kind of session."""
from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from spectrabox.radiometry.records import (
    SpectralMeasurement,
    SpectrumSamples,
    SpectrumSummary,
    WavelengthGrid,
)
from spectrabox.sampling.draw_methods import draw_spectra
from spectrabox.sampling.prior.mixture import LogitMixture, of_families
from spectrabox.sampling.summary import summarise
from spectrabox.session.config.session_schema import SessionConfig


def drawn_and_summarised(config: SessionConfig, name: str, measurement: SpectralMeasurement,
                         seed: int, prior: LogitMixture,
                         draws: SpectrumSamples | None = None) -> dict[str, Any]:
    """A surface's "samples NAME" and "summary NAME", as [sampling] asks for them.

    Parameters
    ----------
    name : str
        Of the surface.
    measurement : SpectralMeasurement
        What the photos said of it.
    seed : int
    prior : LogitMixture
        Of all families.
    draws : SpectrumSamples, optional
        Where they were drawn already.
    """
    chosen = config.sampling
    if draws is None:
        draws = draw_spectra(measurement, chosen.method, chosen.draws, seed, chosen.coefficients,
                             of_families(prior, config.surfaces[name].families))
    summary = summarise(draws, measurement, chosen.level, conditions(draws, measurement))
    return {f"samples {name}": draws,
            f"summary {name}": on_finer_grid(summary, measurement.grid)}


def conditions(draws: SpectrumSamples, measurement: SpectralMeasurement) -> str:
    """What the band rests on, in words."""
    errors = ", ".join(f"{100 * error:.2g}"
                       for error in np.sqrt(np.diag(measurement.noise_covariance)))
    return (f"Conditional on Gaussian errors of the signal of {errors} % of white, on the sampler "
            f"and its prior ({draws.method}), and, for the exact bounds, on splines of "
            f"{draws.coefficients.shape[1]} coefficients between 0 and 1. {draws.sentence}")


def on_finer_grid(summary: SpectrumSummary, grid: WavelengthGrid) -> SpectrumSummary:
    """The same summary on another grid, by straight lines between its wavelengths."""
    curves = ("mean", "standard_deviation", "lower", "upper", "bound_lower", "bound_upper")
    return dataclasses.replace(summary, grid=grid, **{
        name: np.interp(grid.nm, summary.grid.nm, getattr(summary, name)) for name in curves})
