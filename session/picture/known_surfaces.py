"""What the surfaces of known materials say of the light on a picture: its scale, and its errors.

The materials of the other surfaces may be painted with patterns, so that only the known ones tell
light from reflectance. They are compared under the light that the picture's own spectra give.
"""
from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from spectrabox.radiometry.light_scale import scale_from_signals
from spectrabox.radiometry.records import JointReconstruction, LightScale, SurfaceAgreement
from spectrabox.reconstruct.agreement import SCALE_ERROR, surface_covariance
from spectrabox.reconstruct.view import View
from spectrabox.session.picture.scene_of_picture import SceneOfPicture

FEW = 8         # nodes of a surface, below which it is not compared


@dataclass(frozen=True)
class KnownSurfaces:
    """Light scale of the photo, and relative covariance (K, K) by which photo and light disagree.
    """

    scale: LightScale
    covariance: np.ndarray


def known_surfaces(scene: SceneOfPicture, light: np.ndarray, even: np.ndarray) -> KnownSurfaces:
    """Compare the surfaces of known materials with the light on them.

    Parameters
    ----------
    scene : SceneOfPicture
    light : (N, P) array
        At the nodes, for a light scale of 1.
    even : (N,) bool
        Nodes where light does not change too quickly to be compared.
    """
    view, traced = scene.view, scene.traced
    measured, variance = scene.node_signals
    sensed = view.sensitivities * view.grid.weights_nm
    rows = []
    for number, name in enumerate(view.scene_file.surfaces):
        material = view.scene_materials[_index(view, number)]
        own = np.flatnonzero((traced.nodes.keys[0] == number) & even & scene.compared)
        if material.reflectance is None or own.size < FEW:
            continue
        predicted = light[own] * material.reflectance @ sensed.T
        if not np.all(predicted > 0) or not np.all(measured[own] > 0):
            continue
        logs = np.log(measured[own] / predicted)
        noise = np.mean(variance[own] / measured[own]**2, axis=0) \
            + np.mean(traced.relative_variance[own])
        rows.append((f"{material.name} / {name}", material.name, own.size,
                     measured[own].sum(axis=0), predicted.sum(axis=0),
                     np.sqrt(np.maximum(logs.var(axis=0) - noise, 0.0))))
    settings, scale = scene.task.config.reconstruct, scene.joint.views[0].light_scale
    stated = float(np.hypot(settings.surface_error, settings.brightness_error))
    bands = measured.shape[1]
    if not rows:
        return KnownSurfaces(scale, stated**2 * (np.eye(bands) + 1) / 2)
    names, materials, pixels, photo, model, spread = zip(*rows, strict=True)
    if view.light_scale is None:
        scale = scale_from_signals(np.array(photo), np.array(model), SCALE_ERROR, scale.source)
    agreement = SurfaceAgreement(names, materials, np.array(pixels),
                                 np.array(photo) / (scale.value * np.array(model)),
                                 np.array(spread))
    within = np.einsum("sk,sl->kl", agreement.spread, agreement.spread) / len(rows)
    return KnownSurfaces(scale, surface_covariance(agreement, frozenset(materials), stated)
                         + within)


def _index(view: View, surface: int) -> int:
    """The material of a surface, among those of the scene."""
    names = [material.name for material in view.scene_materials]
    return names.index(view.surface_materials[surface])


def with_scale(joint: JointReconstruction, scale: LightScale) -> JointReconstruction:
    """The reconstruction with another light scale of its first photo."""
    first, *others = joint.views
    return replace(joint, views=(replace(first, light_scale=scale), *others))
