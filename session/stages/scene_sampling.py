"""Draws of all materials of a scene at once, through the light transport that the reconstruction
traced.
"""
from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from spectrabox.radiometry.grid import interpolation_matrix
from spectrabox.radiometry.records import (
    Calibration,
    JointReconstruction,
    RegionTransport,
    SpectrumSamples,
)
from spectrabox.radiometry.response import white_signal
from spectrabox.radiometry.spectra.spectrum_files import spectrum_on_grid
from spectrabox.sampling.prior.mixture import PRIOR_GRID
from spectrabox.sampling.scene.scene_draws import draw_scene, shared_errors
from spectrabox.session.stages.error_budget import scale_covariances
from spectrabox.session.stages.one_transport import require_one_transport

KEPT = 1e-4              # of the largest variance of a direction of the sensitivities' error


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
        If the session has several photos, lights of several spectra, or another engine than the
        transport's.
    ConvergenceError
        See ``sampling.scene_draws.draw_scene``.
    """
    require_one_transport(len(joint.views), bool(joint.regions))
    regions, view = joint.regions[0], joint.views[0]
    fine = joint.response * view.white_signal[:, None] * view.light_scale.value
    response = fine @ interpolation_matrix(PRIOR_GRID.nm, joint.grid.nm)
    known = {name: np.interp(PRIOR_GRID.nm, joint.grid.nm, joint.spectra[place])
             for place, name in enumerate(joint.materials) if joint.known[place]}
    return draw_scene(regions.transport, regions.signal, regions.standard_error, response, draws,
                      seed, common=_common_errors(calibration, joint, regions, fine), known=known,
                      families=families, coefficients=coefficients)


def _common_errors(calibration: Calibration, joint: JointReconstruction, regions: RegionTransport,
                   response: np.ndarray) -> np.ndarray:
    """What one standard deviation of each error that regions share does to their signals (Q, R,
    K).
    """
    view = joint.views[0]
    spectra = np.array([joint.spectra[joint.materials.index(name)]
                        for name in regions.transport.materials])
    products = np.exp(regions.transport.exponents.astype(float) @ np.log(np.maximum(spectra, 1e-6)))
    received = regions.transport.coefficients @ products
    signal = received @ response.T
    fit, white = calibration.sensitivity, white_signal(response)
    if fit.covariance is None or fit.basis is None:
        of_curves = _of_tails(calibration, regions, signal / white) * white
    else:
        of_curves = _of_curves(calibration, received, response, view.light_scale.value, joint)
    return np.concatenate([of_curves, _of_stray_light(joint, regions, signal), shared_errors(
        signal, np.sum(list(scale_covariances(calibration, joint, 0).values()), axis=0), 0.0,
        regions.surface, regions.colour_error, regions.brightness_error)])


def _of_stray_light(joint: JointReconstruction, regions: RegionTransport,
                    signal: np.ndarray) -> np.ndarray:
    """Errors (Q, R, K) by light that the scene does not hold, one for each cause."""
    index = [joint.materials.index(regions.transport.materials[material])
             for material in regions.material]
    return np.array([signal * stray.relative[index] for stray in joint.stray_light]
                    ).reshape(-1, *signal.shape)


def _of_tails(calibration: Calibration, regions: RegionTransport,
              relative: np.ndarray) -> np.ndarray:
    """Errors (Q, R, K) of measured curves, relative to white, as
    ``error_budget.sensitivity_covariance`` has them.

    Every band errs by the stated share of the material's brightest band; errors of regions of the
    same material are fully correlated.
    """
    values, vectors = np.linalg.eigh(calibration.relative_covariance)
    patterns = (vectors * np.sqrt(np.maximum(values, 0))).T[values > 0]
    brightest = relative.max(axis=1, keepdims=True)
    errors = [np.where((regions.material == material)[:, None], brightest * pattern, 0.0)
              for material in np.unique(regions.material) for pattern in patterns]
    return np.array(errors).reshape(-1, *relative.shape)


def _of_curves(calibration: Calibration, received: np.ndarray, response: np.ndarray, scale: float,
               joint: JointReconstruction) -> np.ndarray:
    """Errors (Q, R, K) of the camera's curves by principal directions; white keeps its signal,
    being calibrated.
    """
    fit = calibration.sensitivity
    assert fit.covariance is not None and fit.basis is not None
    values, vectors = np.linalg.eigh(fit.covariance)
    chosen = values > KEPT * values[-1]
    bands, count = len(fit.curves), fit.basis.shape[1]
    curves = (vectors[:, chosen] * np.sqrt(values[chosen])).T.reshape(-1, bands,
                                                                      count) @ fit.basis.T
    moved = scale * curves * spectrum_on_grid(calibration.light, joint.grid) * joint.grid.weights_nm
    moved -= response * (moved.sum(axis=2) / white_signal(response))[..., None]
    return np.einsum("rp,qkp->qrk", received, moved)
