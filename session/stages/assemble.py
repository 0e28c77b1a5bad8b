"""Stored results of a finished run to what the report shows."""
from __future__ import annotations

from typing import Any

import numpy as np

from spectrabox.measure.surface_signals import relative_errors
from spectrabox.measure.surface_spectra import score
from spectrabox.radiometry.error_model import DISAGREEMENT, PHOTO_NOISE, RENDERING_NOISE
from spectrabox.radiometry.records import Calibration, JointReconstruction, SurfaceSignals
from spectrabox.radiometry.spectra.spectrum_files import on_grid, read_curves, spectrum_on_grid
from spectrabox.sampling.prior.family_coverage import FamilyCoverage, family_coverages
from spectrabox.sampling.prior.mixture import load_prior, of_families
from spectrabox.session.config.session_chart import session_chart
from spectrabox.session.config.session_schema import SessionConfig
from spectrabox.session.pictures.picture_results import picture_of
from spectrabox.session.pipeline import FinishedRun
from spectrabox.session.stages.inputs import GRID, band_names, read_reflectance
from spectrabox.session.stages.stored_records import (
    calibrations_of,
    chart_fit_of,
    chart_of,
    geometry_of,
    joint_of,
    left_out_of,
    notes_of,
    photo_of,
    prior_influence_of,
    signals_of,
    spectrum_of,
)
from spectrabox.session.store.rehearsals import stored_rehearsal
from spectrabox.session.store.results import (
    VALID_OUTCOMES,
    ChartResult,
    MaterialResult,
    SessionResults,
    ViewResult,
)

CHART_WARNING, SURFACE_WARNING = 0.03, 0.05


def assemble(config: SessionConfig, run: FinishedRun, provenance: dict[str, Any]) -> SessionResults:
    """Everything the report shows."""
    stored = run.stored
    calibrations, joint = calibrations_of(config, stored), joint_of(stored)
    calibration, reconstruction = calibrations[0], joint.views[0]
    photo, signals = photo_of(stored), signals_of(stored)
    bands = band_names(config, photo.signal.shape[2])
    indices = [joint.materials.index(name) for name in config.materials if name in joint.materials]
    materials = [surface_result(config, signals, run, index, joint.spectra[index])
                 for index in indices]
    previews = config.results_folder / "photo"
    views = [ViewResult(view.name, bands, calibrations[number],
                        previews / f"{view.record('preview')}.png", joint.views[number])
             for number, view in enumerate(config.all_views) if view.name]
    return SessionResults(
        folder=config.folder, name=config.session.name, operator=config.session.operator,
        notes=config.session.notes, bands=bands, inputs=input_files(config, run),
        chart=chart_result(config, run),
        calibration=calibration, sensitivity_truth=sensitivity_truth(config),
        light_scale=reconstruction.light_scale, photo=photo, photo_preview=previews / "preview.png",
        reconstruction=reconstruction,
        materials=materials, views=views, signal_bands=joint.bands if views else bands,
        provenance=provenance, input_digests=run.input_digests(config),
        warnings=notes_of(stored) + _warnings(config, calibration, joint)
        + doubtful_materials(materials),
        stages=[{"name": name, "seconds": stage.seconds, "state": run.states[name]} for name,
                stage in stored.items()], rehearsal=stored_rehearsal(config),
        geometry=geometry_of(stored), picture=picture_of(config, stored))


def surface_result(config: SessionConfig, signals: SurfaceSignals, run: FinishedRun, index: int,
                   inverse_rendering: np.ndarray | None) -> MaterialResult:
    """What the report shows of one surface.

    Parameters
    ----------
    signals : SurfaceSignals
    index : int
        Of the surface.
    inverse_rendering : (P,) array or None
        The one spectrum of inverse rendering, where there is one.
    """
    name, signal = signals.names[index], signals.signal[index]
    section = config.surfaces[name]
    truth = None if section.truth is None else read_reflectance(config, section.truth)
    by_cause = {error.cause: error.covariance[index] for error in signals.errors}
    noise = by_cause[PHOTO_NOISE if PHOTO_NOISE in by_cause else RENDERING_NOISE]
    with np.errstate(invalid="ignore"):
        disagreement = by_cause[DISAGREEMENT] / np.outer(signal, signal)
    if signals.known[index]:
        return MaterialResult(name, signals.spectra[index], signal, noise, disagreement, None, None,
                              {}, truth, None)
    spectrum = spectrum_of(run.stored, name)
    scores = None if truth is None else score(spectrum_on_grid(truth, GRID), inverse_rendering,
                                              spectrum.summary, spectrum.samples)
    families: tuple[FamilyCoverage, ...] = ()
    if spectrum.family_shares and spectrum.samples.outcome in VALID_OUTCOMES:
        prior = of_families(load_prior(), section.families)
        families = family_coverages(spectrum.family_shares, prior.stated, prior.certificates)
    return MaterialResult(name, inverse_rendering, signal, noise, disagreement, spectrum.summary,
                          spectrum.samples, relative_errors(signals, index), truth, scores,
                          spectrum.variance_shares, families)


def chart_result(config: SessionConfig, run: FinishedRun) -> ChartResult | None:
    chart = chart_of(run.stored)
    if chart is None:
        return None
    predicted, irradiance = chart_fit_of(run.stored)
    return ChartResult(chart[0], chart[1], predicted,
                       irradiance / np.fmax.reduce(irradiance),
                       config.results_folder / "chart" / "overlay.png", session_chart(config),
                       left_out_of(run.stored), prior_influence_of(run.stored))


def sensitivity_truth(config: SessionConfig) -> tuple[np.ndarray, np.ndarray] | None:
    truth = config.sensitivity.truth
    if truth is None or not config.light.spectrum.stated:   # products are no sensitivities
        return None
    nm, _, curves = read_curves(config.path(truth.file), truth.columns, truth.wavelength_column)
    values = on_grid(nm, curves, GRID, truth.file)
    return GRID.nm, values / values.max()


def input_files(config: SessionConfig, run: FinishedRun) -> list[dict[str, Any]]:
    """Every input file once, with its role, hash, size and what is known of it."""
    roles: dict[str, str] = {}
    for view in config.all_views:
        for role, names in (("object photo", view.photo_files),
                            ("light spectrum", [name for light in view.all_lights
                                                for name in light.files]),
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
        if section.known is not None:
            roles.setdefault(section.known.file, f"known spectrum of {material}")
    hashes = {name: digest for stage in run.stored.values() for name,
              digest in stage.key.get("files", {}).items()}
    facts = {view.photo_files[0]: photo_of(run.stored, view) for view in config.all_views}
    facts |= {view.chart_files[0]: chart[2] for view in config.views_with_chart
              if (chart := chart_of(run.stored, view)) is not None}
    return [{"role": role, "file": name, "sha256": hashes[name],
             "bytes": config.path(name).stat().st_size}
            | ({} if (image := facts.get(name)) is None else
               {"exposure_s": image.exposure_s, "iso": image.iso, "f_number": image.f_number,
                "camera": image.camera, "kind": image.kind.value,
                "clipped": float(image.saturated.any(axis=2).mean())})
            for name, role in roles.items() if name in hashes]


def doubtful_materials(materials: list[MaterialResult]) -> list[str]:
    """Materials whose draws have a reservation: a signal unlike all that the prior knows, say."""
    return [f"{material.name}: {material.samples.sentence}" for material in materials
            if material.doubtful and material.samples is not None]


def _warnings(config: SessionConfig, calibration: Calibration,
              joint: JointReconstruction) -> list[str]:
    found = [f"Calibration: {doubt.value}." for doubt in calibration.doubts]
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
    residuals = calibration.sensitivity.residuals
    if residuals is not None and (rms := float(np.sqrt(np.mean(residuals**2)))) > CHART_WARNING:
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
