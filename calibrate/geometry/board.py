"""A printed ChArUco board and its pose in the scene; points of the scene picked in a photo."""
from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from spectrabox.radiometry import checked_tables, errors

MIN_SQUARES = 3
Vector = Annotated[checked_tables.ListOf[float], Field(min_length=3, max_length=3)]
Pixel = Annotated[checked_tables.ListOf[float], Field(min_length=2, max_length=2)]
POSE_KEYS = ("origin", "right", "down")
ADVICE = "see docs/how-to/geometry.md"
SQUARE_ANGLE = 1e-3     # radians: how far from a right angle the two directions of a board may be


class Board(checked_tables.Table):
    """A board as its file describes it, lengths in the scene's unit.

    Its corner, at the top left as printed, lies at ``origin``, its edges along ``right`` and
    ``down``.
    """

    columns: int = Field(ge=MIN_SQUARES)
    rows: int = Field(ge=MIN_SQUARES)
    square: float
    marker: float
    dictionary: str = "DICT_5X5_100"
    legacy: bool = False            # with the pattern of OpenCV before 4.6
    origin: Vector | None = None
    right: Vector | None = None
    down: Vector | None = None

    @model_validator(mode="after")
    def markers_lie_in_squares(self) -> Board:
        """Refuse a marker that would not fit."""
        if not 0 < self.marker < self.square:
            raise ValueError(f"the marker is {self.marker:g} and the square {self.square:g} wide; "
                             "the marker must lie inside its square, and both be greater than 0")
        return self

    @model_validator(mode="after")
    def edges_are_at_a_right_angle(self) -> Board:
        """Refuse a pose in the scene that is stated in part, or askew."""
        stated = [name for name in POSE_KEYS if getattr(self, name) is not None]
        if stated and len(stated) < len(POSE_KEYS):
            raise ValueError(f"{', '.join(stated)} alone does not say where the board lies; give "
                             f"{', '.join(POSE_KEYS)}")
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


class PointTable(checked_tables.Table):
    """A point of the scene and where the photo shows it."""

    scene: Vector
    px: Pixel


class PointsFile(checked_tables.Table):
    """A file of points."""

    points: dict[str, PointTable] = Field(min_length=1)


def read_board(path: Path) -> Board:
    """A board as its TOML file describes it.

    Parameters
    ----------
    path : Path

    Raises
    ------
    InputError
        Naming every key that is unknown, missing or wrong.
    """
    return checked_tables.checked(Board, checked_tables.read_toml(path, ADVICE), path.name)


def in_scene(board: Board, positions: np.ndarray, name: str) -> np.ndarray:
    """Positions (n, 3) in the scene of points in the board's plane.

    Parameters
    ----------
    board : Board
    positions : (n, 3) array
        In the board's plane, the scene's unit; the third coordinate is 0.
    name : str
        Of the board's file, for errors.

    Raises
    ------
    InputError
        If the board's file does not say where it lies.
    """
    axes = board.axes()
    if axes is None:
        raise errors.InputError(
            f"{name} does not say where the board lies in the scene; add origin = [x, "
            "y, z] (its top-left corner as printed), right = [x, y, z] and down = [x, "
            "y, z] (the directions of its edges)")
    return np.asarray(axes[0] + positions[:, :2] @ axes[1:])


def read_points(path: Path) -> tuple[tuple[str, ...], np.ndarray, np.ndarray]:
    """Points from a TOML file: ``[points.NAME]`` with ``scene = [x, y, z]`` and ``px = [x, y]``
    each.

    Parameters
    ----------
    path : Path

    Returns
    -------
    names : tuple of str
    positions : (n, 3) array
        In the scene, in its unit.
    points_px : (n, 2) array
        Where a photo shows them; (0, 0) is the centre of its first pixel.

    Raises
    ------
    InputError
        Naming every point and what is wrong with it.
    """
    points = checked_tables.checked(PointsFile, checked_tables.read_toml(path, ADVICE),
                                    path.name).points
    return (tuple(points), np.array([point.scene for point in points.values()]),
            np.array([point.px for point in points.values()]))
