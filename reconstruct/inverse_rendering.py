"""From photos, scenes and calibrations to the spectra of their materials."""
from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.progress import Progress
from spectrabox.radiometry.records import JointReconstruction, LightScale, Reconstruction
from spectrabox.radiometry.response import white_signal
from spectrabox.reconstruct.agreement import (
    model_covariance,
    scale_from_surfaces,
    shift_sentence,
    surface_agreement,
)
from spectrabox.reconstruct.engines.answer import EngineAnswer
from spectrabox.reconstruct.engines.gradient import invert_by_gradient
from spectrabox.reconstruct.engines.transport_engine import (
    require_named_lights,
    require_plain_products,
    solve_views,
)
from spectrabox.reconstruct.fit.transport_fit import TransportFit
from spectrabox.reconstruct.joint_reconstruction import joint_record
from spectrabox.reconstruct.misfit import surface_misfits, surface_tests
from spectrabox.reconstruct.scene.scene_file import not_plain_products
from spectrabox.reconstruct.settings import ENGINES, InversionSettings
from spectrabox.reconstruct.view import View
from spectrabox.reconstruct.view_checks import check_views

# engines that take one photo; the others trace the light, and take several
SINGLE_VIEW: dict[str, Callable[[View, InversionSettings, Progress], EngineAnswer]] = {
    "gradient": invert_by_gradient}


def reconstruct(view: View, settings: InversionSettings, progress: Progress) -> Reconstruction:
    """Spectra that explain one photo.

    Parameters
    ----------
    view : View
    settings : InversionSettings
    progress : function of (fraction done, what is being done)

    Raises
    ------
    InputError
        As ``reconstruct_views``.
    """
    return reconstruct_views((view,), settings, progress).views[0]


def settings_for(views: Sequence[View],
                 settings: InversionSettings) -> tuple[InversionSettings, tuple[str, ...]]:
    """The settings with the engine that the views' materials need, and a sentence where that is not
    the default; nothing is traced.

    Raises
    ------
    InputError
        As ``reconstruct_views``.
    """
    if settings.engine not in ENGINES:
        raise InputError(f"there is no engine {settings.engine!r}; use one of {', '.join(ENGINES)}")
    chosen: tuple[str, ...] = ()
    if settings.engine == "auto":
        glossy = dict.fromkeys(name for view in views
                               for name in not_plain_products(view.scene_file))
        if glossy:
            chosen = (f"The gradient engine was chosen, since {', '.join(glossy)} is coated or "
                      "glossy: its light is no plain product of reflectances, as the transport "
                      "engine needs.",)
        settings = replace(settings, engine="gradient" if glossy else "transport")
    if len(views) > 1 and settings.engine in SINGLE_VIEW:
        raise InputError(f"the engine {settings.engine!r} takes one photo, and {len(views)} are "
                         "given; set [reconstruct] engine = \"transport\", or leave photos out")
    if settings.engine not in SINGLE_VIEW:
        for view in views:
            require_plain_products(view)
            require_named_lights(view, settings)
    check_views(views)
    return settings, chosen


def reconstruct_views(views: Sequence[View], settings: InversionSettings, progress: Progress,
                      checkpoint: Path | None = None) -> JointReconstruction:
    """Spectra that explain several photos together: other lights, exposures, viewpoints, cameras.

    Materials are the same wherever the scenes give a surface the same BSDF id. Each view is traced
    on its own; all enter one least-squares fit, each with its own light scale and nuisances.

    Parameters
    ----------
    views : sequence of View
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
    answers: tuple[EngineAnswer, ...]
    if settings.engine in SINGLE_VIEW:
        fit, answers = None, (SINGLE_VIEW[settings.engine](views[0], settings, progress),)
    else:
        fit, answers = solve_views(views, settings, progress, checkpoint)
    answers = tuple(replace(answer, notes=chosen + answer.notes) for answer in answers)
    return reconstruction_of(views, fit, answers, settings)


def reconstruction_of(views: Sequence[View], fit: TransportFit | None,
                      answers: Sequence[EngineAnswer],
                      settings: InversionSettings) -> JointReconstruction:
    """The record of a fit and its answers, one for each view.

    Parameters
    ----------
    views : V of View
    fit : TransportFit or None
        None from an engine that takes a single view.
    answers : V of EngineAnswer
    settings : InversionSettings
        Of which the errors of surfaces, the number of coefficients and the seed count.
    """
    records = [_record(view, answer, settings)
               for view, answer in zip(views, answers, strict=True)]
    return joint_record(views, records, fit, [answer.regions for answer in answers])


def _record(view: View, answer: EngineAnswer, settings: InversionSettings) -> Reconstruction:
    """The answer with all that a later stage or a reader needs."""
    scale = _light_scale(view, answer)
    renderings = answer.renderings * scale.value
    rendered = renderings.mean(axis=0)
    names, materials = tuple(view.scene_file.surfaces), view.surface_materials
    agreement = surface_agreement(names, materials, view.photo, renderings, view.surface, view.used)
    stated_error = float(np.hypot(settings.surface_error, settings.brightness_error))
    labels = [f"{material} / {name}" for name, material in zip(names, materials, strict=True)]
    tests = surface_tests(labels, view.measured, rendered, view.surface, view.used, stated_error)
    misfits = surface_misfits(tests, view.bands)
    shift = shift_sentence(view.measured, rendered)
    spectra, basis = view.spectra(answer.coefficients), view.basis(settings.coefficients)
    white = white_signal(view.response)
    signal = spectra @ (view.response / white[:, None]).T
    unknown = [material.reflectance is None for material in view.scene_materials]
    covariance = np.zeros((len(unknown), len(white), len(white)))
    coefficients = np.full((len(unknown), settings.coefficients), np.nan)
    signal[unknown], covariance[unknown] = answer.signals, answer.signal_covariance
    coefficients[unknown] = answer.coefficients
    known = frozenset(view.known)
    return Reconstruction(
        materials=tuple(material.name for material in view.scene_materials),
        known=tuple(not is_unknown for is_unknown in unknown), grid=view.grid, basis=basis,
        coefficients=coefficients, spectra=spectra, white_signal=white, signal=signal,
        signal_covariance=covariance,
        model_covariance=np.array([model_covariance(agreement, material.name, known, stated_error)
                                   for material in view.scene_materials]),
        measured=view.measured, rendered=rendered, used=view.used,
        surface=_numbered(view.surface, labels, agreement.names),
        agreement=agreement, light_scale=scale, loss_history=answer.loss_history,
        engine=answer.engine, spp=answer.spp, seed=settings.seed, outcome=answer.outcome,
        notes=(*answer.notes, *(misfit.sentence for misfit in misfits),
               *([shift] if shift else [])),
        misfits=misfits)


def _numbered(surface: np.ndarray, labels: Sequence[str], compared: Sequence[str]) -> np.ndarray:
    """Index (H, W) into the compared surfaces, -1 where another or none fills the pixel."""
    numbers = [compared.index(label) if label in compared else -1 for label in labels]
    return np.array([*numbers, -1])[surface]  # -1, no surface, is the last


def _light_scale(view: View, answer: EngineAnswer) -> LightScale:
    """The given scale; or that of the known materials; or that of the fit."""
    if view.light_scale is not None:
        return view.light_scale
    known_surface = view.known_surface
    if (known_surface >= 0).any():
        return scale_from_surfaces(view.measured, answer.renderings.mean(axis=0), known_surface,
                                   f"known material {', '.join(view.known)}")
    return LightScale(answer.scale[0], answer.scale[1], None,
                      "materials in common with the other photos")
