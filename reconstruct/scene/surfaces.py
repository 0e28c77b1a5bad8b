"""Which surface each pixel shows, from the scene's geometry."""
from __future__ import annotations

from typing import Any

import numpy as np

# rays per pixel and axis: a pixel that any other surface touches on this grid counts as mixed
SUBPIXELS = 4
RAYS_AT_ONCE = 1 << 21      # of a large photo, some rows at a time


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
    found = np.empty((height, width), np.int32)
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
        found[first:last] = np.where(pure, cells[..., 0], -1)
    return found
