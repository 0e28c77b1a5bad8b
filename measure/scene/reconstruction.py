"""One photo of a scene to the spectra of its materials: inverse rendering, then every spectrum."""
from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from spectrabox.capture.photo.binning import bin_image, render_size
from spectrabox.measure.scene.photo_errors import StatedErrors, with_photo_errors
from spectrabox.measure.surface_signals import measurement, scene_signals
from spectrabox.measure.surface_spectra import DrawOptions, sample_surfaces
from spectrabox.radiometry.error_model import SURFACE_REFLECTIONS
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records import (
    Calibration,
    JointReconstruction,
    LearntSpectra,
    LightScale,
    LinearImage,
    Progress,
    SurfaceSignals,
    SurfaceSpectrum,
    default_band_names,
)
from spectrabox.reconstruct.inverse_rendering import reconstruct_views
from spectrabox.reconstruct.scene.scene_file import (
    SceneFile,
    check_materials,
    not_plain_products,
    require_same_shape,
)
from spectrabox.reconstruct.settings import InversionSettings
from spectrabox.reconstruct.view import MaterialSpec, View
from spectrabox.sampling.prior.mixture import (
    PRIOR_GRID,
    load_prior,
    of_families,
    reflectance_moments,
)
from spectrabox.sampling.prior.mixture_posterior import posterior
from spectrabox.sampling.spline_measurement import response_on

# of the light's strength where nothing states it: brightnesses relative to a first guess
TRIED_SCALES = np.geomspace(0.4, 4.0, 93)
COARSE_WIDTH = 40           # of the view that the strength is estimated from, in pixels
SCALE_PASSES = 3            # reflections between surfaces change with the strength
FROM_PRIOR = "what the prior expects of surfaces, since nothing states the strength of the light"


@dataclass(frozen=True)
class SceneOptions:
    """How a scene is reconstructed; the defaults are those of ``session.toml``."""

    width: int = 96                 # of the rendered view, in pixels
    glare: float = 0.005            # standard error, of the picture's mean signal
    ambient: float = 0.002          # standard error, of the brightest irradiance
    inversion: InversionSettings = field(default_factory=InversionSettings)
    drawing: DrawOptions = field(default_factory=lambda: DrawOptions(seed=1))


@dataclass(frozen=True, eq=False)
class SceneEstimate:
    """A reconstructed scene, the signals of its materials, and the spectra behind them."""

    joint: JointReconstruction
    signals: SurfaceSignals
    spectra: Mapping[str, SurfaceSpectrum]


def reconstruct_scene(photo: LinearImage, scene: SceneFile, calibration: Calibration,
                      materials: Mapping[str, np.ndarray | None], options: SceneOptions, *,
                      families: Mapping[str, Sequence[str]] | None = None,
                      surfaces: Mapping[str, str] | None = None,
                      scale: LightScale | None = None, chart_glare: np.ndarray | float = 0.0,
                      progress: Progress = lambda share, message: None) -> SceneEstimate:
    """Spectra of all materials of a scene from one photo.

    Parameters
    ----------
    photo : LinearImage
        Of the whole view that the scene's film describes.
    scene : SceneFile
    calibration : Calibration
    materials : mapping
        From the id of each BSDF to its reflectance (P,) on the calibration's grid, None where it
        is to be found.
    options : SceneOptions
    families : mapping, optional
        What surfaces are, by material.
    surfaces : mapping, optional
        How much they mirror, of SURFACE_REFLECTIONS, by material.
    scale : LightScale, optional
        From a chart photo. Without it a known material tells the strength of the light; without
        both it is estimated from what the prior expects, with its error.
    chart_glare : (K,) array or float
        Veiling glare that the chart photo shows, of the picture's mean signal.
    progress : callable

    Raises
    ------
    InputError
        If photo and scene do not show the same view, or name other materials.
    """
    require_same_shape(photo, scene, photo.source)
    if problems := check_materials(scene, {name: name for name in materials}):
        raise InputError("\n".join(problems))
    stated = families or {}
    settings = dataclasses.replace(options.inversion, learnt=learnt_spectra(()))
    specs = tuple(MaterialSpec(name, name, known,
                               learnt_spectra(stated[name]) if stated.get(name) else None)
                  for name, known in materials.items())
    height, width = photo.signal.shape[:2]
    binned = bin_image(photo, *render_size(width, height, options.width))
    bands = default_band_names(photo.signal.shape[2])
    view = View("photo", scene, binned, calibration, bands, specs, scale)
    glare = np.hypot(options.glare, chart_glare)
    if scale is None and not any(spec.reflectance is not None for spec in specs):
        small = bin_image(photo, *render_size(width, height, min(options.width, COARSE_WIDTH)))
        view = dataclasses.replace(view, light_scale=scale_from_prior(
            dataclasses.replace(view, photo=small), settings, stated, progress))
    modelled = not_plain_products(scene)
    joint = with_photo_errors(
        reconstruct_views((view,), settings, progress),
        StatedErrors(None, np.broadcast_to(glare, len(bands)), options.ambient,
                     {name: SURFACE_REFLECTIONS[(surfaces or {}).get(name)]
                      for name, known in materials.items()
                      if known is None and name not in modelled}))
    signals = scene_signals(joint, [calibration])
    return SceneEstimate(joint, signals,
                         sample_surfaces(signals, options.drawing, stated, progress))


def scale_from_prior(view: View, settings: InversionSettings,
                     families: Mapping[str, Sequence[str]], progress: Progress) -> LightScale:
    """The strength of the light under which the materials are most probable.

    Signals are inversely proportional to it but for light reflected between surfaces, so that the
    posterior on a grid of strengths, flat in the logarithm, is taken again at its own mean.

    Parameters
    ----------
    view : View
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
