"""One stage of the shape fit: descent of mesh and spectrum together, on one mesh of fixed
triangles.

The squared error has its gradient by the spectrum and by the surface's place from Mitsuba's
``prb``, and by the outline from ``shape_edges``. Vertices v follow uniform Adam in u = (I +
diffusion L) v (Nicolet et al. 2021, Algorithm 1).
"""
from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from spectrabox.reconstruct.engines.gradient import reflectance_key
from spectrabox.reconstruct.problem import InverseProblem
from spectrabox.reconstruct.rendering.renderer import render
from spectrabox.reconstruct.shape.edges import add_outline_gradient
from spectrabox.reconstruct.shape.mesh import large_steps

SPECTRUM_RATE = 0.02        # of the coefficients, per step
GREY_RANGE = (0.05, 0.95)   # of the flat spectrum to start from
TRIAL_GREY = 0.5


@dataclass(frozen=True)
class Stage:
    """Steps on one mesh: its level of subdivision, the step in radii of the object, the strength of
    the diffusion.
    """

    level: int
    steps: int
    rate: float
    diffusion: float
    spp: int


def flat_start(problems: Sequence[InverseProblem], spp: int, seed: int) -> np.ndarray:
    """Coefficients (N,) of the grey with which the views are about as bright as their photos."""
    count = problems[0].basis.shape[1]
    ratio = []
    for problem in problems:
        rendered = render(problem.scene(np.full((1, count), TRIAL_GREY)), spp,
                          seed)[0] * _scale(problem)
        ratio.append(problem.measured.sum() / rendered.sum())
    return np.full(count, np.clip(TRIAL_GREY * np.median(ratio), *GREY_RANGE))


def descend(problems: Sequence[InverseProblem], saturated: Sequence[np.ndarray], shape_id: str,
            vertices: np.ndarray, faces: np.ndarray, coefficients: np.ndarray, stage: Stage,
            radius: float, views_per_step: int, seed: int,
            progress: Callable[[int], None]) -> tuple[np.ndarray, np.ndarray, list[float]]:
    """Vertices (V, 3) and coefficients (N,) after the stage, and the loss of every step.

    Parameters
    ----------
    problems : sequence of InverseProblem
        One for each view, whose scene holds the mesh.
    saturated : sequence of (H, W, K) bool
        Signals that do not count.
    """
    import drjit as dr
    import mitsuba as mi

    to_steps, from_steps = large_steps(faces, len(vertices), stage.diffusion)
    start = coefficients[None]
    views = [_ViewLoss(problem, problem.scene(start), clipped, shape_id)
             for problem, clipped in zip(problems, saturated, strict=True)]
    places = mi.ad.Adam(lr=stage.rate * radius, uniform=True)
    spectrum = mi.ad.Adam(lr=SPECTRUM_RATE)
    places["u"] = mi.Float(to_steps(vertices).astype(np.float32).ravel())
    spectrum["c"] = mi.Float(coefficients.astype(np.float32))
    generator = np.random.default_rng(seed)
    losses = []
    for step in range(stage.steps):
        chosen = generator.permutation(len(views))[:views_per_step]
        by_place, by_coefficient, loss = np.zeros_like(vertices), np.zeros_like(coefficients), 0.0
        for number in chosen:
            draw = (seed * 100003 + step * len(views) + int(number)) * 3 % 2**32
            parts = views[number].gradients(vertices, coefficients, stage.spp, draw)
            by_place += parts[0] / len(chosen)
            by_coefficient += parts[1] / len(chosen)
            loss += parts[2] / len(chosen)
        dr.set_grad(places["u"], mi.Float(from_steps(by_place).astype(np.float32).ravel()))
        dr.set_grad(spectrum["c"], mi.Float(by_coefficient.astype(np.float32)))
        places.step()
        spectrum.step()
        spectrum["c"] = dr.clip(dr.detach(spectrum["c"]), 0.0, 1.0)
        vertices = from_steps(np.array(places["u"], dtype=float).reshape(-1, 3))
        coefficients = np.array(spectrum["c"], dtype=float)
        losses.append(loss)
        progress(step + 1)
    return vertices, coefficients, losses


class _ViewLoss:
    """An open scene and its photo; squared error relative to the photo's brightest pixel, mean over
    pixels.
    """

    def __init__(self, problem: InverseProblem, scene: Any, saturated: np.ndarray,
                 shape_id: str) -> None:
        import mitsuba as mi

        self.scene, self.photo, self.basis, self.scale = scene, problem.measured, problem.basis, _scale(problem)
        self.weight = ~saturated / (np.where(saturated, 0.0, problem.measured).max() ** 2
                                    * problem.measured.size)
        self.parameters = mi.traverse(scene)
        self.place = f"{shape_id}.vertex_positions"
        self.reflectance = reflectance_key(self.parameters, problem.unknown[0].bsdf)
        self.parameters.keep([self.place, self.reflectance])

    def gradients(self, vertices: np.ndarray, coefficients: np.ndarray, spp: int,
                  draw: int) -> tuple[np.ndarray, np.ndarray, float]:
        """Gradient by vertices (V, 3) and by coefficients (N,), and the loss."""
        import drjit as dr
        import mitsuba as mi

        place = mi.Float(vertices.astype(np.float32).ravel())
        values = mi.Float((self.basis @ coefficients).astype(np.float32))
        dr.enable_grad(place, values)
        self.parameters[self.place], self.parameters[self.reflectance] = place, values
        self.parameters.update()
        image = mi.render(self.scene, self.parameters, spp=spp, seed=draw, seed_grad=draw + 1)
        error = np.array(image, dtype=float) * self.scale - self.photo
        slope = 2 * self.weight * error * self.scale
        dr.backward(dr.sum(image * mi.TensorXf(slope.astype(np.float32)), axis=None))
        add_outline_gradient(self.scene, slope, spp, draw + 2)
        return (np.array(dr.grad(place), dtype=float).reshape(-1, 3),
                self.basis.T @ np.array(dr.grad(values), dtype=float),
                float(np.sum(self.weight * error**2)))


def _scale(problem: InverseProblem) -> float:
    if problem.light_scale is None:
        raise ValueError("the shape fit needs the light scale of every view")
    return problem.light_scale.value
