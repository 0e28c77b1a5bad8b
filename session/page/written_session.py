"""What the page shows of a session.toml that may have faults, and what ``check`` would say of a
mark.
"""


from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np
from pydantic import Field, ValidationError

from spectrabox.capture.photo import linear, regions
from spectrabox.measure import captured, opened_photos
from spectrabox.measure.scene.box_camera import scene_of
from spectrabox.measure.shoot import captures, shoot
from spectrabox.radiometry import checked_tables, errors
from spectrabox.session.config.session_file import SessionConfig, toml_of
from spectrabox.session.page.photo_views import PhotoFile, PhotoViews
from spectrabox.session.problems import readable, require_chart

MAX_PX = 1e6            # no photo is as large
Coordinate = Annotated[float, Field(ge=-MAX_PX, le=MAX_PX, strict=True)]
Pixel = Annotated[checked_tables.ListOf[Coordinate], Field(min_length=2, max_length=2)]
ANY_CAMERA = {"at_mm": (0.0, 0.0, 1.0), "look_at_mm": (0.0, 0.0, 0.0), "fov_deg": 40.0}


def shown_tables(text: str) -> shoot.Shoot | None:
    """The tables of a session.toml; None where they are not well written.

    The camera of a box may be missing or half measured: marks are what it lacks.
    """
    try:
        written = toml_of(text)
    except errors.InputError:
        return None
    scene = written.get("scene")
    box = scene.get("box") if isinstance(scene, dict) else None
    candidates = [written]
    if isinstance(box, dict):
        candidates.append(written | {"scene": {"box": box | {"camera": ANY_CAMERA}}})
    for candidate in candidates:
        try:
            return shoot.Shoot.model_validate(candidate)
        except ValidationError:
            continue
    return None


def facts_of(tables: shoot.Shoot | None) -> dict[str, Any]:
    """What is said of light, picture and further photos."""
    light = None if tables is None else tables.light.spectrum
    scene = tables is not None and not tables.flat and bool(
        tables.scene is not None or tables.materials)
    return {"scene": scene, "light": "" if light is None else light.word or light.file or "",
            "surface": None if tables is None else tables.session.surface,
            "picture": tables is not None and tables.picture is not None,
            "views": [] if tables is None else list(tables.views)}


def photos_of(tables: shoot.Shoot | None) -> dict[str, str]:
    """The first file of every photo that is named, by what it is: "photo", "chart", "NAME",
    "NAME chart".
    """
    if tables is None:
        return {}
    named = {captured.FIRST_PHOTO: tables.photos.object, "chart": tables.photos.chart}
    for name, view in tables.views.items():
        named |= {name: view.photo, f"{name} chart": view.chart}
    return {role: next(iter(shoot.by_band(photo).values()))[0] for role, photo in named.items()
            if photo is not None}


def corner_names(tables: shoot.Shoot | None) -> list[str]:
    """Names of the corners that can be marked, of the box and of boxes in it; none without a
    box.
    """
    if tables is None or tables.scene is None or tables.scene.box is None:
        return []
    # those of the opening last: few photos show them
    return sorted(tables.scene.box.corner_positions(), key=lambda name: name.startswith("front "))


def marks_of(tables: shoot.Shoot | None) -> dict[str, Any]:
    """What can be drawn on photos: outlines of regions, and corners."""
    if tables is None:
        return {"regions": {}, "chart_corners": None, "box_corners": None}
    box = None if tables.scene is None else tables.scene.box
    return {"regions": {name: _region(region) for name, region in tables.regions.items()},
            "chart_corners": _points(tables.chart.corners_px),
            "box_corners": None if box is None else box.camera.corners_px}


def _region(region: shoot.RegionSection) -> dict[str, Any]:
    rect = region.rect is not None and len(region.rect) == 4
    stated = {"family": region.family, "surface": region.surface,
              "known": region.known and region.known.file,
              "truth": region.truth and region.truth.file}
    return {"outline": _points(region.outline() if rect else region.polygon) or (), "rect": rect,
            "stated": {key: value for key, value in stated.items() if isinstance(value, str)},
            "photo": region.photo}


def _points(written: Sequence[Sequence[float]] | None) -> Sequence[Sequence[float]] | None:
    """Points of two numbers each, and None where others are written."""
    return written if written and all(len(point) == 2 for point in written) else None


# ---- what ``check`` would say of a mark on its photo, without a run of the session ---------------

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
            _region_faults(config, name, photos)
        elif kind == "stated" and name in config.regions:
            for stated in (config.regions[name].known, config.regions[name].truth):
                if stated is not None:
                    captures.read_reflectance(config.inputs, stated)
        elif kind in ("session", "view"):
            for view in config.all_views:
                captures.read_light(config.inputs, view.light)
                if view.filter is not None:
                    captures.read_filter(config.inputs, view.filter)
                linear.photo_size(config.path(view.photo_files[0]))
        elif kind == "chart corners":
            _chart(config)
        elif kind == "box corners":
            scene_of(captures.stated_scene(config, config.inputs))
    except errors.SpectraboxError as error:
        return list(error.faults)
    return []


def _region_faults(config: SessionConfig, name: str, photos: PhotoViews) -> None:
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
        regions.region_pixels(saturated, photo.step, np.array(region.outline(), dtype=float),
                              f"photo {file.path.name}: region {name!r}")


def _chart(config: SessionConfig) -> None:
    capture = readable(config.capture)
    if config.chart.corners_px is None or capture is None or not capture.views[0].chart:
        return
    view = capture.views[0]
    chart = readable(opened_photos.develop, capture, view.chart)
    if chart is not None:
        require_chart(capture, view, chart[0])
