"""Photos of known spectra through a session's own light transport, and the inversion of them.

A replay keeps what a session has: the scene, the pixels that are compared, the noise of the photo,
the errors of surfaces that the scene showed. Spectra, curves of the camera and light are the
truth's. What comes back is solved by the code that solves photos, with the transport traced once;
a rendering is the mean of each region, without noise.
"""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from spectrabox.radiometry.interreflection import products
from spectrabox.radiometry.records.scenes import JointReconstruction
from spectrabox.radiometry.records.spectra import Progress
from spectrabox.reconstruct import agreement, inverse_rendering, transport_engine
from spectrabox.reconstruct.fit.transport_fit import TracedView
from spectrabox.reconstruct.scene.surfaces import region_means
from spectrabox.reconstruct.settings import InversionSettings
from spectrabox.reconstruct.view import PhotoView

FLAT = 1e-9     # of the largest singular value: a term of the field that a surface does not have


def replayable(views: Sequence[PhotoView], settings: InversionSettings,
               progress: Progress) -> tuple[TracedView, ...]:
    """The views traced, with the errors that their own photos, solved once, show of the scene.

    Parameters
    ----------
    views : V of PhotoView
    settings : InversionSettings
    progress : function of (fraction done, what is being done)

    Raises
    ------
    InputError
        As ``transport_engine.trace_views``.
    """
    traced = transport_engine.trace_views(views, settings, progress)
    images = {id(view.traced): transport_engine.renderings_of(view, settings) for view in traced}
    shown, _, _ = transport_engine.solve_traced(traced, settings,
                               lambda view, fit: images[id(view.traced)](fit.signals))
    # what known surfaces said of the light is the photos' own: a replay's say it anew
    return tuple(replace(view, view=given.view, known_light=None)
                 for view, given in zip(shown, traced, strict=True))


def replay(views: Sequence[TracedView], settings: InversionSettings,
           reflectances: Mapping[str, np.ndarray], responses: Sequence[np.ndarray],
           glare: Sequence[np.ndarray], ambient: Sequence[float],
           rng: np.random.Generator) -> JointReconstruction:
    """The reconstruction from photos of the truth, as noisy as the session's own.

    Parameters
    ----------
    views : V of TracedView
        As of ``replayable``.
    settings : InversionSettings
        By which these were traced.
    reflectances : mapping of (P,) arrays
        Of every material, as all that follows the truth.
    responses : V of (L, K, P) arrays
        Sensitivity x light x integration weight, light after light where they were traced
        separately, light scale included.
    glare : V of (K,) arrays
        As a share of the mean signal of the picture.
    ambient : V of float
        Light from everywhere, as a share of the brightest irradiance.
    rng : numpy.random.Generator
        Of the noise and the errors of surfaces.
    """
    given, rendered = [], {}
    for traced, response, veil, around in zip(views, responses, glare, ambient, strict=True):
        # The trace is off by its noise from what is photographed; renderings, whose own noise is
        # estimated from the scene's scatter, are not.
        deviations = traced.traced.deviations
        error = np.einsum("are,ar->re", deviations, rng.standard_normal(deviations.shape[:2]))
        view = _photographed(traced, reflectances, response, veil, around, error, rng)
        rendered[id(traced.traced)] = traced.traced.coefficients + error
        # what the first photo showed of errors is the truth's: this photo shows its own
        given.append(
            replace(traced, view=view, nuisances=transport_engine.nuisances(view, settings)))
    tied, fits, solutions = transport_engine.solve_by_lamps(
        given, settings, lambda traced, fit: _picture(rendered[id(traced.traced)] @ fit.signals,
                                                      traced.region, traced.view.measured)[None])
    return inverse_rendering.reconstruction_of([traced.view for traced in tied], fits, solutions,
                                               settings)


def _photographed(traced: TracedView, reflectances: Mapping[str, np.ndarray],
                  response: np.ndarray, glare: np.ndarray, ambient: float, error: np.ndarray,
                  rng: np.random.Generator) -> PhotoView:
    """The view with a photo of the truth in place of its own; its transport is off by an error."""
    view = traced.view
    spectra = np.array([reflectances[each.name] for each in view.scene_materials])
    transport = traced.traced
    per_light = products(transport.exponents, spectra) @ response.transpose(0, 2, 1)
    coefficients = transport.coefficients + error
    signal = coefficients @ per_light.reshape(-1, per_light.shape[2])
    signal = signal * _gains(traced, rng) * _patterns(traced, rng)
    signal = signal + _stray_light(traced, reflectances, response.sum(axis=0), glare, ambient,
                                   signal)
    even = replace(traced, nuisances=replace(traced.nuisances, block_error=0.0))
    noise = np.sqrt(even.photo_variance * np.maximum(signal / traced.measured, 0))
    signal = signal + noise * rng.standard_normal(signal.shape)
    picture = _picture(np.maximum(signal, np.finfo(np.float32).tiny), traced.region, view.measured)
    inside = (traced.region >= 0)[..., None]
    ratio = np.where(inside, picture / view.measured, 1.0)
    return view.with_photo(replace(view.photo, signal=picture.astype(np.float32),
                                   variance=(view.photo.variance * ratio).astype(np.float32)))


def _stray_light(traced: TracedView, reflectances: Mapping[str, np.ndarray],
                 response: np.ndarray, glare: np.ndarray, ambient: float,
                 signal: np.ndarray) -> np.ndarray:
    """Signal (R, K) by glare of the lens and by light that does not come from the scene's lamps."""
    names = traced.view.surface_materials
    reflected = np.array([response @ reflectances[name] for name in names])[traced.group]
    irradiance = (signal / reflected).mean(axis=1)
    shown = traced.region[traced.region >= 0]
    brightest = np.percentile(irradiance[shown], agreement.BRIGHTEST_PERCENTILE)
    mean = _picture(signal, traced.region, traced.view.measured).mean(axis=(0, 1))
    return np.asarray(glare * mean + ambient * brightest * reflected)


def _gains(traced: TracedView, rng: np.random.Generator) -> np.ndarray:
    """Factors (R, K) by which surfaces are brighter than the scene says, in each band and in all.
    """
    errors, bands = traced.nuisances, traced.measured.shape[1]
    surfaces = int(traced.group.max()) + 1
    colour = errors.surface_error * rng.standard_normal((surfaces, bands))
    brightness = errors.brightness_error * rng.standard_normal((surfaces, 1))
    return np.exp(colour + brightness)[traced.group]


def _patterns(traced: TracedView, rng: np.random.Generator) -> np.ndarray:
    """Factors (R, 1) of a smooth pattern on each surface, as strong as the session's photo showed:
    a quadratic field without its mean, the same in all bands.

    The fit takes the errors of blocks for independent, and for larger instead: drawn so they would
    scatter a photo several times more than the pattern that they stand for.
    """
    positions = np.moveaxis(np.indices(traced.region.shape), 0, -1).astype(float)
    row, column = region_means(positions, traced.region).T
    within = traced.nuisances.block_error / agreement.within_to_block(len(traced.group),
                                                                      np.unique(traced.group).size)
    pattern = np.zeros(len(traced.group))
    for surface in np.unique(traced.group):
        own = traced.group == surface
        x, y = (position[own] - position[own].mean() for position in (row, column))
        terms = np.stack([x, y, x * x, x * y, y * y], axis=1)
        axes, sizes, _ = np.linalg.svd(terms - terms.mean(axis=0), full_matrices=False)
        axes = axes[:, sizes > FLAT * sizes[0]]
        if axes.size:
            pattern[own] = np.sqrt(own.sum() / axes.shape[1]) * (
                axes @ rng.standard_normal(axes.shape[1]))
    return np.exp(within * pattern)[:, None]


def _picture(signal: np.ndarray, region: np.ndarray, outside: np.ndarray) -> np.ndarray:
    """Signals (R, K) in the pixels (H, W, K) of their regions, and another picture outside."""
    return np.where((region >= 0)[..., None], signal[np.maximum(region, 0)], outside)
