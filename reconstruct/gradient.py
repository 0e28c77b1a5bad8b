"""Inverse rendering by gradient descent through Mitsuba (paper Sec. 3.2 and 4.2).

Spline coefficients of every unknown material start next to zero, a black scene, and follow Adam within [0, 1]. Mitsuba
renders the image and its derivative with different seeds, so the gradient of the squared error is unbiased although
both are noisy; the error itself is not, and is reported with the variance of the rendering left in.
"""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from radiometry.records import Outcome
from reconstruct.agreement import scale_from_surfaces

START = 1e-3             # not 0: Mitsuba refuses a spectrum without any mass
LEARNING_RATE = 0.06
LAST_RATE = 0.05         # of the first, reached by a cosine
TAIL = 0.25              # share of the steps whose coefficients are averaged into the answer
STILL_FALLING = 0.10     # the loss fell by more than this share over the tail: not done


@dataclass(frozen=True)
class GradientFit:
    """Coefficients of the unknown materials (M, N), their scatter over the last steps, and the way there."""

    coefficients: np.ndarray
    tail: np.ndarray         # (I, M, N) the averaged steps
    scale: float
    scale_tail: np.ndarray   # (I,)
    loss_history: np.ndarray
    outcome: Outcome


def fit_by_gradient(scene: Any, bsdf_ids: tuple[str, ...], basis: np.ndarray, measured: np.ndarray,
                    weight: np.ndarray, *, scale: float | None, known_surface: np.ndarray | None, steps: int, spp: int,
                    seed: int, progress: Callable[[float, str], None]) -> GradientFit:
    """Spectra whose rendering matches the photo.

    Parameters
    ----------
    scene : mi.Scene
        With a ``specfilm`` of the camera's bands and ``regular`` reflectances at the basis' wavelengths.
    bsdf_ids : tuple of str
        BSDFs to be found, M of them.
    basis : (P, N) array
    measured : (H, W, K) signal
    weight : (H, W, K) array
        Inverse variance of each pixel, 0 where it does not count.
    scale : float or None
        Factor from rendering to photo; None to find it, step by step, from ``known_surface``.
    known_surface : (H, W) int or None
        Index of the surface of known material that each pixel shows, -1 elsewhere.
    """
    import drjit as dr
    import mitsuba as mi

    parameters = mi.traverse(scene)
    keys = [_reflectance_key(parameters, bsdf) for bsdf in bsdf_ids]
    parameters.keep(keys)
    points, count = basis.shape
    flat_basis = mi.Float(basis.ravel().astype(np.float32))
    column = dr.arange(mi.UInt32, points * count) % count
    photo, weights = (mi.TensorXf(image.astype(np.float32)) for image in (measured, weight / np.count_nonzero(weight)))
    optimizer = mi.ad.Adam(lr=LEARNING_RATE)
    for key in keys:
        optimizer[key] = mi.Float(np.full(count, START, dtype=np.float32))

    losses, coefficients, scales = [], [], []
    current = 1.0 if scale is None else scale
    for step in range(steps):
        optimizer.set_learning_rate(LEARNING_RATE * cosine_rate(step / steps))
        for key in keys:
            parameters[key] = dr.block_sum(flat_basis * dr.gather(mi.Float, optimizer[key], column), count)
        parameters.update()
        draw = 2 * (seed * 100003 + step)
        image = mi.render(scene, parameters, spp=spp, seed=draw, seed_grad=draw + 1)
        if scale is None and known_surface is not None:
            ratio = scale_from_surfaces(measured, np.array(image), known_surface, "").value
            current = ratio if step == 0 else current + (ratio - current) * max(0.1, 1.0 / (step + 1))
        loss = dr.sum(weights * dr.square(image * current - photo), axis=None)
        dr.backward(loss)
        optimizer.step()
        for key in keys:
            optimizer[key] = dr.clip(dr.detach(optimizer[key]), 0.0, 1.0)
        losses.append(float(np.array(loss).item()))
        scales.append(current)
        if step >= min((1 - TAIL) * steps, steps - 1):
            coefficients.append(np.array([np.array(optimizer[key]) for key in keys], dtype=np.float64))
        progress((step + 1) / steps, f"step {step + 1} of {steps}")
    tail = np.array(coefficients)
    history = np.array(losses)
    return GradientFit(tail.mean(axis=0), tail, float(np.mean(scales[-len(tail):])), np.array(scales[-len(tail):]),
                       history, outcome_of(history))


def _reflectance_key(parameters: Any, bsdf: str) -> str:
    matches = [key for key in parameters.keys()  # noqa: SIM118 - not a dict
               if key.startswith(f"{bsdf}.") and key.endswith(("reflectance.values", "base_color.values"))]
    if len(matches) != 1:
        raise ValueError(f"the scene has {len(matches)} reflectances under the BSDF {bsdf!r}; one is needed")
    return matches[0]


def cosine_rate(fraction: float) -> float:
    """Learning rate, of the first, after this fraction of the steps."""
    return LAST_RATE + (1 - LAST_RATE) * 0.5 * (1 + np.cos(np.pi * fraction))


def outcome_of(losses: np.ndarray) -> Outcome:
    """Whether the loss still fell over the tail, by the means of its two halves."""
    tail = losses[-max(int(TAIL * losses.size), 4):]
    first, second = tail[:tail.size // 2].mean(), tail[tail.size // 2:].mean()
    return Outcome.STEP_LIMIT if second < (1 - STILL_FALLING) * first else Outcome.CONVERGED
