"""What an operator measures of a box with a tape: the tables under [scene.box] of session.toml.

Lengths are in millimetres. The box opens towards the camera: x goes to the right, y up, z out of
the opening, and (0, 0, 0) is the middle of the opening's lower edge, so the back wall lies at z =
-depth. ``box_scene`` makes Mitsuba scenes of them.
"""
from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Annotated, Literal

from pydantic import Field, model_validator

from spectrabox.radiometry.checked_tables import ListOf, Table

Length = Annotated[float, Field(ge=0.1, le=100_000)]
Point = Annotated[ListOf[float], Field(min_length=3, max_length=3)]
Pixel = Annotated[ListOf[float], Field(min_length=2, max_length=2)]
WALLS = ("back", "ceiling", "floor", "left", "right")
CORNERS = tuple(f"{depth} {height} {side}" for depth in ("front", "back")
                for height in ("bottom", "top") for side in ("left", "right"))
MIN_CORNERS = 6
CARD_MM = (290.0, 203.0)        # of the ColorChecker Classic


def _require_upright(what: str, at: Sequence[float] | None, target: Sequence[float] | None,
                     up: Sequence[float]) -> None:
    """Refuse a view in no direction, or one along its own upright."""
    assert at is not None and target is not None
    ahead = [b - a for a, b in zip(at, target, strict=True)]
    if not any(ahead):
        raise ValueError(f"look_at_mm of the {what} is its own position; give a point that it "
                         "faces")
    (x, y, z), (u, v, w) = ahead, up
    across = math.hypot(y * w - z * v, z * u - x * w, x * v - y * u)
    if across < 1e-6 * math.hypot(x, y, z) * math.hypot(u, v, w) or not any(up):
        raise ValueError(f"up of the {what} points where it looks; give a direction across that")


class WallsTable(Table):
    """The material of each wall; what is left out is not there."""

    back: str | None = Field(None, description="material of the back wall")
    left: str | None = Field(None, description="material of the wall on the left")
    right: str | None = Field(None, description="material of the wall on the right")
    floor: str | None = Field(None, description="material of the floor")
    ceiling: str | None = Field(None, description="material of the ceiling")

    @property
    def materials(self) -> dict[str, str]:
        """Material of each wall that is there."""
        return {name: material for name in WALLS
                if (material := getattr(self, name)) is not None}


class ObjectTable(Table):
    """An object in the box."""

    name: str = Field(description="of the surface in the report")
    shape: Literal["box", "sphere", "cylinder"] = Field(description="box, sphere or cylinder")
    material: str = Field(description="its material")
    at_mm: Point = Field(description="[x, y, z]: the middle of its base; of a sphere, where it "
                         "touches the ground")
    size_mm: Point | None = Field(None, description="[x, y, z] of a box before it is turned")
    radius_mm: Length | None = Field(None, description="of a sphere or a cylinder")
    height_mm: Length | None = Field(None, description="of a cylinder, which stands upright")
    turn_deg: float = Field(0.0, ge=-360, le=360, description="about the vertical, "
                            "counter-clockwise as seen from above")
    on_turntable: bool = Field(False, description="turns with the turntable")

    @model_validator(mode="after")
    def _has_its_measures(self) -> ObjectTable:
        wanted = {"box": {"size_mm"}, "sphere": {"radius_mm"},
                  "cylinder": {"radius_mm", "height_mm"}}[self.shape]
        given = {name for name in ("size_mm", "radius_mm", "height_mm")
                 if getattr(self, name) is not None}
        if given != wanted:
            raise ValueError(f"the {self.shape} {self.name!r} needs {' and '.join(sorted(wanted))}"
                             f", and has {' and '.join(sorted(given)) or 'neither'}")
        if self.size_mm is not None and min(self.size_mm) <= 0:
            raise ValueError(f"the box {self.name!r} needs three sizes above 0, not "
                             f"{list(self.size_mm)}")
        return self


class LampTable(Table):
    """The lamp: a ball, or a panel that shines to one side."""

    at_mm: Point = Field(description="[x, y, z] of its middle")
    radius_mm: Length | None = Field(None, description="of a ball")
    size_mm: Annotated[ListOf[Length], Field(min_length=2, max_length=2)] | None = Field(
        None, description="[width, height] of a panel")
    look_at_mm: Point | None = Field(None, description="a point that the panel faces")
    beam: str | None = Field(None, description="file of a panel's measured radiance by angle")
    moved_mm: Point | None = Field(None, description="[x, y, z] from at_mm to the position that "
                                   "'spectrabox geometry light' estimated")
    moved_error_mm: Point | None = Field(None, description="standard errors of moved_mm")

    @model_validator(mode="after")
    def _is_ball_or_panel(self) -> LampTable:
        if (self.radius_mm is None) == (self.size_mm is None):
            raise ValueError("a lamp is a ball with radius_mm, or a panel with size_mm and "
                             "look_at_mm; give one of the two")
        if (self.size_mm is None) != (self.look_at_mm is None):
            raise ValueError("size_mm and look_at_mm of a lamp belong together: a panel has both, "
                             "a ball neither")
        if self.beam is not None and self.size_mm is None:
            raise ValueError("beam is of a panel, which has a direction; give size_mm and "
                             "look_at_mm in place of radius_mm")
        if self.look_at_mm is not None and self.look_at_mm == self.at_mm:
            raise ValueError("look_at_mm of the lamp is its own position; give a point that it "
                             "faces")
        if self.moved_error_mm is not None and self.moved_mm is None:
            raise ValueError("moved_error_mm of the lamp are errors of moved_mm, which is missing; "
                             "give both or neither")
        return self

    @property
    def position_mm(self) -> tuple[float, ...]:
        """Where its middle is taken to be."""
        return tuple(at + by for at, by in zip(self.at_mm, self.moved_mm or (0, 0, 0),
                                               strict=True))


class CameraTable(Table):
    """Where the camera stands: measured, or estimated from the box's corners in the photo."""

    at_mm: Point | None = Field(None, description="[x, y, z] of the lens")
    look_at_mm: Point | None = Field(None, description="a point in the middle of the photo")
    up: Point = Field((0.0, 1.0, 0.0), description="direction that is up in the photo")
    fov_deg: float | None = Field(None, ge=1, le=150, description="field of view across the "
                                  "photo's width: 2 atan(sensor width / (2 focal length))")
    corners_px: dict[str, Pixel] | None = Field(
        None, description="corners in pixels of the photo by name: \"front bottom left\" of the "
        "box, \"NAME front top left\" of a box in it as before its turn; six or more, in place of "
        "at_mm and look_at_mm")
    image: str | None = Field(None, description="name of this photo in the COLMAP model of "
                              "[scene.box.colmap], which then says where the camera stood and what "
                              "its lens is")

    @model_validator(mode="after")
    def _is_measured_or_estimated(self) -> CameraTable:
        measured = [name for name in ("at_mm", "look_at_mm") if getattr(self, name) is not None]
        if self.image is not None:
            others = [name for name in ("at_mm", "look_at_mm", "fov_deg", "corners_px")
                      if getattr(self, name) is not None]
            if others:
                raise ValueError(f"the camera has image and {' and '.join(others)}: the COLMAP "
                                 "model says where it stood and what it sees; leave one out")
            return self
        if self.corners_px is None:
            missing = [name for name in ("at_mm", "look_at_mm", "fov_deg")
                       if getattr(self, name) is None]
            if missing:
                raise ValueError(f"the camera lacks {', '.join(missing)}: measure it, or mark "
                                 "corners of the box in the photo as corners_px")
            _require_upright("camera", self.at_mm, self.look_at_mm, self.up)
            return self
        if measured:
            raise ValueError(f"the camera has corners_px and {' and '.join(measured)}: its pose "
                             "is either estimated from the corners or measured; leave one out")
        if len(self.corners_px) < MIN_CORNERS:
            raise ValueError(f"corners_px has {len(self.corners_px)} corners; {MIN_CORNERS} or "
                             "more are needed: of the opening, the back wall, objects")
        return self

    @property
    def measured(self) -> bool:
        """Whether it stands where a tape says, not where corners or a model say."""
        return self.corners_px is None and self.image is None


class ColmapTable(Table):
    """A COLMAP model of the box's photos, and what ties it to the box."""

    folder: str = Field(description="with the model as text: cameras.txt and images.txt")
    corners_px: Annotated[dict[str, dict[str, Pixel]], Field(min_length=2)] = Field(
        description="corners of the box, and of boxes in it, by picture of the model: "
        "{\"IMG_1.jpg\" = {\"back top left\" = [x, y]}}; three or more that two pictures show, "
        "better six")


class ChartPlaceTable(Table):
    """Where the chart stood under the lamp, in the same coordinates."""

    at_mm: Point = Field(description="[x, y, z] of its middle")
    look_at_mm: Point = Field(description="a point that it faces, the lamp say")
    up: Point = Field((0.0, 1.0, 0.0), description="direction from its last row to its first")
    size_mm: Annotated[ListOf[Length], Field(min_length=2, max_length=2)] = Field(
        CARD_MM, description="[width, height] of the printed card")
    lamp_at_mm: Point | None = Field(None, description="where the lamp stood for the chart photo, "
                                     "if not where it stood for the box")

    @model_validator(mode="after")
    def _faces_somewhere(self) -> ChartPlaceTable:
        _require_upright("chart", self.at_mm, self.look_at_mm, self.up)
        return self


class BoxTable(Table):
    """A box with objects, a lamp and a camera; lengths inside."""

    width_mm: Length = Field(description="inside, from left to right")
    height_mm: Length = Field(description="inside")
    depth_mm: Length = Field(description="inside, from the opening to the back wall")
    walls: WallsTable = Field(WallsTable(), description="material of each wall")
    objects: ListOf[ObjectTable] = Field((), description="what stands in it")
    turntable_mm: Annotated[ListOf[float], Field(min_length=2, max_length=2)] | None = Field(
        None, description="[x, z] of a turntable's axis; views then have turn_deg")
    lamp: LampTable = Field(description="the one lamp")
    camera: CameraTable = Field(description="of the box's photo")
    colmap: ColmapTable | None = Field(None, description="a COLMAP model that says where cameras "
                                       "with an image stood")
    chart: ChartPlaceTable | None = Field(None, description="of the chart photo")

    @model_validator(mode="after")
    def _has_surfaces_of_different_names(self) -> BoxTable:
        names = [*self.walls.materials, *(one.name for one in self.objects)]
        if not names:
            raise ValueError("the box has neither walls nor objects; name the material of a wall "
                             "in [scene.box.walls]")
        if twice := next((name for name in names if names.count(name) > 1), None):
            raise ValueError(f"two surfaces of the box are called {twice!r}; rename one")
        if (fault := self.corner_fault(self.camera)) is not None:
            raise ValueError(fault)
        if reserved := {"lamp", "chart"}.intersection(names):
            raise ValueError(f"an object cannot be called {sorted(reserved)[0]!r}; rename it")
        return self

    @model_validator(mode="after")
    def _ties_what_stands_still(self) -> BoxTable:
        turning = [one.name for one in self.objects if one.on_turntable]
        for picture, corners in (self.colmap.corners_px if self.colmap else {}).items():
            if (fault := self._unknown_corner(corners)) is not None:
                raise ValueError(f"{picture} of colmap: {fault}")
            for name in corners:
                if any(name.startswith(f"{one} ") for one in turning):
                    raise ValueError(f"{picture} of colmap marks {name!r}, which turns with the "
                                     "turntable; mark corners that stand still")
        return self

    def corner_fault(self, camera: CameraTable) -> str | None:
        """What is wrong with a camera of this box, as a sentence; None where nothing is.

        Parameters
        ----------
        camera : CameraTable
        """
        if camera.image is not None and self.colmap is None:
            return (f"the camera's image {camera.image!r} is one of a COLMAP model, and none is "
                    "named; add [scene.box.colmap] with folder and corners_px")
        return self._unknown_corner(camera.corners_px or ())

    def _unknown_corner(self, named: Iterable[str]) -> str | None:
        if unknown := set(named) - set(self.corner_positions()):
            return (f"corners_px names {sorted(unknown)[0]!r}; corners are "
                    f"{', '.join(map(repr, self.corner_positions()))}")
        return None

    @model_validator(mode="after")
    def _has_a_turntable_for_what_turns(self) -> BoxTable:
        turning = [one.name for one in self.objects if one.on_turntable]
        if turning and self.turntable_mm is None:
            raise ValueError(f"{turning[0]!r} is on_turntable, but turntable_mm does not say where "
                             "its axis stands; add turntable_mm = [x, z] to [scene.box]")
        return self

    @property
    def materials(self) -> tuple[str, ...]:
        """Every material that walls and objects name, once."""
        named = [*self.walls.materials.values(), *(one.material for one in self.objects)]
        return tuple(dict.fromkeys(named))

    def turned(self, angle_deg: float) -> BoxTable:
        """The box after its turntable has turned, counter-clockwise as seen from above.

        Parameters
        ----------
        angle_deg : float
        """
        if not angle_deg or self.turntable_mm is None:
            return self
        cosine, sine = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
        x0, z0 = self.turntable_mm

        def moved(one: ObjectTable) -> ObjectTable:
            across, ahead = one.at_mm[0] - x0, one.at_mm[2] - z0
            at_mm = (x0 + cosine * across + sine * ahead, one.at_mm[1],
                     z0 - sine * across + cosine * ahead)
            return one.model_copy(update={"at_mm": at_mm, "turn_deg": one.turn_deg + angle_deg})

        return self.model_copy(update={"objects": tuple(
            moved(one) if one.on_turntable else one for one in self.objects)})

    def lit_from(self, at_mm: Sequence[float] | None) -> BoxTable:
        """The box with its lamp in another place, facing what it faced; None leaves it there.

        Parameters
        ----------
        at_mm : [x, y, z] or None
        """
        if at_mm is None:
            return self
        lamp = self.lamp.model_copy(update={"at_mm": tuple(at_mm), "moved_mm": None,
                                            "moved_error_mm": None})
        return self.model_copy(update={"lamp": lamp})

    def corner_positions(self) -> dict[str, tuple[float, float, float]]:
        """Corners in millimetres by name: the eight inner ones, and those of boxes in it."""
        inner = (self.width_mm, self.height_mm, self.depth_mm)
        positions = _corners(inner, (0.0, 0.0, -self.depth_mm / 2), 0.0)
        for one in self.objects:
            if one.size_mm is not None:
                positions |= {f"{one.name} {corner}": position for corner, position in
                              _corners(one.size_mm, one.at_mm, one.turn_deg).items()}
        return positions


def _corners(size: Sequence[float], at: Sequence[float],
             turn_deg: float) -> dict[str, tuple[float, float, float]]:
    """Corners of a box by name, which stands on the middle of its base and is turned there."""
    (width, height, depth), (x, y, z) = size, at
    cosine, sine = math.cos(math.radians(turn_deg)), math.sin(math.radians(turn_deg))
    corners = {}
    for name in CORNERS:
        near, level, side = name.split()
        across = width / 2 if side == "right" else -width / 2
        ahead = depth / 2 if near == "front" else -depth / 2
        up = height if level == "top" else 0.0
        corners[name] = (x + cosine * across + sine * ahead, y + up,
                         z - sine * across + cosine * ahead)
    return corners
