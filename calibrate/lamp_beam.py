"""A lamp's radiance by angle from a white wall that it shines at, with standard errors.

The wall scatters evenly: a reading is the wall's irradiance E at its place, up to a factor. For a
panel that shines alike around its axis,

    E(x) = sum over the panel of L(theta) cos(theta) cos(theta') / r^2,

theta being the angle from the panel's normal and theta' that from the wall's; for a small panel
that faces the wall this is L cos^4 / d^2. L is a cubic spline in theta with slope 0 ahead, so E is
linear in its coefficients; where the beam's axis meets the wall is found along with it. The errors
are a jackknife over sectors about the axis, between which a beam that is not round differs, or over
tiles of the wall, between which paint that is not even does, whichever is larger; and how the
profile follows the lamp's place within its error.
"""
from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator
from scipy.interpolate import BSpline
from scipy.optimize import least_squares

from spectrabox.calibrate.geometry.lens import Lens, pinhole
from spectrabox.calibrate.geometry.projection import image_rays
from spectrabox.radiometry import checked_tables, errors, shaped
from spectrabox.radiometry.records.photos import LinearImage

QUADRATURE = 3          # points along each side of the panel; while its axis is looked for, 1
SPACINGS_DEG = (2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 20.0)    # of knots; the likeliest is taken
SEARCH_DEG = 6.0        # of knots while the axis is looked for
DEGREE = 3
EVEN = 0.01             # relative: how even a painted wall is from place to place
FLOOR = 0.002           # of the brightest reading: light that is not the lamp's
SECTORS = 12
TILES = 8               # along the rectangle's longer side
MIN_SECTORS = 4         # that must see an angle
RING_DEG, RING_CELLS = 2.0, 3.0     # width of a ring, and the least in readings side by side
STEP_DEG = 1.0          # of the table
RIDGE = 1e-9            # of the largest diagonal: angles that no reading sees stay near 0
BRIGHT = 0.1            # of the radiance ahead: below, a relative difference says nothing


@dataclass(frozen=True, eq=False)
class BeamProfile(shaped.Record):
    """Radiance by angle from the axis, 1 straight ahead, and how far it holds."""

    angle_deg: Annotated[np.ndarray, "J"]
    radiance: Annotated[np.ndarray, "J"]
    standard_error: Annotated[np.ndarray, "J"]
    axis_mm: Annotated[np.ndarray, "2"]     # where the axis meets the wall
    off_axis_deg: float                     # between it and the stated aim of the lamp
    residual_rms: float                     # relative, over readings that are not dark
    asymmetry: float                        # largest relative difference of a sector
    band_difference: float                  # largest of a band's own profile, of 1 ahead


def fit_beam(places_mm: np.ndarray, signal: np.ndarray, variance: np.ndarray,
             wall: WallTable) -> BeamProfile:
    """The profile of the lamp's beam.

    Parameters
    ----------
    places_mm, signal, variance : (n, 2), (n, K) and (n, K) arrays
        Readings of the wall, from `wall_cells`.
    wall : WallTable

    Raises
    ------
    CheckError
        If the wall is dark, or the rectangle does not hold the place that the lamp faces.
    """
    level = signal.mean(axis=0)
    if not np.all(level > 0):
        raise errors.CheckError(
            "the rectangle is dark: its mean signal is 0 or less; give a longer "
            "exposure, or the dark frame of this exposure")
    reading, noise = _mean_over_bands(signal, variance, level)
    deviation = np.sqrt(noise + (EVEN * reading) ** 2 + (FLOOR * reading.max()) ** 2)
    lamp_at, lamp_size = np.array(wall.lamp_at_mm), np.array(wall.lamp_size_mm)
    aimed = np.array(wall.lamp_at_mm[:2] if wall.lamp_look_at_mm is None else wall.lamp_look_at_mm)
    axis = _beam_axis(places_mm, reading, deviation, lamp_at, lamp_size, aimed)
    angle, sector = _angles(places_mm, lamp_at, axis)
    apart = np.sqrt(np.prod(wall.size_mm) / len(angle)) / wall.lamp_at_mm[2]
    top = _seen_all_around(angle, sector, max(RING_DEG, RING_CELLS * float(np.degrees(apart))))
    kept = angle <= top
    places, sector = places_mm[kept], sector[kept]
    reading, deviation = reading[kept], deviation[kept]

    def whitened(lamp_at: np.ndarray, knots: np.ndarray) -> np.ndarray:
        return _irradiance(places, lamp_at, lamp_size, axis, knots) / deviation[:, None]

    def bic(rows: np.ndarray) -> float:
        """Schwarz's criterion, of residuals whose scatter is not known."""
        count, residuals = len(target), target - rows @ _solved(rows, target)
        return float(count * np.log(np.mean(residuals**2)) + rows.shape[1] * np.log(count))

    target = reading / deviation
    fits = [(knots, whitened(lamp_at, knots)) for knots in (
        _knots(top, spacing) for spacing in SPACINGS_DEG if spacing < top / 2)]
    knots, rows = min(fits, key=lambda fit: bic(fit[1]))
    table = np.append(np.arange(0.0, top, STEP_DEG), top)

    def radiance(rows: np.ndarray, target: np.ndarray) -> np.ndarray:
        """At the angles of the table, 1 straight ahead, nowhere below 0."""
        coefficients = _solved(rows, target)
        values = _splines(table, knots) @ coefficients
        ahead = float((_splines(np.zeros(1), knots) @ coefficients)[0])
        return np.asarray(np.maximum(values / ahead, 0.0)) if ahead > 0 else np.zeros(len(values))

    def jackknife(group: np.ndarray) -> np.ndarray:
        """Variance of the radiance, by leaving out one group at a time."""
        left_out = np.array([radiance(rows[group != one], target[group != one])
                             for one in np.unique(group)])
        count = len(left_out)
        return np.asarray((count - 1) / count * np.sum((left_out - left_out.mean(axis=0)) ** 2,
                                                       axis=0))

    profile = radiance(rows, target)
    tile = (places // (max(wall.size_mm) / TILES)).astype(int) @ [1, TILES]
    squared_error = np.maximum(jackknife(sector), jackknife(tile))
    for shift in wall.lamp_error_mm * np.eye(3):
        squared_error += (radiance(whitened(lamp_at + shift, knots), target) - profile) ** 2
    predicted = rows @ _solved(rows, target) * deviation
    bright = predicted > BRIGHT * predicted.max()
    ratio = reading / predicted
    by_sector = [float(np.mean(ratio[bright & (sector == one)])) for one in range(SECTORS)
                 if np.any(bright & (sector == one))]
    own = [radiance(rows, band / deviation) for band in (signal[kept] / level).T]
    cosine = float(np.clip(_normal(lamp_at, axis) @ _normal(lamp_at, aimed), -1, 1))
    return BeamProfile(
        table, profile, np.sqrt(squared_error), axis, float(np.degrees(np.arccos(cosine))),
        float(np.sqrt(np.mean((ratio[bright] - 1) ** 2))),
        float(np.max(np.abs(np.array(by_sector) - 1))),
        float(np.max(np.abs(np.array(own) - profile))))


def _mean_over_bands(signal: np.ndarray, variance: np.ndarray,
                     level: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Readings (n,) relative to the level (K,) of each band, and the variance of their noise."""
    return (signal / level).mean(axis=1), (variance / level**2).sum(axis=1) / len(level) ** 2


# Below, a panel of ``lamp_size`` (2,) stands at ``lamp_at`` (3,), and ``axis`` (2,) is where its
# normal meets the wall, all in mm on the wall's axes.

def _normal(lamp_at: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """Unit direction (3,) of the panel."""
    ahead = np.append(axis, 0.0) - lamp_at
    return np.asarray(ahead / np.linalg.norm(ahead))


def _sides(normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit directions (3,) of the panel's sides: across, and up."""
    upright = np.array([0.0, 1.0, 0.0]) if abs(normal[1]) < 0.99 else np.array([0.0, 0.0, 1.0])
    across = np.cross(upright, normal)
    across /= np.linalg.norm(across)
    return across, np.cross(normal, across)


def _angles(places: np.ndarray, lamp_at: np.ndarray,
            axis: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Angle in degrees and sector about the axis, of places (n, 2), from the panel's middle."""
    ray = np.column_stack([places, np.zeros(len(places))]) - lamp_at
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    normal = _normal(lamp_at, axis)
    across, up = _sides(normal)
    angle = np.degrees(np.arccos(np.clip(ray @ normal, -1, 1)))
    turn = np.arctan2(ray @ up, ray @ across) / (2 * np.pi) % 1.0
    return angle, np.minimum((turn * SECTORS).astype(int), SECTORS - 1)


def _irradiance(places: np.ndarray, lamp_at: np.ndarray, lamp_size: np.ndarray, axis: np.ndarray,
                knots: np.ndarray, quadrature: int = QUADRATURE) -> np.ndarray:
    """Irradiance (n, N) at places (n, 2) of each spline of the radiance, up to a factor."""
    nodes, weights = np.polynomial.legendre.leggauss(quadrature)
    normal = _normal(lamp_at, axis)
    across, up = _sides(normal)
    wall = np.column_stack([places, np.zeros(len(places))])
    total = np.zeros((len(places), len(knots) - DEGREE - 2))
    for u, weight_u in zip(nodes, weights, strict=True):
        for v, weight_v in zip(nodes, weights, strict=True):
            ray = wall - (lamp_at + (u * lamp_size[0] * across + v * lamp_size[1] * up) / 2)
            squared = np.sum(ray**2, axis=1)
            length = np.sqrt(squared)
            ahead = np.clip(ray @ normal / length, 0, 1)
            factor = weight_u * weight_v * ahead * (-ray[:, 2] / length) / squared
            total += factor[:, None] * _splines(np.degrees(np.arccos(ahead)), knots)
    return np.asarray(total * lamp_at[2] ** 2)


def _knots(top: float, spacing: float) -> np.ndarray:
    """Of splines from 0 to the angle ``top``, as far apart as ``spacing`` at most."""
    count = max(int(np.ceil(top / spacing)), 1)
    return np.concatenate([np.zeros(DEGREE), np.linspace(0.0, top, count + 1),
                           np.full(DEGREE, top)])


def _splines(angle_deg: np.ndarray, knots: np.ndarray) -> np.ndarray:
    """Splines (n, N) at angles; the first two are one, so that the slope ahead is 0."""
    values = BSpline.design_matrix(np.clip(angle_deg, 0.0, knots[-1]), knots, DEGREE).toarray()
    return np.column_stack([values[:, :2].sum(axis=1), values[:, 2:]])


def _solved(rows: np.ndarray, target: np.ndarray) -> np.ndarray:
    normal = rows.T @ rows
    normal += RIDGE * np.diag(normal).max() * np.eye(len(normal))
    return np.asarray(np.linalg.solve(normal, rows.T @ target))


def _beam_axis(places: np.ndarray, reading: np.ndarray, deviation: np.ndarray,
               lamp_at: np.ndarray, lamp_size: np.ndarray, aimed: np.ndarray) -> np.ndarray:
    """Where (2,) on the wall the beam is centred."""
    size = lamp_at[2]
    knots = _knots(float(_angles(places, lamp_at, aimed)[0].max()) + 10.0, SEARCH_DEG)
    target = reading / deviation

    def misses(step: np.ndarray) -> np.ndarray:
        rows = _irradiance(places, lamp_at, lamp_size, aimed + size * step, knots, 1) \
            / deviation[:, None]
        return np.asarray(target - rows @ _solved(rows, target))

    solution = least_squares(misses, np.zeros(2), diff_step=1e-3, x_scale=0.1)
    return np.asarray(aimed + size * solution.x)


def _seen_all_around(angle: np.ndarray, sector: np.ndarray, width_deg: float) -> float:
    """The largest angle that enough sectors see, with all below it, in rings of this width."""
    top = 0.0
    for start in np.arange(0.0, 90.0, width_deg):
        ring = (angle >= start) & (angle < start + width_deg)
        if len(np.unique(sector[ring])) < MIN_SECTORS:
            break
        top = float(angle[ring].max())
    if top < 3 * SPACINGS_DEG[0]:
        raise errors.CheckError(
            f"the rectangle shows the beam all around its axis to {top:.0f} degrees "
            "alone; it must hold the place that the lamp faces, and the wall around "
            "it")
    return top


# ---- wall ----------------------------------------------------------------------------------------
# A photo of a white wall that a lamp shines at: what lies where, in millimetres on the wall.
#
# A rectangle is marked on the wall. x goes to the right, y up, z out of the wall; (0, 0, 0) is the
# rectangle's lower left corner.

ADVICE = "see docs/how-to/box.md"
CELLS = 64              # along the rectangle's longer side, of which each is one reading
MIN_CELLS = 200
MAX_SATURATED = 0.02    # of the rectangle
Length = Annotated[float, Field(ge=0.1, le=100_000)]
Pair = Annotated[checked_tables.ListOf[float], Field(min_length=2, max_length=2)]
Point = Annotated[checked_tables.ListOf[float], Field(min_length=3, max_length=3)]


class WallTable(checked_tables.Table):
    """A file that says where rectangle and lamp are; lengths in millimetres."""

    corners_px: Annotated[checked_tables.ListOf[Pair], Field(min_length=4, max_length=4)] = Field(
        description="corners of the rectangle in pixels of the photo, going round from the one "
        "that is top left on the wall: top left, top right, bottom right, bottom left")
    size_mm: Annotated[checked_tables.ListOf[Length], Field(min_length=2, max_length=2)] = Field(
        description="[width, height] of the rectangle")
    lamp_at_mm: Point = Field(description="[x, y, z] of the middle of the lamp's opening: to the "
                              "right and up from the rectangle's lower left corner, out of the "
                              "wall")
    lamp_size_mm: Annotated[checked_tables.ListOf[Length],
                            Field(min_length=2, max_length=2)] = Field(
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
    return checked_tables.checked(WallTable, checked_tables.read_toml(path, ADVICE), path.name)


def wall_cells(photo: LinearImage, wall: WallTable, lens: Lens | None = None
               ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What the photo shows inside the rectangle, each reading the mean over a small square of it:
    places (n, 2) on the wall in mm, signals (n, K) and the variances (n, K) of their noise.

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
        raise errors.InputError(
            f"corners_px lie outside the photo of {limit[0]:.0f} x {limit[1]:.0f} "
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
        raise errors.CheckError(
            f"{share:.0%} of the rectangle is saturated; halve the exposure until the "
            "middle of the beam is not")
    used = inside & ~saturated
    side = max(wall.size_mm) / CELLS
    columns = int(np.ceil(wall.size_mm[0] / side))
    cell = (place[used] // side).astype(int) @ [1, columns]
    _, cell, count = np.unique(cell, return_inverse=True, return_counts=True)
    if len(count) < MIN_CELLS:
        raise errors.CheckError(
            f"{len(count)} of {CELLS} x {CELLS} squares of the rectangle can be read, "
            f"{MIN_CELLS} are needed; photograph it larger")
    bands = photo.signal.shape[2]

    def mean(values: np.ndarray) -> np.ndarray:
        return np.stack([np.bincount(cell, column) / count for column in values.T], axis=1)

    return (mean(place[used]), mean(photo.signal.reshape(-1, bands)[used].astype(float)),
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
