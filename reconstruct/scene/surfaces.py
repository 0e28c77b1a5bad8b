"""Which surface each pixel shows and where on it the pixel lies; blocks of pixels of one surface.

The fit compares means over blocks instead of single pixels. A mean is as linear in the transport as
a pixel is, but its Monte Carlo noise is far smaller. That noise matters: it enters the fit as an
error of the model, which pulls every spectrum down by its relative variance.
"""
from __future__ import annotations

from typing import Any

import numpy as np

# rays per pixel and axis: a pixel that any other surface touches on this grid counts as mixed
SUBPIXELS = 4
RAYS_AT_ONCE = 1 << 21      # of a large photo, some rows at a time
# above, wider blocks: nothing in a diffuse scene varies faster than such a block
MAX_REGIONS = 1024
MIN_BLOCK = 4           # pixels


def surface_map(scene: Any, names: tuple[str, ...], size: tuple[int, int]) -> np.ndarray:
    """Index (H, W) of the one surface that fills each pixel; -1 where none or several do.

    Parameters
    ----------
    scene : mi.Scene
    names : tuple of str
        Shape ids, to which the indices belong; shapes that are not listed (lights) count as none.
    size : (width, height) in pixels
    """
    import drjit as dr
    import mitsuba as mi

    width, height = size
    shapes = [shape for shape in scene.shapes() if shape.id() in names]
    index_of_number = {int(np.array(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape)))[0]):
                       names.index(shape.id()) for shape in shapes}
    lookup = np.full(max(index_of_number, default=0) + 2, -1)
    for number, index in index_of_number.items():
        lookup[number] = index
    surface_index = np.empty((height, width), np.int32)
    rows = max(RAYS_AT_ONCE // (width * SUBPIXELS**2), 1)
    for first in range(0, height, rows):
        last = min(first + rows, height)
        x, y = np.meshgrid((np.arange(width * SUBPIXELS) + 0.5) / (width * SUBPIXELS),
                           (np.arange(first * SUBPIXELS, last * SUBPIXELS) + 0.5)
                           / (height * SUBPIXELS))
        ray, _ = scene.sensors()[0].sample_ray(0.0, 0.5, mi.Point2f(x.ravel(), y.ravel()),
                                               mi.Point2f(0.5))
        hit = scene.ray_intersect_preliminary(mi.Ray3f(ray))
        numbers = np.array(dr.reinterpret_array(mi.UInt32, hit.shape))
        # the last of the table is no surface
        surface = np.where(np.array(hit.is_valid()),
                           lookup[np.minimum(numbers, lookup.size - 1)], -1)
        rows_of_cells = surface.reshape(last - first, SUBPIXELS, width, SUBPIXELS)
        cells = rows_of_cells.swapaxes(1, 2).reshape(last - first, width, -1)
        pure = (cells == cells[..., :1]).all(axis=-1)
        surface_index[first:last] = np.where(pure, cells[..., 0], -1)
    return surface_index


def hits_of(scene: Any, size: tuple[int, int], row: np.ndarray,
            column: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What n pixels show in their middle: the point (n, 3), the area (n,) that the pixel covers of
    the surface, up to one factor, and the texture coordinates (n, 2).

    Parameters
    ----------
    scene : mi.Scene
    size : (width, height)
        Of the whole photo in pixels.
    row, column : (n,) int arrays
        There may be none.
    """
    if not np.size(row):            # which Dr.Jit refuses to calculate with
        return np.empty((0, 3)), np.empty(0), np.empty((0, 2))
    import drjit as dr
    import mitsuba as mi

    position = mi.Point2f((np.asarray(column) + 0.5) / size[0], (np.asarray(row) + 0.5) / size[1])
    ray, _ = scene.sensors()[0].sample_ray(0.0, 0.5, position, mi.Point2f(0.5))
    hit = scene.ray_intersect(mi.Ray3f(ray))
    area = dr.select(hit.is_valid(), dr.square(hit.t) / dr.maximum(dr.abs(hit.wi.z), 1e-3), 0.0)
    return np.array(hit.p).T.reshape(-1, 3), np.array(area), np.array(hit.uv).T.reshape(-1, 2)


def block_regions(surface: np.ndarray, used: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Region (H, W) of each usable pixel, -1 elsewhere, and the surface (R,) of each region.

    Surface after surface, in the order of their first pixels: paths are drawn region after region,
    and how a scene numbers its surfaces must not change them.

    Parameters
    ----------
    surface : (H, W) int
        Index of the surface, -1 where none or several fill a pixel.
    used : (H, W) bool
        Pixels that may be compared.
    """
    row, column = np.nonzero(used & (surface >= 0))
    block = max(MIN_BLOCK, round(np.sqrt(row.size / MAX_REGIONS)))
    known, first, number = np.unique(surface[row, column], return_index=True, return_inverse=True)
    order = np.argsort(first)   # of their first pixels
    rank = np.argsort(order)    # of each known surface
    key = np.stack([rank[number.ravel()], row // block, column // block])
    names, member = np.unique(key, axis=1, return_inverse=True)
    region = np.full(surface.shape, -1)
    region[row, column] = member.ravel()
    return region, known[order][names[0]]


def region_means(image: np.ndarray, region: np.ndarray) -> np.ndarray:
    """Mean (R, ...) over the pixels of each region.

    Parameters
    ----------
    image : (H, W, ...) array
    region : (H, W) int
        Region 0 to R-1 of each pixel, each with one pixel or more; -1 where it is not wanted.
    """
    mask = region >= 0
    count = np.bincount(region[mask])
    flat = image[mask].reshape(len(region[mask]), -1)
    sums = np.stack([np.bincount(region[mask], flat[:, column]) for column in range(flat.shape[1])],
                    axis=1)
    return (sums / count[:, None]).reshape(count.size, *image.shape[2:])
