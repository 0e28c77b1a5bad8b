"""Where the camera sees a shape, for comparing shapes."""
from __future__ import annotations

import numpy as np

from spectrabox.reconstruct.view import View


def silhouette(view: View, shape_id: str, subpixels: int = 4) -> np.ndarray:
    """Where the camera sees the shape: (H, W) share of each pixel, from ``subpixels`` squared
    rays.
    """
    import drjit as dr
    import mitsuba as mi

    scene, (width, height) = view.scene(), view.size
    columns, rows = np.meshgrid((np.arange(width * subpixels) + 0.5) / (width * subpixels),
                                (np.arange(height * subpixels) + 0.5) / (height * subpixels))
    ray, _ = scene.sensors()[0].sample_ray(0.0, 0.5, mi.Point2f(columns.ravel(), rows.ravel()),
                                           mi.Point2f(0.5))
    hit = scene.ray_intersect_preliminary(mi.Ray3f(ray))
    shape = next(shape for shape in scene.shapes() if shape.id() == shape_id)
    seen = np.array(hit.is_valid() & (hit.shape == mi.ShapePtr(shape)))
    dr.eval()
    return seen.reshape(height, subpixels, width, subpixels).mean(axis=(1, 3))
