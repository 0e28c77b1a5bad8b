"""Stored results of a finished run to what the report shows."""
from __future__ import annotations

from typing import Any

import numpy as np

from spectrabox.capture.develop.developed import NOT_LINEAR
from spectrabox.measure.surface_signals import noise_and_disagreement, relative_errors
from spectrabox.measure.surface_spectra import score
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.records import (
    Calibration,
    JointReconstruction,
    RegionSamples,
    Spectrum,
    SurfaceSignals,
    SurfaceSpectrum,
)
from spectrabox.radiometry.spectra.spectrum_files import on_grid, read_curves, spectrum_on_grid
from spectrabox.sampling.prior.family_coverage import FamilyCoverage, family_coverages
from spectrabox.sampling.prior.mixture import load_prior, of_families
from spectrabox.session.config.session_chart import session_chart
from spectrabox.session.config.session_schema import SessionConfig, ViewInputs
from spectrabox.session.outputs.results import (
    VALID_OUTCOMES,
    ChartResult,
    CommonResults,
    FlatResults,
    MaterialResult,
    PhotoOfRegions,
    SceneResults,
    SessionResults,
    ViewResult,
)
from spectrabox.session.pictures.picture_results import picture_of
from spectrabox.session.pipeline import FinishedRun
from spectrabox.session.report.verdict import doubt_sentences, root_mean_square
from spectrabox.session.stages.inputs import band_names, read_reflectance
from spectrabox.session.stages.records import SessionRecords
from spectrabox.session.store.rehearsals import stored_rehearsal

CHART_WARNING, SURFACE_WARNING = 0.03, 0.05


def assemble(config: SessionConfig, run: FinishedRun,
             provenance: dict[str, Any]) -> SessionResults:
    """Everything the report shows.

    Parameters
    ----------
    config : SessionConfig
    run : FinishedRun
    provenance : dict
        As of ``store.program.provenance``.
    """
    records, signals = run.records, run.records.signals
    calibrations, photo = records.calibrations(config), records.photo.photos[""]
    others = {name: records.calibrate.calibrations[name] for name in records.calibrate.other_charts}
    joint = None if config.flat else records.reconstruct.joint
    bands = band_names(config, records.photo.bands)
    indices = [signals.names.index(name) for name in config.surfaces if name in signals.names]
    materials = [_surface_result(config, records, index,
                                 None if joint is None else joint.spectra[index])
                 for index in indices]
    folder = config.results_folder
    doubts = [sentence for where, calibration in {"": calibrations[0], **others}.items()
              for sentence in doubt_sentences(calibration, where)]
    warnings = records.notes + doubts + _scene_warnings(config, calibrations[0], joint) + [
        f"{material.name}: {material.samples.sentence}" for material in materials
        if material.doubtful and material.samples is not None]
    common = CommonResults(
        folder=config.folder, name=config.session.name, operator=config.session.operator,
        notes=config.session.notes, bands=bands, grid=signals.grid,
        inputs=_input_files(config, run), chart=_chart_result(config, records),
        calibration=calibrations[0], other_calibrations=others,
        sensitivity_truth=_sensitivity_truth(config), photo=photo,
        previews={view.name: folder / "photo" / f"{view.label('preview')}.png"
                  for view in config.all_views},
        chart_overlay=folder / "chart" / "overlay.png",
        materials=materials, signal_bands=signals.bands if config.flat or config.views else bands,
        provenance=provenance, input_digests=run.input_digests(config), warnings=warnings,
        stages=[{"name": name, "seconds": stage.seconds, "state": run.states[name]}
                for name, stage in run.stored.items()],
        surfaces_stated=all(surface.surface is not None or surface.measured is not None
                            for surface in config.surfaces.values()),
        picture=picture_of(config, records.picture), swatches=records.sample.swatches,
        processed=NOT_LINEAR in records.notes)
    if joint is None:
        return FlatResults(
            **vars(common), photos=[_photo_of_regions(config, records, view)
                                    for view in config.all_views])
    geometry = records.reconstruct.geometry
    views = [ViewResult(view.name, bands, calibration, reconstruction)
             for view, calibration, reconstruction
             in zip(config.all_views, calibrations, joint.views, strict=True) if view.name]
    return SceneResults(**vars(common), reconstruction=joint.views[0], views=views,
                        rehearsal=stored_rehearsal(config),
                        geometry=geometry if geometry.placements else None)


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


def _surface_result(config: SessionConfig, records: SessionRecords, index: int,
                    inverse_rendering: np.ndarray | None) -> MaterialResult:
    signals = records.signals
    name = signals.names[index]
    section = config.surfaces[name]
    truth = None if section.truth is None else read_reflectance(config, section.truth)
    if signals.known[index]:
        return surface_result(signals, index, None, truth)
    spectrum = records.sample.spectra[name]
    families: tuple[FamilyCoverage, ...] = ()
    if spectrum.family_shares and spectrum.samples.outcome in VALID_OUTCOMES:
        prior = of_families(load_prior(), section.families)
        families = family_coverages(spectrum.family_shares, prior.stated, prior.certificates)
    return surface_result(signals, index, spectrum, truth, inverse_rendering, families)


def _chart_result(config: SessionConfig, records: SessionRecords) -> ChartResult | None:
    fit = records.calibrate.chart
    if fit is None:
        return None
    chart = records.chart.charts[""]
    return ChartResult(chart.detection, chart.samples, fit.predicted,
                       fit.irradiance / np.fmax.reduce(fit.irradiance), session_chart(config),
                       fit.left_out, fit.prior, records.calibrate.other_charts)


def _photo_of_regions(config: SessionConfig, records: SessionRecords,
                      view: ViewInputs) -> PhotoOfRegions:
    photo, chart = records.photo.photos[view.name], records.chart.charts.get(view.name)
    height, width = photo.signal.shape[:2]
    shown, light = config.regions_in(view), records.flat.light.get(view.name)
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
        config.results_folder / "photo" / f"{view.label('preview')}.png",
        (round(width * photo.sensor_step), round(height * photo.sensor_step)),
        {name: np.array(region.outline()) for name, region in shown.items()},
        None if chart is None or view.chart_files != view.photo_files
        else chart.detection.corners_px, None if light is None else light.over_photo,
        _lamp_words(view), None if registration is None else registration.shift_px,
        None if registration is None else registration.residual_px,
        _silent_bands(records.signals, config.all_views.index(view), samples),
        None if held is None else held.means[1])


def _lamp_words(view: ViewInputs) -> str:
    """What lights a photo."""
    light = view.light.file or view.light.word or f"unknown light of {view.light.cct:g} K"
    lamp = light if view.lamp == view.title else f"the lamp of {view.lamp!r}"
    if view.filter is None:
        return f"light: {lamp}"
    return f"light: {lamp} through {view.filter.file or 'an unknown filter'}"


def _silent_bands(signals: SurfaceSignals, number: int,
                  samples: RegionSamples | None) -> tuple[str, ...]:
    """Bands of a photo, by its number, that say nothing of any region that it shows."""
    rows = [] if samples is None else [signals.names.index(name) for name in samples.names]
    return tuple(band for index, band in enumerate(signals.bands)
                 if rows and signals.view_of_band[index] == number
                 and np.isnan(signals.signal[rows, index]).all())


def _sensitivity_truth(config: SessionConfig) -> tuple[np.ndarray, np.ndarray] | None:
    truth = config.sensitivity.truth
    if truth is None or not config.light.spectrum.stated:   # products are no sensitivities
        return None
    nm, _, curves = read_curves(config.path(truth.file), truth.columns, truth.wavelength_column)
    values = on_grid(nm, curves, FINE_GRID, truth.file)
    return FINE_GRID.nm, values / values.max()


def _input_files(config: SessionConfig, run: FinishedRun) -> list[dict[str, Any]]:
    """Every input file once, with its role, hash, size and what is known of it."""
    roles: dict[str, str] = {}
    for view in config.all_views:
        for role, names in (("object photo", view.photo_files),
                            ("light spectrum", view.light_files),
                            ("scene", [view.scene] if view.scene else []),
                            ("chart photo", view.chart_files)):
            for name in names:
                roles.setdefault(name, f"{role}, {view.name}" if view.name else role)
    for role, others in (("dark frame", config.photos.dark_files),
                         ("flat-field photo", config.photos.flats.values()),
                         ("chart scene",
                          [name for name in [config.chart.scene] if name is not None])):
        for name in others:
            roles.setdefault(name, role)
    if not config.sensitivity.from_chart and config.sensitivity.source.file is not None:
        roles.setdefault(config.sensitivity.source.file, "sensitivities")
    for material, section in config.surfaces.items():
        if section.measured is not None:
            roles.setdefault(section.measured.file, f"known spectrum of {material}")
    hashes = {name: digest for stage in run.stored.values() for name,
              digest in stage.key.get("files", {}).items()}
    charts, photos = run.records.chart.charts, run.records.photo.photos
    facts = {view.photo_files[0]: photos[view.name] for view in config.all_views}
    facts |= {view.chart_files[0]: charts[view.name].thumbnail for view in config.views_with_chart}
    return [{"role": role, "file": name, "sha256": hashes[name],
             "bytes": config.path(name).stat().st_size}
            | ({} if (image := facts.get(name)) is None else
               {"exposure_s": image.exposure_s, "iso": image.iso, "f_number": image.f_number,
                "camera": image.camera, "kind": image.kind.value,
                "clipped": float(image.saturated.any(axis=2).mean())})
            for name, role in roles.items() if name in hashes]


def _scene_warnings(config: SessionConfig, calibration: Calibration,
                    joint: JointReconstruction | None) -> list[str]:
    """What to beware of in the reconstruction of a scene; nothing of flat samples."""
    if joint is None:
        return []
    found = []
    misfits = [(name, misfit) for name, view in zip(joint.names, joint.views, strict=True)
               for misfit in view.misfits]
    if misfits and config.picture is not None:
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
    if config.photos.flat is None:
        found.append("No flat-field photo: vignetting is not corrected and counts as reflectance.")
    if config.scale.source == "material" or calibration.light_scale is None:
        found.append("The light scale rests on the spectrum given for a known material.")
    if calibration.sensitivity.basis is None and calibration.sensitivity.residuals is None:
        found.append("The sensitivities were taken from a file and not checked against a chart "
                     "photo.")
    return found
