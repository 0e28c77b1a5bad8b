"""Signals of the regions of a photo that an operator outlined."""
from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from spectrabox.capture.chart.patches import image_from_sensor
from spectrabox.capture.photo.region_edges import region_edge
from spectrabox.radiometry.errors import ClippedPhotoError, InputError
from spectrabox.radiometry.records import photos

MIN_PIXELS = 16
CLIPPED_LIMIT = 0.01        # of the pixels of a region
COLOURS = 3                 # bands of a colour camera
Outline = Sequence[Sequence[float]]
POINTS_A_SIDE = 5           # of the grid at which the light on a region is looked up


def sample_regions(image: photos.LinearImage, outlines: Mapping[str, Outline], *,
                   without_clipped: bool = False,
                   known: Collection[str] = ()) -> photos.RegionSamples:
    """Mean signal of each region, its error and its unevenness.

    The mean is that of every pixel inside, whatever is painted there; its covariance is that of the
    pixels' noise. What the pixels scatter beyond noise and beyond a plane, as of light that falls
    off, is kept as unevenness; an edge across it is told by itself.

    Parameters
    ----------
    image : LinearImage
    outlines : mapping
        From names to corners [x, y] of a polygon, going round, in pixels of the whole photo; (0, 0)
        is the centre of the first.
    without_clipped : bool
        Take a region of which more than 1 % is saturated in some bands: the result names them, and
        their means say nothing. For photos beside others; photos of more than three bands always.
    known : collection of str
        Regions of known spectrum, without which the others can be measured: those may be saturated
        in some bands, or in all.

    Raises
    ------
    InputError
        If a region leaves the photo or holds fewer than 16 pixels.
    ClippedPhotoError
        If more than 1 % of another region is saturated, in all bands where some may be.
    """
    without_clipped |= image.signal.shape[2] > COLOURS
    one_by_one, edges = [], {}
    for name, corners in outlines.items():
        statistics, edge = _one_region(image, np.array(corners, dtype=float),
                                       f"photo {image.source}: region {name!r}",
                                       without_clipped or name in known, name in known)
        one_by_one.append(statistics)
        if edge is not None:
            edges[name] = edge
    mean, covariance, pixels, scatter, points, clipped = (np.array(column)
                                                 for column in zip(*one_by_one, strict=True))
    return photos.RegionSamples(tuple(outlines), mean, covariance, pixels, scatter, points, clipped,
                         edges)


def pixels_in_polygon(corners: np.ndarray, height: int,
                      width: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of the pixels whose centre lies in a polygon (even-odd rule).

    Parameters
    ----------
    corners : (C, 2) array
        In image coordinates, going round.
    height, width : int
        Of the image.
    """
    last = np.array([width - 1, height - 1])
    left, top = np.clip(np.ceil(corners.min(axis=0)), 0, last + 1).astype(int)
    right, bottom = np.clip(np.floor(corners.max(axis=0)), -1, last).astype(int)
    columns, rows = max(right + 1 - left, 0), max(bottom + 1 - top, 0)
    # Edges to the right of the first n pixels of each row, modulo 2: work by the length of the
    # outline, not by corners times pixels.
    crossed = np.zeros((rows, columns + 1), bool)
    edges = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
    ends = np.clip(np.ceil(np.sort(edges[..., 1], axis=1)) - top, 0, rows).astype(int)
    for ((xa, ya), (xb, yb)), (low, high) in zip(edges, ends, strict=True):
        if low < high:
            row = np.arange(low, high)
            x = xa + (row + top - ya) / (yb - ya) * (xb - xa)
            crossed[row, np.clip(np.ceil(x) - left, 0, columns).astype(int)] ^= True
    inside = np.logical_xor.accumulate(crossed[:, ::-1], axis=1)[:, -2::-1]
    y, x = np.nonzero(inside)
    return y + top, x + left


def inside_polygon(corners: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Whether points lie in a polygon (even-odd rule), its lower edges counted in.

    Parameters
    ----------
    corners : (C, 2) array
    x, y : arrays of one shape
    """
    inside = np.zeros(x.shape, bool)
    for (xa, ya), (xb, yb) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if ya == yb:
            continue
        crosses = (y >= min(ya, yb)) & (y < max(ya, yb))
        inside ^= crosses & (x < xa + (y - ya) / (yb - ya) * (xb - xa))
    return inside



def region_pixels(saturated: np.ndarray, sensor_step: float, corners_px: np.ndarray,
                  name: str) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of the pixels of a region.

    Parameters
    ----------
    saturated : (H, W, K) array of bool
    sensor_step : float
        Pixels of the sensor a side of one of these.
    corners_px : (C, 2) array
        Going round, in pixels of the whole photo.
    name : str
        Begins the messages.

    Raises
    ------
    InputError, ClippedPhotoError
        As ``sample_regions``.
    """
    y, x = pixels_in_polygon(image_from_sensor(corners_px, sensor_step), *saturated.shape[:2])
    _require_readable(saturated, sensor_step, corners_px, y, x, name, "more of the surface",
                      "outline a part without reflections")
    return y, x


def _require_readable(saturated: np.ndarray, sensor_step: float, corners_px: np.ndarray,
                      y: np.ndarray, x: np.ndarray, name: str, more: str,
                      less_light: str) -> None:
    """Refuse a region whose pixels cannot be averaged; what to do ends the sentences."""
    size = np.array(saturated.shape[1::-1]) * sensor_step
    if np.any(corners_px < -0.5) or np.any(corners_px > size - 0.5):
        raise InputError(f"{name} leaves the photo of {round(size[0])} x {round(size[1])} pixels; "
                         "correct its corners")
    if y.size < MIN_PIXELS:
        raise InputError(f"{name} holds {y.size} pixels, {MIN_PIXELS} are needed; outline {more}")
    clipped = float(saturated[y, x].any(axis=1).mean())
    if clipped > CLIPPED_LIMIT:
        raise ClippedPhotoError(f"{name} is saturated in {clipped:.0%} of its pixels; expose less, "
                                f"or {less_light}")


def _one_region(image: photos.LinearImage, corners_px: np.ndarray, name: str, without_clipped: bool,
                known: bool) -> tuple[tuple[np.ndarray, ...], photos.RegionEdge | None]:
    saturated = image.saturated
    y, x = pixels_in_polygon(image_from_sensor(corners_px, image.sensor_step),
                             *saturated.shape[:2])
    clipped = np.zeros(saturated.shape[2], bool)
    if without_clipped and y.size:
        clipped = saturated[y, x].mean(axis=0) > CLIPPED_LIMIT
    y, x = region_pixels(saturated if clipped.all() and not known else saturated[..., ~clipped],
                         image.sensor_step, corners_px, name)
    signal, variance = image.signal[y, x].astype(float), image.variance[y, x].mean(axis=0)
    mean = signal.mean(axis=0)
    terms = np.column_stack([np.ones(y.size), x - x.mean(), y - y.mean()])
    # a region may be one pixel wide
    plane = terms @ (np.linalg.pinv(terms.T @ terms, hermitian=True) @ (terms.T @ signal))
    beyond = np.maximum(((signal - plane) ** 2).mean(axis=0) - variance, 0)
    scatter = np.sqrt(beyond) / np.maximum(np.abs(mean), np.finfo(np.float32).tiny)
    edge = None if clipped.all() else region_edge(np.where(clipped, np.nan, signal), variance, x, y,
                                                  image.sensor_step)
    return (mean, np.diag(variance / y.size), np.array(y.size), scatter, _points(corners_px),
            clipped), edge


def _points(corners_px: np.ndarray) -> np.ndarray:
    """Points (25, 2) spread over a region; those of a grid that fall outside are put in its middle.
    """
    low, high = corners_px.min(axis=0), corners_px.max(axis=0)
    at = (np.arange(POINTS_A_SIDE) + 0.5) / POINTS_A_SIDE
    x, y = np.meshgrid(*(low[:, None] + (high - low)[:, None] * at))
    inside = inside_polygon(corners_px, x, y)
    points = np.column_stack([x[inside], y[inside]])
    middle = points.mean(axis=0) if inside.any() else corners_px.mean(axis=0)
    return np.vstack([points, np.tile(middle, (POINTS_A_SIDE**2 - len(points), 1))])
