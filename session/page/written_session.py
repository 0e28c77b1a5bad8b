"""What the page shows of a session.toml: its photos and the marks on them."""
from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

from pydantic import Field, ValidationError

from spectrabox.measure.captured import FIRST_PHOTO
from spectrabox.measure.shoot.shoot import RegionSection, Shoot, by_band
from spectrabox.radiometry.checked_tables import ListOf
from spectrabox.radiometry.errors import InputError
from spectrabox.session.config.session_file import toml_of

MAX_PX = 1e6            # no photo is as large
Coordinate = Annotated[float, Field(ge=-MAX_PX, le=MAX_PX, strict=True)]
Pixel = Annotated[ListOf[Coordinate], Field(min_length=2, max_length=2)]
ANY_CAMERA = {"at_mm": (0.0, 0.0, 1.0), "look_at_mm": (0.0, 0.0, 0.0), "fov_deg": 40.0}


def shown_tables(text: str) -> Shoot | None:
    """The tables of a session.toml; None where they are not well written.

    The camera of a box may be missing or half measured: marks are what it lacks.
    """
    try:
        written = toml_of(text)
    except InputError:
        return None
    scene = written.get("scene")
    box = scene.get("box") if isinstance(scene, dict) else None
    candidates = [written]
    if isinstance(box, dict):
        candidates.append(written | {"scene": {"box": box | {"camera": ANY_CAMERA}}})
    for candidate in candidates:
        try:
            return Shoot.model_validate(candidate)
        except ValidationError:
            continue
    return None


def facts_of(tables: Shoot | None) -> dict[str, Any]:
    """What is said of light, picture and further photos."""
    light = None if tables is None else tables.light.spectrum
    return {"light": "" if light is None else light.word or light.file or "",
            "picture": tables is not None and tables.picture is not None,
            "views": [] if tables is None else list(tables.views)}


def photos_of(tables: Shoot | None) -> dict[str, str]:
    """The first file of every photo that is named, by what it is: "photo", "chart", "NAME",
    "NAME chart".
    """
    if tables is None:
        return {}
    named = {FIRST_PHOTO: tables.photos.object, "chart": tables.photos.chart}
    for name, view in tables.views.items():
        named |= {name: view.photo, f"{name} chart": view.chart}
    return {role: next(iter(by_band(photo).values()))[0] for role, photo in named.items()
            if photo is not None}


def corner_names(tables: Shoot | None) -> list[str]:
    """Names of the corners that can be marked, of the box and of boxes in it; none without a
    box.
    """
    if tables is None or tables.scene is None or tables.scene.box is None:
        return []
    # those of the opening last: few photos show them
    return sorted(tables.scene.box.corner_positions(), key=lambda name: name.startswith("front "))


def marks_of(tables: Shoot | None) -> dict[str, Any]:
    """What can be drawn on photos: outlines of regions, and corners."""
    if tables is None:
        return {"regions": {}, "chart_corners": None, "box_corners": None}
    box = None if tables.scene is None else tables.scene.box
    return {"regions": {name: _region(region) for name, region in tables.regions.items()},
            "chart_corners": _points(tables.chart.corners_px),
            "box_corners": None if box is None else box.camera.corners_px}


def _region(region: RegionSection) -> dict[str, Any]:
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
