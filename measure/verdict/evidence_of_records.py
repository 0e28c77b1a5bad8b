"""Records of a measurement to what it found: the evidence of its verdict, and its warnings."""
from __future__ import annotations

from typing import Any

import numpy as np

from spectrabox.capture.develop.developed import NOT_LINEAR
from spectrabox.measure.captured import Capture, FlatCapture, SceneCapture, View
from spectrabox.measure.records import CaptureRecords
from spectrabox.measure.scene.rehearsed import Rehearsed
from spectrabox.measure.surfaces.surface_signals import noise_and_disagreement, relative_errors
from spectrabox.measure.surfaces.surface_spectra import score
from spectrabox.measure.verdict.calibration import doubt_sentences, root_mean_square
from spectrabox.measure.verdict.evidence import (
    VALID_OUTCOMES,
    ChartResult,
    FlatEvidence,
    MaterialResult,
    PhotoOfRegions,
    SceneEvidence,
    ViewResult,
)
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.records import (
    Calibration,
    JointReconstruction,
    RegionSamples,
    Spectrum,
    SurfaceSignals,
    SurfaceSpectrum,
)
from spectrabox.radiometry.spectra.spectrum_files import spectrum_on_grid
from spectrabox.sampling.prior.family_coverage import FamilyCoverage, family_coverages
from spectrabox.sampling.prior.mixture import load_prior, of_families

CHART_WARNING, SURFACE_WARNING = 0.03, 0.05


def flat_evidence(capture: FlatCapture, records: CaptureRecords) -> FlatEvidence:
    """What was found of flat samples.

    Parameters
    ----------
    capture : FlatCapture
    records : CaptureRecords
        Of all steps.
    """
    return FlatEvidence(**_common_evidence(capture, records),
                        photos=[_photo_of_regions(capture, records, view)
                                for view in capture.views])


def scene_evidence(capture: SceneCapture, records: CaptureRecords,
                   rehearsal: Rehearsed | None = None) -> SceneEvidence:
    """What was found of a scene.

    Parameters
    ----------
    capture : SceneCapture
    records : CaptureRecords
        Of all steps.
    rehearsal : Rehearsed, optional
        Of these results.
    """
    joint, bands = records.reconstruct.joint, capture.band_names(records.photo.bands)
    views = [ViewResult(view.name, bands, calibration, reconstruction)
             for view, calibration, reconstruction
             in zip(capture.views, records.calibrations(capture.views), joint.views, strict=True)
             if view.name]
    return SceneEvidence(**_common_evidence(capture, records), reconstruction=joint.views[0],
                         views=views, rehearsal=rehearsal)


def _common_evidence(capture: Capture, records: CaptureRecords) -> dict[str, Any]:
    """What is known of captures of both kinds, by the fields of their evidence."""
    signals, spectra = records.signals, [None] * len(records.signals.names) if capture.flat \
        else records.reconstruct.joint.spectra
    materials = [_surface_result(capture, records, index, spectra[index])
                 for index in (signals.names.index(name) for name in capture.surfaces
                               if name in signals.names)]
    return {"bands": capture.band_names(records.photo.bands),
            "chart": _chart_result(capture, records),
            "calibration": records.calibrations(capture.views)[0],
            "other_calibrations": other_calibrations(records),
            "photo": records.photo.photos[""], "materials": materials,
            "surfaces_stated": capture.surfaces_stated,
            "with_picture": capture.picture is not None,
            "processed": NOT_LINEAR in records.notes}


def other_calibrations(records: CaptureRecords) -> dict[str, Calibration]:
    """Calibrations of further photos whose charts are a fit of their own, by view."""
    return {name: records.calibrate.calibrations[name] for name in records.calibrate.other_charts}


def warnings_of(capture: Capture, records: CaptureRecords,
                materials: list[MaterialResult]) -> list[str]:
    """What to beware of, in sentences.

    Parameters
    ----------
    capture : Capture
    records : CaptureRecords
        Of all steps.
    materials : list of MaterialResult
        As of the evidence.
    """
    first = records.calibrations(capture.views)[0]
    doubts = [sentence for where, calibration in {"": first, **other_calibrations(records)}.items()
              for sentence in doubt_sentences(calibration, where)]
    of_scene = _scene_warnings(capture, first, records.reconstruct.joint) \
        if isinstance(capture, SceneCapture) else []
    return records.notes + doubts + of_scene + [
        f"{material.name}: {material.samples.sentence}" for material in materials
        if material.doubtful and material.samples is not None]


def surface_result(signals: SurfaceSignals, index: int, spectrum: SurfaceSpectrum | None,
                   truth: Spectrum | None = None, inverse_rendering: np.ndarray | None = None,
                   families: tuple[FamilyCoverage, ...] = ()) -> MaterialResult:
    """What the report shows of one surface.

    Parameters
    ----------
    signals : SurfaceSignals
    index : int
        Of the surface.
    spectrum : SurfaceSpectrum or None
        None where the spectrum was given.
    truth : Spectrum, optional
        Measured, to compare with.
    inverse_rendering : (P,) array, optional
        The one spectrum of inverse rendering.
    families : tuple of FamilyCoverage
        That the surface may be of.
    """
    name, signal = signals.names[index], signals.signal[index]
    noise, disagreement = noise_and_disagreement(signals, index)
    if spectrum is None:
        return MaterialResult(name, signals.spectra[index], signal, noise, disagreement, None, None,
                              {}, truth, None)
    scores = None if truth is None else score(spectrum_on_grid(truth, FINE_GRID), inverse_rendering,
                                              spectrum.summary, spectrum.samples)
    return MaterialResult(name, inverse_rendering, signal, noise, disagreement, spectrum.summary,
                          spectrum.samples, relative_errors(signals, index), truth, scores,
                          spectrum.variance_shares, families)


def _surface_result(capture: Capture, records: CaptureRecords, index: int,
                    inverse_rendering: np.ndarray | None) -> MaterialResult:
    signals = records.signals
    name = signals.names[index]
    section = capture.surfaces[name]
    if signals.known[index]:
        return surface_result(signals, index, None, section.truth)
    spectrum = records.sample.spectra[name]
    families: tuple[FamilyCoverage, ...] = ()
    if spectrum.family_shares and spectrum.samples.outcome in VALID_OUTCOMES:
        prior = of_families(load_prior(), section.families)
        families = family_coverages(spectrum.family_shares, prior.stated, prior.certificates)
    return surface_result(signals, index, spectrum, section.truth, inverse_rendering, families)


def _chart_result(capture: Capture, records: CaptureRecords) -> ChartResult | None:
    fit, chart = records.calibrate.chart, records.chart.charts.get("")
    if fit is None or chart is None:
        return None
    return ChartResult(chart.detection, chart.samples, fit.predicted,
                       fit.irradiance / np.fmax.reduce(fit.irradiance), capture.layout,
                       fit.left_out, fit.prior, records.calibrate.other_charts)


def _photo_of_regions(capture: FlatCapture, records: CaptureRecords,
                      view: View) -> PhotoOfRegions:
    photo, chart = records.photo.photos[view.name], records.chart.charts.get(view.name)
    height, width = photo.signal.shape[:2]
    shown, light = capture.regions_in(view), records.flat.light.get(view.name)
    known = [name for name, section in shown.items() if section.known is not None]
    samples = records.photo.regions.get(view.name)
    fit, registration = records.calibrate.chart, records.photo.registrations.get(view.name)
    held = records.calibrate.other_charts.get(view.name) if view.name else (
        None if fit is None else fit.left_out)
    return PhotoOfRegions(
        view.title,
        {} if light is None else {
            name: (level, error) for name, level, error
            in zip(shown, light.level.tolist(), light.error.tolist(), strict=True)},
        {} if light is None else dict(zip(known, light.level_misfits.tolist(), strict=True)),
        {} if samples is None else dict(zip(samples.names, samples.scatter.max(axis=1).tolist(),
                                            strict=True)),
        view.name,
        (round(width * photo.sensor_step), round(height * photo.sensor_step)),
        {name: np.array(region.outline) for name, region in shown.items()},
        None if chart is None or not view.shows_chart else chart.detection.corners_px,
        None if light is None else light.over_photo,
        _lamp_words(view), None if registration is None else registration.shift_px,
        None if registration is None else registration.residual_px,
        _silent_bands(records.signals, capture.views.index(view), samples),
        None if held is None else held.means[1])


def _lamp_words(view: View) -> str:
    """What lights a photo."""
    lamp = view.light_words if view.lamp == view.title else f"the lamp of {view.lamp!r}"
    if view.filter is None:
        return f"light: {lamp}"
    return f"light: {lamp} through {view.filter_words}"


def _silent_bands(signals: SurfaceSignals, number: int,
                  samples: RegionSamples | None) -> tuple[str, ...]:
    """Bands of a photo, by its number, that say nothing of any region that it shows."""
    rows = [] if samples is None else [signals.names.index(name) for name in samples.names]
    return tuple(band for index, band in enumerate(signals.bands)
                 if rows and signals.view_of_band[index] == number
                 and np.isnan(signals.signal[rows, index]).all())


def _scene_warnings(capture: SceneCapture, calibration: Calibration,
                    joint: JointReconstruction) -> list[str]:
    """What to beware of in the reconstruction of a scene."""
    found = []
    misfits = [(name, misfit) for name, view in zip(joint.names, joint.views, strict=True)
               for misfit in view.misfits]
    if misfits and capture.picture is not None:
        found.append("One spectrum each does not fit "
                     f"{', '.join(dict.fromkeys(misfit.surface for _, misfit in misfits))}: it "
                     "cannot where there are patterns, of which the picture has every pixel's; "
                     "elsewhere check light, position and paint.")
    else:
        found += [misfit.sentence if len(joint.views) == 1 else
                  f"In the photo “{name}” {misfit.sentence}" for name, misfit in misfits]
    rms = root_mean_square(calibration.sensitivity.residuals)
    if rms is not None and rms > CHART_WARNING:
        found.append(f"The chart's patches disagree with the fitted camera by {rms:.1%} rms: look "
                     "for glare, uneven light or another chart.")
    agreement, named = joint.views[0].agreement, {misfit.surface for _, misfit in misfits}
    for index, name in enumerate(agreement.names):
        off = agreement.ratio[index] - 1
        if np.abs(off).max() > SURFACE_WARNING and name not in named:
            found.append(f"Photo and rendering disagree on {name} by "
                         f"{off[np.argmax(np.abs(off))]:+.0%} in the worst band: geometry, light "
                         "or material of this surface is not as the scene says.")
    if not capture.development.flat_fields:
        found.append("No flat-field photo: vignetting is not corrected and counts as reflectance.")
    if not capture.scale_from_chart or calibration.light_scale is None:
        found.append("The light scale rests on the spectrum given for a known material.")
    if calibration.sensitivity.basis is None and calibration.sensitivity.residuals is None:
        found.append("The sensitivities were taken from a file and not checked against a chart "
                     "photo.")
    return found
