"""Edges inside a region: a shadow's edge, a fold, or two paints in one outline.

The region's pixels are averaged in a few hundred cells. Their logarithms hold, without an edge, the
light that falls off smoothly (a polynomial of third degree), the texture of the surface and noise.
A step is fitted across every line, of all directions and offsets. The best of a band is an edge
where its step stands out among what every other line finds in what is left: texture, whatever its
pattern, gives steps across any line. A smooth ramp in place of the step must fit worse.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from spectrabox.capture.chart.patches import sensor_from_image
from spectrabox.radiometry.records.photos import EdgeKind, RegionEdge

CELLS = 20                  # along the longer side of the region's box
MIN_CELLS = 48              # that a region needs for an edge to be looked for
FULL_CELL = 0.5             # of the pixels of a whole cell, for a cell to count
DIRECTIONS, OFFSET = 24, 0.5    # of lines; their distance, in cells
SMALLER_SIDE = 0.12         # of the cells, on either side of a line
DEGREE = 3                  # of the light's polynomial
RAMP = 0.3                  # of the region's extent: width of a smooth change
FINER = np.linspace(-0.6, 0.6, 5)   # of the distance of directions, and of a cell
WIDTHS = (1.0, 2.0)         # of an edge, in cells
LEAST_NOISE = 5e-4          # relative, of the fit of a step: photos of surfaces are not below it
LEAST_STEP = 0.05           # relative
STANDS_OUT = 2.5            # times the largest step that another line finds in what is left
SHARPER = 1.05              # times what the best ramp explains
LEAST_SIGNAL = 0.05         # of a cell, relative to the region's mean, in a logarithm
MAX_NOISE = 0.3             # of a cell's mean: a band beyond says nothing
TEXTURE = 0.003             # relative: bands are weighed by noise beyond it
ANOTHER_COLOUR = 0.25       # of the step, by which bands differ: shadows have a colour, too
COLOUR_SIGMA = 3.0


class Cells(NamedTuple):
    """Means of a region's pixels in n cells of a grid, in K bands."""

    logarithm: np.ndarray   # (n, K) of the signal, relative to the region's mean
    weights: np.ndarray     # (K,) of the bands in their mean; 0 for a band that says nothing
    column: np.ndarray      # (n,) in the grid
    row: np.ndarray
    x: np.ndarray           # (n,) of the middle of the pixels, in pixels of the image
    y: np.ndarray
    whole: np.ndarray       # (n,) bool: all pixels of the cell lie in the region
    side: int               # of a cell, in pixels
    start: tuple[int, int]  # column and row of the first pixel of the grid


class Lines(NamedTuple):
    """M lines across the cells and what a step or a ramp across each would leave beside the light.
    """

    angle: np.ndarray       # (M,) of the normal
    offset: np.ndarray      # (M,) along it, in cells from the middle
    step: np.ndarray        # (M, n) of length 1
    ramp: np.ndarray        # (M, n) of length 1
    light: np.ndarray       # (n, L) orthonormal


def region_edge(signal: np.ndarray, variance: np.ndarray, x: np.ndarray, y: np.ndarray,
                sensor_step: float) -> RegionEdge | None:
    """The edge in a region, if there is one and the region is large enough to tell.

    Parameters
    ----------
    signal : (N, K) array
        Of the region's pixels; NaN in bands that say nothing.
    variance : (K,) array
        Of a pixel.
    x, y : (N,) int arrays
        Columns and rows of the pixels.
    sensor_step : float
        Pixels of the whole photo a side of one of these.
    """
    cells = _cells(signal, variance, x, y)
    if cells.x.size < MIN_CELLS or not cells.weights.any():
        return None
    lines = _lines(cells)
    if not lines.angle.size:
        return None
    told = cells.weights > 0
    bands = np.column_stack([cells.logarithm, cells.logarithm @ cells.weights])
    bands -= lines.light @ (lines.light.T @ bands)
    found = [_sharpest(cells, lines, bands[:, band]) for band in (*np.flatnonzero(told), -1)]
    best = max(found, key=lambda edge: edge.stands_out)
    if best.stands_out < STANDS_OUT:
        return None
    steps = np.where(told, bands[:, :-1].T @ best.profile, np.nan) / best.length
    beyond = _beyond(cells, best)
    smaller = 1 if np.mean(beyond > 0) < 0.5 else -1
    return RegionEdge(_kind(bands, told, steps, best, lines), np.exp(smaller * steps) - 1,
                      _line_px(cells, best, sensor_step),
                      _largest_rectangle(cells, cells.whole & (-smaller * beyond > 1), sensor_step))


class _Edge(NamedTuple):
    """The best step of one band."""

    stands_out: float       # 0 for none that counts
    angle: float
    offset: float
    profile: np.ndarray     # (n,) of length 1
    length: float           # of the profile of a step of 1


def _cells(signal: np.ndarray, variance: np.ndarray, x: np.ndarray, y: np.ndarray) -> Cells:
    start = int(x.min()), int(y.min())
    side = -(-int(max(np.ptp(x), np.ptp(y)) + 1) // CELLS)
    column, row = (x - start[0]) // side, (y - start[1]) // side
    columns = int(column.max()) + 1
    index = row * columns + column
    count = np.bincount(index)
    full = count >= FULL_CELL * side**2
    size = count[full]
    mean = np.column_stack([np.bincount(index, band)[full] / size for band in signal.T])
    level = signal.mean(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        noise = np.sqrt(variance) / side / level
        told = (level > 0) & (noise < MAX_NOISE)
        logarithm = np.log(np.maximum(mean / level, LEAST_SIGNAL))
    weights = np.where(told, 1 / (np.where(told, noise, 0) ** 2 + TEXTURE**2), 0)
    at = np.flatnonzero(full)
    return Cells(np.where(told, logarithm, 0), weights / max(weights.sum(), 1e-30), at % columns,
                 at // columns, np.bincount(index, x)[full] / size,
                 np.bincount(index, y)[full] / size, size == side**2, side, start)


def _lines(cells: Cells) -> Lines:
    across, down = _from_middle(cells)
    extent = max(np.ptp(across), np.ptp(down)) / 2
    light = np.linalg.qr(np.column_stack([
        (across / extent) ** i * (down / extent) ** j
        for i in range(DEGREE + 1) for j in range(DEGREE + 1 - i)]))[0]
    angles, offsets, steps, ramps = [], [], [], []
    for angle in np.pi * np.arange(DIRECTIONS) / DIRECTIONS:
        along = across * np.cos(angle) + down * np.sin(angle)
        offset = np.arange(along.min(), along.max(), OFFSET)
        beyond = along - offset[:, None]
        share = np.mean(beyond > 0, axis=1)
        inner = (share >= SMALLER_SIDE) & (share <= 1 - SMALLER_SIDE)
        angles.append(np.full(inner.sum(), angle))
        offsets.append(offset[inner])
        steps.append(_risen(beyond[inner], 1.0))
        ramps.append(_risen(beyond[inner], RAMP * float(np.ptp(along))))
    return Lines(np.concatenate(angles), np.concatenate(offsets),
                 _beside(light, np.concatenate(steps))[0],
                 _beside(light, np.concatenate(ramps))[0], light)


def _from_middle(cells: Cells) -> tuple[np.ndarray, np.ndarray]:
    """Columns and rows of the cells from their mean, in cells."""
    return ((cells.x - cells.x.mean()) / cells.side, (cells.y - cells.y.mean()) / cells.side)


def _risen(beyond: np.ndarray, width: float) -> np.ndarray:
    """From 0 to 1 over a width about a line, at these distances beyond it."""
    return np.clip(beyond / width + 0.5, 0, 1)


def _beside(light: np.ndarray, profiles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What profiles (M, n) have beside the light, of length 1, and the length (M,) it had."""
    free = profiles - (profiles @ light) @ light.T
    length = np.maximum(np.linalg.norm(free, axis=1), 1e-12)
    return free / length[:, None], length


def _sharpest(cells: Cells, lines: Lines, band: np.ndarray) -> _Edge:
    """The line across which a band (n,) steps most, finer than the grid of lines, and by how much
    the step exceeds that across any other line in what it leaves.
    """
    first = int(np.argmax(np.abs(lines.step @ band)))
    across, down = _from_middle(cells)
    tried, profiles = [], []
    for angle in lines.angle[first] + np.pi / DIRECTIONS * FINER:
        along = across * np.cos(angle) + down * np.sin(angle)
        for offset in lines.offset[first] + FINER:
            tried += [(float(angle), float(offset))] * len(WIDTHS)
            profiles += [_risen(along - offset, width) for width in WIDTHS]
    profile, length = _beside(lines.light, np.array(profiles))
    fitted = np.abs(profile @ band)
    best = int(np.argmax(fitted))
    rest = band - profile[best] * (profile[best] @ band)
    others = np.hypot(np.abs(lines.step @ rest).max(), LEAST_NOISE)
    counts = (fitted[best] > SHARPER * np.abs(lines.ramp @ band).max()
              and fitted[best] > LEAST_STEP * length[best])
    return _Edge(float(fitted[best] / others) if counts else 0.0, *tried[best], profile[best],
                 float(length[best]))


def _kind(bands: np.ndarray, told: np.ndarray, steps: np.ndarray, edge: _Edge,
          lines: Lines) -> EdgeKind:
    """Whether all bands step by one ratio, within what other lines find between the bands."""
    if np.count_nonzero(told) == 1:
        return EdgeKind.ONE_BAND
    mean = float(bands[:, -1] @ edge.profile) / edge.length
    for band in np.flatnonzero(told):
        between = bands[:, band] - bands[:, -1]
        rest = between - edge.profile * (edge.profile @ between)
        error = float(np.hypot(np.sqrt(np.mean((lines.step @ rest) ** 2)), LEAST_NOISE))
        if abs(steps[band] - mean) > max(COLOUR_SIGMA * error / edge.length,
                                         ANOTHER_COLOUR * abs(mean)):
            return EdgeKind.PAINTS
    return EdgeKind.SHADOW


def _line_px(cells: Cells, edge: _Edge, sensor_step: float) -> np.ndarray:
    """Ends (2, 2) of the line across the cells, in pixels of the whole photo."""
    across, down = _from_middle(cells)
    normal = np.array([np.cos(edge.angle), np.sin(edge.angle)])
    direction = np.array([-normal[1], normal[0]])
    near = np.abs(_beyond(cells, edge)) < 1
    along = (across * direction[0] + down * direction[1])[near]
    ends = edge.offset * normal + np.outer([along.min() - 0.5, along.max() + 0.5], direction)
    middle = np.array([cells.x.mean(), cells.y.mean()])
    return sensor_from_image(middle + cells.side * ends, sensor_step)


def _beyond(cells: Cells, edge: _Edge) -> np.ndarray:
    """Distance (n,) of the cells from a line, in cells."""
    across, down = _from_middle(cells)
    return across * np.cos(edge.angle) + down * np.sin(edge.angle) - edge.offset


def _largest_rectangle(cells: Cells, chosen: np.ndarray, sensor_step: float) -> np.ndarray | None:
    """The largest rectangle [x0, y0, x1, y1] of chosen cells (n,) alone, in pixels of the whole
    photo; None where none is chosen.
    """
    free = np.zeros((int(cells.row.max()) + 1, int(cells.column.max()) + 1), bool)
    free[cells.row, cells.column] = chosen
    largest = largest_rectangle(free)
    if largest is None:
        return None
    corners = np.array(largest) * cells.side + np.tile(cells.start, 2)
    return np.asarray(np.rint(corners * sensor_step + [0, 0, -1, -1]))


def largest_rectangle(free: np.ndarray) -> tuple[int, int, int, int] | None:
    """Left, top, right and bottom, the last two exclusive, of the largest rectangle of free cells.

    Parameters
    ----------
    free : (h, w) array of bool
        Of a few dozen cells a side: all pairs of rows are tried.

    Returns
    -------
    tuple of int or None
        None where no cell is free.
    """
    area, largest = 0, (0, 0, 0, 0)
    for top in range(len(free)):
        for bottom in range(top + 1, len(free) + 1):
            run = 0
            for column in range(free.shape[1]):
                run = run + 1 if free[top:bottom, column].all() else 0
                if run * (bottom - top) > area:
                    area = run * (bottom - top)
                    largest = (column + 1 - run, top, column + 1, bottom)
    return largest if area else None
