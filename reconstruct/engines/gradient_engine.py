"""The paper's inversion: differentiable rendering and Adam, for any BSDF (Sec. 3.2 and 4.2)."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from spectrabox.radiometry.progress import Progress
from spectrabox.radiometry.records import Outcome
from spectrabox.radiometry.response import relative_operator
from spectrabox.reconstruct.engines.answer import EngineAnswer
from spectrabox.reconstruct.engines.gradient import GradientFit, fit_by_gradient
from spectrabox.reconstruct.rendering.renderer import render
from spectrabox.reconstruct.scene.scene_file import SceneFile, not_plain_products
from spectrabox.reconstruct.settings import Engine, InversionSettings
from spectrabox.reconstruct.view import View

FINAL_SPP, FINAL_PASSES = 256, 4


def engine_for(scene_files: Sequence[SceneFile]) -> tuple[Engine, tuple[str, ...]]:
    """Name of the engine that treats every material of the scenes, and a sentence on why.

    Parameters
    ----------
    scene_files : sequence of SceneFile

    Returns
    -------
    engine : "transport" or "gradient"
    notes : tuple of str
        Empty for the default, transport.
    """
    glossy = dict.fromkeys(name for scene_file in scene_files
                           for name in not_plain_products(scene_file))
    if not glossy:
        return "transport", ()
    return "gradient", (f"The gradient engine was chosen, since {', '.join(glossy)} is coated or "
                        "glossy: its light is no plain product of reflectances, as the transport "
                        "engine needs.",)


def invert_by_gradient(view: View, settings: InversionSettings,
                       progress: Progress) -> EngineAnswer:
    """Coefficients by gradient descent through Mitsuba's ``prb`` integrator and spectral film.

    Parameters
    ----------
    view : View
        With a light scale or a known material.
    settings : InversionSettings
    progress : function of (fraction done, what is being done)
    """
    fit = fit_by_gradient(view, settings, progress)
    answer = answer_of_descent(view, settings, fit, "gradient descent (Mitsuba prb, specfilm)")
    if fit.outcome is Outcome.STEP_LIMIT:
        return answer
    return replace(answer, notes=(f"The descent stopped after {len(fit.loss_history)} of at most "
                                  f"{settings.steps} steps: its error no longer fell by more than "
                                  "its noise.",))


def answer_of_descent(view: View, settings: InversionSettings, fit: GradientFit,
                      engine: str) -> EngineAnswer:
    """The answer of an engine that descends: its last steps scatter as its signals' error does.

    Parameters
    ----------
    view : View
    settings : InversionSettings
    fit : GradientFit
        Of the view's unknown materials.
    engine : str
        Its name as the report prints it.
    """
    rendered, _ = render(view.scene(fit.coefficients), FINAL_SPP, settings.seed + 7919,
                         FINAL_PASSES)
    operator = relative_operator(view.response, view.basis(settings.coefficients))
    tail = fit.tail @ operator.T
    covariance = np.array([np.cov(tail[:, index], rowvar=False) for index in range(tail.shape[1])])
    return EngineAnswer(fit.coefficients, fit.coefficients @ operator.T, covariance,
                        rendered[None], fit.loss_history, engine, settings.spp, fit.outcome)
