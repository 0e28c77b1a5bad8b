"""Where on its surface each pixel lies: texture coordinates, and the area that it covers."""
from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True, eq=False)
class Hits:
    """What n pixels show in their middle."""

    uv: np.ndarray          # (n, 2) texture coordinates
    area: np.ndarray        # (n,) that a pixel covers of the surface, up to one factor
    point: np.ndarray       # (n, 3)


def hits_of(scene: Any, size: tuple[int, int], row: np.ndarray, column: np.ndarray) -> Hits:
    """What some pixels show.

    Parameters
    ----------
    scene : mi.Scene
    size : (width, height)
        Of the whole photo in pixels.
    row, column : (n,) int arrays
        There may be none.
    """
    if not np.size(row):            # which Dr.Jit refuses to calculate with
        return Hits(np.empty((0, 2)), np.empty(0), np.empty((0, 3)))
    import drjit as dr
    import mitsuba as mi

    place = mi.Point2f((np.asarray(column) + 0.5) / size[0], (np.asarray(row) + 0.5) / size[1])
    ray, _ = scene.sensors()[0].sample_ray(0.0, 0.5, place, mi.Point2f(0.5))
    hit = scene.ray_intersect(mi.Ray3f(ray))
    area = dr.select(hit.is_valid(), dr.square(hit.t) / dr.maximum(dr.abs(hit.wi.z), 1e-3), 0.0)
    return Hits(np.array(hit.uv).T.reshape(-1, 2), np.array(area), np.array(hit.p).T.reshape(-1, 3))
