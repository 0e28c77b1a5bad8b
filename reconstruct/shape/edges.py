"""What the outline of a moving mesh contributes to the derivative of an image, in camera bands.

Where an edge of the object moves over a pixel, what the pixel sees changes by the difference of
radiance across the edge: no path that ends on the surface knows of it. Points on the outline are
drawn by Mitsuba's projective sampling (Zhang et al. 2023). Its integrators cannot be used as they
are: with a spectral film both stop with an error (Mitsuba issue 1819), and in spectral variants
``prb_projective`` sees a black foreground.

Radiance at the edge is that of direct light. Outlines of shadows and of reflections are left out.
The shading must be smooth: between flat faces it jumps, and the motion of those jumps is in no
derivative.
"""
from __future__ import annotations

from typing import Any

import numpy as np


def add_outline_gradient(scene: Any, image_gradient: np.ndarray, spp: int, seed: int) -> None:
    """Add the outline's part of the gradient to every attached vertex position of the scene.

    Parameters
    ----------
    scene : mi.Scene
        Perspective camera, film of K bands with a box filter, meshes with attached
        ``vertex_positions``.
    image_gradient : (H, W, K) array
        Derivative of the loss by the image.
    spp : int
        Outline samples, per pixel of the image.
    seed : int
        Of the samples.
    """
    import drjit as dr
    import mitsuba as mi

    height, width, bands = image_gradient.shape
    sensor = scene.sensors()[0]
    properties = mi.Properties()
    properties["sppc"], properties["sppi"] = 0, 0
    projective = mi.ad.integrators.direct_projective.DirectProjectiveIntegrator(
        properties).proj_detail
    with dr.suspend_grad():
        projective.init_primarily_visible_silhouette(scene, sensor)
        sampler = sensor.sampler().clone()
        sampler.seed(seed, height * width * spp)
        eye = sensor.world_transform() @ mi.Point3f(0)
        edge = projective.sample_primarily_visible_silhouette(scene, eye, sampler.next_2d(), True)
        active = edge.is_valid() & (edge.pdf > 0)
        jump, wavelengths = projective.eval_primary_silhouette_radiance_difference(scene, sampler,
                                                                                   edge, sensor,
                                                                                   active=active)
        jump_in_bands = sensor.film().prepare_sample(jump, wavelengths, bands + 1, weight=0.0,
                                                     alpha=1.0)
        interaction = dr.zeros(mi.Interaction3f)
        interaction.p = edge.p
        position = sensor.sample_direction(interaction, mi.Point2f(0))[0].uv
        pixel = (mi.UInt32(dr.clip(position.y, 0, height - 1)) * width
                 + mi.UInt32(dr.clip(position.x, 0, width - 1)))
        slope = mi.Float(image_gradient.astype(np.float32).ravel())
        weight = sum(jump_in_bands[band] * dr.gather(mi.Float, slope, pixel * bands + band, active)
                     for band in range(bands))
        weight = dr.select(active, weight * projective.sensor_jacobian(sensor, edge) / edge.pdf,
                           0.0) / spp
    on_surface = dr.zeros(mi.SurfaceInteraction3f)
    on_surface.p, on_surface.prim_index, on_surface.uv = edge.p, edge.prim_index, edge.uv
    motion = edge.shape.differential_motion(dr.detach(on_surface), active)
    dr.backward(dr.sum(dr.select(active, dr.dot(motion, edge.n) * weight, 0.0)))
