"""A photo of a white wall that a lamp shines at: what lies where, in millimetres on the wall.

A rectangle is marked on the wall. x goes to the right, y up, z out of the wall; (0, 0, 0) is the
rectangle's lower left corner.
"""
from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from spectrabox.calibrate.geometry.lens import Lens, pinhole
from spectrabox.calibrate.geometry.projection import image_rays
from spectrabox.radiometry.checked_tables import ListOf, Table, checked, read_toml
from spectrabox.radiometry.errors import CheckError, InputError
from spectrabox.radiometry.records import LinearImage
from spectrabox.radiometry.shaped import Record

ADVICE = "see docs/how-to/box.md"
CELLS = 64              # along the rectangle's longer side, of which each is one reading
MIN_CELLS = 200
MAX_SATURATED = 0.02    # of the rectangle
Length = Annotated[float, Field(ge=0.1, le=100_000)]
Pair = Annotated[ListOf[float], Field(min_length=2, max_length=2)]
Point = Annotated[ListOf[float], Field(min_length=3, max_length=3)]


class WallTable(Table):
    """A file that says where rectangle and lamp are; lengths in millimetres."""

    corners_px: Annotated[ListOf[Pair], Field(min_length=4, max_length=4)] = Field(
        description="corners of the rectangle in pixels of the photo, going round from the one "
        "that is top left on the wall: top left, top right, bottom right, bottom left")
    size_mm: Annotated[ListOf[Length], Field(min_length=2, max_length=2)] = Field(
        description="[width, height] of the rectangle")
    lamp_at_mm: Point = Field(description="[x, y, z] of the middle of the lamp's opening: to the "
                              "right and up from the rectangle's lower left corner, out of the "
                              "wall")
    lamp_size_mm: Annotated[ListOf[Length], Field(min_length=2, max_length=2)] = Field(
        description="[width, height] of its opening")
    lamp_look_at_mm: Pair | None = Field(None, description="[x, y] on the wall that it is aimed "
                                         "at; straight ahead where left out")
    lamp_error_mm: float = Field(3.0, ge=0, le=1000, description="standard error of lamp_at_mm "
                                 "along each axis")

    @model_validator(mode="after")
    def _stands_before_the_wall(self) -> WallTable:
        if self.lamp_at_mm[2] <= max(self.lamp_size_mm):
            raise ValueError(f"lamp_at_mm puts the lamp {self.lamp_at_mm[2]:g} mm out of the wall; "
                             "it must stand further away than its opening is wide")
        return self

    @model_validator(mode="after")
    def _has_corners_that_go_round(self) -> WallTable:
        corners = np.array(self.corners_px)
        edges = np.roll(corners, -1, axis=0) - corners
        after = np.roll(edges, -1, axis=0)
        turns = edges[:, 0] * after[:, 1] - edges[:, 1] * after[:, 0]
        if not (np.all(turns > 0) or np.all(turns < 0)):
            raise ValueError("corners_px do not go round: top left, top right, bottom right, "
                             "bottom left")
        if turns[0] < 0:
            raise ValueError("corners_px go round counter-clockwise: top left, top right, bottom "
                             "right, bottom left as the photo shows them")
        return self


@dataclass(frozen=True, eq=False)
class WallCells(Record):
    """Readings of the wall, each the mean over a small square of it."""

    places_mm: Annotated[np.ndarray, "n 2"]
    signal: Annotated[np.ndarray, "n K"]
    variance: Annotated[np.ndarray, "n K"]


def read_wall(path: Path) -> WallTable:
    """Where rectangle and lamp are, as a TOML file says.

    Parameters
    ----------
    path : Path

    Raises
    ------
    InputError
        Naming every key that is unknown, missing or wrong.
    """
    return checked(WallTable, read_toml(path, ADVICE), path.name)


def wall_cells(photo: LinearImage, wall: WallTable, lens: Lens | None = None) -> WallCells:
    """What the photo shows inside the rectangle, by place on the wall.

    Parameters
    ----------
    photo : LinearImage
        Binned or not; undistorted where a lens is given.
    wall : WallTable
    lens : Lens, optional
        By which the photo was undistorted; corners are of the photo before.

    Raises
    ------
    InputError
        If corners lie outside the photo.
    CheckError
        If part of the rectangle is saturated, or too little of it can be read.
    """
    corners = np.array(wall.corners_px)
    height, width = photo.signal.shape[:2]
    limit = np.array([width, height]) * photo.sensor_step
    if np.any(corners < -0.5) or np.any(corners > limit - 0.5):
        raise InputError(f"corners_px lie outside the photo of {limit[0]:.0f} x {limit[1]:.0f} "
                         "pixels; give [x, y] in pixels of the whole photo")
    if lens is not None:
        rays = image_rays(corners, lens) @ pinhole(lens).T
        corners = rays[:, :2] / rays[:, 2:]
    down, across = np.mgrid[0:height, 0:width]
    pixels = (np.stack([across, down], axis=-1) + 0.5) * photo.sensor_step - 0.5
    place = _on_wall(pixels.reshape(-1, 2), corners, wall.size_mm)
    inside = np.all((place > 0) & (place < wall.size_mm), axis=1)
    saturated = photo.saturated.any(axis=2).ravel()
    share = float(saturated[inside].mean()) if inside.any() else 0.0
    if share > MAX_SATURATED:
        raise CheckError(f"{share:.0%} of the rectangle is saturated; halve the exposure until the "
                         "middle of the beam is not")
    used = inside & ~saturated
    side = max(wall.size_mm) / CELLS
    columns = int(np.ceil(wall.size_mm[0] / side))
    cell = (place[used] // side).astype(int) @ [1, columns]
    _, cell, count = np.unique(cell, return_inverse=True, return_counts=True)
    if len(count) < MIN_CELLS:
        raise CheckError(f"{len(count)} of {CELLS} x {CELLS} squares of the rectangle can be read, "
                         f"{MIN_CELLS} are needed; photograph it larger")
    bands = photo.signal.shape[2]

    def mean(values: np.ndarray) -> np.ndarray:
        return np.stack([np.bincount(cell, column) / count for column in values.T], axis=1)

    return WallCells(mean(place[used]), mean(photo.signal.reshape(-1, bands)[used].astype(float)),
                     mean(photo.variance.reshape(-1, bands)[used].astype(float)) / count[:, None])


def _on_wall(pixels: np.ndarray, corners: np.ndarray, size_mm: tuple[float, ...]) -> np.ndarray:
    """Places (n, 2) on the wall of pixels, by the homography of four corners."""
    width, height = size_mm
    wall = np.array([[0, height], [width, height], [width, 0], [0, 0]])
    rows, target = [], []
    for (x, y), (u, v) in zip(corners, wall, strict=True):
        rows += [[x, y, 1, 0, 0, 0, -u * x, -u * y], [0, 0, 0, x, y, 1, -v * x, -v * y]]
        target += [u, v]
    matrix = np.append(np.linalg.solve(np.array(rows), np.array(target)), 1.0).reshape(3, 3)
    homogeneous = np.column_stack([pixels, np.ones(len(pixels))]) @ matrix.T
    # beyond the horizon the sign turns: never inside the rectangle
    safe = np.where(homogeneous[:, 2:] > 0, homogeneous[:, 2:], np.nan)
    return np.nan_to_num(homogeneous[:, :2] / safe, nan=-1.0)
