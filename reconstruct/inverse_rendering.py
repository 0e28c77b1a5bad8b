"""From photos, scenes and calibrations to the spectra of their materials."""
from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.progress import Progress
from spectrabox.radiometry.records import (
    Calibration,
    JointReconstruction,
    LightScale,
    LinearImage,
    Reconstruction,
)
from spectrabox.radiometry.response import white_signal
from spectrabox.reconstruct.agreement import (
    model_covariance,
    scale_from_surfaces,
    shift_sentence,
    surface_agreement,
)
from spectrabox.reconstruct.engines.gradient_engine import engine_for, invert_by_gradient
from spectrabox.reconstruct.engines.per_wavelength import invert_per_wavelength
from spectrabox.reconstruct.engines.transport_engine import solve_views
from spectrabox.reconstruct.joint_reconstruction import engine_answers, joint_record
from spectrabox.reconstruct.misfit import misfit_notes, surface_tests
from spectrabox.reconstruct.problem import (
    EngineAnswer,
    InverseProblem,
    MaterialSpec,
    View,
    inverse_problems,
)
from spectrabox.reconstruct.scene.scene_file import SceneFile
from spectrabox.reconstruct.settings import ENGINES, InversionSettings

ONE_PHOTO: dict[str, Callable[[InverseProblem, InversionSettings, Progress], EngineAnswer]] = {
    "gradient": invert_by_gradient, "per-wavelength": invert_per_wavelength}


def reconstruct(scene_file: SceneFile, photo: LinearImage, calibration: Calibration,
                light_scale: LightScale | None, materials: tuple[MaterialSpec, ...],
                bands: tuple[str, ...], settings: InversionSettings,
                progress: Progress) -> Reconstruction:
    """Find the spectra that explain one photo.

    Parameters
    ----------
    photo : LinearImage
        At the render's size, (H, W, K).
    light_scale : LightScale or None
        For this photo's exposure; None to find it from the materials whose reflectance is known.
    materials : tuple of MaterialSpec
        One for every BSDF that a surface wears.
    bands : tuple of str
        K names.
    settings : InversionSettings
        ``engine`` is one of ``ENGINES``.

    Raises
    ------
    InputError
        If photo and scene cannot be compared (see ``inverse_problems``), the engine is unknown, or
        the transport engine meets a material that it cannot treat.
    """
    view = View("photo", scene_file, photo, calibration, bands, light_scale)
    return reconstruct_views((view,), materials, settings, progress).views[0]


def reconstruct_views(views: Sequence[View], materials: tuple[MaterialSpec, ...],
                      settings: InversionSettings, progress: Progress,
                      checkpoint: Path | None = None) -> JointReconstruction:
    """Find the spectra that explain several photos together: other lights, exposures, viewpoints,
    cameras.

    Materials are the same wherever the scenes give a surface the same BSDF id. Each view is traced
    on its own; all enter one least-squares fit, each with its own light scale and nuisances. A
    trace that was stopped goes on from the file ``checkpoint``.

    Raises
    ------
    InputError
        As ``reconstruct``; or if an engine that takes one photo is given several.
    """
    if settings.engine not in ENGINES:
        raise InputError(f"there is no engine {settings.engine!r}; use one of {', '.join(ENGINES)}")
    chosen: tuple[str, ...] = ()
    if settings.engine == "auto":
        engine, chosen = engine_for([view.scene_file for view in views])
        settings = replace(settings, engine=engine)
    if len(views) > 1 and settings.engine in ONE_PHOTO:
        raise InputError(f"the engine {settings.engine!r} takes one photo, and {len(views)} are "
                         "given; set [reconstruct] engine = \"transport\", or leave photos out")
    if len({view.calibration.sensitivity.grid.nm.tobytes() for view in views}) > 1:
        raise InputError("the calibrations of the views are on different wavelengths: use one grid "
                         "for all")
    problems = inverse_problems(views, materials, settings.coefficients)
    if settings.engine in ONE_PHOTO:
        record = _record(problems[0], ONE_PHOTO[settings.engine](problems[0], settings, progress),
                         settings)
        return joint_record(problems, [replace(record, notes=chosen + record.notes)], None)
    answer = solve_views(problems, settings, progress, checkpoint)
    records = [_record(problem, one, settings)
               for problem, one in zip(problems, engine_answers(problems, answer), strict=True)]
    return joint_record(problems, records, answer.fit, answer.regions)


def _record(problem: InverseProblem, answer: EngineAnswer,
            settings: InversionSettings) -> Reconstruction:
    """The answer with all that a later stage or a reader needs."""
    scale = problem.light_scale
    given = [material.name for material in problem.materials if material.reflectance is not None]
    if scale is None and (problem.known_surface >= 0).any():
        scale = scale_from_surfaces(problem.measured, answer.rendered, problem.known_surface,
                                    f"known material {', '.join(given)}")
    if scale is None:
        scale = LightScale(answer.scale[0], answer.scale[1], None,
                           "materials in common with the other photos")
    name_of = {material.bsdf: material.name for material in problem.materials}
    rendered = answer.rendered * scale.value
    worn = tuple(name_of[bsdf] for bsdf in problem.scene_file.surfaces.values())
    shown = (problem.measured, rendered, problem.surface, problem.used)
    agreement = surface_agreement(tuple(problem.scene_file.surfaces), worn, *shown)
    tests = surface_tests([f"{name} / {shape}" for name, shape in zip(worn,
                                                                      problem.scene_file.surfaces,
                                                                      strict=True)], *shown,
                          float(np.hypot(settings.surface_error, settings.brightness_error)))
    shift = shift_sentence(problem.measured, rendered)
    spectra = problem.spectra(answer.coefficients)
    white = white_signal(problem.response)
    signal = spectra @ (problem.response / white[:, None]).T
    bands, count = len(white), problem.basis.shape[1]
    covariance = np.zeros((len(problem.materials), bands, bands))
    coefficients = np.full((len(problem.materials), count), np.nan)
    found = [material.reflectance is None for material in problem.materials]
    signal[found], covariance[found] = answer.signals, answer.signal_covariance
    coefficients[found] = answer.coefficients
    return Reconstruction(
        materials=tuple(material.name for material in problem.materials),
        known=tuple(not unknown for unknown in found), grid=problem.grid, basis=problem.basis,
        coefficients=coefficients, spectra=spectra, white_signal=white, signal=signal,
        signal_covariance=covariance,
        model_covariance=np.array([model_covariance(agreement, material.name, frozenset(given))
                                   for material in problem.materials]),
        measured=problem.measured, rendered=rendered, used=problem.used, surface=problem.surface,
        agreement=agreement, light_scale=scale, loss_history=answer.loss_history,
        engine=answer.engine, spp=answer.spp, seed=settings.seed, outcome=answer.outcome,
        notes=(*answer.notes, *misfit_notes(tests, problem.bands), *([shift] if shift else [])))
