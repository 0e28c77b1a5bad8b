"""What the page shows of a session.toml that may have faults; what is written wrongly is not."""
from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, TypeAdapter, ValidationError

from spectrabox.capture.photo.orientation import AS_READ
from spectrabox.measure.captured import FIRST_PHOTO
from spectrabox.radiometry.checked_tables import ListOf
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.system.words import plain
from spectrabox.reconstruct.scene.box_tables import BoxTable, CameraTable
from spectrabox.session.config.session_file import text_of
from spectrabox.session.config.session_schema import by_band

STATED = ("family", "known", "surface", "truth")    # of a region
MAX_PX = 1e6            # no photo is as large
Coordinate = Annotated[float, Field(ge=-MAX_PX, le=MAX_PX, strict=True)]
Pixel = Annotated[ListOf[Coordinate], Field(min_length=2, max_length=2)]
OUTLINE, OUTLINES = TypeAdapter(ListOf[Pixel]), TypeAdapter(ListOf[ListOf[Pixel]])
RECTANGLE = TypeAdapter(tuple[Coordinate, Coordinate, Coordinate, Coordinate])
CORNERS, PHOTOS = TypeAdapter(dict[str, Pixel]), TypeAdapter(str | list[str])
ANY_CAMERA = CameraTable(at_mm=(0.0, 0.0, 1.0), look_at_mm=(0.0, 0.0, 0.0), fov_deg=40.0)


def tables_of(text: str) -> dict[str, Any]:
    """The tables of a session.toml; none where it is no TOML."""
    try:
        return tomllib.loads(text_of(text.encode()))
    except (InputError, ValueError, RecursionError):
        return {}


def value_at(written: Any, *keys: str) -> Any:
    """What stands at some keys, one within the other; None where nothing does."""
    for key in keys:
        if not isinstance(written, dict):
            return None
        written = written.get(key)
    return written


def table_at(written: Any, *keys: str) -> dict[str, Any]:
    """The same of a table, empty where there is none."""
    table = value_at(written, *keys)
    return table if isinstance(table, dict) else {}


def name_of(written: dict[str, Any], folder: Path) -> str:
    """The session's name, that of its folder where it has none."""
    name = value_at(written, "session", "name")
    return name if isinstance(name, str) else plain(folder.name)


def orientation_of(written: dict[str, Any]) -> int:
    """How photos are turned, as EXIF numbers it."""
    stated = value_at(written, "photos", "orientation")
    return stated if isinstance(stated, int) and 1 <= stated <= 8 else AS_READ


def facts_of(written: dict[str, Any]) -> dict[str, Any]:
    """What is said of light, picture and further photos."""
    spectrum = value_at(written, "light", "spectrum")
    return {"light": spectrum if isinstance(spectrum, str) else "", "picture": "picture" in written,
            "views": list(table_at(written, "views"))}


def photos_of(written: dict[str, Any]) -> dict[str, str]:
    """The first file of every photo that is named, by what it is: "photo", "chart", "NAME",
    "NAME chart".
    """
    named = {FIRST_PHOTO: value_at(written, "photos", "object"),
             "chart": value_at(written, "photos", "chart")}
    for name, view in table_at(written, "views").items():
        named |= {name: value_at(view, "photo"), f"{name} chart": value_at(view, "chart")}
    first_files = {}
    for role, photo in named.items():
        try:
            files = [file for of_band in by_band(photo).values() for file in of_band]
        except (AttributeError, TypeError):     # no file names
            continue
        if files and isinstance(files[0], str):
            first_files[role] = files[0]
    return first_files


def corner_names(written: dict[str, Any]) -> list[str]:
    """Names of the corners that can be marked, of the box and of boxes in it; none without a box.

    Its camera may be missing or half measured: marks are what it lacks.
    """
    box = value_at(written, "scene", "box")
    if not isinstance(box, dict):
        return []
    measures = {name: value for name, value in box.items() if name not in ("camera", "colmap")}
    try:
        names = list(BoxTable(**measures, camera=ANY_CAMERA).corner_positions())
    except (ValidationError, TypeError):
        return []
    # those of the opening last: few photos show them
    return sorted(names, key=lambda name: name.startswith("front "))


def marks_of(written: dict[str, Any]) -> dict[str, Any]:
    """What can be drawn on photos: outlines of regions, corners and references."""
    return {"regions": {name: _region(region)
                        for name, region in table_at(written, "regions").items()},
            "chart_corners": _drawn(OUTLINE, value_at(written, "chart", "corners_px")),
            "box_corners": _drawn(CORNERS, value_at(written, "scene", "box", "camera",
                                                    "corners_px")),
            "references": {"chart": _drawn(OUTLINES, value_at(written, "drift", "chart_px")),
                           "object": _drawn(OUTLINES, value_at(written, "drift", "object_px"))}}


def _region(region: Any) -> dict[str, Any]:
    outline = _drawn(OUTLINE, value_at(region, "polygon"))
    rect = _drawn(RECTANGLE, value_at(region, "rect"))
    if not outline and rect is not None:
        x0, y0, x1, y1 = rect
        outline = (x0, y0), (x1, y0), (x1, y1), (x0, y1)
    stated = {key: value_at(region, key) for key in STATED}
    return {"outline": outline or (), "rect": rect is not None,
            "stated": {key: value for key, value in stated.items() if isinstance(value, str)},
            "photo": _drawn(PHOTOS, value_at(region, "photo"))}


def _drawn(kind: TypeAdapter[Any], written: Any) -> Any:
    """A value of a file as it can be drawn, or None."""
    try:
        return kind.validate_python(written)
    except ValidationError:
        return None
