"""The stage that decodes object photos: to the render's size, or to the signals of regions."""
from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from spectrabox.calibrate.geometry.projection import undistorted
from spectrabox.capture.photo.binning import bin_image, render_size, thumbnail
from spectrabox.capture.photo.image_files import write_png
from spectrabox.capture.photo.preview import signal_rgb8
from spectrabox.capture.photo.regions import region_signals, sample_regions
from spectrabox.capture.photo.registration import (
    Edges,
    Registration,
    find_edges,
    register,
    registered,
)
from spectrabox.radiometry.records import LinearImage, RegionSamples
from spectrabox.reconstruct.scene.scene_file import require_same_shape
from spectrabox.session.box.box_camera import lens_of_view
from spectrabox.session.config.session_schema import SessionConfig, ViewInputs
from spectrabox.session.stages.inputs import require_exposed
from spectrabox.session.stages.records import MeasuredChart, PhotoRecords
from spectrabox.session.stages.scenes import read_session_scene
from spectrabox.session.stages.stage_task import StageTask

PREVIEW_WIDTH = 800          # pixels of the picture of flat samples in the report, at most
THUMBNAIL_WIDTH = 96         # of what is kept of them as numbers: exposure, clipping, mean signal
UNEVEN = 0.05                # scatter of pixels beyond noise, relative, above which to say so


def measure_photos(task: StageTask) -> PhotoRecords:
    """Object photos to linear signal: of a scene at the render's size, of flat samples by region.

    Parameters
    ----------
    task : StageTask

    Raises
    ------
    ClippedPhotoError
        If most of a photo of a scene, or a region of flat samples, is saturated.
    InputError
        If a photo's shape is not that of its scene, or a region leaves its photo.
    CheckError
        If a further photo of flat samples was not taken from the tripod of the first.
    """
    config = task.config
    photos: dict[str, LinearImage] = {}
    regions: dict[str, RegionSamples] = {}
    notes: tuple[str, ...] = ()
    references = None
    registrations: dict[str, Registration] = {}
    first_edges: Edges | None = None
    for index, view in enumerate(config.all_views):
        task.progress((index + 0.1) / len(config.all_views), f"reading {view.photo_files[0]}")
        photo, own_notes = task.photos.developed(config, view.photo)
        notes += own_notes
        if config.drift.object_px and not view.name:
            references = region_signals(photo, config.drift.object_px)
        if config.flat:
            if config.views and not view.name:
                first_edges = find_edges(photo)
            elif first_edges is not None and (registration := _registration(
                    task, view, first_edges, photo)) is not None:
                registrations[view.name] = registration
            if (samples := _regions(config, view, photo, registrations.get(view.name))) is not None:
                regions[view.name] = samples
                notes += _uneven_notes(samples)
            photos[view.name] = thumbnail(photo, THUMBNAIL_WIDTH)
            preview = signal_rgb8(photo.signal, -(-photo.signal.shape[1] // PREVIEW_WIDTH))
        else:
            photo = _as_rendered(config, view, photo)
            height, width = photo.signal.shape[:2]
            photos[view.name] = bin_image(photo, *render_size(width, height,
                                                              config.reconstruct.width))
            preview = signal_rgb8(photo.signal)
        write_png(task.folder / f"{view.label('preview')}.png", preview)
    return PhotoRecords(photos, regions, references, registrations,
                        task.photos.bands(config, photo), notes)


def _as_rendered(config: SessionConfig, view: ViewInputs, photo: LinearImage) -> LinearImage:
    """The photo as a pinhole takes it, of the shape of its scene."""
    name = view.photo_files[0]
    require_exposed(photo, name)
    if (lens := lens_of_view(config, view)) is not None:
        photo = undistorted(photo, lens)
    require_same_shape(photo, read_session_scene(config, view), name)
    return photo


def _registration(task: StageTask, view: ViewInputs, first_edges: Edges,
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
    config = task.config
    first, charts = config.all_views[0], task.records.chart.charts
    both = {name: region.outline() for name, region in config.regions_in(first).items()
            if name in config.regions_in(view)}
    if not both or view.photo_files == first.photo_files:
        return None
    return registered(first_edges, find_edges(photo), (first.photo_files[0], view.photo_files[0]),
                      both, _charts_px(charts, first, view))


def registration_of(charts: Mapping[str, MeasuredChart], first: ViewInputs, view: ViewInputs,
                    first_edges: Edges, edges: Edges) -> Registration | None:
    """How a photo is shifted against the first; None where both have too little in common to tell.

    Parameters
    ----------
    charts : mapping
        By the names of views.
    first, view : ViewInputs
    first_edges, edges : Edges
        Of their photos.
    """
    return register(first_edges, edges, _charts_px(charts, first, view))


def _charts_px(charts: Mapping[str, MeasuredChart], first: ViewInputs,
               view: ViewInputs) -> tuple[np.ndarray, np.ndarray] | None:
    """Patches (I, 4, 2) of the chart in the photos of two views; None where one does not show it.
    """
    shown = [charts[each.name].detection.corners_px for each in (first, view)
             if each.chart_files == each.photo_files]
    return (shown[0], shown[1]) if len(shown) == 2 else None


def outlines_in(config: SessionConfig, view: ViewInputs, registration: Registration | None
                ) -> dict[str, Sequence[Sequence[float]]]:
    """Outlines of the regions that the photo of a view shows, in its own pixels.

    Parameters
    ----------
    config : SessionConfig
    view : ViewInputs
    registration : Registration or None
        Of its photo to the first.
    """
    outlined = config.regions_in(config.all_views[0])
    return {name: section.outline() if registration is None or name not in outlined
            else registration.moved(np.array(section.outline())).tolist()
            for name, section in config.regions_in(view).items()}


def _regions(config: SessionConfig, view: ViewInputs, photo: LinearImage,
             registration: Registration | None) -> RegionSamples | None:
    """The regions that the photo shows; None where it shows none."""
    shown = outlines_in(config, view, registration)
    return sample_regions(photo, shown, without_clipped=bool(config.views)) if shown else None


def _uneven_notes(samples: RegionSamples) -> tuple[str, ...]:
    return tuple(
        f"region {name!r} is uneven: its pixels scatter by {scatter:.0%} beyond noise and even "
        "light, and its spectrum is the mean of what lies in it; outline a smaller part for one "
        "paint" for name, scatter in zip(samples.names, samples.scatter.max(axis=1), strict=True)
        if scatter > UNEVEN)
