"""Shape and spectrum of one object from photos around it (paper Sec. 4.2, Fig. 6).

A start mesh, such as a sphere, is moved towards the photos by gradient descent, coarse to fine,
while the spline coefficients of the object's spectrum are estimated along with it. The squared
error has its gradient by the spectrum and by the surface's position from Mitsuba's ``prb``, and by
the outline from ``add_outline_gradient``. Vertices v follow uniform Adam in u = (I + diffusion L) v
(Nicolet et al. 2021, Algorithm 1). The spectrum of the descent is a starting point, without errors:
``on_mesh`` lets the transport engine estimate it on the found mesh.
"""
from __future__ import annotations

import copy
import hashlib
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from spectrabox.radiometry.files import whole_file
from spectrabox.radiometry.records.scenes import Reconstruction
from spectrabox.radiometry.records.spectra import Outcome, Progress
from spectrabox.radiometry.system.archives import DamagedArchiveError, opened_npz
from spectrabox.reconstruct.gradient_engine import reflectance_key, stalled
from spectrabox.reconstruct.inverse_rendering import reconstruct
from spectrabox.reconstruct.rendering.renderer import render
from spectrabox.reconstruct.scene.scene_xml import BLACK
from spectrabox.reconstruct.settings import InversionSettings
from spectrabox.reconstruct.shape import mesh as meshes
from spectrabox.reconstruct.view import PhotoView

SPECTRUM_RATE = 0.02        # of the coefficients, per step
GREY_RANGE = (0.05, 0.95)   # of the flat spectrum to start from
TRIAL_GREY = 0.5


@dataclass(frozen=True)
class Stage:
    """Steps on one mesh."""

    subdivisions: int   # of the start mesh, those of the stages before included
    steps: int
    rate: float         # of the vertices, per step, in radii of the start mesh
    diffusion: float
    spp: int
    views: int = 4      # of every step, drawn anew


STAGES = (Stage(0, 40, 0.03, 19.0, 8), Stage(1, 40, 0.02, 19.0, 8), Stage(1, 50, 0.01, 8.0, 8))
SPHERE_LEVEL = 3    # of subdivision of the icosahedron: 642 vertices


@dataclass(frozen=True)
class ShapeSettings:
    """Stages of the fit, coefficients of the spectrum and seed."""

    coefficients: int = 9
    stages: tuple[Stage, ...] = STAGES  # coarse to fine
    seed: int = 1


@dataclass(frozen=True, eq=False)
class ShapeReconstruction:
    """A closed mesh in the scenes' coordinates and the object's spectrum."""

    vertices: np.ndarray        # (V, 3)
    faces: np.ndarray           # (F, 3) anticlockwise seen from outside
    coefficients: np.ndarray    # (N,)
    spectrum: np.ndarray        # (P,) reflectance on the calibration's grid
    # mean over the views of a step of the squared error, in squares of the brightest pixel
    loss_history: np.ndarray
    outcome: Outcome


def sphere(centre: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) and faces (F, 3) of the sphere that a fit starts from.

    Parameters
    ----------
    centre : (3,) array
    radius : float
        In the scene's unit.
    """
    vertices, faces = meshes.icosphere(SPHERE_LEVEL)
    return centre + radius * vertices, faces


def reconstruct_shape(views: Sequence[PhotoView], shape_id: str, vertices: np.ndarray,
                      faces: np.ndarray, settings: ShapeSettings, progress: Progress,
                      checkpoint: Path | None = None) -> ShapeReconstruction:
    """Mesh and spectrum that explain several photos of one object.

    Parameters
    ----------
    views : sequence of PhotoView
        Three or more, each with its light scale. Their scenes hold the object as a shape with the
        id ``shape_id``. The object's own material is the only unknown one.
    shape_id : str
    vertices : (V, 3) array
        Of the start mesh, closed, about where and as large as the object is.
    faces : (F, 3) int
        Anticlockwise seen from outside.
    settings : ShapeSettings
    progress : function of (fraction done, what is being done)
    checkpoint : Path, optional
        File that takes every finished stage, and from which a fit of the same photos, start mesh
        and seed goes on; its stages may have become more. The end has the same bits.
    """
    radius = float(np.ptp(vertices, axis=0).mean() / 2)
    coefficients = np.empty(0)
    losses: list[float] = []
    history: list[float] = []
    total = sum(stage.steps for stage in settings.stages)
    asked = "" if checkpoint is None else _digest(views, shape_id, vertices, faces, settings)
    finished = 0
    if checkpoint is not None and (kept := _finished_stages(checkpoint, asked, settings)):
        finished, vertices, faces, coefficients, losses = kept
        history = losses[-settings.stages[finished - 1].steps:]
    with tempfile.TemporaryDirectory() as folder:
        done = 0
        for number, stage in enumerate(settings.stages):
            if number < finished:
                done = stage.subdivisions
                continue
            for _ in range(stage.subdivisions - done):
                vertices, faces = meshes.subdivided(vertices, faces)
            done = stage.subdivisions
            path = Path(folder) / f"stage_{number}.ply"
            meshes.write_mesh(path, vertices, faces)
            shown = [with_mesh(view, shape_id, path) for view in views]
            if not coefficients.size:
                coefficients = flat_start(shown, settings.coefficients, stage.spp, settings.seed)

            def part(step: int, before: int = len(losses)) -> None:
                progress((before + step) / total, "moving the mesh")

            vertices, coefficients, history = descend(
                shown, shape_id, vertices, faces, coefficients,
                replace(stage, rate=stage.rate * radius), settings.seed * 1009 + number, part)
            losses += history
            if checkpoint is not None:
                with whole_file(checkpoint) as unfinished, unfinished.open("wb") as stream:
                    np.savez(stream, asked=asked, finished=number + 1,
                             stages=repr(settings.stages[:number + 1]), vertices=vertices,
                             faces=faces, coefficients=coefficients, losses=losses)
    outcome = Outcome.CONVERGED if stalled(history, len(history) // 2) else Outcome.STEP_LIMIT
    return ShapeReconstruction(vertices, faces, coefficients,
                               views[0].basis(settings.coefficients) @ coefficients,
                               np.array(losses), outcome)


def _digest(views: Sequence[PhotoView], shape_id: str, vertices: np.ndarray, faces: np.ndarray,
            settings: ShapeSettings) -> str:
    """SHA-256 of what decides a fit's bits but its stages."""
    digest = hashlib.sha256(repr((shape_id, settings.coefficients, settings.seed)).encode())
    for view in views:
        digest.update(ET.tostring(view.scene_file.root))
        digest.update(repr(light_scale(view)).encode())
        for image in (view.measured, view.response, view.photo.saturated):
            digest.update(np.ascontiguousarray(image, dtype=float).tobytes())
    for array in (vertices, faces):
        digest.update(np.ascontiguousarray(array, dtype=float).tobytes())
    return digest.hexdigest()


def _finished_stages(checkpoint: Path, asked: str, settings: ShapeSettings
                     ) -> tuple[int, np.ndarray, np.ndarray, np.ndarray, list[float]] | None:
    """Stages that are finished, and mesh, coefficients and losses after them; None without a file
    of this fit.
    """
    try:
        with opened_npz(checkpoint) as stored:
            finished = int(stored["finished"])
            if str(stored["asked"]) != asked or str(stored["stages"]) != repr(
                    settings.stages[:finished]):
                return None
            return (finished, stored["vertices"], stored["faces"], stored["coefficients"],
                    stored["losses"].tolist())
    except (FileNotFoundError, DamagedArchiveError):
        return None


def with_mesh(view: PhotoView, shape_id: str, mesh: Path) -> PhotoView:
    """The view with a mesh file instead of one of its shapes.

    Parameters
    ----------
    view : PhotoView
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


def on_mesh(views: Sequence[PhotoView], shape_id: str, vertices: np.ndarray, faces: np.ndarray,
            settings: InversionSettings, progress: Progress) -> tuple[Reconstruction, ...]:
    """The spectrum behind each photo by itself on a mesh, by the transport engine.

    Parameters
    ----------
    views : V of PhotoView
    shape_id : str
        Of the shape that the mesh replaces.
    vertices : (V, 3) array
    faces : (F, 3) int
    settings : InversionSettings
    progress : function of (fraction done, what is being done)
    """
    found = []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "found.ply"
        meshes.write_mesh(path, vertices, faces)
        for number, view in enumerate(views):
            progress(number / len(views), "estimating the spectrum")
            found.append(reconstruct(with_mesh(view, shape_id, path), settings,
                                     lambda share, message: None))
    return tuple(found)


def flat_start(views: Sequence[PhotoView], coefficients: int, spp: int, seed: int) -> np.ndarray:
    """Coefficients (N,) of the grey with which the views are about as bright as their photos.

    Parameters
    ----------
    views : sequence of PhotoView
        Each with its light scale and one unknown material.
    coefficients : int
        N.
    spp : int
        Paths per pixel of one rendering of each view.
    seed : int
        Of these.

    Raises
    ------
    ValueError
        If a view has no light scale.
    """
    grey = np.full((1, coefficients), TRIAL_GREY)
    rendered = [render(view.scene(grey), spp, seed)[0] * light_scale(view) for view in views]
    ratio = [view.measured.sum() / image.sum() for view, image in zip(views, rendered, strict=True)]
    return np.full(coefficients, np.clip(TRIAL_GREY * np.median(ratio), *GREY_RANGE))


def descend(views: Sequence[PhotoView], shape_id: str, vertices: np.ndarray, faces: np.ndarray,
            coefficients: np.ndarray, stage: Stage, seed: int,
            progress: Callable[[int], None]) -> tuple[np.ndarray, np.ndarray, list[float]]:
    """Vertices (V, 3) and coefficients (N,) after the stage, and the loss of every step.

    Parameters
    ----------
    views : sequence of PhotoView
        Each with its light scale; their scenes hold the mesh as the shape ``shape_id``.
    shape_id : str
    vertices : (V, 3) array
        In the scene's unit.
    faces : (F, 3) int
    coefficients : (N,) array
        Of the object's spectrum, 0 to 1.
    stage : Stage
        Its rate is in the scene's unit here.
    seed : int
        Of the views of each step and of their renderings.
    progress : function of the number of steps done

    Raises
    ------
    ValueError
        If a view has no light scale.
    """
    import drjit as dr
    import mitsuba as mi

    to_steps, from_steps = meshes.large_steps(faces, len(vertices), stage.diffusion)
    losses_of = [ViewLoss(view, coefficients, shape_id) for view in views]
    positions = mi.ad.Adam(lr=stage.rate, uniform=True)
    spectrum = mi.ad.Adam(lr=SPECTRUM_RATE)
    positions["u"] = mi.Float(to_steps(vertices).astype(np.float32).ravel())
    spectrum["c"] = mi.Float(coefficients.astype(np.float32))
    generator = np.random.default_rng(seed)
    losses = []
    for step in range(stage.steps):
        chosen = generator.permutation(len(views))[:stage.views]
        by_vertex, by_coefficient, loss = np.zeros_like(vertices), np.zeros_like(coefficients), 0.0
        for number in chosen:
            draw = (seed * 100003 + step * len(views) + int(number)) * 3 % 2**32
            parts = losses_of[number].gradients(vertices, coefficients, stage.spp, draw)
            by_vertex += parts[0] / len(chosen)
            by_coefficient += parts[1] / len(chosen)
            loss += parts[2] / len(chosen)
        dr.set_grad(positions["u"], mi.Float(from_steps(by_vertex).astype(np.float32).ravel()))
        dr.set_grad(spectrum["c"], mi.Float(by_coefficient.astype(np.float32)))
        positions.step()
        spectrum.step()
        spectrum["c"] = dr.clip(dr.detach(spectrum["c"]), 0.0, 1.0)
        vertices = from_steps(np.array(positions["u"], dtype=float).reshape(-1, 3))
        coefficients = np.array(spectrum["c"], dtype=float)
        losses.append(loss)
        progress(step + 1)
    return vertices, coefficients, losses


class ViewLoss:
    """An open scene and its photo; squared error relative to the brightest pixel, mean over pixels.
    """

    def __init__(self, view: PhotoView, coefficients: np.ndarray, shape_id: str) -> None:
        import mitsuba as mi

        self.scene, self.scale = view.scene(coefficients[None]), light_scale(view)
        self.photo, self.basis = view.measured, view.basis(coefficients.size)
        saturated = view.photo.saturated
        self.weight = ~saturated / (np.where(saturated, 0.0, self.photo).max() ** 2
                                    * self.photo.size)
        self.parameters = mi.traverse(self.scene)
        self.positions = f"{shape_id}.vertex_positions"
        self.reflectance = reflectance_key(self.parameters, view.unknown[0].bsdf,
                                           view.scene_file)
        self.parameters.keep([self.positions, self.reflectance])

    def gradients(self, vertices: np.ndarray, coefficients: np.ndarray, spp: int,
                  draw: int) -> tuple[np.ndarray, np.ndarray, float]:
        """Gradient by vertices (V, 3) and by coefficients (N,), and the loss."""
        import drjit as dr
        import mitsuba as mi

        positions = mi.Float(vertices.astype(np.float32).ravel())
        values = mi.Float((BLACK + self.basis @ coefficients).astype(np.float32))
        dr.enable_grad(positions, values)
        self.parameters[self.positions], self.parameters[self.reflectance] = positions, values
        self.parameters.update()
        image = mi.render(self.scene, self.parameters, spp=spp, seed=draw, seed_grad=draw + 1)
        error = np.array(image, dtype=float) * self.scale - self.photo
        slope = 2 * self.weight * error * self.scale
        dr.backward(dr.sum(image * mi.TensorXf(slope.astype(np.float32)), axis=None))
        meshes.add_outline_gradient(self.scene, slope, spp, draw + 2)
        return (np.array(dr.grad(positions), dtype=float).reshape(-1, 3),
                self.basis.T @ np.array(dr.grad(values), dtype=float),
                float(np.sum(self.weight * error**2)))


def light_scale(view: PhotoView) -> float:
    """The view's light scale, which the fit does not estimate."""
    if view.light_scale is None:
        raise ValueError("the shape fit needs the light scale of every view")
    return view.light_scale.value
