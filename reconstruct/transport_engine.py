"""The transport engine: trace the scene's light once, then fit the spectra by algebra."""
from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.interreflection import relative_operator
from spectrabox.radiometry.records.spectra import Outcome, Progress
from spectrabox.reconstruct import linearity, scene_estimate
from spectrabox.reconstruct.agreement import SceneErrors, scene_errors, shifted, surface_agreement
from spectrabox.reconstruct.fit import transport_fit, view_terms
from spectrabox.reconstruct.known_light import tie_to_known
from spectrabox.reconstruct.rendering.renderer import load_scene
from spectrabox.reconstruct.scene import edit_scene, scene_file, surfaces
from spectrabox.reconstruct.settings import InversionSettings
from spectrabox.reconstruct.tracer import transport as tracing
from spectrabox.reconstruct.tracer.unit_scene import UnitScene
from spectrabox.reconstruct.view import PhotoView, ViewSolution, same_response, unknown_materials

FIRST_SPP = 64           # paths per pixel by which the noise is judged
FEW_SPP = 2              # and by which most materials are seen to receive light
MORE_SPP = 16               # by which the time of a path is told from that of a trace
MAX_SPP = 1024           # per pixel: where tracing ends, whatever the photo's noise
IMAGE_SPP, IMAGES = 128, 2  # paths per pixel of the final renderings together, and their number
# relative, of a surface's mean in them, the median: noisier ones get more paths, up to MAX_SPP
IMAGE_NOISE = 0.01
STEPS_FORESEEN = 30         # expansions of the cost in the two or three fits of a view, as a rule
UNSEEN_LOSS = 1e-3          # share of the light in dropped products that is no error by itself
VIEW_SEED_STEP = 613     # between the seeds of two views' traces


# one view, the view with the light that its known surfaces show, its fit and its solution
_Solved = tuple[transport_fit.TracedView, tuple[transport_fit.TracedView, ...],
                tuple[transport_fit.TransportFit, ...], tuple[ViewSolution, ...]]


def solve_views(views: Sequence[PhotoView], settings: InversionSettings, progress: Progress,
                checkpoint: Path | None = None
                ) -> tuple[tuple[PhotoView, ...], tuple[transport_fit.TransportFit, ...],
                           tuple[ViewSolution, ...]]:
    """Spectra that explain all photos together, each traced on its own.

    Parameters
    ----------
    views : V views
    settings : InversionSettings
    progress : function of (fraction done, what is being done)
    checkpoint : Path, optional
        File for the trace of the first view, from which it goes on when it was stopped; their
        number follows the name of those of the others.

    Returns
    -------
    views : V of PhotoView
        With the light that their known surfaces show.
    fits : V of TransportFit
        That tells the signals of the materials in each view: see ``solve_by_lamps``.
    solutions : V of ViewSolution
        Of all views together.

    Raises
    ------
    InputError
        As ``unit_scene`` and ``trace_transport``; or if no light reaches a material, or lights that
        are to be distinguished have no id.
    """
    traced = trace_views(views, settings, progress, checkpoint)
    progress(0.7, "fitting spectra")
    images = {id(view.traced): renderings_of(view, settings) for view in traced}
    tied, fits, solutions = solve_by_lamps(traced, settings,
                                           lambda view, fit: images[id(view.traced)](fit.signals))
    if len(views) == 1 and settings.errors_from_scene and settings.engine == "transport":
        _, tied, fits, solutions = _with_scene_estimated(
            (traced[0], tied, fits, solutions), settings, progress)
    progress(1.0, "")
    return tuple(view.view for view in tied), fits, solutions


def _with_scene_estimated(solved: _Solved, settings: InversionSettings,
                          progress: Progress) -> _Solved:
    """One view solved with its scene as the photo shows it; as it is where photo and scene agree,
    or where no camera, lamp and lens explain why they do not.

    Paints that shine send light where matt ones send none: a camera that is fitted to it explains
    little of the edges, lamp and lens leave much as it was, and they are not so.
    """
    stated, tied, _, solutions = solved
    before = _disagreement(tied[0], solutions[0])
    if before < scene_estimate.DISAGREEMENT or not scene_estimate.can_be_estimated(stated.view):
        return solved
    rendered = solutions[0].renderings.mean(axis=0)
    curve = linearity.linearity(stated.view, rendered)
    if curve is not None and curve.severity is Severity.FAIL:   # its lamp would take the curve
        return solved
    progress(0.75, "estimating pose, lamp and lens")
    # against the scene as stated: a pose that is estimated would hide that the photo was cropped
    cropped = shifted(stated.view.measured, rendered)
    placed, parts = _with_camera_estimated(solved, settings)
    view, of_materials, of_lamp, not_estimated = _lamp_estimated(placed, settings)
    if not_estimated:           # nothing is moved by such a photo
        return _with_findings(solved, not_estimated)
    covariance: Mapping[str, np.ndarray] = {}
    if of_lamp:
        region, group = placed[0].region, placed[0].group
        transport = trace_view(view, unit_scene(view, _bounces(view, settings)), region, group,
                               settings.seed, lambda done, what: None)
        lit = _solved_alone(replace(placed[0], view=view, traced=transport), settings)
        if _disagreement(lit[1][0], lit[3][0]) < max(scene_estimate.LEFT,
                                                     scene_estimate.LEFT_SHARE * before):
            placed, parts, covariance = lit, [*parts, *of_lamp], of_materials
    if not parts:
        return solved
    return _with_findings(placed, (scene_estimate.finding(parts), *cropped), covariance)


def _with_findings(solved: _Solved, findings: Sequence[Finding],
                   covariance: Mapping[str, np.ndarray] | None = None) -> _Solved:
    """A solved view with more findings, and the covariance of its materials by the scene's."""
    return *solved[:3], tuple(replace(one, findings=(*one.findings, *findings),
                                      scene_covariance=covariance or {}) for one in solved[3])


def _disagreement(view: transport_fit.TracedView, solution: ViewSolution) -> float:
    """Standard deviation of log(photo / rendering) between surfaces, or within them where that is
    larger; 0 where no two can be compared.
    """
    errors = _errors_of(solution.renderings, view.view, view)
    return 0.0 if errors is None else max(errors.brightness, errors.pattern)


def _solved_alone(view: transport_fit.TracedView, settings: InversionSettings) -> _Solved:
    """A view by itself, solved."""
    render = renderings_of(view, settings)
    tied, fit, solutions = solve_traced([view], settings,
                                        lambda traced, part: render(part.signals))
    return view, tied, (fit,), solutions


def _with_camera_estimated(solved: _Solved,
                           settings: InversionSettings) -> tuple[_Solved, list[dict[str, Any]]]:
    """The view with its camera where the edges of the photo put it, and that as a part of the
    scene; as it is, and none, where they agree.
    """
    turn, parts = np.zeros(3), list[dict[str, Any]]()
    for _ in range(scene_estimate.POSE_ROUNDS):
        view, images = solved[0].view, solved[3][0].renderings
        pose = scene_estimate.estimate_pose(view, images.mean(axis=0))
        if pose is None:
            break
        to_world, turn_more, turn_error, explained = pose
        if not parts and explained < scene_estimate.EDGES_EXPLAINED:
            break
        placed = replace(view, scene_file=edit_scene.with_camera_at(view.scene_file, to_world))
        traced, = trace_views([placed], settings, lambda done, what: None)
        solved = _solved_alone(traced, settings)
        turn = turn + turn_more
        parts = [scene_estimate.camera_part(turn, turn_error)]
    return solved, parts


def _lamp_estimated(solved: _Solved, settings: InversionSettings
                    ) -> tuple[PhotoView, dict[str, np.ndarray], list[dict[str, Any]],
                               tuple[Finding, ...]]:
    """Lamp and lens of a view, as of ``estimate_lamp``."""
    stated, tied, fits, _ = solved
    priors = [transport_fit.spectrum_prior(settings, stated.view.grid, material.learnt)
              for material in unknown_materials([stated.view])]

    def fitted(view: transport_fit.TracedView) -> view_terms.ViewFit:
        return transport_fit.fit_traced([view], priors, fits[0].coefficients).views[0]

    def trace(view: PhotoView, spp: int) -> tracing.TracedTransport:
        return tracing.trace_transport(unit_scene(view, _bounces(view, settings)), stated.region,
                                       spp=spp, seed=settings.seed,
                                       exponents=stated.traced.exponents)
    freed = replace(stated, nuisances=replace(tied[0].nuisances, scale=stated.nuisances.scale))
    return scene_estimate.estimate_lamp(freed, fitted, trace)


def trace_views(views: Sequence[PhotoView], settings: InversionSettings, progress: Progress,
                checkpoint: Path | None = None) -> list[transport_fit.TracedView]:
    """The light transport of every view; parameters and errors as of ``solve_views``."""
    traced = []
    for number, view in enumerate(views):
        def part(done: float, what: str, number: int = number) -> None:
            progress((0.7 * number + done) / len(views), what)  # tracing reports up to 0.7
        file = checkpoint and checkpoint.with_stem(f"{checkpoint.stem}{number or ''}")
        region, group = surfaces.block_regions(view.surface, view.used)
        part(0.0, "tracing light")
        transport = trace_view(view, _unit_scene_for(view, settings), region, group,
                               settings.seed + VIEW_SEED_STEP * number, part, file)
        given = nuisances(view, settings)
        if transport.dropped > UNSEEN_LOSS:
            given = replace(given, brightness_error=float(np.hypot(given.brightness_error,
                                                                   transport.dropped)))
        traced.append(transport_fit.TracedView(view, transport, region, group, given))
    return traced


def trace_view(view: PhotoView, unit: UnitScene, region: np.ndarray, group: np.ndarray, seed: int,
               progress: Progress, checkpoint: Path | None = None) -> tracing.TracedTransport:
    """Transport of the regions, traced until its noise is below the photo's.

    A first trace says how noisy ``FIRST_SPP`` paths per pixel are. More follow until the median
    region's Monte Carlo variance is no more than the variance that the fit gives the photo there,
    or ``MAX_SPP`` are drawn.

    Parameters
    ----------
    view : PhotoView
        Whose photo says how little noise is enough.
    unit : UnitScene
        Of the view.
    region : (H, W) int
        Region 0 to R-1 of each pixel, -1 where it is not wanted.
    group : (R,) int
        Surface of each region.
    seed : int
        Of the first trace; the second has the next.
    progress : function of (fraction done, from 0 to 0.7; what is being done)
    checkpoint : Path, optional
        File from which a trace that was stopped goes on.

    Raises
    ------
    InputError
        If no light reaches a material; or as ``trace_transport``.
    """
    first = tracing.trace_transport(unit, region, spp=FIRST_SPP, seed=seed)
    if unlit := unlit_material(view, first, group):
        raise InputError(unlit)
    more = _needed_spp(view, first, region) - first.spp
    progress(0.2, "tracing light")
    if more <= 0:
        return first
    second = tracing.trace_transport(unit, region, spp=more, seed=seed + 1,
                                     exponents=first.exponents,
                                     progress=lambda done: progress(0.2 + 0.5 * done,
                                                                    "tracing light"),
                                     checkpoint=checkpoint)
    return tracing.joined(first, second)


def _needed_spp(view: PhotoView, first: tracing.TracedTransport, region: np.ndarray) -> int:
    """Paths per pixel at which the noise is that of the photo, by a first trace; at most
    ``MAX_SPP``.
    """
    photo = surfaces.region_means(view.variance / np.maximum(view.measured, 1e-12) ** 2,
                                  region).mean(axis=1)
    photo = photo / np.bincount(region[region >= 0])
    return int(min(first.spp * float(np.median(first.relative_variance / photo)), MAX_SPP))


def _image_spp(traced: tracing.TracedTransport, group: np.ndarray) -> int:
    """Paths per pixel of the final renderings, by the noise that a trace has on each surface: light
    that comes by way of a ceiling alone is noisier than any photo, and a surface in such a
    rendering would be taken to disagree with the photo.
    """
    blocks = np.bincount(group)
    of_surface = np.bincount(group, traced.relative_variance)[blocks > 0] / blocks[blocks > 0]**2
    needed = traced.spp * float(np.median(of_surface)) / IMAGE_NOISE**2
    return int(np.clip(needed, IMAGE_SPP, MAX_SPP))


def solve_by_lamps(
    traced: Sequence[transport_fit.TracedView], settings: InversionSettings,
    render: Callable[[transport_fit.TracedView, view_terms.ViewFit], np.ndarray]
) -> tuple[tuple[transport_fit.TracedView, ...], tuple[transport_fit.TransportFit, ...], tuple[
        ViewSolution, ...]]:
    """Spectra that explain the photos of traced views together, and the signals in each by itself
    where the lamp was moved between them.

    What a surface mirrors, and how far a scene is wrong, is another thing under the same lamp in
    another place: signals are kept apart then, for what follows to compare them. Where no lamp was
    moved, or a view's light is known by another view alone, all views tell of one signal.

    Parameters
    ----------
    traced, settings, render
        As of ``solve_traced``.

    Returns
    -------
    traced, solutions
        As of ``solve_traced``, of all views together.
    fits : V of TransportFit
        Of the views under the same lamps as each: one fit where no lamp was moved.
    """
    tied, fit, solutions = solve_traced(traced, settings, render)
    lamps = [view.view.scene_file.lamps for view in traced]
    moved = any(same_response(one.view, other.view) and place != elsewhere
                for one, place in zip(traced, lamps, strict=True)
                for other, elsewhere in zip(traced, lamps, strict=True))
    alone = all(view.view.light_scale is not None or _shows_known(view.view) for view in traced)
    if not (moved and alone):
        return tied, (fit,) * len(traced), solutions
    of_lamps = {place: solve_traced([view for view, own in zip(traced, lamps, strict=True)
                                     if own == place], settings, render)[1]
                for place in dict.fromkeys(lamps)}
    return tied, tuple(of_lamps[place] for place in lamps), solutions


def solve_traced(
    traced: Sequence[transport_fit.TracedView], settings: InversionSettings,
    render: Callable[[transport_fit.TracedView, view_terms.ViewFit], np.ndarray]
) -> tuple[tuple[transport_fit.TracedView, ...], transport_fit.TransportFit, tuple[ViewSolution,
                                                                                   ...]]:
    """Spectra that explain the photos of traced views.

    The first fit's renderings show errors of the scene, and known surfaces the light on it. With
    these stated it is fitted again; twice where surfaces are known, since what they receive from
    others changed with the light.

    Parameters
    ----------
    traced : V of TracedView
    settings : InversionSettings
    render : function of a traced view and its part of the fit
        Independent renderings (A, H, W, K) of the solution for a light scale of 1.

    Returns
    -------
    traced : V of TracedView
        With the errors that the scene showed, and the light that its known surfaces did.
    fit : TransportFit
    solutions : V of ViewSolution
    """
    priors = [transport_fit.spectrum_prior(settings, traced[0].view.grid, material.learnt)
              for material in unknown_materials([view.view for view in traced])]
    fit = transport_fit.fit_traced(traced, priors)
    images = [render(view, part) for view, part in zip(traced, fit.views, strict=True)]
    given = traced
    for _ in range(2 if any(_shows_known(each.view) for each in given) else 1):
        informed = [_informed_by(shown, view, settings)
                    for view, shown in zip(given, images, strict=True)]
        if [view.nuisances for view in informed] != [view.nuisances for view in traced]:
            traced, fit = informed, transport_fit.fit_traced(informed, priors, fit.coefficients)
            images = [render(view, part) for view, part in zip(traced, fit.views, strict=True)]
    return tuple(traced), fit, _solutions(traced, fit, images, settings)


def require_traceable(view: PhotoView, settings: InversionSettings) -> None:
    """Refuse a scene that the transport engine cannot treat.

    Parameters
    ----------
    view : PhotoView
    settings : InversionSettings
        Of which ``light_error`` counts.

    Raises
    ------
    InputError
        If a surface's reflected light is no plain product with its reflectance, or a light has no
        id where each is to be distinguished from the others.
    """
    _require_plain_products(view)


def unit_scene(view: PhotoView, bounces: int, separate_lights: bool = False) -> UnitScene:
    """The view's scene for the tracer, with reflectances and light spectra of 1.

    Parameters
    ----------
    view : PhotoView
    bounces : int
        Most reflections along a path.
    separate_lights : bool
        Each of ``view.light_groups`` gets its own coefficients.

    Raises
    ------
    InputError
        If a surface's reflected light is no plain product with its reflectance.
    """
    _require_plain_products(view)
    ones = np.ones(2)
    scene = load_scene(view.xml(dict.fromkeys(view.name_of_bsdf, ones), light=view.unit_lights,
                                bands={"one": ones}))
    return UnitScene(scene, view.name_of_bsdf, view.size, bounces,
                     view.light_groups if separate_lights else None, view.scene_file.profiles,
                     view.beam)


def nuisances(view: PhotoView, settings: InversionSettings) -> view_terms.Nuisances:
    """What the settings take as known of one view besides its pixels.

    Parameters
    ----------
    view : PhotoView
        Of which the light scale counts unless known surfaces are to tell it, and whether it has
        several lights.
    settings : InversionSettings
        Of which the errors count.
    """
    scale = None if _shows_known(view) else view.light_scale
    return view_terms.Nuisances(None if scale is None else scale.value,
                                0.0 if scale is None else view.level_error, settings.surface_error,
                                settings.brightness_error,
                                settings.light_error if len(view.light_groups) > 1 else 0.0,
                                settings.mixing_error, settings.block_error)


def require_lit(views: Sequence[PhotoView],
                settings: InversionSettings) -> tuple[int, float]:
    """Refuse views that show a material which no light reaches, by the first, short trace of each.

    A material that one of a few paths connects to a light is illuminated; only for others all are
    followed.

    Parameters
    ----------
    views : sequence of PhotoView
    settings : InversionSettings

    Returns
    -------
    int
        Bytes that tracing, fit and rendering of all views will take, besides the program.
    float
        Seconds of processor that they will take, by those of short traces.

    Raises
    ------
    InputError
        Naming the material; or as ``trace_transport``.
    """
    kept, image, seconds = 0, 0, 0.0
    for number, view in enumerate(views):
        region, group = surfaces.block_regions(view.surface, view.used)
        unit, seed = _unit_scene_for(view, settings), settings.seed + VIEW_SEED_STEP * number
        begun = time.process_time()
        few = tracing.trace_transport(unit, region, spp=FEW_SPP, seed=seed)
        compiled = time.process_time()
        tracing.trace_transport(unit, region, spp=FEW_SPP, seed=seed + 1, exponents=few.exponents)
        started = time.process_time()
        more = tracing.trace_transport(unit, region, spp=MORE_SPP, seed=seed + 2,
                                       exponents=few.exponents)
        # what a trace takes besides its paths is taken off
        each = max(time.process_time() - 2 * started + compiled, 0.0) / (MORE_SPP - FEW_SPP)
        paths = max(_needed_spp(view, more, region), FIRST_SPP) + _image_spp(more, group)
        seconds += compiled - begun + each * paths
        seconds += _seconds_of_fit(view, few, region, group, settings)
        if unlit_material(view, few, group):
            first = tracing.trace_transport(unit, region, spp=FIRST_SPP, seed=seed)
            if unlit := unlit_material(view, first, group):
                raise InputError(unlit)
        passes, regions, groups, products = few.passes.shape
        kept += tracing.memory_of(regions, groups * products, passes)
        image = max(image, tracing.memory_of_image(region.size, groups * products))
    return kept + image, seconds


def _seconds_of_fit(view: PhotoView, traced: tracing.TracedTransport, region: np.ndarray,
                    group: np.ndarray, settings: InversionSettings) -> float:
    """Seconds of processor of the fits of one view, by one expansion of its cost."""
    terms = transport_fit.TracedView(view, traced, region, group, nuisances(view, settings))
    begun = time.process_time()
    system = terms.terms(settings.coefficients)
    compressed = time.process_time()
    system.expand(np.full(system.size, 0.1))
    return 2 * (compressed - begun) + STEPS_FORESEEN * (time.process_time() - compressed)


def unlit_material(view: PhotoView, traced: tracing.TracedTransport,
                   group: np.ndarray) -> str | None:
    """A sentence about the first material that the camera sees but no path connects to a light.

    Parameters
    ----------
    view : PhotoView
    traced : TracedTransport
        Of R regions.
    group : (R,) int
        Surface of each region.
    """
    received = traced.coefficients.sum(axis=1)
    bsdfs = list(view.scene_file.surfaces.values())
    for material in view.scene_materials:
        own = np.isin(group, [index for index, bsdf in enumerate(bsdfs) if bsdf == material.bsdf])
        if own.any() and not received[own].any():
            return (f"no light reaches material {material.name!r} in "
                    f"{view.scene_file.path.name}, although the photo shows it lit: check the "
                    "light's position and the direction its surfaces face")
    return None


def renderings_of(traced: transport_fit.TracedView, settings: InversionSettings
                  ) -> Callable[[np.ndarray], np.ndarray]:
    """The view's renderings for a light scale of 1 as a function of the signals of its products.

    Parameters
    ----------
    traced : TracedView
    settings : InversionSettings
        Of which the engine and the seed count.

    Returns
    -------
    function of signals (L E, K), which gives images (A, H, W, K)
    """
    view, transport = traced.view, traced.traced
    unit = unit_scene(view, _bounces(view, settings), transport.passes.shape[2] > 1)
    return tracing.images_of_signals(unit, transport.exponents,
                                     spp=_image_spp(transport, traced.group),
                                     seed=settings.seed + 7919, passes=IMAGES)


def _informed_by(images: np.ndarray, traced: transport_fit.TracedView,
                 settings: InversionSettings) -> transport_fit.TracedView:
    """The view with what renderings (A, H, W, K) for a light scale of 1 show: the light on known
    surfaces, errors of the scene.
    """
    view, given, light = traced.view, traced.nuisances, traced.known_light
    if _shows_known(view):
        rendered = images.mean(axis=0)
        view, light = tie_to_known(view, rendered, None)
        view, light = tie_to_known(traced.view, rendered, _errors_of(images, view, traced))
        assert view.light_scale is not None
        given = replace(given, scale=view.light_scale.value)
    errors = _errors_of(images, view, traced) if settings.errors_from_scene else None
    if errors is not None:
        given = replace(given, surface_error=max(given.surface_error, errors.colour),
                        block_error=max(given.block_error, errors.block),
                        brightness_error=max(given.brightness_error, errors.brightness))
    return replace(traced, view=view, nuisances=given, known_light=light)


def _errors_of(images: np.ndarray, view: PhotoView,
               traced: transport_fit.TracedView) -> SceneErrors | None:
    """By which surfaces of one material disagree under the light of a view."""
    scale = 1.0 if view.light_scale is None else view.light_scale.value
    agreement = surface_agreement(tuple(view.scene_file.surfaces), view.surface_materials,
                                  view.photo, images * scale, view.surface, view.used)
    return scene_errors(agreement, frozenset(view.known), len(traced.group))


def _shows_known(view: PhotoView) -> bool:
    """Whether pixels of a view show a surface of known spectrum."""
    return bool((view.known_surface >= 0).any())


def _solutions(traced: Sequence[transport_fit.TracedView], fit: transport_fit.TransportFit,
               images: Sequence[np.ndarray],
               settings: InversionSettings) -> tuple[ViewSolution, ...]:
    """The fit's solution for each view."""
    unknown = unknown_materials([view.view for view in traced])
    bsdfs = [material.bsdf for material in unknown]
    operators = [relative_operator(view.view.response, view.view.basis(settings.coefficients))
                 for view in traced]
    determined = transport_fit.determined([material.name for material in unknown],
                                          transport_fit.identifiability(fit), np.vstack(operators))
    ill_posed = fit.outcome is Outcome.CONVERGED and any(one.values["by_prior"]
                                                         for one in determined)
    name = ("single bounce (direct light only)" if settings.engine == "single-bounce"
            else "light transport traced once")
    # what scales that were estimated have in common, the level of the first, is stated with it
    level = next((part.scale_error / part.scale
                  for view, part in zip(traced, fit.views, strict=True)
                  if part.scale_error is not None and view.nuisances.scale is not None), 0.0)
    solutions = []
    for view, image, operator, part in zip(traced, images, operators, fit.views, strict=True):
        own = [bsdfs.index(material.bsdf) for material in view.view.unknown]
        signals, covariance = transport_fit.band_signals(fit, operator, len(bsdfs))
        lights = [light for light, in view.view.light_groups]
        solutions.append(ViewSolution(
            fit.coefficients[own], signals[own], covariance[own], image, fit.cost_history,
            f"{name} ({_bounces(view.view, settings)} bounces, {len(view.traced.exponents)} "
            "products)", view.traced.spp, Outcome.ILL_POSED if ill_posed else fit.outcome,
            determined + part.findings(view.view.bands, lights),
            (part.scale, None if part.scale_error is None else float(np.sqrt(max(
                part.scale_error**2 - (level * part.scale) ** 2, 0.0)))),
            view.regions(part), view.known_light))
    return tuple(solutions)


def _unit_scene_for(view: PhotoView, settings: InversionSettings) -> UnitScene:
    """The scene for the tracer with the bounces and light groups that the settings ask for."""
    return unit_scene(view, _bounces(view, settings), _separates_lights(view, settings))


def _bounces(view: PhotoView, settings: InversionSettings) -> int:
    return 1 if settings.engine == "single-bounce" else view.scene_file.max_depth - 1


def _separates_lights(view: PhotoView, settings: InversionSettings) -> bool:
    return len(view.light_groups) > 1 and (settings.light_error > 0 or bool(view.own_lights))


def _require_plain_products(view: PhotoView) -> None:
    if others := scene_file.needs_descent(view.scene_file):
        raise InputError("the transport engine treats diffuse surfaces and plain metals only, and "
                         f"{', '.join(others)} of {view.scene_file.path.name} is coated or "
                         "glossy: its spectrum does not just multiply; set [reconstruct] engine = "
                         "\"gradient\"")
