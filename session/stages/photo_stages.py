"""The stages that decode photos: charts to patch statistics, object photos to the render's size."""
from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.calibrate.geometry.lens_files import read_lens
from spectrabox.calibrate.geometry.projection import undistorted
from spectrabox.capture.chart.detection import chart_overlay, find_chart
from spectrabox.capture.chart.patches import require_unclipped, sample_patches
from spectrabox.capture.chart.quality import judge_chart
from spectrabox.capture.chart.reference_region import region_signals
from spectrabox.capture.photo.binning import bin_image, render_size
from spectrabox.capture.photo.image_files import write_png
from spectrabox.capture.photo.preview import preview_rgb8
from spectrabox.radiometry.chart import PATCH_NAMES, typical_camera_signals
from spectrabox.radiometry.spectra.spectrum_files import spectrum_on_grid
from spectrabox.session.config.session_schema import SessionConfig, Shot
from spectrabox.session.stages.inputs import (
    GRID,
    chart_corners,
    check_aspect,
    read_chart_reference,
    read_light,
    read_photo,
    read_session_scene,
    require_exposed,
)

Progress = Callable[[float, str], None]
THUMBNAIL_WIDTH = 48     # pixels: a chart photo is kept only for its exposure and source


def find_and_sample_charts(config: SessionConfig, folder: Path,
                           progress: Progress) -> dict[str, Any]:
    """Chart photos to patch statistics."""
    records: dict[str, Any] = {"notes": ()}
    for index, shot in enumerate(config.chart_shots):
        progress((index + 0.1) / len(config.chart_shots),
                 f"finding the chart in {shot.chart_files[0]}")
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
    found = {"detection": detection, "samples": samples, "thumbnail": thumbnail, "notes": notes}
    if config.drift.chart_px and not shot.name:
        found["references"] = region_signals(photo, np.array(config.drift.chart_px))
    return found


def bin_object_photos(config: SessionConfig, folder: Path, progress: Progress) -> dict[str, Any]:
    """Object photos to linear signal at the render's size."""
    records: dict[str, Any] = {"notes": ()}
    for index, shot in enumerate(config.shots):
        name = shot.photo_files[0]
        progress((index + 0.1) / len(config.shots), f"decoding {name}")
        photo, notes = read_photo(config, shot.photo)
        require_exposed(photo, name)
        if config.drift.object_px and not shot.name:
            records["references"] = region_signals(photo, np.array(config.drift.object_px))
        if config.camera.lens is not None:
            photo = undistorted(photo, read_lens(config.path(config.camera.lens)))
        check_aspect(photo, read_session_scene(config, shot.scene), name)
        write_png(folder / f"{shot.record('preview')}.png", preview_rgb8(photo))
        height, width = photo.signal.shape[:2]
        records[shot.record("photo")] = bin_image(photo,
                                                  *render_size(width, height,
                                                               config.reconstruct.width))
        records["notes"] += notes
    return records
