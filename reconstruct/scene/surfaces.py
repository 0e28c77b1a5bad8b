"""Which surface each pixel shows, from the scene's geometry."""
from __future__ import annotations

from typing import Any

import numpy as np

# rays per pixel and axis: a pixel that any other surface touches on this grid counts as mixed
SUBPIXELS = 4


def surface_map(scene: Any, names: tuple[str, ...], size: tuple[int, int]) -> np.ndarray:
    """Index into ``names`` (H, W) of the one surface that fills each pixel; -1 where none or
    several do.

    Parameters
    ----------
    scene : mi.Scene
    names : tuple of str
        Shape ids; shapes that are not listed (lights) count as none.
    size : (width, height) in pixels
    """
    import drjit as dr
    import mitsuba as mi

    width, height = size
    columns, rows = np.meshgrid((np.arange(width * SUBPIXELS) + 0.5) / (width * SUBPIXELS),
                                (np.arange(height * SUBPIXELS) + 0.5) / (height * SUBPIXELS))
    place = mi.Point2f(columns.ravel(), rows.ravel())
    ray, _ = scene.sensors()[0].sample_ray(0.0, 0.5, place, mi.Point2f(0.5))
    hit = scene.ray_intersect_preliminary(mi.Ray3f(ray))
    found = np.array(dr.reinterpret_array(mi.UInt32, hit.shape))
    index_of_shape = {int(np.array(dr.reinterpret_array(mi.UInt32,
                                                        mi.ShapePtr(shape)))[0]): names.index(
                          shape.id()) for shape in scene.shapes() if shape.id() in names}
    lookup = np.full(int(max([found.max(), *index_of_shape])) + 1, -1)
    for shape, index in index_of_shape.items():
        lookup[shape] = index
    valid = np.array(hit.is_valid())
    surface = np.where(valid, lookup[found], -1)
    cells = surface.reshape(height, SUBPIXELS, width, SUBPIXELS).swapaxes(1, 2).reshape(height,
                                                                                        width, -1)
    pure = (cells == cells[..., :1]).all(axis=-1)
    return np.where(pure, cells[..., 0], -1)
