"""The transport engine: trace the scene's light once, then fit the spectra by algebra."""
from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records import RegionTransport
from spectrabox.reconstruct.agreement import scale_from_surfaces, scene_errors, surface_agreement
from spectrabox.reconstruct.fit.inversion_inputs import spectrum_prior
from spectrabox.reconstruct.fit.photo_terms import ViewFit
from spectrabox.reconstruct.fit.region_transport import region_transport
from spectrabox.reconstruct.fit.traced_fit import TracedView, fit_traced
from spectrabox.reconstruct.fit.transport_fit import FitPriors, TransportFit
from spectrabox.reconstruct.problem import InverseProblem
from spectrabox.reconstruct.rendering.renderer import load_scene
from spectrabox.reconstruct.scene.regions import block_regions, region_means
from spectrabox.reconstruct.scene.scene_file import not_plain_products
from spectrabox.reconstruct.settings import InversionSettings
from spectrabox.reconstruct.tracer.transport import (
    TracedTransport,
    joined,
    shaded_image,
    trace_transport,
)

FIRST_SPP = 64           # paths per pixel by which the noise is judged
MOST_SPP = 1024          # per pixel: where tracing ends, whatever the photo's noise
IMAGE_SPP = 512          # of the final rendering


@dataclass(frozen=True)
class ViewsAnswer:
    """What the engine finds from several photos."""

    fit: TransportFit
    rendered: tuple[np.ndarray, ...]    # (H, W, K) of each photo for a light scale of 1
    engines: tuple[str, ...]            # of each photo, in words
    spp: tuple[int, ...]
    regions: tuple[RegionTransport | None, ...]     # for the samplers


def unit_scene(problem: InverseProblem) -> Any:
    """The scene with reflectances and light spectra of 1.

    Raises
    ------
    InputError
        If a surface's reflected light is no plain product with its reflectance.
    """
    if others := not_plain_products(problem.scene_file):
        raise InputError("the transport engine treats diffuse surfaces only, and "
                         f"{', '.join(others)} of {problem.scene_file.path.name} is coated or "
                         "glossy: its spectrum does not just multiply; set [reconstruct] engine = "
                         "\"gradient\"")
    ones = np.ones(2)
    return load_scene(problem.xml({material.bsdf: ones for material in problem.materials},
                                  light=ones,
                                  bands={"one": ones}))


def trace_problem(problem: InverseProblem, region: np.ndarray, bounces: int, seed: int,
                  progress: Callable[[float, str], None], lights_apart: bool = False,
                  checkpoint: Path | None = None) -> TracedTransport:
    """Transport of the regions, with as many paths as it takes for its noise to fall below the
    photo's.

    A first trace says how noisy ``FIRST_SPP`` paths per pixel are. More follow until the median
    region's Monte Carlo variance is no more than the variance that the fit gives the photo there,
    or ``MOST_SPP`` are drawn.

    Parameters
    ----------
    lights_apart : bool
        Keeps the lights of ``problem.light_groups`` apart.
    checkpoint : Path, optional
        File from which a trace that was stopped goes on.
    """
    lights = problem.light_groups if lights_apart else None
    scene, bsdfs = unit_scene(problem), {material.bsdf: material.name
                                         for material in problem.materials}
    profiles = problem.scene_file.profiles
    first = trace_transport(scene, bsdfs, problem.size, region, bounces=bounces, spp=FIRST_SPP,
                            seed=seed, lights=lights, profiles=profiles)
    photo = region_means(problem.variance / np.maximum(problem.measured, 1e-12) ** 2,
                         region).mean(axis=1)
    photo = photo / np.bincount(region[region >= 0])
    needed = first.spp * float(np.median(first.relative_variance / photo))
    more = int(min(needed, MOST_SPP)) - first.spp
    progress(0.2, "tracing light")
    if more <= 0:
        return first
    second = trace_transport(scene, bsdfs, problem.size, region, bounces=bounces, spp=more,
                             seed=seed + 1, exponents=first.exponents, lights=lights,
                             checkpoint=checkpoint, profiles=profiles,
                             progress=lambda done: progress(0.2 + 0.5 * done, "tracing light"))
    return joined(first, second)


def fit_problem(problem: InverseProblem, traced: TracedTransport, region: np.ndarray,
                group: np.ndarray,
                priors: FitPriors) -> TransportFit:
    """Fit the regions of one photo, as ``fit_traced``."""
    return fit_traced([TracedView(problem, traced, region, group)], [priors])


def solve_views(problems: Sequence[InverseProblem], settings: InversionSettings,
                progress: Callable[[float, str], None],
                checkpoint: Path | None = None) -> ViewsAnswer:
    """Spectra that explain all photos together, each traced on its own.

    Parameters
    ----------
    checkpoint : Path, optional
        File for the trace of the first photo, from which it goes on when it was stopped; its number
        follows the name of those of the others.

    Raises
    ------
    InputError
        As ``unit_scene``; or if no light reaches a material.
    """
    single = settings.engine == "single-bounce"
    views, depths = [], []
    for number, problem in enumerate(problems):
        def part(done: float, what: str, number: int = number) -> None:
            progress((0.7 * number + done) / len(problems), what)  # tracing reports up to 0.7
        region, group = block_regions(problem.surface, problem.used)
        part(0.0, "tracing light")
        depths.append(1 if single else problem.scene_file.max_depth - 1)
        apart = len(problem.light_groups) > 1 and (settings.light_error > 0
                                                   or bool(problem.own_lights))
        if apart:
            _require_named_lights(problem)
        traced = trace_problem(problem, region, depths[-1], settings.seed + 613 * number, part,
                               apart,
                               checkpoint
                               and checkpoint.with_stem(f"{checkpoint.stem}{number or ''}"))
        _require_lit(problem, traced, group)
        views.append(TracedView(problem, traced, region, group))
    progress(0.7, "fitting spectra")
    priors = [fit_priors(settings, problem) for problem in problems]
    fit = fit_traced(views, priors)
    images = _images(views, fit, depths, settings.seed)
    known = [_priors_told(settings, view, image, prior)
             for view, image, prior in zip(views, images, priors, strict=True)]
    if known != priors:
        fit = fit_traced(views, known)
        images = _images(views, fit, depths, settings.seed)
    name = "single bounce (direct light only)" if single else "light transport traced once"
    progress(1.0, "")
    return ViewsAnswer(fit, images, tuple(f"{name} ({depth} bounces, {len(view.traced.exponents)} "
                                          "products)"
                                          for view, depth in zip(views, depths, strict=True)),
                       tuple(view.traced.spp for view in views),
                       tuple(region_transport(view, prior, fit, number)
                             for number, (view, prior)
                             in enumerate(zip(views, known, strict=True))))


def fit_priors(settings: InversionSettings, problem: InverseProblem) -> FitPriors:
    """Priors of the fit of one photo, as the settings state them."""
    scale = problem.light_scale
    lights = len(problem.light_groups) if settings.light_error > 0 else 1
    return FitPriors(None if scale is None else scale.value, settings.surface_error,
                     settings.brightness_error, settings.light_error if lights > 1 else 0.0,
                     settings.mixing_error, settings.block_error, settings.smoothness
                     if settings.spectrum_prior != "none" else 0.0,
                     spectrum_prior(settings, problem.grid, problem.basis))


def _priors_told(settings: InversionSettings, view: TracedView, image: np.ndarray,
                 priors: FitPriors) -> FitPriors:
    """What a first rendering tells of the light scale, from known surfaces alone as in every
    engine, and of errors.
    """
    problem, scale = view.problem, priors.scale
    if scale is None and (problem.known_surface >= 0).any():
        scale = scale_from_surfaces(problem.measured, image, problem.known_surface, "").value
        priors = replace(priors, scale=scale)
    if not settings.errors_from_scene:
        return priors
    name_of = {material.bsdf: material.name for material in problem.materials}
    agreement = surface_agreement(
        tuple(problem.scene_file.surfaces),
        tuple(name_of[bsdf] for bsdf in problem.scene_file.surfaces.values()), problem.measured,
        image * (scale or 1.0), problem.surface, problem.used)
    found = scene_errors(agreement, frozenset(material.name for material in problem.materials
                                              if material.reflectance is not None), len(view.group))
    if found is None:
        return priors
    return replace(priors, gain_error=max(priors.gain_error, found.colour),
                   block_error=max(priors.block_error, found.block),
                   brightness_error=max(priors.brightness_error, found.brightness))


def _images(views: Sequence[TracedView], fit: TransportFit, depths: Sequence[int],
            seed: int) -> tuple[np.ndarray, ...]:
    return tuple(_image(view, found, depth, seed) for view, found,
                 depth in zip(views, fit.views, depths, strict=True))


def _image(view: TracedView, found: ViewFit, bounces: int, seed: int) -> np.ndarray:
    problem, traced = view.problem, view.traced
    lights = problem.light_groups if traced.passes.shape[2] > 1 else None
    return shaded_image(unit_scene(problem),
                        {material.bsdf: material.name for material in problem.materials},
                        problem.size, traced.exponents, found.signals, bounces=bounces,
                        spp=IMAGE_SPP,
                        seed=seed + 7919, lights=lights, profiles=problem.scene_file.profiles)


def _require_named_lights(problem: InverseProblem) -> None:
    if any(not node.get("id") for node in problem.scene_file.root.findall("emitter")):
        raise InputError(f"{problem.scene_file.path.name} has a light without an id, and its "
                         "lights are to be told apart: write <emitter id=...> on each")


def _require_lit(problem: InverseProblem, traced: TracedTransport, group: np.ndarray) -> None:
    """Refuse a material that the camera sees but no light reaches."""
    received = traced.coefficients.sum(axis=1)
    worn = list(problem.scene_file.surfaces.values())
    for material in problem.materials:
        mine = np.isin(group, [index for index, bsdf in enumerate(worn) if bsdf == material.bsdf])
        if mine.any() and not received[mine].any():
            raise InputError(f"no light reaches material {material.name!r} in "
                             f"{problem.scene_file.path.name}, although the photo shows it lit: "
                             "check the light's place and the direction its surfaces face")
