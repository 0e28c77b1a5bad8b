"""From a photo, a scene and a calibration to the spectra of its materials."""
from __future__ import annotations

from collections.abc import Callable

import numpy as np

from radiometry.errors import InputError
from radiometry.records import Calibration, LightScale, LinearImage, Reconstruction
from radiometry.response import white_signal
from reconstruct.agreement import model_covariance, scale_from_surfaces, surface_agreement
from reconstruct.gradient_engine import invert_by_gradient
from reconstruct.inverse_problem import EngineAnswer, InverseProblem, InversionSettings, MaterialSpec, inverse_problem
from reconstruct.per_wavelength import invert_per_wavelength
from reconstruct.scene_file import SceneFile
from reconstruct.transport_engine import invert_by_single_bounce, invert_by_transport

__all__ = ["ENGINES", "InversionSettings", "MaterialSpec", "reconstruct"]

ENGINES: dict[str, Callable[[InverseProblem, InversionSettings, Callable[[float, str], None]], EngineAnswer]] = {
    "transport": invert_by_transport, "gradient": invert_by_gradient, "per-wavelength": invert_per_wavelength,
    "single-bounce": invert_by_single_bounce}


def reconstruct(scene_file: SceneFile, photo: LinearImage, calibration: Calibration, light_scale: LightScale | None,
                materials: tuple[MaterialSpec, ...], bands: tuple[str, ...], settings: InversionSettings,
                progress: Callable[[float, str], None]) -> Reconstruction:
    """Find the spectra that explain the photo.

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
        If photo and scene cannot be compared (see ``inverse_problem``), the engine is unknown, or the transport engine
        meets a material that it cannot treat.
    """
    if settings.engine not in ENGINES:
        raise InputError(f"there is no engine {settings.engine!r}; use one of {', '.join(ENGINES)}")
    problem = inverse_problem(scene_file, photo, calibration, light_scale, materials, bands, settings.coefficients)
    answer = ENGINES[settings.engine](problem, settings, progress)
    return _record(problem, answer, settings)


def _record(problem: InverseProblem, answer: EngineAnswer, settings: InversionSettings) -> Reconstruction:
    """The answer with all that a later stage or a reader needs."""
    scale = problem.light_scale
    given = [material.name for material in problem.materials if material.reflectance is not None]
    if scale is None:
        scale = scale_from_surfaces(problem.measured, answer.rendered, problem.known_surface,
                                    f"known material {', '.join(given)}")
    name_of = {material.bsdf: material.name for material in problem.materials}
    agreement = surface_agreement(
        tuple(problem.scene_file.surfaces), tuple(name_of[bsdf] for bsdf in problem.scene_file.surfaces.values()),
        problem.measured, answer.rendered * scale.value, problem.surface, problem.used)
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
        coefficients=coefficients, spectra=spectra, white_signal=white, signal=signal, signal_covariance=covariance,
        model_covariance=np.array([model_covariance(agreement, material.name, frozenset(given))
                                   for material in problem.materials]),
        measured=problem.measured, rendered=answer.rendered * scale.value, used=problem.used, surface=problem.surface,
        agreement=agreement, light_scale=scale, loss_history=answer.loss_history, engine=answer.engine, spp=answer.spp,
        seed=settings.seed, outcome=answer.outcome, notes=answer.notes)
