"""The steps "chart" and "photo": charts found, photos developed, regions and references measured.
"""


from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from spectrabox.calibrate.geometry.projection import undistorted
from spectrabox.capture.chart import patches, quality
from spectrabox.capture.chart.detection import chart_overlay
from spectrabox.capture.photo import preview
from spectrabox.capture.photo import registration as registering
from spectrabox.capture.photo.regions import sample_regions
from spectrabox.measure import captured, opened_photos
from spectrabox.measure.records import CaptureRecords, MeasuredChart, PhotoRecords
from spectrabox.measure.scene.box_camera import lens_of, scene_of
from spectrabox.measure.steps import chart_fit
from spectrabox.measure.steps.work import Work
from spectrabox.radiometry import errors, grid
from spectrabox.radiometry.chart import typical_camera_signals
from spectrabox.radiometry.findings import Finding, Severity, faults
from spectrabox.radiometry.records import photos as photo_records
from spectrabox.reconstruct.scene.scene_file import require_same_shape

THUMBNAIL_WIDTH = 48     # pixels: a chart photo is kept only for its exposure and source


def find_charts(capture: captured.Capture, records: CaptureRecords,
                work: Work) -> dict[str, MeasuredChart]:
    """Chart photos to patch statistics, by view.

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
    first: tuple[photo_records.ChartDetection, registering.Edges] | None = None
    for index, view in enumerate(views):
        name = view.chart_names[0]
        work.progress((index + 0.1) / len(views), f"finding the chart in {name}")
        photo, own_findings = work.photos.developed(view.chart)
        opened_photos.require_one_camera([*(each.thumbnail for each in charts.values()), photo])
        again = None if first is None else _moved(*first, photo)
        detection, expected = find_stated_chart(capture, view, photo, again)
        if capture.one_tripod and len(capture.views) > 1 and first is None:
            first = detection, registering.find_edges(photo)
        no_picture = work.write_picture(view.label("overlay"),
                                        partial(chart_overlay, photo, detection))
        verdict = quality.judge_chart(photo, detection, expected, chart.layout,
                                      light_explained=capture.chart_scene is not None,
                                      excluded=chart.excluded)
        lost = patches.require_unclipped(verdict.samples, chart.layout.names, name,
                                         chart.layout.neutrals, work.photos.bands(photo),
                                         bands_may_drop=capture.bands_may_drop)
        told = faults(verdict.findings)
        charts[view.name] = MeasuredChart(
            detection, verdict.samples, preview.thumbnail(photo, THUMBNAIL_WIDTH), verdict.light,
            verdict.findings, (*no_picture, *(one for one in own_findings if one not in told),
                               *lost))
    return charts


def find_stated_chart(capture: captured.Capture, view: captured.View,
                      photo: photo_records.LinearImage,
                      before: photo_records.ChartDetection | None = None
                      ) -> tuple[photo_records.ChartDetection, np.ndarray]:
    """The chart in the chart photo of a view, and the signals (I, 3) by which it is known.

    Parameters
    ----------
    capture : Capture
    view : View
    photo : LinearImage
    before : ChartDetection, optional
        Where another photo from the same tripod shows it.

    Raises
    ------
    ChartNotFoundError, CheckError
        As ``find_chart``.
    """
    chart = capture.lit_chart
    expected = typical_camera_signals(chart.reflectances, grid.FINE_GRID, view.power)
    corners = None if view.name else chart.corners_px       # which are stated of the first alone
    return chart_fit.find(photo, expected, chart.layout, corners, before,
                          filtered=view.filter is not None, excluded=chart.excluded), expected


def _moved(before: photo_records.ChartDetection, edges: registering.Edges,
           photo: photo_records.LinearImage) -> photo_records.ChartDetection:
    """The chart of another photo where a photo that is shifted against it shows it."""
    other = registering.find_edges(photo)
    registration = registering.register(edges,
                                        other) if edges.size.shape == other.size.shape else None
    return before if registration is None else dataclasses.replace(
        before, corners_px=registration.moved(before.corners_px))


# ---- the step that decodes the photos ------------------------------------------------------------

PREVIEW_WIDTH = 800          # pixels of the picture of flat samples in the report, at most
PHOTO_THUMBNAIL_WIDTH = 96  # of what is kept of them as numbers: exposure, clipping, mean signal
UNEVEN = 0.05                # scatter of pixels beyond noise, relative, above which to say so


def measure_flat_photos(capture: captured.FlatCapture, records: CaptureRecords,
                        work: Work) -> PhotoRecords:
    """Photos of flat samples to the signals of their regions.

    Parameters
    ----------
    capture : FlatCapture
    records : CaptureRecords
        Of the charts.
    work : Work

    Raises
    ------
    ClippedPhotoError
        If a region of unknown spectrum is saturated.
    InputError
        If a region leaves its photo, a photo through a filter is the one without it, or two cameras
        took the photos or the chart's.
    CheckError
        If a further photo was not taken from the tripod of the first.
    """
    several = len(capture.views) > 1
    photos: dict[str, photo_records.LinearImage] = {}
    regions: dict[str, photo_records.RegionSamples] = {}
    registrations: dict[str, photo_records.Registration] = {}
    findings: list[Finding] = []
    first_edges: registering.Edges | None = None
    for index, view in enumerate(capture.views):
        work.progress((index + 0.1) / len(capture.views), f"reading {view.photo_names[0]}")
        photo, own_findings = work.photos.developed(view.photo)
        findings += own_findings
        opened_photos.require_one_camera([
            *(chart.thumbnail for chart in records.charts.values()), *photos.values(), photo
        ])
        if several and not view.name:
            first_edges = registering.find_edges(photo)
        elif first_edges is not None:
            both = _outlines_in_both(capture, view)
            registration = _registration(capture, records, view, both, first_edges, photo)
            if registration is not None:
                registrations[view.name] = registration
            elif both:
                findings.append(_not_registered(capture, records, view))
        outlines = outlines_in(capture, view, registrations.get(view.name))
        if outlines:
            regions[view.name] = sample_regions(photo, outlines, without_clipped=several,
                                                known=capture.known)
            findings += uneven_regions(regions[view.name], view.name)
        photos[view.name] = preview.thumbnail(photo, PHOTO_THUMBNAIL_WIDTH)
        if view.filter is not None and np.array_equal(photos[view.name].signal,
                                                      photos[""].signal):
            raise errors.InputError(
                f"{view.photo_names[0]} is the photo without the filter; give the one "
                "that was taken through it")
        findings += work.write_picture(view.label("preview"), partial(
            preview.signal_rgb8, photo.signal, -(-photo.signal.shape[1] // PREVIEW_WIDTH)))
    return PhotoRecords(photos, regions, registrations, work.photos.bands(photo),
                        tuple(findings))


def measure_scene_photos(capture: captured.SceneCapture, records: CaptureRecords,
                         work: Work) -> PhotoRecords:
    """Photos of a scene, as a pinhole takes them, at the render's size.

    Parameters
    ----------
    capture : SceneCapture
    records : CaptureRecords
        None are needed.
    work : Work

    Raises
    ------
    ClippedPhotoError
        If most of a photo is saturated.
    InputError
        If a photo's shape is not that of its scene.
    """
    photos: dict[str, photo_records.LinearImage] = {}
    findings: list[Finding] = []
    for index, view in enumerate(capture.views):
        name = view.photo_names[0]
        work.progress((index + 0.1) / len(capture.views), f"reading {name}")
        photo, own_findings = work.photos.developed(view.photo)
        findings += own_findings
        opened_photos.require_exposed(photo, name)
        lens = lens_of(view)
        if lens is not None:
            photo = undistorted(photo, lens)
        require_same_shape(photo, scene_of(view.scene), name)
        height, width = photo.signal.shape[:2]
        photos[view.name] = preview.bin_image(
            photo, *preview.render_size(width, height, capture.inversion.width))
        findings += work.write_picture(view.label("preview"),
                                       partial(preview.signal_rgb8, photo.signal))
    return PhotoRecords(photos, {}, {}, work.photos.bands(photo),
                        tuple(findings))


def _outlines_in_both(capture: captured.FlatCapture,
                      view: captured.View) -> dict[str, captured.Outline]:
    """Outlines of the regions that another photo shows as the first does, by name."""
    first = capture.views[0]
    return {} if view.photo == first.photo else {
        name: region.outline for name, region in capture.regions_in(first).items()
        if name in capture.regions_in(view)}


def _registration(capture: captured.FlatCapture, records: CaptureRecords, view: captured.View,
                  both: Mapping[str, captured.Outline], first_edges: registering.Edges,
                  photo: photo_records.LinearImage) -> photo_records.Registration | None:
    """How a photo is shifted against the first; None where no region is in both, or both have too
    little in common to tell.

    Raises
    ------
    InputError
        If the photos are of different sizes.
    CheckError
        As ``registered``.
    """
    if not both:
        return None
    first = capture.views[0]
    return registering.registered(first_edges, registering.find_edges(photo),
                                  (first.photo_names[0], view.photo_names[0]),
                                  both, _charts_px(records.charts, first, view))


def _not_registered(capture: captured.FlatCapture, records: CaptureRecords,
                    view: captured.View) -> Finding:
    """That a photo was not compared with the first, and what its chart says."""
    first = capture.views[0]
    chart_px = _charts_px(records.charts, first, view)
    return Finding("photo.not-registered", Severity.NOTE, view.photo_names[0], {
        "first": first.photo_names[0],
        "chart_px": None if chart_px is None else float(registering.distance_px(chart_px))})


def registration_of(charts: Mapping[str, MeasuredChart], first: captured.View, view: captured.View,
                    first_edges: registering.Edges,
                    edges: registering.Edges) -> photo_records.Registration | None:
    """How a photo is shifted against the first; None where both have too little in common to tell.

    Parameters
    ----------
    charts : mapping
        By the names of views.
    first, view : View
    first_edges, edges : Edges
        Of their photos.
    """
    return registering.register(first_edges, edges, _charts_px(charts, first, view))


def _charts_px(charts: Mapping[str, MeasuredChart], first: captured.View,
               view: captured.View) -> tuple[np.ndarray, np.ndarray] | None:
    """Patches (I, 4, 2) of the chart in the photos of two views; None where one does not show it.
    """
    shown = [charts[each.name].detection.corners_px for each in (first, view)
             if each.shows_chart]
    return (shown[0], shown[1]) if len(shown) == 2 else None


def outlines_in(capture: captured.FlatCapture, view: captured.View,
                registration: photo_records.Registration
                | None) -> dict[str, Sequence[Sequence[float]]]:
    """Outlines of the regions that the photo of a view shows, in its own pixels.

    Parameters
    ----------
    capture : FlatCapture
    view : View
    registration : Registration or None
        Of its photo to the first.
    """
    outlined = capture.regions_in(capture.views[0])
    return {name: region.outline if registration is None or name not in outlined
            else registration.moved(np.array(region.outline)).tolist()
            for name, region in capture.regions_in(view).items()}


def uneven_region(name: str, scatter: float, photo: str = "") -> Finding:
    """A region whose pixels scatter by so much more than noise and even light."""
    return Finding("region.uneven", Severity.NOTE, name, {
        "scatter": scatter, "limit": UNEVEN, "photo": photo})


def uneven_regions(samples: photo_records.RegionSamples, photo: str = "") -> list[Finding]:
    """Regions whose pixels scatter by more than noise and even light.

    Parameters
    ----------
    samples : RegionSamples
    photo : str
        Name of the view; empty of the first.
    """
    return [uneven_region(name, float(scatter), photo)
            for name, scatter in zip(samples.names, samples.scatter.max(axis=1), strict=True)
            if scatter > UNEVEN]
