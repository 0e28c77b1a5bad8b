"""Shape and spectra of one object from photos around it (paper Sec. 4.2, Fig. 6).

A start mesh, such as a sphere, is moved towards the photos by gradient descent, coarse to fine,
while the spline coefficients of its paints' spectra are estimated along with it. The squared
error has its gradient by the spectrum and by the surface's position from Mitsuba's ``prb``, and by
the outline from ``add_outline_gradient``. Vertices v follow uniform Adam in u = (I + diffusion L) v
(Nicolet et al. 2021, Algorithm 1). The spectra of the descent are starting points, without errors:
``on_mesh`` lets the transport engine estimate them on the found mesh.
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
from spectrabox.reconstruct.shape import paints
from spectrabox.reconstruct.view import PhotoView

SPECTRUM_RATE = 0.02        # of the coefficients, per step
GREY_RANGE = (0.05, 0.95)   # of the flat spectrum to start from
TRIAL_GREY = 0.5
VOTE_STEPS = 10     # after which the photos say anew which paint the moved mesh has where


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


@dataclass(frozen=True, eq=False)
class ShapeReconstruction:
    """A closed mesh in the scenes' coordinates and the spectra of its M paints."""

    vertices: np.ndarray        # (V, 3)
    faces: np.ndarray           # (F, 3) anticlockwise seen from outside
    spectra: np.ndarray         # (M, P) reflectance on the calibration's grid
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
                      faces: np.ndarray, painted: paints.PaintLabels, stages: tuple[Stage, ...],
                      settings: InversionSettings, progress: Progress,
                      checkpoint: Path | None = None) -> ShapeReconstruction:
    """Mesh and spectra that explain several photos of one object.

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
    painted : PaintLabels
        Where the photos show its paints.
    stages : tuple of Stage
        Coarse to fine.
    settings : InversionSettings
        Of which the number of coefficients and the seed count.
    progress : function of (fraction done, what is being done)
    checkpoint : Path, optional
        File that takes every finished stage, and from which a fit of the same photos, start mesh
        and seed goes on; its stages may have become more. The end has the same bits.
    """
    radius = float(np.ptp(vertices, axis=0).mean() / 2)
    coefficients = np.empty(0)
    losses: list[float] = []
    history: list[float] = []
    total = sum(stage.steps for stage in stages)
    asked = "" if checkpoint is None else _digest(views, shape_id, vertices, faces, painted,
                                                  settings)
    finished = 0
    if checkpoint is not None and (kept := _finished_stages(checkpoint, asked, stages)):
        finished, vertices, faces, coefficients, losses = kept
        history = losses[-stages[finished - 1].steps:]
    with tempfile.TemporaryDirectory() as folder:
        done = 0
        for number, stage in enumerate(stages):
            if number < finished:
                done = stage.subdivisions
                continue
            for _ in range(stage.subdivisions - done):
                vertices, faces = meshes.subdivided(vertices, faces)
            done = stage.subdivisions
            path = Path(folder) / f"stage_{number}.ply"
            # the weights of paints are put in by the descent
            meshes.write_mesh(path, vertices, faces, attributes={
                paints.weight_name(paint): np.zeros(len(vertices))
                for paint in range(1, len(painted.names))})
            shown = [paints.painted_mesh(with_mesh(view, shape_id, path), shape_id, painted.names)
                     for view in views]
            if not coefficients.size:
                coefficients = flat_start(shown, painted, settings.coefficients, stage.spp,
                                          settings.seed)

            def part(step: int, before: int = len(losses)) -> None:
                progress((before + step) / total, "moving the mesh")

            vertices, coefficients, history = descend(
                shown, shape_id, vertices, faces, painted, coefficients,
                replace(stage, rate=stage.rate * radius), settings.seed * 1009 + number, part)
            losses += history
            if checkpoint is not None:
                with whole_file(checkpoint) as unfinished, unfinished.open("wb") as stream:
                    np.savez(stream, asked=asked, finished=number + 1,
                             stages=repr(stages[:number + 1]), vertices=vertices,
                             faces=faces, coefficients=coefficients, losses=losses)
    outcome = Outcome.CONVERGED if stalled(history, len(history) // 2) else Outcome.STEP_LIMIT
    return ShapeReconstruction(vertices, faces,
                               coefficients @ views[0].basis(settings.coefficients).T,
                               np.array(losses), outcome)


def _digest(views: Sequence[PhotoView], shape_id: str, vertices: np.ndarray, faces: np.ndarray,
            painted: paints.PaintLabels, settings: InversionSettings) -> str:
    """SHA-256 of what decides a fit's bits but its stages."""
    digest = hashlib.sha256(repr((shape_id, settings.coefficients, settings.seed,
                                  len(painted.names))).encode())
    for labels in painted.labels:
        digest.update(labels.tobytes())
    for view in views:
        digest.update(ET.tostring(view.scene_file.root))
        digest.update(repr(light_scale(view)).encode())
        for image in (view.measured, view.response, view.photo.saturated):
            digest.update(np.ascontiguousarray(image, dtype=float).tobytes())
    for array in (vertices, faces):
        digest.update(np.ascontiguousarray(array, dtype=float).tobytes())
    return digest.hexdigest()


def _finished_stages(checkpoint: Path, asked: str, stages: tuple[Stage, ...]
                     ) -> tuple[int, np.ndarray, np.ndarray, np.ndarray, list[float]] | None:
    """Stages that are finished, and mesh, coefficients and losses after them; None without a file
    of this fit.
    """
    try:
        with opened_npz(checkpoint) as stored:
            finished = int(stored["finished"])
            if str(stored["asked"]) != asked or str(stored["stages"]) != repr(stages[:finished]):
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
            painted: paints.PaintLabels, spectra: np.ndarray, settings: InversionSettings,
            progress: Progress) -> tuple[np.ndarray, tuple[Reconstruction, ...]]:
    """The paint of each face, and the spectra behind each photo by itself on a mesh, by the
    transport engine.

    A photo that does not tell of a paint (``paints.telling_photos``) takes its spectrum, for the
    light that it casts on others, from the descent; that paint is a known one in its record.

    Parameters
    ----------
    views : V of PhotoView
    shape_id : str
        Of the shape that the mesh replaces.
    vertices : (V, 3) array
    faces : (F, 3) int
    painted : PaintLabels
    spectra : (M, P) array
        Of the paints, from the descent.
    settings : InversionSettings
    progress : function of (fraction done, what is being done)

    Returns
    -------
    (F,) int, V of Reconstruction

    Raises
    ------
    InputError
        If fewer than two photos tell of a paint.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "found"
        meshes.write_mesh(path.with_suffix(".ply"), vertices, faces)
        shown = [with_mesh(view, shape_id, path.with_suffix(".ply")) for view in views]
        paint_of_face = np.zeros(len(faces), dtype=int)
        if painted.labels:
            counts = [paints.votes(view.scene(), shape_id, len(faces), labels, len(painted.names))
                      for view, labels in zip(shown, painted.labels, strict=True)]
            paint_of_face = paints.paint_of_faces(np.sum(counts, axis=0), vertices, faces)
            shown = _each_paint(shown, shape_id, paints.write_mesh_of_each_paint(
                path, vertices, faces, paint_of_face, painted.names), painted, spectra)
        found = []
        for number, view in enumerate(shown):
            progress(number / len(views), "estimating the spectrum")
            found.append(reconstruct(view, settings, lambda share, message: None))
    return paint_of_face, tuple(found)


def _each_paint(views: Sequence[PhotoView], shape_id: str, files: Sequence[Path | None],
                painted: paints.PaintLabels, spectra: np.ndarray) -> list[PhotoView]:
    """Views in which each paint is a shape, compared where photo and mesh have the same paint; the
    paints that a photo does not tell of are known.
    """
    shown, pixels = [], []
    for number, view in enumerate(views):
        of_paints = paints.mesh_of_each_paint(view, shape_id, files, painted.names)
        shares = painted.shares[number]
        name_of = (*of_paints.surface_materials, "")       # the last where no surface is
        own = np.array([painted.names.index(name) if name else -1
                        for name in name_of])[of_paints.surface]
        alike = (shares.max(axis=2) > paints.PURE) & (shares.argmax(axis=2) == own)
        shown.append(_compared_where(of_paints, alike))
        pixels.append(np.bincount(own[shown[-1].used], minlength=len(painted.names)))
    telling = paints.telling_photos(np.array(pixels), painted.names)
    for number, own_telling in enumerate(telling):
        view = shown[number]
        told = [index for index, name in enumerate(view.surface_materials)
                if own_telling[painted.names.index(name)]]
        shown[number] = replace(
            _compared_where(view, np.isin(view.surface, told)), materials=tuple(
                material if tells else replace(material, reflectance=spectrum)
                for material, tells, spectrum in zip(view.materials, own_telling, spectra,
                                                     strict=True)))
    return shown


def _compared_where(view: PhotoView, pixels: np.ndarray) -> PhotoView:
    """The view, compared at these pixels (H, W) alone."""
    return replace(view, photo=replace(
        view.photo, saturated=view.photo.saturated | ~pixels[..., None]))


def flat_start(views: Sequence[PhotoView], painted: paints.PaintLabels, coefficients: int, spp: int,
               seed: int) -> np.ndarray:
    """Coefficients (M, N) of the greys with which the views are about as bright as their photos.

    Parameters
    ----------
    views : sequence of PhotoView
        Each with its light scale and unknown materials alone.
    painted : PaintLabels
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
    grey = np.full((len(painted.names), coefficients), TRIAL_GREY)
    rendered = [render(view.scene(grey), spp, seed)[0] * light_scale(view) for view in views]
    shares = [share[..., None] for share in painted.shares]
    greys = []
    for paint in range(len(painted.names)):
        ratios = [(view.measured * share[:, :, paint]).sum() / (image * share[:, :, paint]).sum()
                  for view, image, share in zip(views, rendered, shares, strict=True)
                  if (image * share[:, :, paint]).any()]
        greys.append(np.clip(TRIAL_GREY * np.median(ratios or [1.0]), *GREY_RANGE))
    return np.repeat(np.array(greys)[:, None], coefficients, axis=1)


def descend(views: Sequence[PhotoView], shape_id: str, vertices: np.ndarray, faces: np.ndarray,
            painted: paints.PaintLabels, coefficients: np.ndarray, stage: Stage, seed: int,
            progress: Callable[[int], None]) -> tuple[np.ndarray, np.ndarray, list[float]]:
    """Vertices (V, 3) and coefficients (M, N) after the stage, and the loss of every step.

    Parameters
    ----------
    views : sequence of PhotoView
        Each with its light scale; their scenes hold the mesh as the shape ``shape_id``.
    shape_id : str
    vertices : (V, 3) array
        In the scene's unit.
    faces : (F, 3) int
    painted : PaintLabels
    coefficients : (M, N) array
        Of its spectra, 0 to 1.
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
    spectra = mi.ad.Adam(lr=SPECTRUM_RATE)
    positions["u"] = mi.Float(to_steps(vertices).astype(np.float32).ravel())
    spectra["c"] = mi.Float(coefficients.astype(np.float32).ravel())
    generator = np.random.default_rng(seed)
    losses = []
    for step in range(stage.steps):
        if painted.labels and step % VOTE_STEPS == 0:
            _vote(losses_of, vertices, faces, painted)
        chosen = generator.permutation(len(views))[:stage.views]
        by_vertex, by_coefficient, loss = np.zeros_like(vertices), np.zeros_like(coefficients), 0.0
        for number in chosen:
            draw = (seed * 100003 + step * len(views) + int(number)) * 3 % 2**32
            parts = losses_of[number].gradients(vertices, coefficients, stage.spp, draw)
            by_vertex += parts[0] / len(chosen)
            by_coefficient += parts[1] / len(chosen)
            loss += parts[2] / len(chosen)
        dr.set_grad(positions["u"], mi.Float(from_steps(by_vertex).astype(np.float32).ravel()))
        dr.set_grad(spectra["c"], mi.Float(by_coefficient.astype(np.float32).ravel()))
        positions.step()
        spectra.step()
        spectra["c"] = dr.clip(dr.detach(spectra["c"]), 0.0, 1.0)
        vertices = from_steps(np.array(positions["u"], dtype=float).reshape(-1, 3))
        coefficients = np.array(spectra["c"], dtype=float).reshape(coefficients.shape)
        losses.append(loss)
        progress(step + 1)
    return vertices, coefficients, losses


def _vote(losses_of: Sequence[ViewLoss], vertices: np.ndarray, faces: np.ndarray,
          painted: paints.PaintLabels) -> None:
    """Put the paints into the scenes where the photos show them on the mesh."""
    counts = np.zeros((len(faces), len(painted.names)), dtype=int)
    for loss, labels in zip(losses_of, painted.labels, strict=True):
        loss.place(vertices)
        counts += paints.votes(loss.scene, loss.shape_id, len(faces), labels, len(painted.names))
    weights = paints.vertex_weights(counts, vertices, faces)
    for loss in losses_of:
        loss.paint(weights)


class ViewLoss:
    """An open scene and its photo; squared error relative to the brightest pixel, mean over pixels.
    """

    def __init__(self, view: PhotoView, coefficients: np.ndarray, shape_id: str) -> None:
        import mitsuba as mi

        self.scene, self.scale = view.scene(coefficients), light_scale(view)
        self.shape_id = shape_id
        self.photo, self.basis = view.measured, view.basis(coefficients.shape[1])
        saturated = view.photo.saturated
        self.weight = ~saturated / (np.where(saturated, 0.0, self.photo).max() ** 2
                                    * self.photo.size)
        self.parameters = mi.traverse(self.scene)
        self.positions = f"{shape_id}.vertex_positions"
        self.reflectances = [reflectance_key(self.parameters, material.bsdf, view.scene_file)
                             for material in view.unknown]
        self.weights = [f"{shape_id}.{paints.weight_name(paint)}"
                        for paint in range(1, len(coefficients))]
        self.parameters.keep([self.positions, *self.reflectances, *self.weights])

    def place(self, vertices: np.ndarray) -> None:
        """Move the mesh to vertices (V, 3)."""
        import mitsuba as mi

        self.parameters[self.positions] = mi.Float(vertices.astype(np.float32).ravel())
        self.parameters.update()

    def paint(self, weights: np.ndarray) -> None:
        """Blend the paints by weights (M - 1, V) of ``paints.vertex_weights``."""
        import mitsuba as mi

        for name, values in zip(self.weights, weights, strict=True):
            self.parameters[name] = mi.Float(values.astype(np.float32))
        self.parameters.update()

    def gradients(self, vertices: np.ndarray, coefficients: np.ndarray, spp: int,
                  draw: int) -> tuple[np.ndarray, np.ndarray, float]:
        """Gradient by vertices (V, 3) and by coefficients (M, N), and the loss."""
        import drjit as dr
        import mitsuba as mi

        positions = mi.Float(vertices.astype(np.float32).ravel())
        spectra = [mi.Float((BLACK + self.basis @ own).astype(np.float32)) for own in coefficients]
        dr.enable_grad(positions, *spectra)
        self.parameters[self.positions] = positions
        for name, values in zip(self.reflectances, spectra, strict=True):
            self.parameters[name] = values
        self.parameters.update()
        image = mi.render(self.scene, self.parameters, spp=spp, seed=draw, seed_grad=draw + 1)
        error = np.array(image, dtype=float) * self.scale - self.photo
        slope = 2 * self.weight * error * self.scale
        dr.backward(dr.sum(image * mi.TensorXf(slope.astype(np.float32)), axis=None))
        meshes.add_outline_gradient(self.scene, slope, spp, draw + 2)
        return (np.array(dr.grad(positions), dtype=float).reshape(-1, 3),
                np.array([self.basis.T @ np.array(dr.grad(values), dtype=float)
                          for values in spectra]),
                float(np.sum(self.weight * error**2)))


def light_scale(view: PhotoView) -> float:
    """The view's light scale, which the fit does not estimate."""
    if view.light_scale is None:
        raise ValueError("the shape fit needs the light scale of every view")
    return view.light_scale.value
