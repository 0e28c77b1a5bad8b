"""Light on a picture as its surfaces of known reflectance show it: scale, and disagreement.

The materials of the other surfaces may be painted with patterns, so that only the known ones tell
light from reflectance. They are compared under the light that the picture's own spectra give.
"""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spectrabox.measure.pictures.traced_photo import TracedPhoto
from spectrabox.radiometry.light_scale import scale_from_signals
from spectrabox.radiometry.records.calibration import LightScale
from spectrabox.radiometry.records.scenes import SurfaceAgreement
from spectrabox.reconstruct.agreement import SCALE_ERROR, surface_covariance

MIN_NODES = 8   # of a surface that is compared


@dataclass(frozen=True)
class ReferenceSurfaces:
    """Light scale of the photo, and relative covariance (K, K) by which photo and light disagree.
    """

    scale: LightScale
    covariance: np.ndarray


def compare_reference_surfaces(scene: TracedPhoto, light: np.ndarray,
                               even: np.ndarray) -> ReferenceSurfaces:
    """Compare the surfaces of known reflectance with the light on them.

    Parameters
    ----------
    scene : TracedPhoto
    light : (N, P) array
        At the nodes, for a light scale of 1.
    even : (N,) bool array
        Nodes where light does not change too quickly to be compared.
    """
    view, traced = scene.view, scene.traced
    measured, variance = scene.node_signals
    weights = view.sensitivities * view.grid.weights_nm
    materials_by_name = {material.name: material for material in view.scene_materials}
    rows = []
    for number, name in enumerate(view.scene_file.surfaces):
        material = materials_by_name[view.surface_materials[number]]
        own = np.flatnonzero((traced.nodes.keys[0] == number) & even & scene.compared)
        if material.reflectance is None or own.size < MIN_NODES:
            continue
        predicted = light[own] * material.reflectance @ weights.T
        if not np.all(predicted > 0) or not np.all(measured[own] > 0):
            continue
        logs = np.log(measured[own] / predicted)
        noise = np.mean(variance[own] / measured[own]**2, axis=0) \
            + np.mean(traced.relative_variance[own])
        rows.append((f"{material.name} / {name}", material.name, own.size,
                     measured[own].sum(axis=0), predicted.sum(axis=0),
                     np.sqrt(np.maximum(logs.var(axis=0) - noise, 0.0))))
    scale, bands = scene.joint.views[0].light_scale, measured.shape[1]
    if not rows:
        return ReferenceSurfaces(scale, scene.disagreement**2 * (np.eye(bands) + 1) / 2)
    names, materials, pixels, photo, model, spread = zip(*rows, strict=True)
    if view.light_scale is None:
        scale = scale_from_signals(np.array(photo), np.array(model), SCALE_ERROR, scale.source)
    agreement = SurfaceAgreement(names, materials, np.array(pixels),
                                 np.array(photo) / (scale.value * np.array(model)),
                                 np.array(spread))
    within = np.einsum("sk,sl->kl", agreement.spread, agreement.spread) / len(rows)
    return ReferenceSurfaces(scale, surface_covariance(agreement, frozenset(materials),
                                                       scene.disagreement) + within)
