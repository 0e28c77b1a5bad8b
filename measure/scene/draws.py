"""Draws of all materials of a scene at once, through the light transport that the reconstruction
traced.
"""
from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from spectrabox.radiometry import covariance, error_model, grid, interreflection
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.gloss import gloss_states
from spectrabox.radiometry.records.calibration import Calibration
from spectrabox.radiometry.records.scenes import JointReconstruction, RegionTransport
from spectrabox.radiometry.records.spectra import SpectrumSamples
from spectrabox.sampling.prior.mixture import PRIOR_GRID
from spectrabox.sampling.scene import scene_draws

KEPT = 1e-4     # of the largest variance of signals by curves and light; less is left out


def require_one_transport(photos: int, traced: bool) -> None:
    """Refuse draws through the transport where there is not just one.

    Parameters
    ----------
    photos : int
        Of the session.
    traced : bool
        Whether the engine traces one light transport, for lights of one spectrum.

    Raises
    ------
    InputError
    """
    if photos > 1 or not traced:
        reason = "the session has several photos" if photos > 1 else \
            "the engine kept no light transport, or the lights differ in spectrum"
        raise InputError("sampling.through = \"transport\" takes one photo under lights of one "
                         f"spectrum, fitted by the transport engine, and {reason}; set [sampling] "
                         "through = \"surface\"")


def draw_through_transport(calibration: Calibration, joint: JointReconstruction, draws: int,
                           seed: int,
                           coefficients: int,
                           families: Mapping[str, Sequence[str]]) -> dict[str, SpectrumSamples]:
    """Draws of every unknown material, interreflection, noise, calibration and model errors
    included.

    Parameters
    ----------
    draws : int
        Spectra of each material.
    coefficients : int
        Of the splines that the draws are stored with.

    Returns
    -------
    dict
        From the name of each unknown material to its draws.

    Raises
    ------
    InputError
        If the capture has several photos, lights of several spectra, or another engine than the
        transport's.
    ConvergenceError
        See ``sampling.scene.scene_draws.draw_scene``.
    """
    require_one_transport(len(joint.views), bool(joint.regions))
    regions, view = joint.regions[0], joint.views[0]
    fine = joint.response * view.white_signal[:, None] * view.light_scale.value
    response = fine @ grid.interpolation_matrix(PRIOR_GRID.nm, joint.grid.nm)
    known = {name: np.interp(PRIOR_GRID.nm, joint.grid.nm, joint.spectra[place])
             for place, name in enumerate(joint.materials) if joint.known[place]}
    common, logs = scene_draws.split_shared(*_common_errors(calibration, joint, regions, fine))
    return scene_draws.draw_scene(regions, response, draws, seed, common=common, logs=logs,
                                  known=known, families=families, coefficients=coefficients)


def _common_errors(calibration: Calibration, joint: JointReconstruction, regions: RegionTransport,
                   response: np.ndarray) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """The signals (R, K) that the reconstruction found, the surface (R,) of each region, and by
    cause what one standard deviation of each error that regions share does to the signals
    (Q, R, K).
    """
    spectra = np.array([joint.spectra[joint.materials.index(name)] for name in regions.materials])
    products = np.exp(regions.exponents.astype(float) @ np.log(np.maximum(spectra, 1e-6)))
    received = regions.coefficients @ products
    signal = received @ response.T
    white = interreflection.white_signal(response)
    curves = error_model.curve_errors(calibration, joint.grid)
    light = error_model.light_errors(calibration, joint.grid, joint.response)
    causes = {
        error_model.SENSITIVITIES: [
            _of_response(curves, signal / white, received) * white,
            _of_tails(curves.of_brightest, regions, signal / white) * white
        ], error_model.LIGHT_SPECTRUM: [_of_response(light, signal / white, received) * white],
        error_model.SURFACE_REFLECTION: [_of_gloss(joint, regions, signal)],
        error_model.DISAGREEMENT: [
            scene_draws.shared_errors(signal, np.zeros((len(white),) * 2), 0.0, regions.surface,
                                      regions.colour_error, regions.brightness_error)
        ]
    }
    for cause, errors in _of_stray_light(joint, regions, signal).items():
        causes.setdefault(cause, []).append(errors)
    for cause, relative in error_model.scale_covariances(calibration,
                                                         joint.views[0].light_scale).items():
        causes.setdefault(cause, []).append(scene_draws.shared_errors(signal, relative))
    return signal, regions.surface, {cause: np.concatenate(errors)
                                     for cause, errors in causes.items()}


def _of_response(errors: error_model.ResponseErrors, relative: np.ndarray,
                 received: np.ndarray) -> np.ndarray:
    """Errors (Q, R, K) of signals relative to white, of light (R, P), without those of little
    variance.
    """
    return _strongest(np.moveaxis(errors.changes(relative, received), 2, 0))


def _strongest(changes: np.ndarray) -> np.ndarray:
    """The same errors (E, R, K) as fewer independent ones, without those of little variance."""
    if not changes.size:
        return changes      # of curves and a light that are given without errors
    _, size, directions = np.linalg.svd(changes.reshape(len(changes), -1), full_matrices=False)
    kept = size**2 > KEPT * np.max(size**2, initial=0.0)
    return (size[kept, None] * directions[kept]).reshape(-1, *changes.shape[1:])


def _of_stray_light(joint: JointReconstruction, regions: RegionTransport,
                    signal: np.ndarray) -> dict[str, np.ndarray]:
    """Errors (Q, R, K) by light that the scene does not hold, by cause: one, or one for each
    material where a cause befalls them one by one.
    """
    index = np.array([joint.materials.index(regions.materials[material])
                      for material in regions.material])
    errors: dict[str, np.ndarray] = {}
    for cause, relative in joint.stray_light.items():
        changes = signal * relative[index]
        errors[cause] = np.array([changes] if error_model.CAUSES[cause].surfaces else [
            np.where((index == material)[:, None], changes, 0.0) for material in np.unique(index)])
    return errors


def _of_gloss(joint: JointReconstruction, regions: RegionTransport,
              signal: np.ndarray) -> np.ndarray:
    """Errors (Q, R, K) by what each material may mirror, as one Gaussian of its mean square: the
    transport knows no gloss of one sign.
    """
    errors = []
    for number, name in enumerate(regions.materials):
        if name not in joint.gloss:
            continue
        gloss = gloss_states(joint.gloss[name], [""])
        size = np.sqrt(gloss.mean[0]**2 + gloss.covariance[0, 0])
        own = joint.signal[joint.materials.index(name)]
        share = np.divide(size, own, where=own > 0, out=np.zeros_like(own))
        errors.append(np.where((regions.material == number)[:, None], signal * share, 0.0))
    return np.array(errors).reshape(-1, *signal.shape)


def _of_tails(of_brightest: np.ndarray, regions: RegionTransport,
              relative: np.ndarray) -> np.ndarray:
    """Errors (Q, R, K) of measured curves, relative to white; see ``error_model.curve_errors``.

    Every band errs by the stated share of the material's brightest band; errors of regions of the
    same material are fully correlated.
    """
    brightest = relative.max(axis=1, keepdims=True)
    errors = [np.where((regions.material == material)[:, None], brightest * pattern, 0.0)
              for material in np.unique(regions.material)
              for pattern in covariance.error_patterns(of_brightest)]
    return np.array(errors).reshape(-1, *relative.shape)
