"""Inverse rendering by gradient descent through Mitsuba (paper Sec. 3.2 and 4.2).

Spline coefficients of every unknown material start next to zero, a black scene, and follow Adam
within [0, 1]. Mitsuba renders the image and its derivative with different seeds, so the gradient of
the squared error is unbiased although both are noisy; the error itself is not, and is reported with
the variance of the rendering left in.

It stops by itself: once the error has not fallen over ``WINDOW`` steps by more than the standard
error that its own scatter gives, the step size falls over the last quarter of the steps,
whose second half is averaged.
"""
from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.interreflection import relative_operator
from spectrabox.radiometry.records.spectra import Outcome, Progress
from spectrabox.reconstruct.agreement import scale_from_surfaces
from spectrabox.reconstruct.rendering.renderer import render
from spectrabox.reconstruct.scene import scene_file, scene_xml
from spectrabox.reconstruct.settings import InversionSettings
from spectrabox.reconstruct.view import PhotoView, ViewSolution

START = 1e-3
LEARNING_RATE = 0.06
LAST_RATE = 0.05         # of the first, reached by a cosine
TAIL = 0.25              # share of the steps over which the step size falls
WINDOW = 30  # steps: the mean loss of these is compared with that of as many before them
STALLED = 1.0            # standard errors by which it must have fallen to go on
FINAL_SPP, FINAL_PASSES = 256, 4     # of the rendering that the photo is compared with


def invert_by_gradient(view: PhotoView, settings: InversionSettings,
                       progress: Progress) -> ViewSolution:
    """Coefficients by gradient descent through Mitsuba's ``prb`` integrator and spectral film.

    Parameters
    ----------
    view : PhotoView
        With a light scale or a known material.
    settings : InversionSettings
    progress : function of (fraction done, what is being done)

    Returns
    -------
    ViewSolution
        The averaged last steps, whose scatter is taken for the error of the signals.
    """
    ends, scale, losses, outcome = fit_by_gradient(view, settings, progress)
    coefficients = ends.mean(axis=0)
    rendered, _ = render(view.scene(coefficients), FINAL_SPP, settings.seed + 7919, FINAL_PASSES)
    operator = relative_operator(view.response, view.basis(settings.coefficients))
    tail = ends @ operator.T
    covariance = np.array([np.cov(tail[:, index], rowvar=False) for index in range(tail.shape[1])])
    findings = () if outcome is Outcome.STEP_LIMIT else (
        Finding("fit.descent-ended", Severity.INFO, values={
            "steps": len(losses), "limit": settings.steps}),)
    return ViewSolution(coefficients, coefficients @ operator.T, covariance, rendered[None], losses,
                        "gradient descent (Mitsuba prb, specfilm)", settings.spp, outcome, findings,
                        (scale, None))


def seconds_of_descent(view: PhotoView, settings: InversionSettings) -> float:
    """Seconds of processor that ``invert_by_gradient`` takes if it goes to its last step.

    By a first step, which compiles the renderings, and the time of a second for all others.

    Parameters
    ----------
    view : PhotoView
    settings : InversionSettings
    """
    def silent(done: float, what: str) -> None:
        """Nobody waits for this."""
    marks = [time.process_time()]
    for _ in range(2):
        fit_by_gradient(view, replace(settings, steps=1), silent)
        marks.append(time.process_time())
    compiled, step = np.diff(marks)
    # of the last rendering without its derivative, which takes about twice its own time
    return float(compiled + step * (settings.steps + FINAL_SPP / settings.spp / 3))


def fit_by_gradient(view: PhotoView, settings: InversionSettings, progress: Progress
                    ) -> tuple[np.ndarray, float, np.ndarray, Outcome]:
    """Spectra whose rendering matches the photo.

    Parameters
    ----------
    view : PhotoView
        Without a light scale it is estimated, step by step, from the surfaces of known material.
    settings : InversionSettings
        At most ``steps`` steps. Step ``n`` renders with the random numbers ``2 (100003 seed + n)``
        and the next.

    Returns
    -------
    tail : (I, U, N) array
        Coefficients of the unknown materials after each of the last steps; their mean is the fit.
    scale : float
    losses : (S,) array
        Of all steps.
    outcome : Outcome
    """
    import drjit as dr
    import mitsuba as mi

    scene, measured, known_surface = view.scene(), view.measured, view.known_surface
    weight = view.used[..., None] / view.variance  # 0 where a pixel does not count
    steps, spp = settings.steps, settings.spp
    parameters = mi.traverse(scene)
    keys = [reflectance_key(parameters, material.bsdf, view.scene_file)
            for material in view.unknown]
    parameters.keep(keys)
    basis = view.basis(settings.coefficients)
    points, count = basis.shape
    flat_basis = mi.Float(basis.ravel().astype(np.float32))
    column = dr.arange(mi.UInt32, points * count) % count
    photo, weights = (mi.TensorXf(image.astype(np.float32))
                      for image in (measured, weight / np.count_nonzero(weight)))
    optimizer = mi.ad.Adam(lr=LEARNING_RATE)
    for key in keys:
        optimizer[key] = mi.Float(np.full(count, START, dtype=np.float32))

    losses: list[float] = []
    coefficients, scales = [], []
    scale_unknown = view.light_scale is None
    current = 1.0 if view.light_scale is None else view.light_scale.value
    tail, last, done = max(int(TAIL * steps), 1), steps, False
    begun = time.monotonic()
    for step in range(steps):
        if not done and step < last - tail and stalled(losses):
            tail, done = max(int(step * TAIL / (1 - TAIL)), 1), True
            last = step + tail
        optimizer.set_learning_rate(LEARNING_RATE * cosine_rate(max(step - (last - tail), 0)
                                                                / tail))
        for key in keys:
            parameters[key] = scene_xml.BLACK + dr.block_sum(
                flat_basis * dr.gather(mi.Float, optimizer[key], column), count)
        parameters.update()
        draw = 2 * (settings.seed * 100003 + step) % 2**32
        image = mi.render(scene, parameters, spp=spp, seed=draw, seed_grad=draw + 1)
        if scale_unknown:
            ratio = scale_from_surfaces(measured, np.array(image), known_surface, "").value
            gain = max(0.1, 1.0 / (step + 1))
            current = ratio if step == 0 else current + (ratio - current) * gain
        loss = dr.sum(weights * dr.square(image * current - photo), axis=None)
        dr.backward(loss)
        optimizer.step()
        for key in keys:
            optimizer[key] = dr.clip(dr.detach(optimizer[key]), 0.0, 1.0)
        losses.append(float(np.array(loss).item()))
        scales.append(current)
        if step >= min(last - tail / 2, last - 2):  # two at least: their scatter is the error
            coefficients.append(np.array([np.array(optimizer[key]) for key in keys],
                                         dtype=np.float64))
        left = (time.monotonic() - begun) / (step + 1) * (last - step - 1)
        progress((step + 1) / last, f"step {step + 1} of {'' if done else 'at most '}{last}, about "
                 f"{left:.0f} s left")
        if step + 1 == last:
            break
    end = np.array(coefficients)
    return (end, float(np.mean(scales[-len(end):])), np.array(losses),
            Outcome.CONVERGED if done else Outcome.STEP_LIMIT)


def reflectance_key(parameters: Any, bsdf: str, scene: scene_file.SceneFile) -> str:
    """Name, among a scene's parameters, of the spectrum of a BSDF that is estimated.

    Mitsuba names a BSDF by its id, or by the shape that has it, where the id begins with the name
    of that shape.

    Parameters
    ----------
    parameters : mi.SceneParameters
    bsdf : str
        Its id.
    scene : SceneFile

    Raises
    ------
    InputError
        If there is none, or more than one.
    """
    owners = (bsdf, *(f"{shape}.bsdf" for shape, own in scene.surfaces.items() if own == bsdf))
    spectrum = scene_file.estimated_spectrum(scene, bsdf)
    matches = [key for key in parameters.keys()  # noqa: SIM118 - not a dict
               if key.startswith(tuple(f"{owner}." for owner in owners))
               and key.endswith(f".{spectrum}.values")]
    if len(matches) != 1:
        raise InputError(f"{scene.path.name}: the BSDF {bsdf!r} has {len(matches)} spectra "
                         f"{spectrum!r} that could be estimated, and one is needed; write it at "
                         "the top of the scene, with an id of its own")
    return matches[0]


def stalled(losses: list[float], window: int | None = None) -> bool:
    """Whether the mean loss no longer falls, beyond its noise, from window to window.

    Two windows are compared: the last steps and as many before. The noise of both means is that of
    independent steps with the scatter within the two windows.

    Parameters
    ----------
    losses : list of float
        Of all steps so far.
    window : int, optional
        Steps of each mean; ``WINDOW`` where it is left out. False for fewer losses than two
        windows.
    """
    window = WINDOW if window is None else window
    if window < 2 or len(losses) < 2 * window:
        return False
    before, now = np.array(losses[-2 * window:-window]), np.array(losses[-window:])
    error = np.sqrt((before.var(ddof=1) + now.var(ddof=1)) / window)
    return bool(before.mean() - now.mean() <= STALLED * error)


def cosine_rate(fraction: float) -> float:
    """Learning rate, relative to the first, 1 falling to ``LAST_RATE``.

    Parameters
    ----------
    fraction : float
        Of the steps that are done, 0 to 1.
    """
    return LAST_RATE + (1 - LAST_RATE) * 0.5 * (1 + np.cos(np.pi * fraction))
