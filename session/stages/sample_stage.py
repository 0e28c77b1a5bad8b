"""The stage that draws: every spectrum behind each material's signal."""
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
from spectrabox.sampling.methods import draw_spectra
from spectrabox.sampling.prior.mixture import load_prior, of_families
from spectrabox.sampling.summary import summarise
from spectrabox.session.stages.error_budget import measurement_of
from spectrabox.session.stages.scene_sampling import draw_through_transport
from spectrabox.session.stages.stage_task import StageTask
from spectrabox.session.stages.stored_records import calibrations_of, joint_of


def sample_materials(task: StageTask) -> dict[str, Any]:
    """Draws from all spectra behind each unknown material's signal, and their summary.

    Returns
    -------
    dict
        Of every unknown material its "samples NAME" and "summary NAME".
    """
    chosen, seed = task.config.sampling, task.config.session.seed
    calibrations, joint = calibrations_of(task.config, task.stored), joint_of(task.stored)
    prior = load_prior()
    records: dict[str, Any] = {}
    jointly: dict[str, SpectrumSamples] = {}
    families = {name: material.families for name, material in task.config.materials.items()}
    if chosen.through == "transport":
        task.progress(0.0, "all materials at once")
        jointly = draw_through_transport(calibrations[0], joint, chosen.draws, seed,
                                         chosen.coefficients, families)
    for index, name in enumerate(joint.materials):
        if joint.known[index]:
            continue
        task.progress(index / len(joint.materials), name)
        measurement = measurement_of(calibrations, joint, index)
        draws = jointly.get(name) or draw_spectra(measurement, chosen.method, chosen.draws,
                                                  seed + index, chosen.coefficients,
                                                  of_families(prior, families[name]))
        records[f"samples {name}"] = draws
        records[f"summary {name}"] = on_finer_grid(summarise(
            draws, measurement, chosen.level, conditions(draws, measurement)), joint.grid)
    return records


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
