"""One photo with all that explains it, and what an inversion needs of it.

That is: pixels that can be compared, spectra of light and camera, the scene for the renderer.
"""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.grid import basis_matrix
from spectrabox.radiometry.interreflection import response_matrix, white_signal
from spectrabox.radiometry.records import scenes
from spectrabox.radiometry.records.calibration import Calibration, LightScale
from spectrabox.radiometry.records.photos import LinearImage
from spectrabox.radiometry.records.spectra import Outcome, Spectrum, WavelengthGrid
from spectrabox.radiometry.spectra.spectrum_files import spectrum_on_grid
from spectrabox.reconstruct.agreement import usable_pixels
from spectrabox.reconstruct.rendering.renderer import load_scene
from spectrabox.reconstruct.scene import stated, surfaces
from spectrabox.reconstruct.scene.beam import Beam
from spectrabox.reconstruct.scene.scene_file import SceneFile
from spectrabox.reconstruct.scene.scene_xml import scene_xml

PHOTO_FLOOR = 0.01       # of a band's median signal: black level and stray light
PHOTO_ERROR = 0.02  # relative: pose, light profile, lens; keeps bright pixels from ruling the fit
PLACEHOLDER = 0.5
SAME_RESPONSE = 1e-9    # relative: responses closer than this are the same


@dataclass(frozen=True, eq=False)
class MaterialSpec:
    """A material of the session: its BSDF in the scene, and its reflectance (P,) if it is known.

    ``learnt`` is what is expected of an unknown one whose family of surfaces was stated.
    """

    name: str
    bsdf: str
    reflectance: np.ndarray | None = None
    learnt: scenes.LearntSpectra | None = None


@dataclass(frozen=True, eq=False)
class PhotoView:
    """One photo with all that explains it: several views of the same materials are solved together.

    Parameters
    ----------
    name : str
        Of the photo, for sentences.
    scene_file : SceneFile
    photo : LinearImage
        At the render's size, (H, W, K).
    calibration : Calibration
        Of K bands on P wavelengths.
    bands : tuple of str
        K names.
    materials : tuple of MaterialSpec
        One for every BSDF that a surface of the scene has; there may be more.
    light_scale : LightScale or None
        For this photo's exposure; None to estimate it from a known material, or from materials that
        another view of known scale shows too.
    light_spectra : mapping from light id to Spectrum
        Of lights of the scene whose spectrum is not the calibration's.
    lamp : str
        By which views are told to be under one lamp, whatever its filter; the scene says its place.
    level_error : float
        Standard deviation of the logarithm of the light scale where that is no more than what is
        expected beforehand: it is estimated with the spectra.
    beam : Beam, optional
        Of the scene's only lamp, as it was estimated.
    """

    name: str
    scene_file: SceneFile
    photo: LinearImage
    calibration: Calibration
    bands: tuple[str, ...]
    materials: tuple[MaterialSpec, ...]
    light_scale: LightScale | None = None
    light_spectra: Mapping[str, Spectrum] = field(default_factory=dict)
    lamp: str = ""
    level_error: float = 0.0
    beam: Beam | None = None

    # ---- the photo -------------------------------------------------------------------------------

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        return self.photo.signal.shape[1], self.photo.signal.shape[0]

    def with_photo(self, photo: LinearImage, light_scale: LightScale | None = None) -> PhotoView:
        """The view with another photo of the same surfaces, compared at the same pixels.

        Parameters
        ----------
        photo : LinearImage
            (H, W, K).
        light_scale : LightScale, optional
            Of that photo; the view's own where it is left out.
        """
        other = replace(self, photo=photo, light_scale=light_scale or self.light_scale)
        vars(other).update(surface=self.surface, used=self.used)  # the scene is the same
        return other

    @cached_property
    def measured(self) -> np.ndarray:
        """Signal (H, W, K)."""
        return self.photo.signal.astype(np.float64)

    @cached_property
    def variance(self) -> np.ndarray:
        """Variance (H, W, K) of a pixel against a perfect rendering."""
        floor = PHOTO_FLOOR * np.median(self.measured[self.used], axis=0) if self.used.any() else 0
        noise = self.photo.variance.astype(np.float64)
        return np.asarray(noise + (PHOTO_ERROR * self.measured) ** 2 + floor**2)

    @cached_property
    def surface(self) -> np.ndarray:
        """Index (H, W) into the scene's surfaces, -1 where no surface fills the pixel."""
        ones = np.ones(2)
        scene = load_scene(self.xml(dict.fromkeys((material.bsdf for material in self.materials),
                                                  np.full(2, PLACEHOLDER)),
                                    light=ones, bands={"one": ones}))
        return surfaces.surface_map(scene, tuple(self.scene_file.surfaces), self.size)

    @cached_property
    def used(self) -> np.ndarray:
        """Pixels (H, W) bool that can be compared with a rendering."""
        return usable_pixels(self.photo, self.surface)

    # ---- materials -------------------------------------------------------------------------------

    @property
    def scene_materials(self) -> tuple[MaterialSpec, ...]:
        """The materials (M) of the scene's surfaces."""
        bsdfs = set(self.scene_file.surfaces.values())
        return tuple(material for material in self.materials if material.bsdf in bsdfs)

    @property
    def unknown(self) -> tuple[MaterialSpec, ...]:
        """The materials (U) of the scene whose spectrum is to be estimated."""
        return tuple(material for material in self.scene_materials if material.reflectance is None)

    @property
    def known(self) -> tuple[str, ...]:
        """Names of the scene's materials whose reflectance is given."""
        return tuple(material.name for material in self.scene_materials
                     if material.reflectance is not None)

    @property
    def name_of_bsdf(self) -> dict[str, str]:
        """Material name by BSDF id."""
        return {material.bsdf: material.name for material in self.scene_materials}

    @property
    def surface_materials(self) -> tuple[str, ...]:
        """Material name (S) of each of the scene's surfaces."""
        return tuple(self.name_of_bsdf[bsdf] for bsdf in self.scene_file.surfaces.values())

    @property
    def known_surface(self) -> np.ndarray:
        """Index (H, W) of the surface of known material in each usable pixel, -1 elsewhere."""
        indices = [index for index, name in enumerate(self.surface_materials)
                   if name in self.known]
        return np.where(self.used & np.isin(self.surface, indices), self.surface, -1)

    def basis(self, coefficients: int) -> np.ndarray:
        """Spline basis (P, N) of a reflectance."""
        return basis_matrix(self.grid.nm, coefficients)

    def spectra(self, coefficients: np.ndarray) -> np.ndarray:
        """Spectra (M, P) of the scene's materials, the known ones as they are given.

        Parameters
        ----------
        coefficients : (U, N) array
            Of the unknown materials.
        """
        estimates = iter(coefficients @ self.basis(coefficients.shape[1]).T)
        return np.array([next(estimates) if material.reflectance is None else material.reflectance
                         for material in self.scene_materials])

    # ---- light and camera ------------------------------------------------------------------------

    @property
    def grid(self) -> WavelengthGrid:
        """Wavelengths (P,) of all spectra of the view."""
        return self.calibration.sensitivity.grid

    @property
    def sensitivities(self) -> np.ndarray:
        """Camera sensitivities (K, P)."""
        return self.calibration.sensitivity.curves

    @cached_property
    def light(self) -> np.ndarray:
        """Light spectrum (P,) of the calibration."""
        return spectrum_on_grid(self.calibration.light, self.grid)

    @cached_property
    def relative_lights(self) -> dict[str, np.ndarray]:
        """What the scene states of each light, relative to the strongest: (P,) by id."""
        return stated.relative_lights(self.scene_file, self.grid.nm)

    @cached_property
    def own_lights(self) -> dict[str, np.ndarray]:
        """Spectrum (P,) of each light that has another one, by id: as it was given, or in the
        colour in which the scene states it beside the strongest.
        """
        coloured = {name: self.light * relative for name, relative in self.relative_lights.items()
                    if stated.strength(relative) is None}
        return coloured | {name: spectrum_on_grid(spectrum, self.grid)
                           for name, spectrum in self.light_spectra.items()}

    @property
    def unit_lights(self) -> dict[str, np.ndarray]:
        """Flat spectra (2,) of the lights in a scene of unit spectra: their relative strengths, and
        1 of those in ``own_lights``, whose spectra have them.
        """
        return {name: np.full(2, 1.0 if name in self.own_lights else relative.mean())
                for name, relative in self.relative_lights.items()}

    @property
    def light_groups(self) -> tuple[tuple[str, ...], ...]:
        """Ids of the scene's lights, each a group of its own."""
        return tuple((name,) for name in dict.fromkeys(self.scene_file.light_ids))

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What of its scene is not kept, and how its lights were taken."""
        left_out = self.scene_file.left_out
        if len(self.relative_lights) < 2:
            return left_out
        return (*left_out, Finding("scene.lights", Severity.INFO, values={
            "names": [*self.relative_lights],
            "strengths": [float(relative.mean()) for relative in self.relative_lights.values()],
            "coloured": [name for name in self.own_lights if name not in self.light_spectra],
            "given": [*self.light_spectra]}))

    @property
    def response(self) -> np.ndarray:
        """Sensitivity x light x integration weight (K, P) under the calibration's light."""
        return response_matrix(self.grid, self.sensitivities, self.light)

    @property
    def responses(self) -> np.ndarray:
        """Response (L, K, P) under each light of ``light_groups``."""
        return np.array([response_matrix(self.grid, self.sensitivities,
                                         self.own_lights.get(name, self.light))
                         for name, in self.light_groups])

    @property
    def lamp_in_place(self) -> str:
        """The same for views under one lamp in one place."""
        return f"{self.lamp} {self.scene_file.lamps}"

    # ---- for the renderer ------------------------------------------------------------------------

    def xml(self, spectra: Mapping[str, np.ndarray], *,
            light: np.ndarray | Mapping[str, np.ndarray] | None = None,
            bands: Mapping[str, np.ndarray] | None = None, integrator: str = "prb") -> str:
        """The scene as XML text with these spectra.

        Parameters
        ----------
        spectra : mapping of BSDF id to reflectance
            Evenly spaced over the grid's range.
        light, bands : as of ``scene_xml``
            The view's own where they are None.
        integrator : str

        Raises
        ------
        InputError
            As ``scene_xml``.
        """
        if light is None and (len(self.light_groups) > 1 or self.own_lights):
            unit = self.unit_lights
            light = {name: self.own_lights.get(name, self.light * unit[name][0])
                     for name, in self.light_groups}
        if bands is None:
            bands = dict(zip(self.bands, self.sensitivities, strict=True))
        return scene_xml(self.scene_file, reflectances=spectra,
                         light=self.light if light is None else light, bands=bands,
                         range_nm=(self.grid.nm[0], self.grid.nm[-1]), size=self.size,
                         integrator=integrator)

    def scene(self, coefficients: np.ndarray | None = None) -> Any:
        """The scene for Mitsuba.

        Parameters
        ----------
        coefficients : (U, N) array, optional
            Of the unknown materials; placeholders where it is left out.

        Raises
        ------
        InputError
            If Mitsuba cannot load it, or cannot render its lights as they are (see ``scene_xml``).
        """
        if coefficients is None:
            coefficients = np.full((len(self.unknown), 4), PLACEHOLDER)
        names = [material.bsdf for material in self.scene_materials]
        return load_scene(self.xml(dict(zip(names, self.spectra(coefficients), strict=True))))


@dataclass(frozen=True, eq=False)
class ViewSolution:
    """What an engine finds for one view, before it is compared with the photo."""

    coefficients: np.ndarray        # (U, N)
    signals: np.ndarray             # (U, K) relative to white: what the photo alone gives
    signal_covariance: np.ndarray   # (U, K, K)
    # (A, H, W, K) for a light scale of 1: independent renderings, whose mean is the picture
    renderings: np.ndarray
    loss_history: np.ndarray
    engine: str
    spp: int
    outcome: Outcome
    findings: tuple[Finding, ...] = ()      # what is measured and what assumed
    # light scale and its standard error, where no known material sets it
    scale: tuple[float, float | None] = (1.0, None)
    regions: scenes.RegionTransport | None = None  # for the samplers, where light was traced
    # what known surfaces said of the light on the view
    known_light: scenes.KnownLight | None = None
    # of each material, by name: relative covariance (K, K) by what was estimated of the scene
    scene_covariance: Mapping[str, np.ndarray] = field(default_factory=dict)


def unknown_materials(views: Sequence[PhotoView]) -> tuple[MaterialSpec, ...]:
    """The materials of any of the views whose spectrum is to be estimated, each once."""
    return tuple({material.bsdf: material for view in views for material in view.unknown}.values())


def same_response(one: PhotoView, other: PhotoView) -> bool:
    """Whether the bands of two views are the same, under the same light, up to their exposure."""
    responses = [view.response / white_signal(view.response)[:, None] for view in (one, other)]
    return responses[0].shape == responses[1].shape and bool(
        np.abs(responses[0] - responses[1]).max() <= SAME_RESPONSE * np.abs(responses[1]).max())


# ---- what must hold ------------------------------------------------------------------------------
# What must hold of the views before an inversion starts; each check says what to do.

DARK_BAND = 1e-6         # of the strongest band's light: below, a band has none
NEGATIVE_SIGMA = 6.0     # a pixel this far below zero is no noise
MAX_NEGATIVE = 1e-3      # share of such pixels that defects explain
MIN_PIXELS = 12          # of a material, below which its colour cannot be estimated


def check_views(views: Sequence[PhotoView]) -> None:
    """Refuse views from which no spectra can be estimated.

    Parameters
    ----------
    views : sequence of PhotoView

    Raises
    ------
    InputError
        If the views are on different wavelengths, a view's light scale cannot be estimated, a
        material fills too few usable pixels in all views together, a band gets no light, a light is
        named that the scene lacks, or pixels are no numbers or far below zero.
    """
    if len({view.grid.nm.tobytes() for view in views}) > 1:
        raise InputError("the calibrations of the views are on different wavelengths: use one grid "
                         "for all")
    _require_scales(views)
    for view in views:
        lights, photo = view.scene_file.light_ids, view.photo
        if missing := [name for name in view.light_spectra if name not in lights]:
            raise InputError(f"{view.scene_file.path.name} has no light {missing[0]!r}; it has "
                             f"{', '.join(lights)}")
        white = white_signal(view.responses.sum(axis=0))
        dark = [name for name, value in zip(view.bands, white, strict=True)
                if not value > DARK_BAND * white.max()]
        if dark:
            raise InputError(f"the light gives the camera's band {', '.join(dark)} nothing (less "
                             f"than {DARK_BAND:g} of the strongest band): its photo says nothing; "
                             "leave the band out, or check the light spectrum")
        if lost := int(np.count_nonzero(~np.isfinite(photo.signal).all(axis=2))):
            raise InputError(f"{photo.source}: {lost} pixels hold no number (NaN or infinity); "
                             "mend or mask them")
        below = (photo.signal < -NEGATIVE_SIGMA * np.sqrt(photo.variance)).any(axis=2).mean()
        if below > MAX_NEGATIVE:
            raise InputError(f"{photo.source}: {below:.1%} of the pixels are further below zero "
                             "than noise explains; the black level taken off is too high")
    _require_pixels(views)


def _require_scales(views: Sequence[PhotoView]) -> None:
    """Refuse a view without a light scale, a known material, or a material in common with a view
    that has either.
    """
    bsdfs = [set(view.scene_file.surfaces.values()) for view in views]
    linked = {material.bsdf for view in views for material in view.materials
              if material.reflectance is not None}
    waiting = list(range(len(views)))
    while scaled := [index for index in waiting
                     if views[index].light_scale is not None or bsdfs[index] & linked]:
        linked |= set().union(*(bsdfs[index] for index in scaled))
        waiting = [index for index in waiting if index not in scaled]
    if waiting:
        which = "" if len(views) == 1 else f" of {views[waiting[0]].name}"
        raise InputError(f"the light scale{which} is unknown: give one material its known "
                         "spectrum, or calibrate from a chart photo with [chart] scene")


def _require_pixels(views: Sequence[PhotoView]) -> None:
    """Refuse a material that fills too few usable pixels in all views together. Of known ones it is
    enough that one tells the light scale, or that every view has it.
    """
    materials = {material.bsdf: material for view in views for material in view.materials}
    seen, usable = dict.fromkeys(materials, 0), dict.fromkeys(materials, 0)
    for view in views:
        for bsdf in view.name_of_bsdf:
            own = np.isin(view.surface, [index for index, each in enumerate(
                view.scene_file.surfaces.values()) if each == bsdf])
            seen[bsdf] += int(own.sum())
            usable[bsdf] += int((own & view.used).sum())
    told = all(view.light_scale is not None for view in views) or any(
        usable[bsdf] >= MIN_PIXELS for bsdf, material in materials.items()
        if material.reflectance is not None)
    for bsdf, material in materials.items():
        if usable[bsdf] < MIN_PIXELS and not (told and material.reflectance is not None):
            raise InputError(
                f"material {material.name!r} fills {seen[bsdf]} pixels of the rendered "
                f"view{'s' if len(views) > 1 else ''}, {usable[bsdf]} of them usable (unsaturated, "
                f"lit, away from edges); {MIN_PIXELS} are needed: check pose and exposure, or "
                "raise [reconstruct] width")
