"""What ``check`` would say of a mark on its photo, without a run of the session."""
from __future__ import annotations

import numpy as np

from spectrabox.capture.photo.linear import photo_size
from spectrabox.capture.photo.regions import region_pixels, region_signals
from spectrabox.radiometry.chart import typical_camera_signals
from spectrabox.radiometry.errors import SpectraboxError
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.session.check import readable, require_chart
from spectrabox.session.config.session_schema import SessionConfig
from spectrabox.session.page.photo_views import PhotoFile, PhotoViews
from spectrabox.session.stages.inputs import (
    power_of,
    read_chart_reference,
    read_light_of,
    read_photo,
    read_reflectance,
)
from spectrabox.session.stages.scenes import read_session_scene


def mark_faults(config: SessionConfig, kind: str, name: str, photos: PhotoViews) -> list[str]:
    """Faults of what a session says of a region, the chart's corners, a box or references.

    A photo that is missing or cannot be read is no fault of the mark.

    Parameters
    ----------
    config : SessionConfig
        With the mark.
    kind, name : str
        As of a ``Mark``.
    photos : PhotoViews
        In which a region is looked up.
    """
    try:
        if kind == "region":
            _region(config, name, photos)
        elif kind == "stated" and name in config.regions:
            for stated in (config.regions[name].known, config.regions[name].truth):
                if stated is not None:
                    read_reflectance(config, stated)
        elif kind in ("session", "view"):
            for view in config.all_views:
                read_light_of(config, view)
                photo_size(config.path(view.photo_files[0]))
        elif kind == "chart corners":
            _chart(config)
        elif kind == "box corners":
            read_session_scene(config)
        elif kind == "reference":
            _references(config, name)
    except SpectraboxError as error:
        return str(error).splitlines()
    return []


def _region(config: SessionConfig, name: str, photos: PhotoViews) -> None:
    for view in config.all_views:
        region, files = config.regions_in(view).get(name), view.photo_files
        if region is None:
            continue
        file = PhotoFile(config.path(files[0]), config.photos.orientation)
        photo = readable(photos.photo, file)
        if photo is None:
            continue
        # of several files a shorter exposure may hold what is clipped
        saturated = photos.clipped(file) if len(files) == 1 else np.zeros(photo.signal.shape, bool)
        region_pixels(saturated, photo.step, np.array(region.outline(), dtype=float),
                      f"photo {file.path.name}: region {name!r}")


def _chart(config: SessionConfig) -> None:
    view = config.all_views[0]
    if config.chart.corners_px is None or not view.chart:
        return
    chart = readable(read_photo, config, view.chart)
    light = readable(read_light_of, config, view)
    reference = readable(read_chart_reference, config)
    if chart is not None and light is not None and reference is not None:
        require_chart(config, view, chart[0],
                      typical_camera_signals(reference, FINE_GRID, power_of(light)))


def _references(config: SessionConfig, name: str) -> None:
    view = config.all_views[0]
    files, quads = ((view.chart, config.drift.chart_px) if name == "chart"
                    else (view.photo, config.drift.object_px))
    developed = readable(read_photo, config, files) if files and quads else None
    if developed is not None:
        region_signals(developed[0], quads)
