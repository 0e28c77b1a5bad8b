"""Shape and spectrum of one object from photos around it (paper Sec. 4.2, Fig. 6).

A sphere is moved towards the photos by gradient descent, coarse to fine, while the spline
coefficients of the object's spectrum are found along with it (``shape_descent``). The spectrum of
the descent is a starting point: put the mesh into the views (``wearing``) and let the transport
engine find the spectrum with its uncertainty.
"""
from __future__ import annotations

import copy
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records import Outcome
from spectrabox.reconstruct.engines.gradient import stalled
from spectrabox.reconstruct.problem import InverseProblem, MaterialSpec, View, inverse_problems
from spectrabox.reconstruct.shape.descent import Stage, descend, flat_start
from spectrabox.reconstruct.shape.mesh import icosphere, subdivided, write_mesh

FEWEST_VIEWS = 3
STAGES = (Stage(3, 40, 0.03, 19.0, 8), Stage(4, 40, 0.02, 19.0, 8), Stage(4, 50, 0.01, 8.0, 8))


@dataclass(frozen=True)
class ShapeSettings:
    """Numbers an operator may choose."""

    coefficients: int = 9
    stages: tuple[Stage, ...] = STAGES  # coarse to fine
    views_per_step: int = 4             # drawn anew for every step
    seed: int = 1


@dataclass(frozen=True)
class ShapeReconstruction:
    """A closed mesh in the scenes' coordinates and the object's spectrum."""

    vertices: np.ndarray        # (V, 3)
    faces: np.ndarray           # (F, 3) anticlockwise seen from outside
    coefficients: np.ndarray    # (N,)
    spectrum: np.ndarray        # (P,) reflectance on the calibration's grid
    # mean over the views of a step of the squared error, in squares of the brightest pixel
    loss_history: np.ndarray
    outcome: Outcome


def reconstruct_shape(views: Sequence[View], shape_id: str, materials: tuple[MaterialSpec, ...],
                      settings: ShapeSettings,
                      progress: Callable[[float, str], None]) -> ShapeReconstruction:
    """Find the mesh and the spectrum that explain several photos of one object.

    Parameters
    ----------
    views : sequence of View
        Three or more, each with its light scale. Their scenes hold the object as a shape with the
        id ``shape_id``, for instance a sphere, about where and as large as it is: the fit starts
        from the sphere in its bounding box.
    materials : tuple of MaterialSpec
        One for every BSDF that a surface wears; the object's own is the only unknown one.

    Raises
    ------
    InputError
        If there are too few views, a scene lacks the shape, a light scale is missing, other
        materials are unknown, or photos and scenes cannot be compared (see ``inverse_problems``).
    """
    _check(views, shape_id, materials)
    vertices, faces = icosphere(settings.stages[0].level)
    centre, radius = bounding_sphere(inverse_problems(views[:1], materials,
                                                      settings.coefficients)[0], shape_id)
    vertices = centre + radius * vertices
    coefficients = np.empty(0)
    losses: list[float] = []
    total = sum(stage.steps for stage in settings.stages)
    with tempfile.TemporaryDirectory() as folder:
        for number, stage in enumerate(settings.stages):
            for _ in range(stage.level - (settings.stages[number - 1].level if number
                                          else stage.level)):
                vertices, faces = subdivided(vertices, faces)
            path = Path(folder) / f"stage_{number}.ply"
            write_mesh(path, vertices, faces)
            problems = inverse_problems([wearing(view, shape_id, path) for view in views],
                                        materials, settings.coefficients)
            saturated = [view.photo.saturated for view in views]
            if not coefficients.size:
                coefficients = flat_start(problems, stage.spp, settings.seed)
            before = len(losses)
            vertices, coefficients, history = descend(
                problems, saturated, shape_id, vertices, faces, coefficients, stage, radius, settings.views_per_step,
                settings.seed * 1009 + number,
                lambda step, before=before: progress((before + step) / total, "moving the mesh"))  # type: ignore[misc]
            losses += history
    return ShapeReconstruction(vertices, faces, coefficients, problems[0].basis @ coefficients,
                               np.array(losses), Outcome.CONVERGED
                               if stalled(history, len(history) // 2) else Outcome.STEP_LIMIT)


def wearing(view: View, shape_id: str, mesh: Path) -> View:
    """The view with a mesh file, in the scene's coordinates, in the place of one of its shapes."""
    root = copy.deepcopy(view.scene_file.root)
    shape = next(node for node in root.iter("shape") if node.get("id") == shape_id)
    for child in [child for child in shape if child.tag != "ref"]:
        shape.remove(child)
    shape.set("type", "ply")
    ET.SubElement(shape, "string", name="filename", value=str(mesh.resolve()))
    return replace(view, scene_file=replace(view.scene_file, root=root))


def bounding_sphere(problem: InverseProblem, shape_id: str) -> tuple[np.ndarray, float]:
    """Centre (3,) and radius of the sphere in the bounding box of a shape, in the scene's
    coordinates.
    """
    box = next(shape for shape in problem.scene().shapes() if shape.id() == shape_id).bbox()
    lower, upper = np.array(box.min, dtype=float).ravel(), np.array(box.max, dtype=float).ravel()
    return (lower + upper) / 2, float((upper - lower).mean() / 2)


def silhouette(problem: InverseProblem, shape_id: str, subpixels: int = 4) -> np.ndarray:
    """Where the camera sees the shape: (H, W) share of each pixel, from ``subpixels`` squared
    rays.
    """
    import drjit as dr
    import mitsuba as mi

    scene, (width, height) = problem.scene(), problem.size
    columns, rows = np.meshgrid((np.arange(width * subpixels) + 0.5) / (width * subpixels),
                                (np.arange(height * subpixels) + 0.5) / (height * subpixels))
    ray, _ = scene.sensors()[0].sample_ray(0.0, 0.5, mi.Point2f(columns.ravel(), rows.ravel()),
                                           mi.Point2f(0.5))
    hit = scene.ray_intersect_preliminary(mi.Ray3f(ray))
    shape = next(shape for shape in scene.shapes() if shape.id() == shape_id)
    seen = np.array(hit.is_valid() & (hit.shape == mi.ShapePtr(shape)))
    dr.eval()
    return seen.reshape(height, subpixels, width, subpixels).mean(axis=(1, 3))


def _check(views: Sequence[View], shape_id: str, materials: tuple[MaterialSpec, ...]) -> None:
    if len(views) < FEWEST_VIEWS:
        raise InputError(f"{len(views)} photos of the object are given; {FEWEST_VIEWS} or more, "
                         "from around it, are needed to find its shape")
    for view in views:
        surfaces = view.scene_file.surfaces
        if shape_id not in surfaces:
            raise InputError(f"{view.scene_file.path.name} has no shape with the id {shape_id!r}; "
                             f"it has {', '.join(surfaces)}")
        if view.light_scale is None:
            raise InputError(f"the light scale of {view.name} is unknown: a shape needs photos "
                             "whose brightness is known; calibrate from a chart photo with [chart] "
                             "scene")
    own = views[0].scene_file.surfaces[shape_id]
    others = [material.name for material in materials if material.reflectance is None
              and material.bsdf != own]
    if others:
        raise InputError(f"the spectrum of {', '.join(others)} is unknown: beside an unknown shape "
                         "only the object's own may be; give the others theirs")
    if all(material.reflectance is not None for material in materials if material.bsdf == own):
        raise InputError(f"the object {shape_id!r} wears no material that is looked for: leave its "
                         "reflectance out")
