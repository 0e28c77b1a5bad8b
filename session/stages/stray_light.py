"""Light in the object photos that no scene holds: veiling glare of the lens, and light from
elsewhere than the lamp.

Both add to the signal, so that dark materials and shadows suffer most.

    glare    d s(m, k) / s(m, k) = g mean of the picture(k) / mean over the material's pixels(k)
    ambient  d s(m, k) / s(m, k) = a largest irradiance / mean irradiance on the material's pixels
"""
from __future__ import annotations

import dataclasses

import numpy as np

from spectrabox.radiometry.error_model import GLARE, STRAY_LIGHT
from spectrabox.radiometry.records import JointReconstruction, Reconstruction, StrayLight
from spectrabox.reconstruct.agreement import BRIGHTEST_PERCENTILE


def with_stray_light(joint: JointReconstruction, glare: np.ndarray,
                     ambient: float) -> JointReconstruction:
    """The reconstruction with what stray light may have added to each material's signal.

    Parameters
    ----------
    joint : JointReconstruction
        Whose own stray light is replaced.
    glare : (K,) array
        Standard error, of the mean signal of each band over the picture.
    ambient : float
        Standard error, of the brightest irradiance in the picture.
    """
    of_glare, of_ambient = np.zeros((2, *joint.signal.shape))
    for number in np.unique(joint.view_of_band):
        view, bands = joint.views[number], np.flatnonzero(joint.view_of_band == number)
        irradiance = _irradiance(view)
        lit = np.isfinite(irradiance)
        brightest = np.percentile(irradiance[lit], BRIGHTEST_PERCENTILE) if lit.any() else 0.0
        for name in view.materials:
            own, index = _pixels_of(view, name) & lit, joint.materials.index(name)
            if own.any():
                shown = view.measured[own].mean(axis=0)
                of_glare[index, bands] = glare * view.measured.mean(axis=(0, 1)) / shown
                of_ambient[index, bands] = ambient * brightest / irradiance[own].mean()
    return dataclasses.replace(joint, stray_light=(StrayLight(GLARE, of_glare),
                                                   StrayLight(STRAY_LIGHT, of_ambient)))


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
