"""The strength of the light on a scene where nothing states it, from what the prior expects."""
from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from spectrabox.capture.photo.binning import bin_image, render_size
from spectrabox.measure.surfaces.surface_signals import measurement, scene_signals
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records.calibration import LightScale
from spectrabox.radiometry.records.scenes import LearntSpectra
from spectrabox.radiometry.records.spectra import Progress
from spectrabox.reconstruct.inverse_rendering import reconstruct_views
from spectrabox.reconstruct.settings import InversionSettings
from spectrabox.reconstruct.view import PhotoView
from spectrabox.sampling.prior.mixture import (
    PRIOR_GRID,
    load_prior,
    of_families,
    reflectance_moments,
)
from spectrabox.sampling.prior.mixture_posterior import posterior
from spectrabox.sampling.spectral_measurement import response_on

# of the light's strength where nothing states it: brightnesses relative to a first guess
TRIED_SCALES = np.geomspace(0.4, 4.0, 93)
COARSE_WIDTH = 40           # of the view that the strength is estimated from, in pixels
SCALE_PASSES = 3            # reflections between surfaces change with the strength
FROM_PRIOR = "what the prior expects of surfaces, since nothing states the strength of the light"


def scale_from_prior(view: PhotoView, settings: InversionSettings,
                     families: Mapping[str, Sequence[str]], progress: Progress) -> LightScale:
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
    first = reconstruct_views((dataclasses.replace(view, light_scale=LightScale(
        1.0, None, None, FROM_PRIOR)),), settings, progress).views[0]
    value /= max(float(np.percentile(first.rendered, 99)), np.finfo(float).tiny)
    spread = np.inf
    for _ in range(SCALE_PASSES):
        scale = LightScale(value, value * min(spread, 0.5), None, FROM_PRIOR)
        joint = reconstruct_views((dataclasses.replace(view, light_scale=scale),), settings,
                                  progress)
        signals = scene_signals(joint, [view.calibration])
        log_posterior = np.zeros(TRIED_SCALES.size)
        for index, name in enumerate(signals.names):
            prior = of_families(load_prior(), families.get(name, ()))
            own = measurement(signals, index)
            noise = np.diag(np.diag(joint.signal_covariance[index])) + np.diag(
                (0.02 * own.signal) ** 2)
            log_posterior += posterior(
                prior, response_on(own, PRIOR_GRID), own.signal / TRIED_SCALES[:, None],
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
    return LightScale(value, value * spread, None, FROM_PRIOR)


def learnt_spectra(families: Sequence[str]) -> LearntSpectra:
    """Mean and covariance of the learnt prior, of some families if any are stated."""
    prior = of_families(load_prior(), families)
    return LearntSpectra(np.asarray(prior.nm), *reflectance_moments(prior))
