"""The stage that decodes chart photos, to patch statistics."""
from __future__ import annotations

import dataclasses

import numpy as np

from spectrabox.capture.chart.detection import chart_overlay, find_chart, find_chart_again
from spectrabox.capture.chart.patches import require_unclipped
from spectrabox.capture.chart.quality import judge_chart
from spectrabox.capture.photo.binning import thumbnail
from spectrabox.capture.photo.image_files import write_png
from spectrabox.capture.photo.regions import region_signals
from spectrabox.capture.photo.registration import Edges, find_edges, register
from spectrabox.radiometry.chart import typical_camera_signals
from spectrabox.radiometry.errors import ChartNotFoundError
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.records import ChartDetection, LinearImage
from spectrabox.session.config.session_chart import session_chart
from spectrabox.session.config.session_schema import SessionConfig, ViewInputs
from spectrabox.session.stages.inputs import (
    chart_corners,
    power_of,
    read_chart_reference,
    read_filter,
    read_light,
)
from spectrabox.session.stages.records import ChartRecords, MeasuredChart
from spectrabox.session.stages.stage_task import StageTask

THUMBNAIL_WIDTH = 48     # pixels: a chart photo is kept only for its exposure and source


def find_and_sample_charts(task: StageTask) -> ChartRecords:
    """Chart photos to patch statistics.

    Parameters
    ----------
    task : StageTask

    Raises
    ------
    CheckError
        If a chart is not found, or too little of it can be read.
    """
    config, layout = task.config, session_chart(task.config)
    charts: dict[str, MeasuredChart] = {}
    notes: tuple[str, ...] = ()
    references = None
    first: tuple[ChartDetection, Edges] | None = None
    for index, view in enumerate(config.views_with_chart):
        name = view.chart_files[0]
        task.progress((index + 0.1) / len(config.views_with_chart), f"finding the chart in {name}")
        photo, own_notes = task.photos.developed(config, view.chart)
        expected = typical_camera_signals(read_chart_reference(config), FINE_GRID,
                                          _power(config, view))
        again = None if first is None else _moved(*first, photo)
        detection = _chart_in(config, view, photo, expected, again)
        if config.flat and config.views and first is None:
            first = detection, find_edges(photo)
        write_png(task.folder / f"{view.label('overlay')}.png", chart_overlay(photo, detection))
        verdict = judge_chart(photo, detection, expected, layout,
                              light_explained=config.chart_pose_known)
        lost = require_unclipped(verdict.samples, layout.names, name, layout.neutrals,
                                 task.photos.bands(config, photo), bands_may_drop=config.flat)
        notes += (*own_notes, *lost,
                  *(f"{name} should be shot again: {reason}" for reason in verdict.reasons))
        if config.drift.chart_px and not view.name:
            references = region_signals(photo, config.drift.chart_px)
        charts[view.name] = MeasuredChart(detection, verdict.samples,
                                          thumbnail(photo, THUMBNAIL_WIDTH), verdict.light,
                                          tuple(verdict.reasons))
    return ChartRecords(charts, references, notes)


def _chart_in(config: SessionConfig, view: ViewInputs, photo: LinearImage, expected: np.ndarray,
              again: ChartDetection | None) -> ChartDetection:
    """The chart in a view's photo: searched for by its colours or, through a filter or where its
    light leaves no colours, where another photo from the same tripod shows it.
    """
    layout = session_chart(config)
    if again is not None and view.filter is not None:
        return find_chart_again(photo, expected, again, layout)
    try:
        return find_chart(photo, expected, chart_corners(config, view), layout)
    except ChartNotFoundError:
        if again is None:
            raise
        return find_chart_again(photo, expected, again, layout)


def _moved(before: ChartDetection, edges: Edges, photo: LinearImage) -> ChartDetection:
    """The chart of another photo where a photo that is shifted against it shows it."""
    other = find_edges(photo)
    registration = register(edges, other) if edges.size.shape == other.size.shape else None
    return before if registration is None else dataclasses.replace(
        before, corners_px=registration.moved(before.corners_px))


def _power(config: SessionConfig, view: ViewInputs) -> np.ndarray | None:
    """Light (P,) that an ordinary camera would see the chart in, as far as it is known."""
    power = power_of(read_light(config, view.light))
    if view.filter is None:
        return power
    return (1.0 if power is None else power) * read_filter(config, view.filter).transmittance
