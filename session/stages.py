"""The stages of a session and what each makes of its shots; ``pipeline.py`` alone knows their order."""
from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from capture.binning import bin_image, render_size
from capture.chart_detection import chart_overlay, find_chart
from capture.chart_quality import judge_chart
from capture.image_files import write_png
from capture.patches import require_unclipped, sample_patches
from capture.preview import preview_rgb8
from radiometry.chart import PATCH_NAMES, typical_camera_signals
from radiometry.errors import InputError
from radiometry.light_scale import scale_for_photo
from radiometry.records import (
    Calibration,
    LightScale,
    LinearImage,
    SpectrumSummary,
    WavelengthGrid,
)
from radiometry.spectrum_files import spectrum_on_grid
from reconstruct.inverse_rendering import (
    InversionSettings,
    JointReconstruction,
    LearntSpectra,
    MaterialSpec,
    View,
    reconstruct_views,
)
from reconstruct.renderer import start_mitsuba
from sampling.logit_mixture import load_prior, reflectance_moments
from sampling.methods import draw_spectra
from sampling.spectral_samples import SpectralMeasurement, SpectralSamples, summarise_spectra
from session.error_budget import measurement_of
from session.inputs import (
    GRID,
    chart_corners,
    check_aspect,
    read_chart_reference,
    read_light,
    read_materials,
    read_photo,
    read_sensitivities,
    read_session_scene,
    require_exposed,
)
from session.session_schema import SessionConfig, Shot

Progress = Callable[[float, str], None]
FIRST_VIEW = "photo"
THUMBNAIL_WIDTH = 48     # pixels: the chart photo is kept only for its exposure and source


def band_names(config: SessionConfig, bands: int) -> tuple[str, ...]:
    """Names of the camera's bands.

    Raises
    ------
    InputError
        If the photo and the measured curves differ in the number of bands.
    """
    photographed = tuple(config.shots[0].photo)
    names = photographed if any(photographed) else ("R", "G", "B") if bands == 3 else \
        tuple(f"band {index + 1}" for index in range(bands))
    if config.sensitivity.from_chart:
        return names
    curves = read_sensitivities(config)[0]
    if len(curves) != bands:
        raise InputError(f"{config.sensitivity.source.file} holds {len(curves)} curves, but the photo has {bands} "
                         f"bands ({', '.join(names)}): give one curve for each, in this order")
    return names if any(photographed) else curves


def find_and_sample_charts(config: SessionConfig, folder: Path, progress: Progress) -> dict[str, Any]:
    """Chart photos to patch statistics."""
    records: dict[str, Any] = {"notes": ()}
    for index, shot in enumerate(config.chart_shots):
        progress((index + 0.1) / len(config.chart_shots), f"finding the chart in {shot.chart_files[0]}")
        found = _find_and_sample_chart(config, shot, folder)
        records["notes"] += found.pop("notes")
        records |= {shot.record(kind): value for kind, value in found.items()}
    return records


def _find_and_sample_chart(config: SessionConfig, shot: Shot, folder: Path) -> dict[str, Any]:
    name = shot.chart_files[0]
    photo, notes = read_photo(config, shot.chart)
    light = spectrum_on_grid(read_light(config, shot.light), GRID)
    reference = typical_camera_signals(read_chart_reference(config), GRID, light)
    detection = find_chart(photo, reference, chart_corners(config, shot))
    samples = sample_patches(photo, detection)
    require_unclipped(samples, PATCH_NAMES, name)
    verdict = judge_chart(photo, detection, reference, PATCH_NAMES)
    notes = (*notes, *(f"{name} should be shot again: {reason}" for reason in verdict.reasons))
    write_png(folder / f"{shot.record('overlay')}.png", chart_overlay(photo, detection))
    height, width = photo.signal.shape[:2]
    thumbnail = bin_image(photo, THUMBNAIL_WIDTH, max(round(THUMBNAIL_WIDTH * height / width), 1))
    return {"detection": detection, "samples": samples, "thumbnail": thumbnail, "notes": notes}


def bin_object_photos(config: SessionConfig, folder: Path, progress: Progress) -> dict[str, Any]:
    """Object photos to linear signal at the render's size."""
    records: dict[str, Any] = {"notes": ()}
    for index, shot in enumerate(config.shots):
        name = shot.photo_files[0]
        progress((index + 0.1) / len(config.shots), f"decoding {name}")
        photo, notes = read_photo(config, shot.photo)
        require_exposed(photo, name)
        check_aspect(photo, read_session_scene(config, shot.scene), name)
        write_png(folder / f"{shot.record('preview')}.png", preview_rgb8(photo))
        height, width = photo.signal.shape[:2]
        records[shot.record("photo")] = bin_image(photo, *render_size(width, height, config.reconstruct.width))
        records["notes"] += notes
    return records


def invert_photos(config: SessionConfig, device: str, photos: Sequence[LinearImage],
                  calibrations: Sequence[Calibration], charts: Sequence[LinearImage | None],
                  progress: Progress) -> JointReconstruction:
    """Photos, scenes and calibrations to spectra; of every shot its photo, calibration and chart under its light."""
    start_mitsuba(device)
    bands = band_names(config, photos[0].signal.shape[2])
    views: list[View] = []
    materials: dict[str, MaterialSpec] = {}
    for shot, photo, calibration, chart in zip(config.shots, photos, calibrations, charts, strict=True):
        scene = read_session_scene(config, shot.scene)
        materials |= {material.bsdf: material for material in read_materials(config, scene)}
        views.append(View(shot.name or FIRST_VIEW, scene, photo, calibration, bands,
                          _scale_of(config, photo, calibration, chart),
                          {light: read_light(config, spectrum) for light, spectrum in shot.lights_by_id.items()}))
    chosen = config.reconstruct
    settings = InversionSettings(**{name: value for name, value in vars(chosen).items() if name != "width"},
                                 seed=config.session.seed, learnt=_learnt_spectra(chosen.spectrum_prior))
    return reconstruct_views(views, tuple(materials.values()), settings, progress)


def _learnt_spectra(spectrum_prior: str) -> LearntSpectra | None:
    prior = load_prior() if spectrum_prior == "learnt" else None
    return None if prior is None else LearntSpectra(np.asarray(prior.nm), *reflectance_moments(prior))


def _scale_of(config: SessionConfig, photo: LinearImage, calibration: Calibration,
              chart: LinearImage | None) -> LightScale | None:
    """Light scale of a photo from the chart under its light; None leaves it to the materials."""
    if chart is None or calibration.light_scale is None or config.scale.source != "chart":
        return None
    return scale_for_photo(calibration.light_scale, chart, photo)


def sample_materials(config: SessionConfig, calibrations: Sequence[Calibration], joint: JointReconstruction,
                     progress: Progress) -> dict[str, Any]:
    """Draws from all spectra behind each unknown material's signal, and their summary."""
    records: dict[str, Any] = {}
    for index, name in enumerate(joint.materials):
        if joint.known[index]:
            continue
        progress(index / len(joint.materials), name)
        measurement = measurement_of(calibrations, joint, index)
        draws = draw_spectra(measurement, config.sampling.method, config.sampling.draws, config.session.seed + index,
                             config.sampling.coefficients)
        records[f"samples {name}"] = draws
        records[f"summary {name}"] = on_finer_grid(summarise_spectra(
            draws, measurement, config.sampling.level, conditions(draws, measurement)), joint.grid)
    return records


def conditions(draws: SpectralSamples, measurement: SpectralMeasurement) -> str:
    """What the band rests on, in words."""
    errors = ", ".join(f"{100 * error:.2g}" for error in np.sqrt(np.diag(measurement.noise_covariance)))
    return (f"Conditional on Gaussian errors of the signal of {errors} % of white, on the sampler and its prior "
            f"({draws.method}), and, for the exact bounds, on splines of {draws.coefficients.shape[1]} coefficients "
            f"between 0 and 1. {draws.outcome}")


def on_finer_grid(summary: SpectrumSummary, grid: WavelengthGrid) -> SpectrumSummary:
    """The same summary on another grid, by straight lines between its wavelengths."""
    curves = ("mean", "standard_deviation", "lower", "upper", "bound_lower", "bound_upper")
    return dataclasses.replace(summary, grid=grid, **{
        name: np.interp(grid.nm, summary.grid.nm, getattr(summary, name)) for name in curves})
