"""The stage that draws: every spectrum behind each surface's signal, of any kind of session."""
from __future__ import annotations

from spectrabox.measure.scene.draws import draw_through_transport
from spectrabox.measure.surface_spectra import DrawOptions, learn_from_swatches, sample_surfaces
from spectrabox.radiometry.records import SpectrumSamples
from spectrabox.session.stages.records import SampleRecords
from spectrabox.session.stages.stage_task import StageTask


def draw_surfaces(task: StageTask) -> SampleRecords:
    """Draws from all spectra behind each unknown surface's signal, and their summary.

    Parameters
    ----------
    task : StageTask
    """
    config, records, chosen = task.config, task.records, task.config.sampling
    families = {name: surface.families for name, surface in config.surfaces.items()}
    jointly: dict[str, SpectrumSamples] = {}
    if chosen.through == "transport":
        task.progress(0.0, "all materials at once")
        jointly = draw_through_transport(
            records.calibrations(config)[0], records.reconstruct.joint, chosen.draws,
            config.session.seed, chosen.coefficients, families)
    correction = learn_from_swatches(records.signals, [
        name for name, region in config.regions.items() if region.swatch is not None], families)
    options = DrawOptions(chosen.method, chosen.draws, chosen.coefficients, chosen.level,
                          config.session.seed)
    return SampleRecords(sample_surfaces(records.signals, options, families, task.progress,
                                         jointly, correction),
                         "" if correction is None else correction.sentence)
