"""A printed ChArUco board and where it lies in the scene; points of the scene that an operator
picked in a photo.
"""
from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from spectrabox.radiometry.checked_tables import ListOf, Table, checked, read_toml
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.shaped import Record

MIN_SQUARES = 3
Vector = Annotated[ListOf[float], Field(min_length=3, max_length=3)]
Pixel = Annotated[ListOf[float], Field(min_length=2, max_length=2)]
PLACE = ("origin", "right", "down")
ADVICE = "see docs/how-to/geometry.md"
SQUARE_ANGLE = 1e-3     # radians: how far from a right angle the two directions of a board may be


@dataclass(frozen=True, eq=False)
class Board(Record):
    """Lengths in the scene's unit. Its corner, at the top left as printed, lies at ``origin``."""

    columns: int
    rows: int
    square: float
    marker: float
    dictionary: str = "DICT_5X5_100"
    legacy: bool = False  # printed with the pattern of OpenCV before 4.6
    # rows: origin, direction to the right, direction down
    axes: Annotated[np.ndarray, "3 3"] | None = None


@dataclass(frozen=True, eq=False)
class ScenePoints(Record):
    """Points that are known in the scene and seen in a photo; (0, 0) is the centre of its top-left
    pixel.
    """

    names: tuple[str, ...]
    places: Annotated[np.ndarray, "n 3"]                    # the scene's unit
    points_px: Annotated[np.ndarray, "n 2"]


class BoardTable(Table):
    """A board file."""

    columns: int = Field(ge=MIN_SQUARES)
    rows: int = Field(ge=MIN_SQUARES)
    square: float
    marker: float
    dictionary: str = Board.dictionary
    legacy: bool = Board.legacy
    origin: Vector | None = None
    right: Vector | None = None
    down: Vector | None = None

    @model_validator(mode="after")
    def markers_lie_in_squares(self) -> BoardTable:
        """Refuse a marker that would not fit."""
        if not 0 < self.marker < self.square:
            raise ValueError(f"the marker is {self.marker:g} and the square {self.square:g} wide; "
                             "the marker must lie inside its square, and both be greater than 0")
        return self

    @model_validator(mode="after")
    def edges_are_at_a_right_angle(self) -> BoardTable:
        """Refuse a place in the scene that is stated in part, or askew."""
        stated = [name for name in PLACE if getattr(self, name) is not None]
        if stated and len(stated) < len(PLACE):
            raise ValueError(f"{', '.join(stated)} alone does not say where the board lies; give "
                             f"{', '.join(PLACE)}")
        if stated and self.axes() is None:
            raise ValueError("right and down must be two directions at a right angle")
        return self

    def axes(self) -> np.ndarray | None:
        """Origin and unit directions (3, 3); None where they are not stated or askew."""
        if self.origin is None or self.right is None or self.down is None:
            return None
        axes = np.array([self.origin, self.right, self.down])
        lengths = np.linalg.norm(axes[1:], axis=1)
        if not np.all(lengths > 0) or abs(axes[1] @ axes[2]) > SQUARE_ANGLE * lengths.prod():
            return None
        axes[1:] /= lengths[:, None]
        return axes


class PointTable(Table):
    """A point of the scene and where the photo shows it."""

    scene: Vector
    px: Pixel


class PointsFile(Table):
    """A file of points."""

    points: dict[str, PointTable] = Field(min_length=1)


def read_board(path: Path) -> Board:
    """A board as its TOML file describes it.

    Raises
    ------
    InputError
        Naming every key that is unknown, missing or wrong.
    """
    table = checked(BoardTable, read_toml(path, ADVICE), path.name)
    return Board(table.columns, table.rows, table.square, table.marker, table.dictionary,
                 table.legacy, table.axes())


def in_scene(board: Board, places: np.ndarray, name: str) -> np.ndarray:
    """Places (n, 3) in the board's plane as places of the scene.

    Raises
    ------
    InputError
        If the board's file does not say where it lies.
    """
    if board.axes is None:
        raise InputError(f"{name} does not say where the board lies in the scene; add origin = [x, "
                         "y, z] (its top-left corner as printed), right = [x, y, z] and down = [x, "
                         "y, z] (the directions of its edges)")
    return board.axes[0] + places[:, :2] @ board.axes[1:]


def read_points(path: Path) -> ScenePoints:
    """Points from a TOML file: ``[points.NAME]`` with ``scene = [x, y, z]`` and ``px = [x, y]``
    each.

    Raises
    ------
    InputError
        Naming every point and what is wrong with it.
    """
    points = checked(PointsFile, read_toml(path, ADVICE), path.name).points
    return ScenePoints(tuple(points), np.array([point.scene for point in points.values()]),
                       np.array([point.px for point in points.values()]))
