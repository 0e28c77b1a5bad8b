"""The step that decodes the photos: of a scene at the render's size, of flat samples to the signals
of regions.
"""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from spectrabox.calibrate.geometry.projection import undistorted
from spectrabox.capture.photo.binning import bin_image, render_size, thumbnail
from spectrabox.capture.photo.preview import signal_rgb8
from spectrabox.capture.photo.regions import sample_regions
from spectrabox.capture.photo.registration import (
    Edges,
    distance_px,
    find_edges,
    register,
    registered,
)
from spectrabox.measure.captured import FlatCapture, Outline, SceneCapture, View
from spectrabox.measure.opened_photos import require_exposed, require_one_camera
from spectrabox.measure.records import CaptureRecords, MeasuredChart, PhotoRecords
from spectrabox.measure.scene.box_camera import lens_of, scene_of
from spectrabox.measure.steps.work import Work
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.records.photos import LinearImage, RegionSamples, Registration
from spectrabox.reconstruct.scene.scene_file import require_same_shape

PREVIEW_WIDTH = 800          # pixels of the picture of flat samples in the report, at most
THUMBNAIL_WIDTH = 96         # of what is kept of them as numbers: exposure, clipping, mean signal
UNEVEN = 0.05                # scatter of pixels beyond noise, relative, above which to say so


def measure_flat_photos(capture: FlatCapture, records: CaptureRecords,
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
        If a region is saturated.
    InputError
        If a region leaves its photo, a photo through a filter is the one without it, or two cameras
        took the photos or the chart's.
    CheckError
        If a further photo was not taken from the tripod of the first.
    """
    several = len(capture.views) > 1
    photos: dict[str, LinearImage] = {}
    regions: dict[str, RegionSamples] = {}
    registrations: dict[str, Registration] = {}
    findings: list[Finding] = []
    first_edges: Edges | None = None
    for index, view in enumerate(capture.views):
        work.progress((index + 0.1) / len(capture.views), f"reading {view.photo_names[0]}")
        photo, own_findings = work.photos.developed(view.photo)
        findings += own_findings
        require_one_camera([*(chart.thumbnail for chart in records.chart.charts.values()),
                            *photos.values(), photo])
        if several and not view.name:
            first_edges = find_edges(photo)
        elif first_edges is not None:
            both = _outlines_in_both(capture, view)
            registration = _registration(capture, records, view, both, first_edges, photo)
            if registration is not None:
                registrations[view.name] = registration
            elif both:
                findings.append(_not_registered(capture, records, view))
        outlines = outlines_in(capture, view, registrations.get(view.name))
        if outlines:
            regions[view.name] = sample_regions(photo, outlines, without_clipped=several)
            findings += uneven_regions(regions[view.name], view.name)
        photos[view.name] = thumbnail(photo, THUMBNAIL_WIDTH)
        if view.filter is not None and np.array_equal(photos[view.name].signal,
                                                      photos[""].signal):
            raise InputError(f"{view.photo_names[0]} is the photo without the filter; give the one "
                             "that was taken through it")
        findings += work.write_picture(view.label("preview"), partial(
            signal_rgb8, photo.signal, -(-photo.signal.shape[1] // PREVIEW_WIDTH)))
    return PhotoRecords(photos, regions, registrations, work.photos.bands(photo),
                        tuple(findings))


def measure_scene_photos(capture: SceneCapture, records: CaptureRecords,
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
    photos: dict[str, LinearImage] = {}
    findings: list[Finding] = []
    for index, view in enumerate(capture.views):
        name = view.photo_names[0]
        work.progress((index + 0.1) / len(capture.views), f"reading {name}")
        photo, own_findings = work.photos.developed(view.photo)
        findings += own_findings
        require_exposed(photo, name)
        lens = lens_of(view)
        if lens is not None:
            photo = undistorted(photo, lens)
        require_same_shape(photo, scene_of(view.scene), name)
        height, width = photo.signal.shape[:2]
        photos[view.name] = bin_image(photo, *render_size(width, height, capture.inversion.width))
        findings += work.write_picture(view.label("preview"), partial(signal_rgb8, photo.signal))
    return PhotoRecords(photos, {}, {}, work.photos.bands(photo),
                        tuple(findings))


def _outlines_in_both(capture: FlatCapture, view: View) -> dict[str, Outline]:
    """Outlines of the regions that another photo shows as the first does, by name."""
    first = capture.views[0]
    return {} if view.photo == first.photo else {
        name: region.outline for name, region in capture.regions_in(first).items()
        if name in capture.regions_in(view)}


def _registration(capture: FlatCapture, records: CaptureRecords, view: View,
                  both: Mapping[str, Outline], first_edges: Edges,
                  photo: LinearImage) -> Registration | None:
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
    return registered(first_edges, find_edges(photo), (first.photo_names[0], view.photo_names[0]),
                      both, _charts_px(records.chart.charts, first, view))


def _not_registered(capture: FlatCapture, records: CaptureRecords, view: View) -> Finding:
    """That a photo was not compared with the first, and what its chart says."""
    first = capture.views[0]
    chart_px = _charts_px(records.chart.charts, first, view)
    return Finding("photo.not-registered", Severity.NOTE, view.photo_names[0], {
        "first": first.photo_names[0],
        "chart_px": None if chart_px is None else float(distance_px(chart_px))})


def registration_of(charts: Mapping[str, MeasuredChart], first: View, view: View,
                    first_edges: Edges, edges: Edges) -> Registration | None:
    """How a photo is shifted against the first; None where both have too little in common to tell.

    Parameters
    ----------
    charts : mapping
        By the names of views.
    first, view : View
    first_edges, edges : Edges
        Of their photos.
    """
    return register(first_edges, edges, _charts_px(charts, first, view))


def _charts_px(charts: Mapping[str, MeasuredChart], first: View,
               view: View) -> tuple[np.ndarray, np.ndarray] | None:
    """Patches (I, 4, 2) of the chart in the photos of two views; None where one does not show it.
    """
    shown = [charts[each.name].detection.corners_px for each in (first, view)
             if each.shows_chart]
    return (shown[0], shown[1]) if len(shown) == 2 else None


def outlines_in(capture: FlatCapture, view: View, registration: Registration | None
                ) -> dict[str, Sequence[Sequence[float]]]:
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


def uneven_regions(samples: RegionSamples, photo: str = "") -> list[Finding]:
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
