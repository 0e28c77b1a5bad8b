"""Light in the object photos that no scene holds: veiling glare of the lens, light from elsewhere
than the lamp, and what the outermost layer of a surface mirrors.

All add to the signal, so that dark materials and shadows suffer most.

    glare       d s(m, k) / s(m, k) = g mean of the picture(k) / mean over its pixels(k)
    ambient     d s(m, k) / s(m, k) = a largest irradiance / mean irradiance on its pixels
    gloss       d s(m, k) = g of the material >= 0, a share of white (radiometry/gloss.py)
"""
from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from spectrabox.radiometry.error_model import (
    GLARE,
    STRAY_LIGHT,
)
from spectrabox.radiometry.records.scenes import (
    JointReconstruction,
    Reconstruction,
    StrayLightError,
)
from spectrabox.reconstruct.agreement import BRIGHTEST_PERCENTILE


@dataclass(frozen=True, eq=False)
class StatedErrors:
    """What a scene states of its photos beyond noise, camera and light."""

    glare: np.ndarray           # (K,) standard error, of a photo's mean signal
    ambient: float              # standard error, of the brightest irradiance
    # of materials that may mirror light: what is stated of their surfaces; None: nothing
    gloss: Mapping[str, str | None]


def with_stray_light(joint: JointReconstruction, errors: StatedErrors) -> JointReconstruction:
    """The reconstruction with what stray light may have added to each material's signal.

    Parameters
    ----------
    joint : JointReconstruction
        Whose own stray light is replaced.
    errors : StatedErrors
    """
    of_glare, of_ambient = np.zeros((2, *joint.signal.shape))
    for number in np.unique(joint.view_of_band):
        view = joint.views[number]
        bands = np.flatnonzero(joint.view_of_band == number)
        irradiance = _irradiance(view)
        lit = np.isfinite(irradiance)
        brightest = np.percentile(irradiance[lit], BRIGHTEST_PERCENTILE) if lit.any() else 0.0
        for name in view.materials:
            own = _pixels_of(view, name) & lit
            index = joint.materials.index(name)
            if own.any():
                shown = view.measured[own].mean(axis=0)
                of_glare[index, bands] = errors.glare * view.measured.mean(axis=(0, 1)) / shown
                of_ambient[index, bands] = errors.ambient * brightest / irradiance[own].mean()
    return dataclasses.replace(joint, gloss=dict(errors.gloss), stray_light=(
        StrayLightError(GLARE, of_glare), StrayLightError(STRAY_LIGHT, of_ambient)))


def _irradiance(view: Reconstruction) -> np.ndarray:
    """Irradiance (H, W) of the usable pixels up to one factor: signal over reflectance, mean over
    bands; NaN elsewhere.
    """
    irradiance = np.full(view.used.shape, np.nan)
    for index, name in enumerate(view.materials):
        own = _pixels_of(view, name)
        if np.all(view.signal[index] > 0):
            irradiance[own] = (view.measured[own] / (view.signal[index] * view.white_signal)).mean(
                axis=1)
    return irradiance


def _pixels_of(view: Reconstruction, material: str) -> np.ndarray:
    """Usable pixels (H, W) of a material."""
    surfaces = [index for index, name in enumerate(view.agreement.materials) if name == material]
    return view.used & np.isin(view.surface, surfaces)
