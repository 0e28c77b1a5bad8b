"""Closed triangle meshes for the shape fit: sphere, subdivision, large-steps diffusion, outline.

Mitsuba's own ``mi.ad.LargeSteps`` needs a further package for the same sparse factor that SciPy
gives. Its projective integrators stop with an error on a spectral film (Mitsuba issue 1819), and in
spectral variants ``prb_projective`` sees a black foreground.
"""
from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import coo_matrix, diags_array, eye_array
from scipy.sparse.linalg import splu

from spectrabox.radiometry.files import whole_file
from spectrabox.reconstruct.view import PhotoView

ICOSAHEDRON = np.array([
    (0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4), (11, 10, 2),
    (10, 7, 6), (7, 1, 8), (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8), (3, 8, 9), (4, 9, 5),
    (2, 4, 11), (6, 2, 10), (8, 6, 7), (9, 8, 1)])

NO_ATTRIBUTES: Mapping[str, np.ndarray] = {}


def icosphere(level: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices on the unit sphere and faces, anticlockwise seen from outside.

    Parameters
    ----------
    level : int
        Subdivisions of the icosahedron, 0 or more.

    Returns
    -------
    vertices : (10 * 4^level + 2, 3) array
    faces : (20 * 4^level, 3) int
    """
    golden = (1 + np.sqrt(5)) / 2
    corners = [(first, second * golden) for second in (1, -1) for first in (-1, 1)]
    vertices = np.array([np.roll((a, b, 0.0), turn) for turn in range(3) for a, b in corners])
    faces = ICOSAHEDRON
    for _ in range(level):
        vertices, faces = subdivided(vertices / np.linalg.norm(vertices, axis=1, keepdims=True),
                                     faces)
    return vertices / np.linalg.norm(vertices, axis=1, keepdims=True), faces


def subdivided(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The same surface with every triangle cut into four at the middles of its edges.

    Parameters
    ----------
    vertices : (V, 3) array
    faces : (F, 3) int
        Of a closed mesh.

    Returns
    -------
    vertices : (V + 3 F / 2, 3) array
        The given ones first.
    faces : (4 F, 3) int
    """
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    unique, index = np.unique(edges, axis=0, return_inverse=True)
    ab, bc, ca = len(vertices) + index.reshape(-1, 3).T
    a, b, c = faces.T
    parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return (np.concatenate([vertices, vertices[unique].mean(axis=1)]),
            np.concatenate([np.stack(part, axis=1) for part in parts]))


def large_steps(faces: np.ndarray, count: int,
                strength: float) -> tuple[Callable[[np.ndarray], np.ndarray],
                                          Callable[[np.ndarray], np.ndarray]]:
    """Two functions that undo each other: v to u = (I + strength L) v, and back.

    L is the combinatorial Laplacian of the mesh (Nicolet et al. 2021, Eq. 9), so the second also
    spreads a gradient (V, 3) over the surface. The vertices of a smooth motion have a smooth u:
    descent in u moves them together.

    Parameters
    ----------
    faces : (F, 3) int
        Of a closed mesh.
    count : int
        V, of its vertices.
    strength : float
        0 or more; larger moves more of the surface together.
    """
    rows, columns = faces[:, [0, 1, 2, 1, 2, 0]].ravel(), faces[:, [1, 2, 0, 0, 1, 2]].ravel()
    neighbours = coo_matrix((np.ones(rows.size), (rows, columns)), shape=(count, count)).tocsr()
    neighbours.data[:] = 1.0  # the two faces of an edge name it twice
    laplacian = diags_array(np.asarray(neighbours.sum(axis=1)).ravel()) - neighbours
    matrix = (eye_array(count) + strength * laplacian).tocsc()
    factor = splu(matrix)
    return lambda vertices: matrix @ vertices, factor.solve


def write_mesh(path: Path, vertices: np.ndarray, faces: np.ndarray,
               normals: np.ndarray | None = None,
               attributes: Mapping[str, np.ndarray] = NO_ATTRIBUTES) -> None:
    """Write a PLY file with a normal at every vertex, whole or not at all.

    Parameters
    ----------
    path : Path
    vertices : (V, 3) array
    faces : (F, 3) int
    normals : (V, 3) array, optional
        Smooth ones of this mesh where they are left out.
    attributes : mapping of name to (V,) array
        Of the vertices; Mitsuba's names, which begin with "vertex_".

    Raises
    ------
    EnvironmentProblem
        If the folder cannot be written.
    """
    mesh = _mitsuba_mesh(vertices, faces, attributes)
    if normals is not None:
        import mitsuba as mi

        # after the positions, by which Mitsuba makes normals of its own
        parameters = mi.traverse(mesh)
        parameters["vertex_normals"] = mi.Float(normals.astype(np.float32).ravel())
        parameters.update()
    with whole_file(path) as unfinished:
        mesh.write_ply(str(unfinished))


def smooth_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Unit normals (V, 3) at vertices (V, 3) of faces (F, 3), as ``write_mesh`` writes them."""
    mesh = _mitsuba_mesh(vertices, faces, NO_ATTRIBUTES)
    return np.array(mesh.vertex_normals_buffer(), dtype=float).reshape(-1, 3)


def _mitsuba_mesh(vertices: np.ndarray, faces: np.ndarray,
                  attributes: Mapping[str, np.ndarray]) -> Any:
    """A mi.Mesh with smooth normals."""
    import mitsuba as mi

    mesh = mi.Mesh("mesh", len(vertices), len(faces), has_vertex_normals=True)
    for name, values in attributes.items():
        mesh.add_attribute(name, 1, values.tolist())
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = mi.Float(vertices.astype(np.float32).ravel())
    parameters["faces"] = mi.UInt(faces.astype(np.uint32).ravel())
    parameters.update()
    mesh.recompute_vertex_normals()
    return mesh


def add_outline_gradient(scene: Any, image_gradient: np.ndarray, spp: int, seed: int) -> None:
    """Add the outline's part of the gradient to every attached vertex position of the scene.

    Where an edge of the object moves over a pixel, what the pixel sees changes by the difference of
    radiance across the edge: no path that ends on the surface knows of it. Points on the outline
    are drawn by Mitsuba's projective sampling (Zhang et al. 2023). Radiance at the edge is that of
    direct light; outlines of shadows and of reflections are left out. The shading must be smooth:
    between flat faces it jumps, and the motion of those jumps is in no derivative.

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


def silhouette(view: PhotoView, shape_id: str, subpixels: int = 4) -> np.ndarray:
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
