"""The transport engine: trace the scene's light once, then fit the spectra by algebra."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from radiometry.errors import InputError
from radiometry.records import Outcome
from radiometry.response import relative_operator
from reconstruct.agreement import scale_from_surfaces
from reconstruct.band_system import compress, huber_weight
from reconstruct.identifiability import band_signals, identifiability, sentences
from reconstruct.inverse_problem import EngineAnswer, InverseProblem, InversionSettings
from reconstruct.regions import block_regions, region_means
from reconstruct.renderer import load_scene
from reconstruct.scene_file import not_plain_products
from reconstruct.transport import TracedTransport, joined, shaded_image, trace_transport
from reconstruct.transport_fit import FitPriors, SpectrumModel, TransportFit, fit_spectra

FIRST_SPP = 64           # paths per pixel by which the noise is judged
MOST_SPP = 1024          # per pixel: where tracing ends, whatever the photo's noise
IMAGE_SPP = 512          # of the final rendering
LAMP_SHARE = 1e-3        # of a region's light straight from a lamp: above, its edge runs through a pixel
ROBUST_ROUNDS = 2        # times that pixels beyond HUBER sigma are weighed anew


def invert_by_transport(problem: InverseProblem, settings: InversionSettings,
                        progress: Callable[[float, str], None]) -> EngineAnswer:
    """Coefficients, by a traced light transport with all the bounces of the scene."""
    return _invert(problem, settings, problem.scene_file.max_depth - 1, "light transport traced once", progress)


def invert_by_single_bounce(problem: InverseProblem, settings: InversionSettings,
                            progress: Callable[[float, str], None]) -> EngineAnswer:
    """The same without interreflection: direct light only, as a baseline."""
    return _invert(problem, settings, 1, "single bounce (direct light only)", progress)


def unit_scene(problem: InverseProblem) -> Any:
    """The scene with reflectances and light spectra of 1.

    Raises
    ------
    InputError
        If a surface's reflected light is no plain product with its reflectance.
    """
    if others := not_plain_products(problem.scene_file):
        raise InputError(f"the transport engine treats diffuse surfaces only, and {', '.join(others)} of "
                         f"{problem.scene_file.path.name} is coated or glossy: its spectrum does not just multiply; "
                         "set [reconstruct] engine = \"gradient\"")
    ones = np.ones(2)
    return load_scene(problem.xml({material.bsdf: ones for material in problem.materials}, light=ones,
                                  bands={"one": ones}))


def trace_problem(problem: InverseProblem, region: np.ndarray, bounces: int, seed: int,
                  progress: Callable[[float, str], None]) -> TracedTransport:
    """Transport of the regions, with as many paths as it takes for its noise to fall below the photo's."""
    scene, bsdfs = unit_scene(problem), {material.bsdf: material.name for material in problem.materials}
    first = trace_transport(scene, bsdfs, problem.size, region, bounces=bounces, spp=FIRST_SPP, seed=seed)
    photo = region_means(problem.variance / np.maximum(problem.measured, 1e-12) ** 2, region).mean(axis=1)
    needed = FIRST_SPP * float(np.median(first.relative_variance / photo))
    more = int(min(needed, MOST_SPP)) - FIRST_SPP
    progress(0.2, "tracing light")
    if more <= 0:
        return first
    second = trace_transport(scene, bsdfs, problem.size, region, bounces=bounces, spp=more, seed=seed + 1,
                             exponents=first.exponents,
                             progress=lambda done: progress(0.2 + 0.5 * done, "tracing light"))
    return joined(first, second)


def fit_problem(problem: InverseProblem, traced: TracedTransport, region: np.ndarray, group: np.ndarray,
                priors: FitPriors) -> TransportFit:
    """Fit the regions; those that no spectrum explains lose weight round by round, those that see the lamp count none.

    The matrices are small: several BLAS threads would take longer than one.
    """
    with threadpool_limits(1, "blas"):
        return _fit_regions(problem, traced, region, group, priors)


def _fit_regions(problem: InverseProblem, traced: TracedTransport, region: np.ndarray, group: np.ndarray,
                 priors: FitPriors) -> TransportFit:
    model = SpectrumModel(traced.exponents, problem.response[None], problem.basis,
                          {index: material.reflectance for index, material in enumerate(problem.materials)
                           if material.reflectance is not None})
    measured = region_means(problem.measured, region)
    pixels = np.bincount(region[region >= 0])
    rendering = _smoothed(traced.relative_variance, group)
    variance = (region_means(problem.variance, region) / pixels[:, None] + rendering[:, None] * measured**2)
    coefficients, deviations = traced.coefficients, traced.deviations
    lamp = coefficients[:, ::len(traced.exponents)].sum(axis=1) > LAMP_SHARE * coefficients.sum(axis=1)
    weight = np.where(lamp[:, None], 0.0, 1 / variance)
    fit = fit_spectra(compress(coefficients, measured, weight, group, deviations), model, priors)
    for _ in range(ROBUST_ROUNDS):
        gain = np.array([fit.gains.get(name, np.ones(measured.shape[1])) for name in group.tolist()])
        predicted = fit.scale * gain * (coefficients @ fit.signals)
        trust = huber_weight(measured - predicted, np.sqrt(variance))
        fit = fit_spectra(compress(coefficients, measured, trust * weight, group, deviations), model, priors,
                          fit.coefficients)
    return fit


def _invert(problem: InverseProblem, settings: InversionSettings, bounces: int, engine: str,
            progress: Callable[[float, str], None]) -> EngineAnswer:
    region, group = block_regions(problem.surface, problem.used)
    progress(0.0, "tracing light")
    traced = trace_problem(problem, region, bounces, settings.seed, progress)
    _require_lit(problem, traced, group)
    progress(0.7, "fitting spectra")
    scale = problem.light_scale
    priors = FitPriors(settings.smoothness, None if scale is None else scale.value, settings.surface_error)
    fit = fit_problem(problem, traced, region, group, priors)
    rendered = _image(problem, traced, fit, bounces, settings.seed)
    if scale is None:  # by the rule of every engine: from the known surfaces alone, and the spectra for that scale
        value = scale_from_surfaces(problem.measured, rendered, problem.known_surface, "").value
        fit = fit_problem(problem, traced, region, group, replace(priors, scale=value))
        rendered = _image(problem, traced, fit, bounces, settings.seed)
    operator = relative_operator(problem.response, problem.basis)
    names = tuple(material.name for material in problem.unknown)
    found = identifiability(fit, names, operator)
    signals, covariance = band_signals(fit, operator, len(names))
    outcome = Outcome.ILL_POSED if fit.outcome is Outcome.CONVERGED and any(item.by_prior for item in found) \
        else fit.outcome
    progress(1.0, "")
    return EngineAnswer(fit.coefficients, signals, covariance, rendered, fit.cost_history,
                        f"{engine} ({bounces} bounces, {traced.exponents.shape[0]} products)", traced.spp, outcome,
                        sentences(found))


def _image(problem: InverseProblem, traced: TracedTransport, fit: TransportFit, bounces: int, seed: int) -> np.ndarray:
    return shaded_image(unit_scene(problem), {material.bsdf: material.name for material in problem.materials},
                        problem.size, traced.exponents, fit.signals, bounces=bounces, spp=IMAGE_SPP, seed=seed + 7919)


def _smoothed(relative_variance: np.ndarray, group: np.ndarray) -> np.ndarray:
    """Monte Carlo variance of each region, half its own and half its surface's: few passes know it only roughly."""
    pooled = np.bincount(group, relative_variance) / np.maximum(np.bincount(group), 1)
    return 0.5 * (relative_variance + pooled[group])


def _require_lit(problem: InverseProblem, traced: TracedTransport, group: np.ndarray) -> None:
    """Refuse a material that the camera sees but no light reaches."""
    received = traced.coefficients.sum(axis=1)
    worn = list(problem.scene_file.surfaces.values())
    for material in problem.materials:
        mine = np.isin(group, [index for index, bsdf in enumerate(worn) if bsdf == material.bsdf])
        if not received[mine].any():
            raise InputError(f"no light reaches material {material.name!r} in {problem.scene_file.path.name}, although "
                             "the photo shows it lit: check the light's place and the direction its surfaces face")
