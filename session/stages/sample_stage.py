"""The stage that draws: every spectrum behind each material's signal."""
from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from spectrabox.radiometry.records import (
    Calibration,
    JointReconstruction,
    SpectrumSummary,
    WavelengthGrid,
)
from spectrabox.sampling.measurement import SpectralMeasurement, SpectralSamples, summarise_spectra
from spectrabox.sampling.methods import draw_spectra
from spectrabox.session.config.session_schema import SessionConfig
from spectrabox.session.stages.error_budget import measurement_of
from spectrabox.session.stages.scene_sampling import draw_through_transport

Progress = Callable[[float, str], None]


def sample_materials(config: SessionConfig, calibrations: Sequence[Calibration],
                     joint: JointReconstruction,
                     progress: Progress) -> dict[str, Any]:
    """Draws from all spectra behind each unknown material's signal, and their summary."""
    records: dict[str, Any] = {}
    jointly: dict[str, SpectralSamples] = {}
    if config.sampling.through == "transport":
        progress(0.0, "all materials at once")
        jointly = draw_through_transport(calibrations[0], joint, config.sampling.draws,
                                         config.session.seed, config.sampling.coefficients)
    for index, name in enumerate(joint.materials):
        if joint.known[index]:
            continue
        progress(index / len(joint.materials), name)
        measurement = measurement_of(calibrations, joint, index)
        draws = jointly.get(name) or draw_spectra(measurement, config.sampling.method,
                                                  config.sampling.draws, config.session.seed
                                                  + index, config.sampling.coefficients)
        records[f"samples {name}"] = draws
        records[f"summary {name}"] = on_finer_grid(summarise_spectra(
            draws, measurement, config.sampling.level, conditions(draws, measurement)), joint.grid)
    return records


def conditions(draws: SpectralSamples, measurement: SpectralMeasurement) -> str:
    """What the band rests on, in words."""
    errors = ", ".join(f"{100 * error:.2g}"
                       for error in np.sqrt(np.diag(measurement.noise_covariance)))
    return (f"Conditional on Gaussian errors of the signal of {errors} % of white, on the sampler "
            f"and its prior ({draws.method}), and, for the exact bounds, on splines of "
            f"{draws.coefficients.shape[1]} coefficients between 0 and 1. {draws.outcome}")


def on_finer_grid(summary: SpectrumSummary, grid: WavelengthGrid) -> SpectrumSummary:
    """The same summary on another grid, by straight lines between its wavelengths."""
    curves = ("mean", "standard_deviation", "lower", "upper", "bound_lower", "bound_upper")
    return dataclasses.replace(summary, grid=grid, **{
        name: np.interp(grid.nm, summary.grid.nm, getattr(summary, name)) for name in curves})
