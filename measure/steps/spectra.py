"""The step that draws: every spectrum behind each surface's signal, of any capture."""
from __future__ import annotations

from spectrabox.measure.captured import Capture
from spectrabox.measure.records import CaptureRecords, SampleRecords
from spectrabox.measure.scene.draws import draw_through_transport
from spectrabox.measure.steps.work import Work
from spectrabox.measure.surfaces.surface_spectra import DrawOptions, sample_surfaces
from spectrabox.radiometry.records.spectra import SpectrumSamples


def draw_surfaces(capture: Capture, records: CaptureRecords, work: Work) -> SampleRecords:
    """Draws from all spectra behind each unknown surface's signal, and their summary.

    Parameters
    ----------
    capture : Capture
    records : CaptureRecords
        Of the steps up to signals or inversion.
    work : Work
    """
    chosen, families = capture.sampling, capture.families
    jointly: dict[str, SpectrumSamples] = {}
    if chosen.through == "transport":
        work.progress(0.0, "all materials at once")
        jointly = draw_through_transport(
            records.calibrations(capture.views)[0], records.reconstruct.joint, chosen.draws,
            capture.seed, chosen.coefficients, families)
    options = DrawOptions(chosen.method, chosen.draws, chosen.coefficients, chosen.level,
                          capture.seed)
    return SampleRecords(sample_surfaces(records.signals, options, families, work.progress,
                                         jointly))
