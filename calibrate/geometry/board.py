"""A printed ChArUco board and where it lies in the scene; points of the scene that an operator
picked in a photo.
"""
from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.shaped import Record

BOARD_KEYS = {"columns", "rows", "square", "marker", "dictionary", "legacy", "origin", "right",
              "down"}
MIN_SQUARES = 3
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


def read_board(path: Path) -> Board:
    """A board as its TOML file describes it.

    Raises
    ------
    InputError
        Naming the key that is unknown, missing or wrong.
    """
    written = _toml(path)
    if unknown := sorted(set(written) - BOARD_KEYS):
        raise InputError(f"{path.name}: unknown key {unknown[0]!r}; known are "
                         f"{', '.join(sorted(BOARD_KEYS))}")
    columns, rows = written.get("columns"), written.get("rows")
    if not (isinstance(columns, int) and isinstance(rows, int) and min(columns, rows)
            >= MIN_SQUARES):
        raise InputError(f"{path.name}: columns and rows are {columns} and {rows}; whole numbers "
                         f"of squares, {MIN_SQUARES} or more, are needed")
    square, marker = (_number(written.get(name), name, path) for name in ("square", "marker"))
    if not 0 < marker < square:
        raise InputError(f"{path.name}: the marker is {marker:g} and the square {square:g} wide; "
                         "the marker must lie inside its square, and both be greater than 0")
    place = [written.get(name) for name in ("origin", "right", "down")]
    axes = None
    if any(vector is not None for vector in place):
        axes = np.array([_vector(vector, name, 3, path)
                         for vector, name in zip(place, ("origin", "right", "down"), strict=True)])
        lengths = np.linalg.norm(axes[1:], axis=1)
        if not np.all(lengths > 0) or abs(axes[1] @ axes[2]) > SQUARE_ANGLE * lengths.prod():
            raise InputError(f"{path.name}: right and down must be two directions at a right angle")
        axes[1:] /= lengths[:, None]
    return Board(columns, rows, square, marker, str(written.get("dictionary", Board.dictionary)),
                 bool(written.get("legacy", False)), axes)


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
        Naming the point and what is wrong with it.
    """
    written = _toml(path)
    points = written.get("points")
    if not isinstance(points, dict) or not points or set(written) != {"points"}:
        raise InputError(f"{path.name} must hold one table [points.NAME] for each point, and "
                         "nothing else")
    places, pixels = [], []
    for name, point in points.items():
        if not isinstance(point, dict) or set(point) != {"scene", "px"}:
            raise InputError(f"{path.name}: point {name!r} must have scene = [x, y, z] and px = "
                             "[x, y]")
        places.append(_vector(point["scene"], f"points.{name}.scene", 3, path))
        pixels.append(_vector(point["px"], f"points.{name}.px", 2, path))
    return ScenePoints(tuple(points), np.array(places), np.array(pixels))


def _toml(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}); give its right name") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path.name} is not valid TOML: {error}") from None


def _number(value: Any, name: str, path: Path) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
        raise InputError(f"{path.name}: {name} is {value!r}; a number is needed")
    return float(value)


def _vector(value: Any, name: str, size: int, path: Path) -> np.ndarray:
    if not isinstance(value, list) or len(value) != size:
        raise InputError(f"{path.name}: {name} is {value!r}; {size} numbers in brackets are needed")
    return np.array([_number(part, name, path) for part in value])
