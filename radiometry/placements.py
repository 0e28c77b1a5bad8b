"""Where lamp and cameras of a scene stand, as records: apart from what estimates them."""
from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from spectrabox.radiometry.shaped import Record

SCENE_UNIT, MM = "scene's unit", "mm"


@dataclass(frozen=True, eq=False)
class Placement(Record):
    """A lamp or camera: its stated position, the one that is used, and how that is known."""

    what: str
    how: str
    unit: str                                               # ``MM`` or ``SCENE_UNIT``
    stated: Annotated[np.ndarray, "3"] | None
    place: Annotated[np.ndarray, "3"] | None
    moved: Annotated[np.ndarray, "3"] | None                # from the stated position
    standard_error: Annotated[np.ndarray, "3"] | None


@dataclass(frozen=True, eq=False)
class MarkedView(Record):
    """A photo with a box's edges and marked corners, in shares of its width and height."""

    name: str                                               # empty of the first
    edges: Annotated[np.ndarray, "m 2 2"]
    corners: tuple[str, ...]
    marked: Annotated[np.ndarray, "n 2"]
    seen: Annotated[np.ndarray, "n 2"]                      # where the camera sees them
    residuals_px: Annotated[np.ndarray, "n"]


@dataclass(frozen=True, eq=False)
class SceneGeometry(Record):
    """What was estimated of a scene; empty where everything stands as stated."""

    placements: tuple[Placement, ...]
    views: tuple[MarkedView, ...]
