"""The stage that draws: every spectrum behind each material's signal."""
from __future__ import annotations

from typing import Any

from spectrabox.measure.surface_signals import measurement, scene_signals
from spectrabox.radiometry.records import SpectrumSamples
from spectrabox.sampling.prior.mixture import load_prior
from spectrabox.session.stages.drawing import drawn_and_summarised
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
    signals, prior = scene_signals(joint, calibrations), load_prior()
    records: dict[str, Any] = {}
    jointly: dict[str, SpectrumSamples] = {}
    families = {name: material.families for name, material in task.config.materials.items()}
    if chosen.through == "transport":
        # with scipy.linalg, a quarter of a second to import
        from spectrabox.session.stages.scene_sampling import draw_through_transport
        task.progress(0.0, "all materials at once")
        jointly = draw_through_transport(calibrations[0], joint, chosen.draws, seed,
                                         chosen.coefficients, families)
    for index, name in enumerate(joint.materials):
        if joint.known[index]:
            continue
        task.progress(index / len(joint.materials), name)
        records |= drawn_and_summarised(task.config, name, measurement(signals, index),
                                        seed + index, prior, jointly.get(name))
    return records
