"""One stage of the shape fit: descent of mesh and spectrum together, on fixed triangles.

The squared error has its gradient by the spectrum and by the surface's position from Mitsuba's
``prb``, and by the outline from ``edges.py``. Vertices v follow uniform Adam in u = (I +
diffusion L) v (Nicolet et al. 2021, Algorithm 1).
"""
from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from spectrabox.reconstruct.engines.gradient import reflectance_key
from spectrabox.reconstruct.rendering.renderer import render
from spectrabox.reconstruct.scene.scene_xml import BLACK
from spectrabox.reconstruct.shape.edges import add_outline_gradient
from spectrabox.reconstruct.shape.mesh import large_steps
from spectrabox.reconstruct.view import View

SPECTRUM_RATE = 0.02        # of the coefficients, per step
GREY_RANGE = (0.05, 0.95)   # of the flat spectrum to start from
TRIAL_GREY = 0.5


@dataclass(frozen=True)
class Stage:
    """Steps on one mesh."""

    level: int          # of subdivision of the icosahedron
    steps: int
    rate: float         # of the vertices, per step, in radii of the object
    diffusion: float
    spp: int
    views: int = 4      # of every step, drawn anew


def flat_start(views: Sequence[View], coefficients: int, spp: int, seed: int) -> np.ndarray:
    """Coefficients (N,) of the grey with which the views are about as bright as their photos.

    Parameters
    ----------
    views : sequence of View
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
    rendered = [render(view.scene(grey), spp, seed)[0] * _scale(view) for view in views]
    ratio = [view.measured.sum() / image.sum() for view, image in zip(views, rendered, strict=True)]
    return np.full(coefficients, np.clip(TRIAL_GREY * np.median(ratio), *GREY_RANGE))


def descend(views: Sequence[View], shape_id: str, vertices: np.ndarray, faces: np.ndarray,
            coefficients: np.ndarray, stage: Stage, seed: int,
            progress: Callable[[int], None]) -> tuple[np.ndarray, np.ndarray, list[float]]:
    """Vertices (V, 3) and coefficients (N,) after the stage, and the loss of every step.

    Parameters
    ----------
    views : sequence of View
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

    to_steps, from_steps = large_steps(faces, len(vertices), stage.diffusion)
    losses_of = [_ViewLoss(view, coefficients, shape_id) for view in views]
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


class _ViewLoss:
    """An open scene and its photo; squared error relative to the brightest pixel, mean over pixels.
    """

    def __init__(self, view: View, coefficients: np.ndarray, shape_id: str) -> None:
        import mitsuba as mi

        self.scene, self.scale = view.scene(coefficients[None]), _scale(view)
        self.photo, self.basis = view.measured, view.basis(coefficients.size)
        saturated = view.photo.saturated
        self.weight = ~saturated / (np.where(saturated, 0.0, self.photo).max() ** 2
                                    * self.photo.size)
        self.parameters = mi.traverse(self.scene)
        self.positions = f"{shape_id}.vertex_positions"
        self.reflectance = reflectance_key(self.parameters, view.unknown[0].bsdf)
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
        add_outline_gradient(self.scene, slope, spp, draw + 2)
        return (np.array(dr.grad(positions), dtype=float).reshape(-1, 3),
                self.basis.T @ np.array(dr.grad(values), dtype=float),
                float(np.sum(self.weight * error**2)))


def _scale(view: View) -> float:
    if view.light_scale is None:
        raise ValueError("the shape fit needs the light scale of every view")
    return view.light_scale.value
