"""From a photo, a scene and a calibration to the spectra of its materials."""
from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from radiometry.bspline import basis_matrix
from radiometry.errors import InputError
from radiometry.records import (
    Calibration,
    LightScale,
    LinearImage,
    Reconstruction,
)
from radiometry.response import relative_operator, response_matrix, white_signal
from radiometry.spectrum_files import spectrum_on_grid
from reconstruct.agreement import model_covariance, scale_from_surfaces, surface_agreement, usable_pixels
from reconstruct.gradient import GradientFit, fit_by_gradient
from reconstruct.renderer import load_scene, render
from reconstruct.scene_file import SceneFile, scene_xml
from reconstruct.surfaces import surface_map

PHOTO_FLOOR = 0.01       # of a band's median signal: black level and stray light
PHOTO_ERROR = 0.02       # relative: pose, light profile, lens; keeps bright pixels from ruling the fit
FEWEST_PIXELS = 12       # of a material, below which its colour cannot be said
FINAL_SPP, FINAL_PASSES = 256, 4
PLACEHOLDER = 0.5


@dataclass(frozen=True)
class MaterialSpec:
    """One material of the session: its BSDF in the scene, and its reflectance (P,) where that is known."""

    name: str
    bsdf: str
    reflectance: np.ndarray | None = None


@dataclass(frozen=True)
class InversionSettings:
    """Numbers an operator may choose."""

    coefficients: int = 9
    steps: int = 160
    spp: int = 16
    seed: int = 1


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

    Raises
    ------
    InputError
        If neither scale nor known material is given, or a material fills too few usable pixels.
    """
    grid = calibration.sensitivity.grid
    basis = basis_matrix(grid.nm, settings.coefficients)
    light = spectrum_on_grid(calibration.light, grid)
    size = (photo.signal.shape[1], photo.signal.shape[0])
    unknown = tuple(material for material in materials if material.reflectance is None)
    names, worn = tuple(scene_file.surfaces), tuple(scene_file.surfaces.values())
    name_of = {material.bsdf: material.name for material in materials}

    def scene_of(reflectances: Mapping[str, np.ndarray]) -> Any:
        return load_scene(scene_xml(
            scene_file, reflectances=reflectances, light=light, range_nm=(grid.nm[0], grid.nm[-1]), size=size,
            bands=dict(zip(bands, calibration.sensitivity.curves, strict=True))))

    start = {material.bsdf: np.full(grid.nm.size, PLACEHOLDER) if material.reflectance is None
             else material.reflectance for material in materials}
    scene = scene_of(start)
    surface = surface_map(scene, names, size)
    used = usable_pixels(photo, surface)
    _require_pixels(materials, worn, surface, used)
    known_bsdfs = {material.bsdf for material in materials if material.reflectance is not None}
    known_surface = np.where(used & np.isin(surface, [i for i, bsdf in enumerate(worn) if bsdf in known_bsdfs]),
                             surface, -1)
    if light_scale is None and not known_bsdfs:
        raise InputError("the light scale is unknown: give one material its known spectrum, or calibrate from a chart "
                         "photo with [chart] scene")
    measured = photo.signal.astype(np.float64)
    fit = _fit(scene, unknown, basis, measured, photo, used, light_scale, known_surface, settings, progress)
    spectra = np.array([_spectrum(material, unknown, basis, fit) for material in materials])
    final, _ = render(scene_of(dict(zip(name_of, spectra, strict=True))), FINAL_SPP, settings.seed + 7919, FINAL_PASSES)
    if light_scale is None:
        known_names = ", ".join(material.name for material in materials if material.reflectance is not None)
        light_scale = scale_from_surfaces(measured, final, known_surface, f"known material {known_names}")
    agreement = surface_agreement(names, tuple(name_of[bsdf] for bsdf in worn), measured, final * light_scale.value,
                                  surface, used)
    given = frozenset(material.name for material in materials if material.reflectance is not None)
    response = response_matrix(grid, calibration.sensitivity.curves, light)
    operator = relative_operator(response, basis)
    return Reconstruction(
        materials=tuple(material.name for material in materials),
        known=tuple(material.reflectance is not None for material in materials),
        grid=grid, basis=basis, coefficients=_coefficients(materials, unknown, fit, basis.shape[1]), spectra=spectra,
        white_signal=white_signal(response), signal=spectra @ (response / white_signal(response)[:, None]).T,
        signal_covariance=np.array([_signal_covariance(material, unknown, fit, operator) for material in materials]),
        model_covariance=np.array([model_covariance(agreement, material.name, given) for material in materials]),
        measured=measured, rendered=final * light_scale.value, used=used, surface=surface, agreement=agreement,
        light_scale=light_scale, loss_history=fit.loss_history, engine="gradient descent (Mitsuba prb, specfilm)",
        spp=settings.spp, seed=settings.seed, outcome=fit.outcome)


def _fit(scene: Any, unknown: tuple[MaterialSpec, ...], basis: np.ndarray, measured: np.ndarray, photo: LinearImage,
         used: np.ndarray, light_scale: LightScale | None, known_surface: np.ndarray, settings: InversionSettings,
         progress: Callable[[float, str], None]) -> GradientFit:
    floor = PHOTO_FLOOR * np.median(measured[used], axis=0)
    variance = photo.variance + (PHOTO_ERROR * measured) ** 2 + floor**2
    return fit_by_gradient(
        scene, tuple(material.bsdf for material in unknown), basis, measured, used[..., None] / variance,
        scale=None if light_scale is None else light_scale.value, known_surface=known_surface, steps=settings.steps,
        spp=settings.spp, seed=settings.seed, progress=progress)


def _require_pixels(materials: tuple[MaterialSpec, ...], worn: tuple[str, ...], surface: np.ndarray,
                    used: np.ndarray) -> None:
    for material in materials:
        mine = np.isin(surface, [index for index, bsdf in enumerate(worn) if bsdf == material.bsdf])
        if np.count_nonzero(mine & used) < FEWEST_PIXELS:
            raise InputError(
                f"material {material.name!r} fills {np.count_nonzero(mine)} pixels of the rendered view, "
                f"{np.count_nonzero(mine & used)} of them usable (unsaturated, lit, away from edges); {FEWEST_PIXELS} "
                "are needed: check pose and exposure, or raise [reconstruct] width")


def _spectrum(material: MaterialSpec, unknown: tuple[MaterialSpec, ...], basis: np.ndarray,
              fit: GradientFit) -> np.ndarray:
    if material.reflectance is not None:
        return material.reflectance
    return basis @ fit.coefficients[unknown.index(material)]


def _coefficients(materials: tuple[MaterialSpec, ...], unknown: tuple[MaterialSpec, ...], fit: GradientFit,
                  count: int) -> np.ndarray:
    return np.array([fit.coefficients[unknown.index(material)] if material in unknown else np.full(count, np.nan)
                     for material in materials])


def _signal_covariance(material: MaterialSpec, unknown: tuple[MaterialSpec, ...], fit: GradientFit,
                       operator: np.ndarray) -> np.ndarray:
    """Scatter of the material's signal over the averaged steps: noise of the renderings and of the descent."""
    if material not in unknown:
        return np.zeros((operator.shape[0],) * 2)
    signals = fit.tail[:, unknown.index(material)] @ operator.T
    return np.cov(signals, rowvar=False)
