"""The stages that decode photos: charts to patch statistics, object photos to the render's size."""
from __future__ import annotations

from collections.abc import Mapping
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
from spectrabox.session.config.session_schema import SessionConfig, ViewInputs
from spectrabox.session.stages.inputs import (
    GRID,
    chart_corners,
    check_aspect,
    read_chart_reference,
    read_light,
    read_photo,
    require_exposed,
)
from spectrabox.session.stages.scenes import read_session_scene
from spectrabox.session.stages.stage_task import StageTask
from spectrabox.session.store.store import StoredStage

THUMBNAIL_WIDTH = 48     # pixels: a chart photo is kept only for its exposure and source


def find_and_sample_charts(task: StageTask) -> dict[str, Any]:
    """Chart photos to patch statistics.

    Returns
    -------
    dict
        "notes", and of every view with a chart its "detection", "samples" and "thumbnail"; of the
        first also the signals of the "references" where the session names some.

    Raises
    ------
    CheckError
        If a chart is not found, or a patch is clipped.
    """
    config = task.config
    records: dict[str, Any] = {"notes": ()}
    for index, view in enumerate(config.views_with_chart):
        task.progress((index + 0.1) / len(config.views_with_chart),
                      f"finding the chart in {view.chart_files[0]}")
        found = _find_and_sample_chart(config, view, task.folder)
        records["notes"] += found.pop("notes")
        records |= {view.record(kind): value for kind, value in found.items()}
    return records


def _find_and_sample_chart(config: SessionConfig, view: ViewInputs, folder: Path) -> dict[str, Any]:
    name = view.chart_files[0]
    photo, notes = read_photo(config, view.chart)
    light = spectrum_on_grid(read_light(config, view.light), GRID)
    reference = typical_camera_signals(read_chart_reference(config), GRID, light)
    detection = find_chart(photo, reference, chart_corners(config, view))
    samples = sample_patches(photo, detection)
    require_unclipped(samples, PATCH_NAMES, name)
    verdict = judge_chart(photo, detection, reference, PATCH_NAMES,
                          light_explained=config.chart.scene is not None)
    notes = (*notes, *(f"{name} should be shot again: {reason}" for reason in verdict.reasons))
    write_png(folder / f"{view.record('overlay')}.png", chart_overlay(photo, detection))
    height, width = photo.signal.shape[:2]
    thumbnail = bin_image(photo, THUMBNAIL_WIDTH, max(round(THUMBNAIL_WIDTH * height / width), 1))
    found = {"detection": detection, "samples": samples, "thumbnail": thumbnail, "notes": notes,
             "light on chart": verdict.light}
    if config.drift.chart_px and not view.name:
        found["references"] = region_signals(photo, np.array(config.drift.chart_px))
    return found


def bin_object_photos(task: StageTask) -> dict[str, Any]:
    """Object photos to linear signal at the render's size.

    Returns
    -------
    dict
        "notes", and the "photo" of every view; of the first also the signals of the "references"
        where the session names some.

    Raises
    ------
    ClippedPhotoError
        If most of a photo is saturated.
    InputError
        If its shape is not that of its scene.
    """
    config = task.config
    records: dict[str, Any] = {"notes": ()}
    for index, view in enumerate(config.all_views):
        name = view.photo_files[0]
        task.progress((index + 0.1) / len(config.all_views), f"decoding {name}")
        photo, notes = read_photo(config, view.photo)
        require_exposed(photo, name)
        if config.drift.object_px and not view.name:
            records["references"] = region_signals(photo, np.array(config.drift.object_px))
        if config.camera.lens is not None:
            photo = undistorted(photo, read_lens(config.path(config.camera.lens)))
        check_aspect(photo, read_session_scene(config, view.scene), name)
        write_png(task.folder / f"{view.record('preview')}.png", preview_rgb8(photo))
        height, width = photo.signal.shape[:2]
        size = render_size(width, height, config.reconstruct.width)
        records[view.record("photo")] = bin_image(photo, *size)
        records["notes"] += notes
    return records


def light_on_chart(stored: Mapping[str, StoredStage], view: ViewInputs) -> np.ndarray:
    """Light (24,) on the patches of a view's chart photo, as it changes evenly over the chart."""
    light: np.ndarray = stored["chart"].record(np.ndarray, view.record("light on chart"))
    return light
