"""From photos, scenes and calibrations to the spectra of their materials."""
from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from spectrabox.radiometry import error_model
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.interreflection import white_signal
from spectrabox.radiometry.records import calibration, scenes, spectra
from spectrabox.reconstruct import agreement as view_agreement
from spectrabox.reconstruct import misfit
from spectrabox.reconstruct import view as photo_views
from spectrabox.reconstruct.fit.transport_fit import TransportFit, band_signals
from spectrabox.reconstruct.gradient_engine import invert_by_gradient, seconds_of_descent
from spectrabox.reconstruct.linearity import linearity
from spectrabox.reconstruct.scene.scene_file import needs_descent
from spectrabox.reconstruct.settings import ENGINES, InversionSettings
from spectrabox.reconstruct.transport_engine import require_lit, require_traceable, solve_views

# of white: error given to every stacked signal, so that bands which repeat others stay regular
REDUNDANT = 1e-4
# engines that take one photo; the others trace the light, and take several
SINGLE_VIEW: dict[str, Callable[[photo_views.PhotoView, InversionSettings,
                                 spectra.Progress], photo_views.ViewSolution]] = {
                                     "gradient": invert_by_gradient}


def reconstruct(view: photo_views.PhotoView, settings: InversionSettings,
                progress: spectra.Progress) -> scenes.Reconstruction:
    """Spectra that explain one photo.

    Parameters
    ----------
    view : PhotoView
    settings : InversionSettings
    progress : function of (fraction done, what is being done)

    Raises
    ------
    InputError
        As ``reconstruct_views``.
    """
    return reconstruct_views((view,), settings, progress).views[0]


def settings_for(views: Sequence[photo_views.PhotoView],
                 settings: InversionSettings) -> tuple[InversionSettings, tuple[Finding, ...]]:
    """The settings with the engine that the views' materials need; nothing is traced.

    Parameters
    ----------
    views : V of PhotoView
    settings : InversionSettings

    Returns
    -------
    settings : InversionSettings
    findings : tuple of Finding
        Where the engine is not the default.

    Raises
    ------
    InputError
        As ``reconstruct_views``.
    """
    if settings.engine not in ENGINES:
        raise InputError(f"there is no engine {settings.engine!r}; use one of {', '.join(ENGINES)}")
    chosen: tuple[Finding, ...] = ()
    if settings.engine == "auto":
        glossy = dict.fromkeys(name for view in views
                               for name in needs_descent(view.scene_file))
        if glossy:
            chosen = (Finding("fit.gradient-engine", Severity.INFO,
                              values={"names": list(glossy)}),)
        settings = replace(settings, engine="gradient" if glossy else "transport")
    if len(views) > 1 and settings.engine in SINGLE_VIEW:
        raise InputError(f"the engine {settings.engine!r} takes one photo, and {len(views)} are "
                         "given; set [reconstruct] engine = \"transport\", or leave photos out")
    if settings.engine not in SINGLE_VIEW:
        for view in views:
            require_traceable(view, settings)
    photo_views.check_views(views)
    return settings, chosen


def forecast(views: Sequence[photo_views.PhotoView],
             settings: InversionSettings) -> tuple[str, float, int | None]:
    """What ``reconstruct_views`` will take, by what a first, short piece of it took: all that it
    uses is built, and one step of it is done.

    Parameters
    ----------
    views : V of PhotoView
    settings : InversionSettings

    Returns
    -------
    engine : str
        That the materials need.
    seconds : float
        Of processor on this machine; of a descent at most.
    tracing_bytes : int or None
        Besides the program; None where no light is traced.

    Raises
    ------
    InputError
        As ``reconstruct_views``.
    """
    settings, _ = settings_for(views, settings)
    if settings.engine in SINGLE_VIEW:
        return settings.engine, seconds_of_descent(views[0], settings), None
    tracing_bytes, seconds = require_lit(views, settings)
    return settings.engine, seconds, tracing_bytes


def reconstruct_views(views: Sequence[photo_views.PhotoView], settings: InversionSettings,
                      progress: spectra.Progress,
                      checkpoint: Path | None = None) -> scenes.JointReconstruction:
    """Spectra that explain several photos together: other lights, exposures, viewpoints, cameras.

    Materials are the same wherever the scenes give a surface the same BSDF id. Each view is traced
    on its own; all enter one least-squares fit, each with its own light scale and nuisances.

    Parameters
    ----------
    views : sequence of PhotoView
    settings : InversionSettings
    progress : function of (fraction done, what is being done)
    checkpoint : Path, optional
        File from which a trace that was stopped goes on.

    Raises
    ------
    InputError
        If photo and scene of a view cannot be compared (see ``check_views``), the engine is
        unknown, the transport engine encounters a material that it cannot treat, or an engine that
        takes one photo is given several.
    """
    settings, chosen = settings_for(views, settings)
    solutions: tuple[photo_views.ViewSolution, ...]
    if settings.engine in SINGLE_VIEW:
        fits: tuple[TransportFit | None, ...] = (None,)
        solutions = (SINGLE_VIEW[settings.engine](views[0], settings, progress),)
    else:
        views, fits, solutions = solve_views(views, settings, progress, checkpoint)
    solutions = tuple(replace(solution, findings=chosen + solution.findings)
                      for solution in solutions)
    return reconstruction_of(views, fits, solutions, settings)


def reconstruction_of(views: Sequence[photo_views.PhotoView], fits: Sequence[TransportFit | None],
                      solutions: Sequence[photo_views.ViewSolution],
                      settings: InversionSettings) -> scenes.JointReconstruction:
    """The record of a fit and its solutions, one for each view.

    Parameters
    ----------
    views : V of PhotoView
    fits : V of TransportFit or None
        That tells the signals in each view; None from an engine that takes a single view.
    solutions : V of ViewSolution
    settings : InversionSettings
        Of which the errors of surfaces, the number of coefficients and the seed count.
    """
    records = [_record(view, solution, settings)
               for view, solution in zip(views, solutions, strict=True)]
    return joint_record(views, records, fits, [solution.regions for solution in solutions])


def joint_record(views: Sequence[photo_views.PhotoView], records: Sequence[scenes.Reconstruction],
                 fits: Sequence[TransportFit | None],
                 regions: Sequence[scenes.RegionTransport | None]) -> scenes.JointReconstruction:
    """Several photos of the same materials as one record, the bands of all of them stacked.

    Parameters
    ----------
    views, records : V each
    fits : V of TransportFit or None
        That tells the signals in each view, by which views of the same bands are told apart. None
        from an engine that takes a single view: its signals are taken as they are.
    regions : of each view
        Left out where a view has none.
    """
    responses = [view.response / white_signal(view.response)[:, None] for view in views]

    def alike(number: int) -> list[int]:
        """Views of the same bands in the same fit."""
        return [other for other, view in enumerate(views)
                if fits[other] is fits[number] and photo_views.same_response(view, views[number])]
    distinct = [number for number in range(len(views)) if alike(number)[0] == number]
    materials = tuple(dict.fromkeys(name for record in records for name in record.materials))
    shown = {name: (record, index) for record in reversed(records)
             for index, name in enumerate(record.materials)}
    first_shown = [shown[name] for name in materials]
    spectra = np.array([record.spectra[index] for record, index in first_shown])
    known = tuple(record.known[index] for record, index in first_shown)
    response = np.vstack([responses[number] for number in distinct])
    view_of_band = np.repeat(distinct, [len(views[number].bands) for number in distinct])
    signal = spectra @ response.T
    covariance = np.zeros((len(materials), len(response), len(response)))
    for fit in {id(each): each for each in fits}.values():
        if fit is None:
            signal, covariance = np.array(records[0].signal), np.array(records[0].signal_covariance)
            continue
        own = [number for number, each in enumerate(fits) if each is fit]
        told = photo_views.unknown_materials([views[number] for number in own])
        bands = np.flatnonzero(np.isin(view_of_band, own))
        unknown = np.array([materials.index(material.name) for material in told])
        operator = response[bands] @ views[0].basis(fit.coefficients.shape[1])
        unseen = np.setdiff1d(np.flatnonzero(np.logical_not(known)), unknown)
        signal[np.ix_(unseen, bands)] = np.nan
        signal[np.ix_(unknown, bands)], covariance[np.ix_(unknown, bands, bands)] = band_signals(
            fit, operator, len(unknown))
    model = np.zeros_like(covariance)
    for number in distinct:
        bands = np.flatnonzero(view_of_band == number)
        same = [records[other] for other in alike(number)]
        for index, name in enumerate(materials):
            parts = [record.model_covariance[record.materials.index(name)] for record in same
                     if name in record.materials]
            # the mean, not divided by their number: the errors of one model are correlated
            if parts:
                model[index][np.ix_(bands, bands)] = np.mean(parts, axis=0)
    if len(views) > 1:
        covariance = covariance + REDUNDANT**2 * np.eye(len(response))
    return scenes.JointReconstruction(
        tuple(records), tuple(view.name for view in views), materials, known, views[0].grid,
        spectra, tuple(f"{views[number].name}: {band}" for number in distinct
                       for band in views[number].bands),
        view_of_band, response, signal, covariance, model,
        tuple(region for region in regions if region is not None),
        lamps=tuple(view.lamp_in_place for view in views))


def _on_scene(linear: Finding | None, others: tuple[Finding, ...]) -> tuple[Finding, ...]:
    """Whether the photo is linear, once, and what else was found of the scene."""
    curve = [one for one in others if one.code == "scene.not-linear"]
    if not curve or (linear is not None and linear.severity is Severity.FAIL):
        rest = [one for one in others if one.code != "scene.not-linear"]
        return (*filter(None, [linear]), *rest)
    return others


def _record(view: photo_views.PhotoView, solution: photo_views.ViewSolution,
            settings: InversionSettings) -> scenes.Reconstruction:
    """The solution with all that a later stage or a reader needs."""
    # the given scale; or that of the known materials; or that of the fit
    if (scale := view.light_scale) is not None and view.level_error > 0:
        scale = error_model.with_common_error(
            calibration.LightScale(solution.scale[0], 0.0, None, scale.source),
            error_model.LEVEL_BY_PRIOR, view.level_error)
    elif scale is None:
        known_surface = view.known_surface
        if (known_surface >= 0).any():
            scale = view_agreement.scale_from_surfaces(view.measured,
                                                       solution.renderings.mean(
                                                           axis=0), known_surface,
                                                       f"known material {', '.join(view.known)}")
        else:
            scale = error_model.with_common_error(
                calibration.LightScale(*solution.scale, None,
                                       "materials in common with the other photos"),
                error_model.LEVEL_BY_PRIOR, view.level_error)
    renderings = solution.renderings * scale.value
    rendered = renderings.mean(axis=0)
    names = tuple(view.scene_file.surfaces)
    materials = view.surface_materials
    agreement = view_agreement.surface_agreement(names, materials, view.photo, renderings,
                                                 view.surface, view.used)
    stated_error = float(np.hypot(settings.surface_error, settings.brightness_error))
    labels = [f"{material} / {name}" for name, material in zip(names, materials, strict=True)]
    numbers = [agreement.names.index(label) if label in agreement.names else -1 for label in labels]
    misfits = misfit.surface_misfits(
        labels, view.bands, view.measured, rendered,
        [view.used & (view.surface == index) for index in range(len(labels))], stated_error)
    spectra = view.spectra(solution.coefficients)
    basis = view.basis(settings.coefficients)
    white = white_signal(view.response)
    signal = spectra @ (view.response / white[:, None]).T
    unknown = [material.reflectance is None for material in view.scene_materials]
    covariance = np.zeros((len(unknown), len(white), len(white)))
    coefficients = np.full((len(unknown), settings.coefficients), np.nan)
    rendered_signal = signal.copy()
    signal[unknown], covariance[unknown] = solution.signals, solution.signal_covariance
    coefficients[unknown] = solution.coefficients
    known = frozenset(view.known)
    taken = np.maximum(signal, REDUNDANT) / np.maximum(rendered_signal, REDUNDANT)
    return scenes.Reconstruction(
        materials=tuple(material.name for material in view.scene_materials),
        known=tuple(not is_unknown for is_unknown in unknown), grid=view.grid, basis=basis,
        coefficients=coefficients, spectra=spectra, white_signal=white, signal=signal,
        signal_covariance=covariance,
        model_covariance=np.array([
            view_agreement.model_covariance(agreement, material.name, known, stated_error, factor)
            + solution.scene_covariance.get(material.name, 0.0)
            for material, factor in zip(view.scene_materials, taken, strict=True)]),
        measured=view.measured, rendered=rendered, used=view.used,
        surface=np.array([*numbers, -1])[view.surface],     # -1, no surface, is the last
        agreement=agreement, light_scale=scale, loss_history=solution.loss_history,
        engine=solution.engine, spp=solution.spp, seed=settings.seed, outcome=solution.outcome,
        findings=(*_on_scene(linearity(view, rendered), solution.findings),
                  *view_agreement.shifted(view.measured, rendered)),
        misfits=misfits, known_light=solution.known_light)
