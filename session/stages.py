"""The stages of a session: what each reads (its key) and what it makes. Only ``pipeline.py`` knows their order."""
from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from calibrate.calibration import calibration_from_chart, calibration_from_curves
from capture.binning import bin_image, render_size
from capture.chart_detection import chart_overlay, find_chart
from capture.image_files import write_png
from capture.patches import require_unclipped, sample_patches
from capture.preview import preview_rgb8
from radiometry.chart import PATCH_NAMES, patch_centres_uv, patch_size_uv, typical_camera_signals
from radiometry.light_scale import scale_for_photo
from radiometry.records import (
    Calibration,
    LightScale,
    LinearImage,
    PatchSamples,
    Reconstruction,
)
from radiometry.spectrum_files import spectrum_on_grid
from reconstruct.inverse_rendering import InversionSettings, reconstruct
from reconstruct.irradiance import patch_irradiance
from reconstruct.renderer import start_mitsuba
from sampling.summary import summarise
from sampling.tilted_rejection import sample_spectra
from session.error_budget import measurement_of
from session.inputs import (
    GRID,
    check_aspect,
    read_chart_reference,
    read_chart_scene,
    read_light,
    read_materials,
    read_photo,
    read_sensitivities,
    read_session_scene,
    require_exposed,
)
from session.session_file import SessionConfig

Progress = Callable[[float, str], None]
THUMBNAIL_WIDTH = 48     # pixels: the chart photo is kept only for its exposure and source


def needs_chart(config: SessionConfig) -> bool:
    """Whether anything is to come from the chart photo."""
    return config.sensitivity.from_chart or config.scale.source == "chart"


def band_names(config: SessionConfig, bands: int) -> tuple[str, ...]:
    """Names of the camera's bands."""
    if not config.sensitivity.from_chart:
        return read_sensitivities(config)[0]
    return ("R", "G", "B") if bands == 3 else tuple(f"band {index + 1}" for index in range(bands))


def find_and_sample_chart(config: SessionConfig, folder: Path, progress: Progress) -> dict[str, Any]:
    """Chart photo to patch statistics."""
    name = str(config.photos.chart)
    progress(0.1, f"decoding {name}")
    photo = read_photo(config, name)
    progress(0.5, "finding the chart")
    light = spectrum_on_grid(read_light(config), GRID)
    reference = typical_camera_signals(read_chart_reference(config), GRID, light)
    corners = None if config.chart.corners_px is None else np.array(config.chart.corners_px)
    detection = find_chart(photo, reference, corners)
    samples = sample_patches(photo, detection)
    require_unclipped(samples, PATCH_NAMES, name)
    write_png(folder / "overlay.png", chart_overlay(photo, detection))
    height, width = photo.signal.shape[:2]
    thumbnail = bin_image(photo, THUMBNAIL_WIDTH, max(round(THUMBNAIL_WIDTH * height / width), 1))
    return {"detection": detection, "samples": samples, "thumbnail": thumbnail}


def bin_object_photo(config: SessionConfig, folder: Path, progress: Progress) -> dict[str, Any]:
    """Object photo to linear signal at the render's size."""
    progress(0.1, f"decoding {config.photos.object}")
    photo = read_photo(config, config.photos.object)
    require_exposed(photo, config.photos.object)
    check_aspect(photo, read_session_scene(config), config.photos.object)
    write_png(folder / "preview.png", preview_rgb8(photo))
    height, width = photo.signal.shape[:2]
    return {"photo": bin_image(photo, *render_size(width, height, config.reconstruct.width))}


def calibrate_camera(config: SessionConfig, device: str, samples: PatchSamples | None,
                     progress: Progress) -> dict[str, Any]:
    """Patch statistics and light to sensitivities and light scale."""
    light = read_light(config)
    curves = None if config.sensitivity.from_chart else read_sensitivities(config)[1]
    if samples is None:
        assert curves is not None
        return {"calibration": calibration_from_curves(GRID, curves, light, config.sensitivity.relative_error),
                "irradiance": None, "predicted": None}
    scene = read_chart_scene(config)
    irradiance = np.full(24, np.pi)
    if scene is not None:
        progress(0.2, "irradiance on the chart")
        start_mitsuba(device)
        irradiance = patch_irradiance(scene, patch_centres_uv(), patch_size_uv(), config.session.seed)
    progress(0.6, "fitting sensitivities")
    calibration, predicted = calibration_from_chart(
        samples, read_chart_reference(config), light, irradiance, GRID, coefficients=config.sensitivity.coefficients,
        curves=curves, scaled=scene is not None)
    return {"calibration": calibration, "irradiance": irradiance, "predicted": predicted}


def invert_photo(config: SessionConfig, device: str, photo: LinearImage, calibration: Calibration,
                 chart_photo: LinearImage | None, progress: Progress) -> Reconstruction:
    """Photo, scene and calibration to spectra."""
    scene = read_session_scene(config)
    materials = read_materials(config, scene)
    scale: LightScale | None = None
    if config.scale.source == "chart":
        assert calibration.light_scale is not None and chart_photo is not None
        scale = scale_for_photo(calibration.light_scale, chart_photo, photo)
    start_mitsuba(device)
    settings = InversionSettings(config.reconstruct.coefficients, config.reconstruct.steps, config.reconstruct.spp,
                                 config.session.seed)
    return reconstruct(scene, photo, calibration, scale, materials, band_names(config, photo.signal.shape[2]),
                       settings, progress)


def sample_materials(config: SessionConfig, calibration: Calibration, reconstruction: Reconstruction,
                     progress: Progress) -> dict[str, Any]:
    """Draws from all spectra behind each unknown material's signal, and their summary."""
    records: dict[str, Any] = {}
    for index, name in enumerate(reconstruction.materials):
        if reconstruction.known[index]:
            continue
        progress(index / len(reconstruction.materials), name)
        operator = measurement_of(calibration, reconstruction, index)
        draws = sample_spectra(operator, config.sampling.draws, config.session.seed + index)
        records[f"samples {name}"] = draws
        records[f"summary {name}"] = summarise(draws, operator, reconstruction.grid, reconstruction.basis,
                                               level=config.sampling.level)
    return records
