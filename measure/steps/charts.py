"""The step that finds the charts in their photos, and measures their patches."""
from __future__ import annotations

import dataclasses
from functools import partial

import numpy as np

from spectrabox.capture.chart.detection import chart_overlay
from spectrabox.capture.chart.patches import require_unclipped
from spectrabox.capture.chart.quality import judge_chart
from spectrabox.capture.photo.binning import thumbnail
from spectrabox.capture.photo.registration import Edges, find_edges, register
from spectrabox.measure.captured import Capture, View
from spectrabox.measure.opened_photos import require_one_camera
from spectrabox.measure.records import CaptureRecords, ChartRecords, MeasuredChart
from spectrabox.measure.steps import chart_fit
from spectrabox.measure.steps.work import Work
from spectrabox.radiometry.chart import typical_camera_signals
from spectrabox.radiometry.findings import Finding
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.records.photos import ChartDetection, LinearImage

THUMBNAIL_WIDTH = 48     # pixels: a chart photo is kept only for its exposure and source


def find_charts(capture: Capture, records: CaptureRecords, work: Work) -> ChartRecords:
    """Chart photos to patch statistics.

    Parameters
    ----------
    capture : Capture
    records : CaptureRecords
        None are needed.
    work : Work

    Raises
    ------
    CheckError
        If a chart is not found, or too little of it can be read.
    InputError
        If two cameras took the photos.
    """
    chart = capture.lit_chart
    views = capture.views_with_chart
    charts: dict[str, MeasuredChart] = {}
    findings: list[Finding] = []
    first: tuple[ChartDetection, Edges] | None = None
    for index, view in enumerate(views):
        name = view.chart_names[0]
        work.progress((index + 0.1) / len(views), f"finding the chart in {name}")
        photo, own_findings = work.photos.developed(view.chart)
        require_one_camera([*(each.thumbnail for each in charts.values()), photo])
        expected = typical_camera_signals(chart.reflectances, FINE_GRID, view.power)
        again = None if first is None else _moved(*first, photo)
        detection = chart_fit.find(photo, expected, chart.layout, stated_corners(capture, view),
                                   again, filtered=view.filter is not None)
        if capture.one_tripod and len(capture.views) > 1 and first is None:
            first = detection, find_edges(photo)
        findings += work.write_picture(view.label("overlay"),
                                       partial(chart_overlay, photo, detection))
        verdict = judge_chart(photo, detection, expected, chart.layout,
                              light_explained=capture.chart_scene is not None)
        lost = require_unclipped(verdict.samples, chart.layout.names, name, chart.layout.neutrals,
                                 work.photos.bands(photo), bands_may_drop=capture.bands_may_drop)
        findings += (*own_findings, *lost)
        charts[view.name] = MeasuredChart(detection, verdict.samples,
                                          thumbnail(photo, THUMBNAIL_WIDTH), verdict.light,
                                          verdict.findings)
    return ChartRecords(charts, tuple(findings))


def stated_corners(capture: Capture, view: View) -> np.ndarray | None:
    """Outer corners (4, 2) of the chart in pixels where they were stated, of the first view alone.
    """
    return None if view.name else capture.lit_chart.corners_px


def _moved(before: ChartDetection, edges: Edges, photo: LinearImage) -> ChartDetection:
    """The chart of another photo where a photo that is shifted against it shows it."""
    other = find_edges(photo)
    registration = register(edges, other) if edges.size.shape == other.size.shape else None
    return before if registration is None else dataclasses.replace(
        before, corners_px=registration.moved(before.corners_px))
