"""The strength of the light on a scene, and what its photos err by in common.

Light in the object photos that no scene holds: veiling glare of the lens, light from elsewhere
than the lamp, and what the outermost layer of a surface mirrors.

All add to the signal, so that dark materials and shadows suffer most.

    glare       d s(m, k) / s(m, k) = g mean of the picture(k) / mean over its pixels(k)
    ambient     d s(m, k) / s(m, k) = a largest irradiance / mean irradiance on its pixels
    gloss       d s(m, k) = g of the material >= 0, a share of white (radiometry/gloss.py)
"""


from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from spectrabox.capture.photo.preview import bin_image, render_size
from spectrabox.measure.surfaces.surface_signals import measurement, scene_signals
from spectrabox.radiometry import error_model
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records import calibration, scenes, spectra
from spectrabox.reconstruct import agreement, inverse_rendering, settings
from spectrabox.reconstruct.view import PhotoView
from spectrabox.sampling.prior import mixture, mixture_posterior
from spectrabox.sampling.spectral_measurement import response_on


def with_stray_light(joint: scenes.JointReconstruction, glare: np.ndarray, ambient: float,
                     gloss: Mapping[str, str | None]) -> scenes.JointReconstruction:
    """The reconstruction with what stray light may have added to each material's signal.

    Parameters
    ----------
    joint : JointReconstruction
        Whose own stray light is replaced.
    glare : (K,) array
        Standard error, of a photo's mean signal.
    ambient : float
        Standard error, of the brightest irradiance.
    gloss : mapping
        From materials that may mirror light to what is stated of their surfaces; None: nothing.
    """
    of_glare, of_ambient = np.zeros((2, *joint.signal.shape))
    for number in np.unique(joint.view_of_band):
        view = joint.views[number]
        bands = np.flatnonzero(joint.view_of_band == number)
        irradiance = _irradiance(view)
        lit = np.isfinite(irradiance)
        brightest = np.percentile(irradiance[lit],
                                  agreement.BRIGHTEST_PERCENTILE) if lit.any() else 0.0
        for name in view.materials:
            own = _pixels_of(view, name) & lit
            index = joint.materials.index(name)
            if own.any():
                shown = view.measured[own].mean(axis=0)
                of_glare[index, bands] = glare * view.measured.mean(axis=(0, 1)) / shown
                of_ambient[index, bands] = ambient * brightest / irradiance[own].mean()
    return dataclasses.replace(
        joint, gloss=dict(gloss),
        stray_light={error_model.GLARE: of_glare, error_model.STRAY_LIGHT: of_ambient})


def _irradiance(view: scenes.Reconstruction) -> np.ndarray:
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


def _pixels_of(view: scenes.Reconstruction, material: str) -> np.ndarray:
    """Usable pixels (H, W) of a material."""
    surfaces = [index for index, name in enumerate(view.agreement.materials) if name == material]
    return view.used & np.isin(view.surface, surfaces)


# ---- light strength ------------------------------------------------------------------------------

# of the light's strength where nothing states it: brightnesses relative to a first guess
TRIED_SCALES = np.geomspace(0.4, 4.0, 93)
COARSE_WIDTH = 40           # of the view that the strength is estimated from, in pixels
SCALE_PASSES = 3            # reflections between surfaces change with the strength
FROM_PRIOR = "what the prior expects of surfaces, since nothing states the strength of the light"


def scale_from_prior(view: PhotoView, settings: settings.InversionSettings,
                     families: Mapping[str, Sequence[str]],
                     progress: spectra.Progress) -> calibration.LightScale:
    """The strength of the light under which the materials are most probable.

    Signals are inversely proportional to it but for light reflected between surfaces, so that the
    posterior on a grid of strengths, flat in the logarithm, is taken again at its own mean.

    Parameters
    ----------
    view : PhotoView
        Whose light scale is not known.
    settings : InversionSettings
    families : mapping
        What surfaces are, by material.
    progress : callable

    Returns
    -------
    LightScale
        With its standard error, which is common to all bands.

    Raises
    ------
    InputError
        If no spectrum fits at any strength.
    """
    height, width = view.photo.signal.shape[:2]
    view = dataclasses.replace(view, photo=bin_image(
        view.photo, *render_size(width, height, min(width, COARSE_WIDTH))))
    white = view.photo.signal[~view.photo.saturated.any(axis=2)]
    value = float(np.percentile(white, 99))
    # a guess to begin with: whether photo and scene agree is asked of what follows
    first = inverse_rendering.reconstruct_views((dataclasses.replace(
        view, light_scale=calibration.LightScale(1.0, None, None, FROM_PRIOR)),),
        dataclasses.replace(settings, errors_from_scene=False), progress).views[0]
    value /= max(float(np.percentile(first.rendered, 99)), np.finfo(float).tiny)
    spread = np.inf
    for _ in range(SCALE_PASSES):
        scale = calibration.LightScale(value, value * min(spread, 0.5), None, FROM_PRIOR)
        joint = inverse_rendering.reconstruct_views(
            (dataclasses.replace(view, light_scale=scale),), settings, progress)
        signals = scene_signals(joint, [view.calibration])
        log_posterior = np.zeros(TRIED_SCALES.size)
        for index, name in enumerate(signals.names):
            prior = mixture.of_families(mixture.load_prior(), families.get(name, ()))
            own = measurement(signals, index)
            noise = np.diag(np.diag(joint.signal_covariance[index])) + np.diag(
                (0.02 * own.signal) ** 2)
            log_posterior += mixture_posterior.posterior(
                prior, response_on(own, mixture.PRIOR_GRID), own.signal / TRIED_SCALES[:, None],
                noise / TRIED_SCALES[:, None, None]**2).log_evidence
            log_posterior -= len(own.signal) * np.log(TRIED_SCALES)
        weights = np.exp(log_posterior - log_posterior.max())
        weights /= weights.sum()
        logs = np.log(TRIED_SCALES)
        shift = float(weights @ logs)
        spread = float(np.sqrt(weights @ (logs - shift) ** 2))
        value *= float(np.exp(shift))
    if not np.isfinite(value):
        raise InputError("no strength of the light explains the photo; give a chart scene to "
                         "fit_camera, or the spectrum of one material")
    return calibration.LightScale(value, value * spread, None, FROM_PRIOR)


def learnt_spectra(families: Sequence[str]) -> scenes.LearntSpectra:
    """Mean and covariance of the learnt prior, of some families if any are stated."""
    prior = mixture.of_families(mixture.load_prior(), families)
    return scenes.LearntSpectra(np.asarray(prior.nm), *mixture.reflectance_moments(prior))
