"""The steps "signals" and "sample": signals of flat samples, and the spectra behind signals."""


from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from spectrabox.calibrate.chart_equations import PatchError
from spectrabox.capture.chart.patches import clipped_bands
from spectrabox.measure import records as step_records
from spectrabox.measure.captured import Capture, FlatCapture, View
from spectrabox.measure.extras import attempt, to_keep
from spectrabox.measure.pictures import shown_photo
from spectrabox.measure.regions import moved_lamp, white
from spectrabox.measure.regions.flat_signals import flat_signals
from spectrabox.measure.scene.draws import draw_through_transport
from spectrabox.measure.steps import photos, work
from spectrabox.measure.surfaces.surface_spectra import sample_surfaces
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.findings import Finding
from spectrabox.radiometry.records.spectra import SpectrumSamples, SpectrumSummary


def find_signals(capture: FlatCapture, records: step_records.CaptureRecords,
                 work: work.Work) -> step_records.SignalRecords:
    """What regions and charts read, and the calibrations, to signals relative to white.

    Parameters
    ----------
    capture : FlatCapture
    records : CaptureRecords
        Of charts, photos and calibration.
    work : Work

    Raises
    ------
    InputError
        If there is no region to estimate, or chart and samples were exposed differently and do not
        say how.
    CheckError
        If no band of any photo shows a region that is not known.
    """
    require_unknown_region(capture)
    photos = flat_photos(capture, records)
    errors = flat_errors(capture, records)
    known, findings = white.agreeing_known(photos, capture.known, errors)
    light: dict[str, dict[str, tuple[float, float]]] = {}
    misfits: dict[str, dict[str, float]] = {}
    light_maps: dict[str, np.ndarray] = {}
    whites = []
    for number, (view, photo) in enumerate(zip(capture.views, photos, strict=True)):
        work.progress(number / len(photos), view.photo_names[0])
        at_regions = white.white_at_regions(photo, known, errors)
        whites.append(at_regions)
        findings += _write_calibrated(view, photo, known, errors, work)
        if at_regions is not None:
            light[view.name] = dict(zip(at_regions.samples.names, zip(
                np.exp(at_regions.log_field).tolist(), at_regions.field_error.tolist(),
                strict=True), strict=True))
            misfits[view.name] = dict(at_regions.level_misfits)
            light_maps[view.name] = white.light_map(photo, known, errors)
            findings += at_regions.left_out
    signals = flat_signals(photos, whites, capture.families, capture.known,
                           capture.band_names(records.photo.bands), errors)
    return step_records.SignalRecords(
        signals, light, misfits, light_maps, (*moved_lamp.differences_of_photos(
            signals, [photo.name for photo in photos]), *findings))


def known_of_signals(capture: FlatCapture,
                     records: step_records.CaptureRecords) -> dict[str, np.ndarray]:
    """The regions of known spectrum that the signals rest on: those that contradict no photo.

    Parameters
    ----------
    capture : FlatCapture
    records : CaptureRecords
        Of the steps up to the signals.
    """
    told = {name for misfits in records.flat_signals.level_misfits.values() for name in misfits}
    return {name: spectrum for name, spectrum in capture.known.items() if name in told}


def _write_calibrated(view: View, photo: white.FlatPhoto, known: Mapping[str, np.ndarray],
                      errors: white.FlatErrors, work: work.Work) -> tuple[Finding, ...]:
    """The photo in the colours of its calibration, among the step's pictures; none of a camera of
    other than three bands.
    """
    if work.folder is None:
        return ()
    look, failed = attempt(f"picture {step_records.CALIBRATED!r}",
                           lambda: shown_photo.calibrated_look(photo, known, errors), None)
    if failed is not None:
        return (to_keep(failed),)
    if look is None:
        return ()
    image, _ = work.photos.developed(view.photo)
    return work.write_picture(view.label(step_records.CALIBRATED),
                              lambda: shown_photo.look_of_image(
                                  look, image, -(-image.signal.shape[1] // photos.PREVIEW_WIDTH)))


def require_unknown_region(capture: FlatCapture) -> None:
    """Refuse a sample of which nothing is left to estimate.

    Raises
    ------
    InputError
    """
    if not capture.regions:
        raise InputError("no region is outlined yet; outline one on the page ('spectrabox open'), "
                         "or add [regions.NAME] with rect = [x0, y0, x1, y1]")
    if all(region.known is not None for region in capture.regions.values()):
        raise InputError("every region is known, so there is nothing to find; leave out one "
                         "'known'")


def flat_photos(capture: FlatCapture,
                records: step_records.CaptureRecords) -> list[white.FlatPhoto]:
    """Every photo of the sample, with the chart photo that shows its light.

    Parameters
    ----------
    capture : FlatCapture
    records : CaptureRecords
        Of the steps up to the calibration.
    """
    layout = capture.layout
    photos = []
    for view, calibration in zip(capture.views, records.calibrations(capture.views), strict=True):
        with_chart = view if view.chart else capture.views[0]
        chart = records.charts[with_chart.name]
        photos.append(white.FlatPhoto(
            view.title, records.photo.regions.get(view.name),
            records.photo.photos[view.name], chart.thumbnail,
            with_chart.chart == view.photo, chart.detection.corners_px, layout,
            records.calibrate.whites[with_chart.name], calibration,
            view.place, bool(view.moved), clipped_bands(chart.samples, layout.neutrals)))
    return photos


def flat_errors(capture: FlatCapture, records: step_records.CaptureRecords) -> white.FlatErrors:
    """What is stated of errors, and the disagreement that the chart's patches show.

    Parameters
    ----------
    capture : FlatCapture
    records : CaptureRecords
        Of the calibration.
    """
    fit = records.calibrate.chart
    assert fit is not None and fit.patch_error is not None      # flat samples need chart and prior
    own, common = fit.patch_error
    return white.FlatErrors(capture.repeatability.relative_error, capture.stray_light.glare,
                      PatchError(float(own), float(common)),
                      bool(capture.flat_fields), capture.repeatability.plane,
                      {name: region.surface for name, region in capture.regions.items()
                       if region.surface is not None}, capture.known_errors, capture.seed,
                      capture.layout.gloss)


# ---- the step that draws: every spectrum behind each surface's signal, of any capture ------------

def draw_surfaces(capture: Capture, records: step_records.CaptureRecords,
                  work: work.Work) -> dict[str, SpectrumSummary]:
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
    return sample_surfaces(records.signals, chosen, capture.seed, families, work.progress, jointly)
