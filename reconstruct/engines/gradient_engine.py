"""The paper's inversion: differentiable rendering and Adam, for any BSDF (paper Sec. 3.2 and
4.2).
"""
from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from spectrabox.radiometry.records import Outcome
from spectrabox.radiometry.response import relative_operator
from spectrabox.reconstruct.engines.gradient import GradientFit, fit_by_gradient
from spectrabox.reconstruct.problem import EngineAnswer, InverseProblem
from spectrabox.reconstruct.rendering.renderer import render
from spectrabox.reconstruct.scene.scene_file import SceneFile, not_plain_products
from spectrabox.reconstruct.settings import Engine, InversionSettings

FINAL_SPP, FINAL_PASSES = 256, 4


def engine_for(scene_files: Sequence[SceneFile]) -> tuple[Engine, tuple[str, ...]]:
    """Name of the engine that treats every material of the scenes, and a sentence if it is not the
    default.
    """
    glossy = dict.fromkeys(name for scene_file in scene_files
                           for name in not_plain_products(scene_file))
    if not glossy:
        return "transport", ()
    return "gradient", (f"The gradient engine was chosen, since {', '.join(glossy)} is coated or "
                        "glossy: its light is no plain product of reflectances, as the transport "
                        "engine needs.",)


def invert_by_gradient(problem: InverseProblem, settings: InversionSettings,
                       progress: Callable[[float, str], None]) -> EngineAnswer:
    """Coefficients by gradient descent through Mitsuba's ``prb`` integrator and its spectral
    film.
    """
    scale = problem.light_scale
    fit = fit_by_gradient(
        problem.scene(), tuple(material.bsdf for material in problem.unknown), problem.basis,
        problem.measured, problem.used[..., None] / problem.variance, scale=None if scale is None
        else scale.value, known_surface=problem.known_surface, steps=settings.steps,
        spp=settings.spp, seed=settings.seed, progress=progress)
    answer = answer_of_descent(problem, settings, fit, "gradient descent (Mitsuba prb, specfilm)")
    if fit.outcome is Outcome.STEP_LIMIT:
        return answer
    return replace(answer, notes=(f"The descent stopped after {len(fit.loss_history)} of at most "
                                  f"{settings.steps} steps: its error no longer fell by more than "
                                  "its noise.",))


def answer_of_descent(problem: InverseProblem, settings: InversionSettings, fit: GradientFit,
                      engine: str) -> EngineAnswer:
    """The answer of an engine that descends: its last steps scatter as its signals' error does."""
    rendered, _ = render(problem.scene(fit.coefficients), FINAL_SPP, settings.seed + 7919,
                         FINAL_PASSES)
    operator = relative_operator(problem.response, problem.basis)
    tail = fit.tail @ operator.T
    covariance = np.array([np.cov(tail[:, place], rowvar=False) for place in range(tail.shape[1])])
    return EngineAnswer(fit.coefficients, fit.coefficients @ operator.T, covariance, rendered,
                        fit.loss_history, engine, settings.spp, fit.outcome)
