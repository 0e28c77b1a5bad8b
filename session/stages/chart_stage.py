"""The stage that decodes chart photos, to patch statistics."""
from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from spectrabox.capture.chart.detection import chart_overlay, find_chart
from spectrabox.capture.chart.patches import require_unclipped
from spectrabox.capture.chart.quality import judge_chart
from spectrabox.capture.photo.binning import bin_image
from spectrabox.capture.photo.image_files import write_png
from spectrabox.capture.photo.regions import region_signals
from spectrabox.radiometry.chart import typical_camera_signals
from spectrabox.session.config.session_chart import session_chart
from spectrabox.session.config.session_schema import ViewInputs
from spectrabox.session.stages.inputs import (
    GRID,
    chart_corners,
    power_of,
    read_chart_reference,
    read_light,
)
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
        found = _find_and_sample_chart(task, view)
        records["notes"] += found.pop("notes")
        records |= {view.record(kind): value for kind, value in found.items()}
    return records


def _find_and_sample_chart(task: StageTask, view: ViewInputs) -> dict[str, Any]:
    config, name = task.config, view.chart_files[0]
    photo, notes = task.photos.developed(config, view.chart)
    reference = typical_camera_signals(read_chart_reference(config), GRID,
                                       power_of(read_light(config, view.light)))
    chart = session_chart(config)
    detection = find_chart(photo, reference, chart_corners(config, view), chart)
    write_png(task.folder / f"{view.record('overlay')}.png", chart_overlay(photo, detection))
    verdict = judge_chart(photo, detection, reference, chart,
                          light_explained=config.chart_pose_known)
    samples = verdict.samples
    require_unclipped(samples, chart.names, name)
    notes = (*notes, *(f"{name} should be shot again: {reason}" for reason in verdict.reasons))
    height, width = photo.signal.shape[:2]
    thumbnail = bin_image(photo, THUMBNAIL_WIDTH, max(round(THUMBNAIL_WIDTH * height / width), 1))
    found = {"detection": detection, "samples": samples, "thumbnail": thumbnail, "notes": notes,
             "light on chart": verdict.light}
    if config.drift.chart_px and not view.name:
        found["references"] = region_signals(photo, np.array(config.drift.chart_px))
    return found


def light_on_chart(stored: Mapping[str, StoredStage], view: ViewInputs) -> np.ndarray:
    """Light (I,) on the patches of a view's chart photo, as it changes evenly over the chart."""
    light: np.ndarray = stored["chart"].record(np.ndarray, view.record("light on chart"))
    return light
