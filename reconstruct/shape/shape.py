"""Shape and spectrum of one object from photos around it (paper Sec. 4.2, Fig. 6).

A sphere is moved towards the photos by gradient descent, coarse to fine, while the spline
coefficients of the object's spectrum are estimated along with it (``descent.py``). The spectrum of
the descent is a starting point: put the mesh into the views (``with_mesh``) and let the transport
engine estimate the spectrum with its uncertainty.
"""
from __future__ import annotations

import copy
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.progress import Progress
from spectrabox.radiometry.records import Outcome
from spectrabox.reconstruct.engines.gradient import stalled
from spectrabox.reconstruct.shape.descent import Stage, descend, flat_start
from spectrabox.reconstruct.shape.mesh import icosphere, subdivided, write_mesh
from spectrabox.reconstruct.view import View
from spectrabox.reconstruct.view_checks import check_views

MIN_VIEWS = 3
STAGES = (Stage(3, 40, 0.03, 19.0, 8), Stage(4, 40, 0.02, 19.0, 8), Stage(4, 50, 0.01, 8.0, 8))


@dataclass(frozen=True)
class ShapeSettings:
    """Numbers an operator may choose."""

    coefficients: int = 9
    stages: tuple[Stage, ...] = STAGES  # coarse to fine
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


def reconstruct_shape(views: Sequence[View], shape_id: str, settings: ShapeSettings,
                      progress: Progress) -> ShapeReconstruction:
    """Mesh and spectrum that explain several photos of one object.

    Parameters
    ----------
    views : sequence of View
        Three or more, each with its light scale. Their scenes hold the object as a shape with the
        id ``shape_id``, for instance a sphere, about where and as large as it is: the fit starts
        from the sphere in its bounding box. The object's own material is the only unknown one.
    shape_id : str
    settings : ShapeSettings
    progress : function of (fraction done, what is being done)

    Raises
    ------
    InputError
        If there are too few views, a scene lacks the shape, a light scale is missing, other
        materials are unknown, or photos and scenes cannot be compared (see ``check_views``).
    """
    _check(views, shape_id)
    vertices, faces = icosphere(settings.stages[0].level)
    centre, radius = bounding_sphere(views[0], shape_id)
    vertices = centre + radius * vertices
    coefficients = np.empty(0)
    losses: list[float] = []
    total = sum(stage.steps for stage in settings.stages)
    with tempfile.TemporaryDirectory() as folder:
        for number, stage in enumerate(settings.stages):
            last_level = settings.stages[number - 1].level if number else stage.level
            for _ in range(stage.level - last_level):
                vertices, faces = subdivided(vertices, faces)
            path = Path(folder) / f"stage_{number}.ply"
            write_mesh(path, vertices, faces)
            shown = [with_mesh(view, shape_id, path) for view in views]
            check_views(shown)
            if not coefficients.size:
                coefficients = flat_start(shown, settings.coefficients, stage.spp, settings.seed)

            def part(step: int, before: int = len(losses)) -> None:
                progress((before + step) / total, "moving the mesh")

            vertices, coefficients, history = descend(
                shown, shape_id, vertices, faces, coefficients,
                replace(stage, rate=stage.rate * radius), settings.seed * 1009 + number, part)
            losses += history
    outcome = Outcome.CONVERGED if stalled(history, len(history) // 2) else Outcome.STEP_LIMIT
    return ShapeReconstruction(vertices, faces, coefficients,
                               views[0].basis(settings.coefficients) @ coefficients,
                               np.array(losses), outcome)


def with_mesh(view: View, shape_id: str, mesh: Path) -> View:
    """The view with a mesh file instead of one of its shapes.

    Parameters
    ----------
    view : View
        Stays as it is.
    shape_id : str
        Of a shape of its scene, whose material the mesh takes over.
    mesh : Path
        PLY file, in the scene's coordinates.
    """
    root = copy.deepcopy(view.scene_file.root)
    shape = next(node for node in root.iter("shape") if node.get("id") == shape_id)
    for child in [child for child in shape if child.tag != "ref"]:
        shape.remove(child)
    shape.set("type", "ply")
    ET.SubElement(shape, "string", name="filename", value=str(mesh.resolve()))
    return replace(view, scene_file=replace(view.scene_file, root=root))


def bounding_sphere(view: View, shape_id: str) -> tuple[np.ndarray, float]:
    """Centre (3,) and radius of the sphere in a shape's bounding box, in the scene's coordinates.

    Parameters
    ----------
    view : View
    shape_id : str
        Of a shape of its scene.
    """
    box = next(shape for shape in view.scene().shapes() if shape.id() == shape_id).bbox()
    lower, upper = np.array(box.min, dtype=float).ravel(), np.array(box.max, dtype=float).ravel()
    return (lower + upper) / 2, float((upper - lower).mean() / 2)


def _check(views: Sequence[View], shape_id: str) -> None:
    if len(views) < MIN_VIEWS:
        raise InputError(f"{len(views)} photos of the object are given; {MIN_VIEWS} or more, "
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
    own, materials = views[0].scene_file.surfaces[shape_id], views[0].materials
    others = [material.name for material in materials
              if material.reflectance is None and material.bsdf != own]
    if others:
        raise InputError(f"the spectrum of {', '.join(others)} is unknown: beside an unknown shape "
                         "only the object's own may be; give the others theirs")
    if all(material.reflectance is not None for material in materials if material.bsdf == own):
        raise InputError(f"the object {shape_id!r} has no material of unknown spectrum: leave its "
                         "reflectance out")
