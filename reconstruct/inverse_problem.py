"""What an inversion starts from: the photo, the scene that explains it, and the checks that both can be compared."""
from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from radiometry.bspline import basis_matrix
from radiometry.errors import InputError
from radiometry.records import Calibration, LightScale, LinearImage, Outcome, WavelengthGrid
from radiometry.response import response_matrix, white_signal
from radiometry.spectrum_files import spectrum_on_grid
from reconstruct.agreement import usable_pixels
from reconstruct.renderer import load_scene
from reconstruct.scene_file import SceneFile, scene_xml
from reconstruct.surfaces import surface_map

PHOTO_FLOOR = 0.01       # of a band's median signal: black level and stray light
PHOTO_ERROR = 0.02       # relative: pose, light profile, lens; keeps bright pixels from ruling the fit
FEWEST_PIXELS = 12       # of a material, below which its colour cannot be said
PLACEHOLDER = 0.5
DARK_BAND = 1e-6         # of the strongest band's light: below, a band has none
NEGATIVE_SIGMA = 6.0     # a pixel this far below zero is no noise
MOST_NEGATIVE = 1e-3     # share of such pixels that defects explain


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
    steps: int = 160                # of the gradient and per-wavelength engines
    spp: int = 16                   # paths per pixel and step; the transport engine decides how many it needs
    seed: int = 1
    surface_error: float = 0.01     # relative standard deviation of each surface's brightness in each band: light
                                    # profile, pose, uneven paint; 0 where only pixel noise is to be expected
    smoothness: float = 0.1         # of the prior on spectra (reconstruct/transport_fit.py); 0 for none
    engine: str = "transport"       # or "gradient", "per-wavelength", "single-bounce"


@dataclass(frozen=True)
class InverseProblem:
    """One photo and the scene that is to explain it."""

    scene_file: SceneFile
    materials: tuple[MaterialSpec, ...]
    bands: tuple[str, ...]
    grid: WavelengthGrid
    basis: np.ndarray               # (P, N)
    light: np.ndarray               # (P,)
    sensitivities: np.ndarray       # (K, P)
    measured: np.ndarray            # (H, W, K)
    variance: np.ndarray            # (H, W, K) of a pixel against a perfect rendering
    surface: np.ndarray             # (H, W) index into the scene's surfaces, -1 none or mixed
    used: np.ndarray                # (H, W) bool
    light_scale: LightScale | None

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        return self.measured.shape[1], self.measured.shape[0]

    @property
    def unknown(self) -> tuple[MaterialSpec, ...]:
        """Materials that are looked for."""
        return tuple(material for material in self.materials if material.reflectance is None)

    @property
    def response(self) -> np.ndarray:
        """Sensitivity x light x integration weight (K, P)."""
        return response_matrix(self.grid, self.sensitivities, self.light)

    @property
    def known_surface(self) -> np.ndarray:
        """Index (H, W) of the surface of known material that each usable pixel shows, -1 elsewhere."""
        known = {material.bsdf for material in self.materials if material.reflectance is not None}
        mine = [index for index, bsdf in enumerate(self.scene_file.surfaces.values()) if bsdf in known]
        return np.where(self.used & np.isin(self.surface, mine), self.surface, -1)

    def spectra(self, coefficients: np.ndarray) -> np.ndarray:
        """All spectra (M, P) for coefficients (U, N) of the unknown materials."""
        found = iter(coefficients)
        return np.array([next(found) @ self.basis.T if material.reflectance is None else material.reflectance
                         for material in self.materials])

    def xml(self, spectra: Mapping[str, np.ndarray], **options: Any) -> str:
        """The scene with these spectra by BSDF id; options as of ``scene_xml``."""
        given: dict[str, Any] = {"light": self.light, "size": self.size,
                                 "bands": dict(zip(self.bands, self.sensitivities, strict=True)),
                                 "range_nm": (self.grid.nm[0], self.grid.nm[-1])}
        return scene_xml(self.scene_file, reflectances=spectra, **(given | options))

    def scene(self, coefficients: np.ndarray | None = None) -> Any:
        """The scene for Mitsuba with the spectra of coefficients (U, N), or placeholders."""
        if coefficients is None:
            coefficients = np.full((len(self.unknown), self.basis.shape[1]), PLACEHOLDER)
        names = [material.bsdf for material in self.materials]
        return load_scene(self.xml(dict(zip(names, self.spectra(coefficients), strict=True))))


@dataclass(frozen=True)
class EngineAnswer:
    """What any engine finds."""

    coefficients: np.ndarray        # (U, N)
    signals: np.ndarray             # (U, K) relative to white: what the photo says of them
    signal_covariance: np.ndarray   # (U, K, K)
    rendered: np.ndarray            # (H, W, K) for a light scale of 1
    loss_history: np.ndarray
    engine: str
    spp: int
    outcome: Outcome
    notes: tuple[str, ...] = ()     # sentences on what is measured and what assumed


def inverse_problem(scene_file: SceneFile, photo: LinearImage, calibration: Calibration,
                    light_scale: LightScale | None, materials: tuple[MaterialSpec, ...], bands: tuple[str, ...],
                    coefficients: int) -> InverseProblem:
    """The photo made ready for an inversion, and checked against the scene.

    Raises
    ------
    InputError
        If there is neither a scale nor a known material, a material fills too few usable pixels, a band gets no light,
        or pixels are no numbers or far below zero.
    """
    grid = calibration.sensitivity.grid
    light = spectrum_on_grid(calibration.light, grid)
    if light_scale is None and all(material.reflectance is None for material in materials):
        raise InputError("the light scale is unknown: give one material its known spectrum, or calibrate from a chart "
                         "photo with [chart] scene")
    _require_light(white_signal(response_matrix(grid, calibration.sensitivity.curves, light)), bands)
    _require_sound_pixels(photo)
    measured = photo.signal.astype(np.float64)
    size = (measured.shape[1], measured.shape[0])
    flat = {material.bsdf: np.full(2, PLACEHOLDER) for material in materials}
    scene = load_scene(scene_xml(scene_file, reflectances=flat, light=np.ones(2), bands={"one": np.ones(2)},
                                 range_nm=(grid.nm[0], grid.nm[-1]), size=size))
    surface = surface_map(scene, tuple(scene_file.surfaces), size)
    used = usable_pixels(photo, surface)
    _require_pixels(materials, tuple(scene_file.surfaces.values()), surface, used)
    floor = PHOTO_FLOOR * np.median(measured[used], axis=0)
    return InverseProblem(
        scene_file, materials, bands, grid, basis_matrix(grid.nm, coefficients), light, calibration.sensitivity.curves,
        measured, photo.variance + (PHOTO_ERROR * measured) ** 2 + floor**2, surface, used, light_scale)


def _require_light(white: np.ndarray, bands: tuple[str, ...]) -> None:
    dark = [name for name, value in zip(bands, white, strict=True) if not value > DARK_BAND * white.max()]
    if dark:
        raise InputError(f"the light gives the camera's band {', '.join(dark)} nothing (less than {DARK_BAND:g} of "
                         "the strongest band): its photo says nothing; leave the band out, or check the light spectrum")


def _require_sound_pixels(photo: LinearImage) -> None:
    lost = int(np.count_nonzero(~np.isfinite(photo.signal).all(axis=2)))
    if lost:
        raise InputError(f"{photo.source}: {lost} pixels hold no number (NaN or infinity); mend or mask them")
    below = photo.signal < -NEGATIVE_SIGMA * np.sqrt(photo.variance)
    if below.any(axis=2).mean() > MOST_NEGATIVE:
        raise InputError(f"{photo.source}: {below.any(axis=2).mean():.1%} of the pixels are further below zero than "
                         "noise explains; the black level taken off is too high")


def _require_pixels(materials: tuple[MaterialSpec, ...], worn: tuple[str, ...], surface: np.ndarray,
                    used: np.ndarray) -> None:
    for material in materials:
        mine = np.isin(surface, [index for index, bsdf in enumerate(worn) if bsdf == material.bsdf])
        if np.count_nonzero(mine & used) < FEWEST_PIXELS:
            raise InputError(
                f"material {material.name!r} fills {np.count_nonzero(mine)} pixels of the rendered view, "
                f"{np.count_nonzero(mine & used)} of them usable (unsaturated, lit, away from edges); {FEWEST_PIXELS} "
                "are needed: check pose and exposure, or raise [reconstruct] width")
