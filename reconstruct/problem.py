"""What an inversion starts from: the photo, the scene that explains it, and the checks that both
can be compared.
"""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from spectrabox.radiometry.bspline import basis_matrix
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records import (
    Calibration,
    LightScale,
    LinearImage,
    Outcome,
    WavelengthGrid,
)
from spectrabox.radiometry.response import response_matrix, white_signal
from spectrabox.radiometry.spectra.spectrum_files import spectrum_on_grid
from spectrabox.reconstruct.agreement import usable_pixels
from spectrabox.reconstruct.fit.inversion_inputs import (
    MaterialSpec,
    View,
    gain_of_bands,
    require_light,
    require_scales,
    require_sound_pixels,
)
from spectrabox.reconstruct.rendering.renderer import load_scene
from spectrabox.reconstruct.scene.scene_file import SceneFile
from spectrabox.reconstruct.scene.scene_xml import scene_xml
from spectrabox.reconstruct.scene.surfaces import surface_map

PHOTO_FLOOR = 0.01       # of a band's median signal: black level and stray light
PHOTO_ERROR = 0.02  # relative: pose, light profile, lens; keeps bright pixels from ruling the fit
FEWEST_PIXELS = 12       # of a material, below which its colour cannot be said
PLACEHOLDER = 0.5


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
    name: str = "photo"
    # light id -> (P,), where not ``light``
    own_lights: Mapping[str, np.ndarray] = field(default_factory=dict)

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
    def light_groups(self) -> tuple[tuple[str, ...], ...]:
        """Ids of the scene's lights, each a group of its own."""
        return tuple((name,) for name in dict.fromkeys(self.scene_file.light_ids))

    @property
    def responses(self) -> np.ndarray:
        """Response (L, K, P) under each light of ``light_groups``."""
        return np.array([response_matrix(self.grid, self.sensitivities,
                                         self.own_lights.get(name, self.light))
                         for name, in self.light_groups])

    @property
    def known_surface(self) -> np.ndarray:
        """Index (H, W) of the surface of known material that each usable pixel shows, -1
        elsewhere.
        """
        known = {material.bsdf for material in self.materials if material.reflectance is not None}
        mine = [index for index, bsdf in enumerate(self.scene_file.surfaces.values())
                if bsdf in known]
        return np.where(self.used & np.isin(self.surface, mine), self.surface, -1)

    def spectra(self, coefficients: np.ndarray) -> np.ndarray:
        """All spectra (M, P) for coefficients (U, N) of the unknown materials."""
        found = iter(coefficients)
        return np.array([next(found) @ self.basis.T if material.reflectance is None
                         else material.reflectance
                         for material in self.materials])

    def xml(self, spectra: Mapping[str, np.ndarray], **options: Any) -> str:
        """The scene with these spectra by BSDF id; options as of ``scene_xml``."""
        lights = {name: self.own_lights.get(name, self.light) for name, in self.light_groups}
        given: dict[str, Any] = {"light": lights if self.own_lights else self.light,
                                 "size": self.size,
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
    # light scale and its standard error, where no known material tells
    scale: tuple[float, float | None] = (1.0, None)


def inverse_problem(scene_file: SceneFile, photo: LinearImage, calibration: Calibration,
                    light_scale: LightScale | None, materials: tuple[MaterialSpec, ...],
                    bands: tuple[str, ...], coefficients: int) -> InverseProblem:
    """The photo made ready for an inversion, and checked against the scene.

    Raises
    ------
    InputError
        As ``inverse_problems``.
    """
    return inverse_problems([View("photo", scene_file, photo, calibration, bands, light_scale)],
                            materials, coefficients)[0]


def inverse_problems(views: Sequence[View], materials: tuple[MaterialSpec, ...],
                     coefficients: int) -> tuple[InverseProblem, ...]:
    """The photos made ready for one inversion, and checked against their scenes.

    Raises
    ------
    InputError
        If a view's light scale cannot be found, a material fills too few usable pixels in all views
        together, a band gets no light, or pixels are no numbers or far below zero.
    """
    require_scales(views, materials)
    problems = tuple(_one_problem(view, materials, coefficients) for view in views)
    _require_pixels(materials, problems)
    return problems


def _one_problem(view: View, materials: tuple[MaterialSpec, ...],
                 coefficients: int) -> InverseProblem:
    scene_file, photo, curves = view.scene_file, view.photo, view.calibration.sensitivity.curves
    grid = view.calibration.sensitivity.grid
    light = spectrum_on_grid(view.calibration.light, grid)
    own = {name: spectrum_on_grid(spectrum, grid) for name, spectrum in view.light_spectra.items()}
    if missing := [name for name in own if name not in scene_file.light_ids]:
        raise InputError(f"{scene_file.path.name} has no light {missing[0]!r}; it has "
                         f"{', '.join(scene_file.light_ids)}")
    received = [response_matrix(grid, curves, own.get(name, light))
                for name in scene_file.light_ids]
    require_light(white_signal(np.sum(received, axis=0)), view.bands)
    require_sound_pixels(photo)
    measured, variance = photo.signal.astype(np.float64), photo.variance.astype(np.float64)
    if view.gain is not None:
        gain = gain_of_bands(view.gain, measured.shape, photo.source)
        measured, variance = measured / gain, variance / gain**2
    size = (measured.shape[1], measured.shape[0])
    worn = set(scene_file.surfaces.values())
    flat = {material.bsdf: np.full(2, PLACEHOLDER) for material in materials}
    scene = load_scene(scene_xml(scene_file, reflectances=flat, light=np.ones(2),
                                 bands={"one": np.ones(2)}, range_nm=(grid.nm[0], grid.nm[-1]),
                                 size=size))
    surface = surface_map(scene, tuple(scene_file.surfaces), size)
    used = usable_pixels(photo, surface)
    floor = PHOTO_FLOOR * np.median(measured[used], axis=0) if used.any() else 0.0
    return InverseProblem(
        scene_file, tuple(material for material in materials if material.bsdf in worn), view.bands,
        grid, basis_matrix(grid.nm, coefficients), light, curves, measured,
        variance + (PHOTO_ERROR * measured) ** 2 + floor**2, surface, used, view.light_scale,
        view.name, own)


def _require_pixels(materials: tuple[MaterialSpec, ...],
                    problems: Sequence[InverseProblem]) -> None:
    for material in materials:
        seen = usable = 0
        for problem in problems:
            worn = problem.scene_file.surfaces.values()
            mine = np.isin(problem.surface,
                           [index for index, bsdf in enumerate(worn) if bsdf == material.bsdf])
            seen, usable = seen + int(mine.sum()), usable + int((mine & problem.used).sum())
        if usable < FEWEST_PIXELS:
            raise InputError(
                f"material {material.name!r} fills {seen} pixels of the rendered "
                f"view{'s' if len(problems) > 1 else ''}, {usable} of them usable (unsaturated, "
                f"lit, away from edges); {FEWEST_PIXELS} are needed: check pose and exposure, or "
                "raise [reconstruct] width")
