"""The stage that draws: every spectrum behind each surface's signal, of any kind of session."""
from __future__ import annotations

from typing import Any

from spectrabox.measure.surface_spectra import DrawOptions, sample_surfaces
from spectrabox.radiometry.records import SpectrumSamples
from spectrabox.session.config.session_schema import SessionConfig
from spectrabox.session.stages.stage_task import StageTask
from spectrabox.session.stages.stored_records import calibrations_of, joint_of, signals_of


def draw_surfaces(task: StageTask) -> dict[str, Any]:
    """Draws from all spectra behind each unknown surface's signal, and their summary.

    Returns
    -------
    dict
        Of every unknown surface its "samples NAME", "summary NAME", "variance shares NAME" and
        "family shares NAME".
    """
    config = task.config
    families = {name: surface.families for name, surface in config.surfaces.items()}
    jointly: dict[str, SpectrumSamples] = {}
    if config.sampling.through == "transport":
        # with scipy.linalg, a quarter of a second to import
        from spectrabox.measure.scene.draws import draw_through_transport
        task.progress(0.0, "all materials at once")
        jointly = draw_through_transport(
            calibrations_of(config, task.stored)[0], joint_of(task.stored), config.sampling.draws,
            config.session.seed, config.sampling.coefficients, families)
    spectra = sample_surfaces(signals_of(task.stored), draw_options(config), families,
                              task.progress, jointly)
    records: dict[str, Any] = {}
    for name, spectrum in spectra.items():
        records |= {f"samples {name}": spectrum.samples, f"summary {name}": spectrum.summary,
                    f"variance shares {name}": spectrum.variance_shares,
                    f"family shares {name}": spectrum.family_shares}
    return records


def draw_options(config: SessionConfig) -> DrawOptions:
    """What [sampling] asks for."""
    chosen = config.sampling
    return DrawOptions(chosen.method, chosen.draws, chosen.coefficients, chosen.level,
                       config.session.seed)
