"""What ``check`` would say of a mark on its photo, without a run of the session."""
from __future__ import annotations

import numpy as np

from spectrabox.capture.photo.linear import photo_size
from spectrabox.capture.photo.regions import region_pixels
from spectrabox.measure.opened_photos import develop
from spectrabox.measure.scene.box_camera import scene_of
from spectrabox.measure.shoot.captures import (
    read_filter,
    read_light,
    read_reflectance,
    stated_scene,
)
from spectrabox.radiometry.errors import SpectraboxError
from spectrabox.session.config.session_file import SessionConfig
from spectrabox.session.page.photo_views import PhotoFile, PhotoViews
from spectrabox.session.problems import readable, require_chart


def mark_faults(config: SessionConfig, kind: str, name: str, photos: PhotoViews) -> list[str]:
    """Faults of what a session says of a region, the chart's corners or a box.

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
                    read_reflectance(config.inputs, stated)
        elif kind in ("session", "view"):
            for view in config.all_views:
                read_light(config.inputs, view.light)
                if view.filter is not None:
                    read_filter(config.inputs, view.filter)
                photo_size(config.path(view.photo_files[0]))
        elif kind == "chart corners":
            _chart(config)
        elif kind == "box corners":
            scene_of(stated_scene(config, config.inputs))
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
    capture = readable(config.capture)
    if config.chart.corners_px is None or capture is None or not capture.views[0].chart:
        return
    view = capture.views[0]
    chart = readable(develop, capture, view.chart)
    if chart is not None:
        require_chart(capture, view, chart[0])
