"""The light on every pixel of a photo of a scene, and the errors of the pixels' signals.

Light from everywhere else depends on the spectra that are looked for: those of some pixels of each
material, found under the light as it is known so far, give the mean spectrum by which the light is
found anew, until it stands still.
"""
from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array

from spectrabox.radiometry.light_drift import drift_covariance
from spectrabox.radiometry.records import Calibration, LightScale
from spectrabox.reconstruct.agreement import BRIGHTEST_PERCENTILE
from spectrabox.reconstruct.pixels.hits import hits_of
from spectrabox.sampling.prior.mixture import GRID as PRIOR_GRID
from spectrabox.session.picture.illumination import illumination
from spectrabox.session.picture.known_surfaces import known_surfaces, with_scale
from spectrabox.session.picture.part_of_photo import cut
from spectrabox.session.picture.picture import LitPixels
from spectrabox.session.picture.pixel_errors import PixelErrors, White
from spectrabox.session.picture.scene_of_picture import SceneOfPicture
from spectrabox.session.picture.unseen import DARK as NO_LIGHT
from spectrabox.session.picture.unseen import EDGE, PENUMBRA, SEEN
from spectrabox.session.stages.error_budget import scale_covariances
from spectrabox.session.stages.inputs import GRID
from spectrabox.session.stages.reconstruct_stage import drift_of, glare_error

MOST_ROUNDS, STANDS_STILL = 12, 0.005   # the largest relative change of light that is none
STEP = 0.65                 # of the way to a new spectrum: brighter walls send on more light, by
                            # which they are then taken for darker, and whole steps swing about
PIXELS_OF_MATERIAL = 200    # by which the mean spectrum of a material is found
MISPLACED_PX = 0.5          # of a pixel: photo against scene
PENUMBRA_ERROR = 0.03       # relative, of light that changes quickly: beyond, there is no answer
UNLIT = 1e-3                # of the median light: changes of less are none
DARK = 1e-9                 # of the lamp's strongest wavelength


@dataclass(frozen=True, eq=False)
class FoundLight:
    """The light on the pixels, and how it was found."""

    pixels: LitPixels
    scale: LightScale               # of the photo, by which they are lit
    spectra: np.ndarray             # (M, P) of the materials, by which light is coloured
    changes: tuple[float, ...]      # largest relative change of the light in each round

    @property
    def sentence(self) -> str:
        """Whether the light stood still in the end."""
        rounds, last = len(self.changes), self.changes[-1]
        if last <= STANDS_STILL:
            return (f"the picture's light from other surfaces has converged: of {rounds} rounds "
                    f"the last changed it by {last:.2%} at most")
        return (f"the picture's light from other surfaces has not converged: after {rounds} rounds "
                f"it still changes by {last:.1%} in places; near strongly coloured surfaces its "
                "spectra are less certain than they say")


def found_light(scene: SceneOfPicture, progress: Callable[[float], None]) -> FoundLight:
    """The light on every pixel, with the spectra of the materials that the pixels themselves show.
    """
    view, traced = scene.view, scene.traced
    joint, rng = scene.joint, np.random.default_rng(scene.task.config.session.seed)
    spectra = np.array([joint.spectra[joint.materials.index(material.name)]
                        for material in view.scene_materials])
    unknown = [index for index, material in enumerate(view.scene_materials)
               if material.reflectance is None]
    light = traced.on_nodes(spectra, scene.lamps)
    pixels, scale = _lit(scene, light)
    chosen = _some_pixels(scene, pixels, unknown, rng)
    changes: list[float] = []
    while len(changes) < MOST_ROUNDS and (not changes or changes[-1] > STANDS_STILL):
        for index, mean in _mean_spectra(scene, pixels, chosen).items():
            spectra[index] += STEP * (mean - spectra[index])
        before, light = light, traced.on_nodes(spectra, scene.lamps)
        changes.append(_change(light[~traced.lamp], before[~traced.lamp]))
        pixels, scale = _lit(scene, light)
        progress(len(changes) / MOST_ROUNDS)
    return FoundLight(pixels, scale, spectra, tuple(changes))


def _change(light: np.ndarray, before: np.ndarray) -> float:
    """The largest change of light (N, P), relative to what it was, or to what is dark."""
    if not light.size:
        return 0.0
    return float(np.max(np.abs(light - before) / np.maximum(before, UNLIT * np.median(before))))


@dataclass(frozen=True)
class _SomePixels:
    """Some pixels (n,) of each material, in the whole photo, and the area that each stands for."""

    material: np.ndarray
    row: np.ndarray
    column: np.ndarray
    area: np.ndarray


def _some_pixels(scene: SceneOfPicture, pixels: LitPixels, materials: Sequence[int],
                 rng: np.random.Generator) -> _SomePixels:
    """Pixels spread evenly over what the photo shows of each material."""
    view, part = scene.view, scene.part
    assert pixels.unseen is not None
    inside = scene.traced.nodes.surface[part.rows, part.columns]
    usable = (pixels.unseen == SEEN) & ~pixels.photo.saturated.any(axis=2)
    places = []
    for material in materials:
        surfaces = [index for index, name in enumerate(view.surface_materials)
                    if name == view.scene_materials[material].name]
        place = np.flatnonzero(np.isin(inside, surfaces) & usable)
        if place.size > PIXELS_OF_MATERIAL:
            # one of each stretch of pixels, row by row
            ends = np.linspace(0, place.size, PIXELS_OF_MATERIAL + 1)
            place = place[(ends[:-1] + rng.random(PIXELS_OF_MATERIAL) * np.diff(ends)).astype(int)]
        places.append(place)
    row, column = np.divmod(np.concatenate([np.empty(0, int), *places]), inside.shape[1])
    row, column = row + part.rows.start, column + part.columns.start
    area = hits_of(scene.unit.scene, view.size, row, column).area
    return _SomePixels(np.repeat(materials, [place.size for place in places]), row, column, area)


def _mean_spectra(scene: SceneOfPicture, pixels: LitPixels,
                  some: _SomePixels) -> dict[int, np.ndarray]:
    """Mean (P,) of the spectra of each material's pixels, weighted by the light that they send on.
    """
    if not some.row.size:
        return {}
    photo = scene.view.photo
    weights = scene.traced.nodes.weights(some.row, some.column)
    alone = replace(photo, **{name: getattr(photo, name)[some.row, some.column][None]
                              for name in ("signal", "variance", "saturated")})
    lit = LitPixels(alone, replace(pixels.errors, between=lambda first, last: weights))
    rows = lit.rows(0, 1, singly=True)
    mean, _, _ = lit.one_by_one(rows, roughly=True)
    light = (weights @ pixels.errors.white.signal).mean(axis=1)
    weight = some.area * light * rows.seen
    return {int(material): np.interp(GRID.nm, PRIOR_GRID.nm, weight[own] @ mean[own]
                                     / weight[own].sum())
            for material in np.unique(some.material)
            for own in (some.material == material,) if weight[own].any()}


def _lit(scene: SceneOfPicture, light: np.ndarray) -> tuple[LitPixels, LightScale]:
    """The pixels under a light (N, P) at the nodes, and the light scale that makes it signals."""
    nodes, part = scene.traced.nodes, scene.part
    grey = light @ scene.to_signals.sum(axis=(0, 2))
    uneven = nodes.unevenness(grey, MISPLACED_PX)
    seen = known_surfaces(scene, light, uneven < PENUMBRA_ERROR)
    found = illumination(light, seen.scale.value * scene.to_signals)
    white = found.white
    grey = np.maximum(white.mean(axis=1), 1e-30)
    config, stored = scene.task.config, scene.task.stored
    drift = drift_of(config, stored)
    bands = white.shape[1]
    veil = glare_error(config, stored) * scene.joint.views[0].measured.mean(axis=(0, 1))
    ambient = config.stray_light.ambient * np.percentile(grey, BRIGHTEST_PERCENTILE) / grey
    alike = scene.traced.relative_variance + uneven**2 + ambient**2
    scale = sum(scale_covariances(scene.calibration, with_scale(scene.joint, seen.scale),
                                  0).values())
    log = scale + alike[:, None, None] * np.ones((bands, bands))
    width = part.columns.stop - part.columns.start

    def between(first: int, last: int) -> csr_array:
        row, column = np.divmod(np.arange(first * width, last * width), width)
        return nodes.weights(row + part.rows.start, column + part.columns.start)

    typical = found.typical @ found.spectra
    errors = PixelErrors(
        between, White(np.maximum(white, 1e-30), log, np.zeros_like(log)), found, np.zeros(bands),
        np.zeros((bands, bands)), veil,
        np.zeros((bands, bands)) if drift is None else drift_covariance(drift),
        seen.covariance, [_under(scene, colour) for colour in typical],
        _responses(scene, typical), scene.prior)
    unseen = np.full(nodes.surface.shape, SEEN, np.uint8)
    region = nodes.region
    unseen[(uneven > PENUMBRA_ERROR)[region]] = PENUMBRA
    unseen[(found.maps == 0).all(axis=1)[region]] = NO_LIGHT
    unseen[scene.edges | (region < 0) | scene.traced.lamp[region]] = EDGE
    return LitPixels(cut(scene.view.photo, part), errors, unseen[part.rows, part.columns],
                     highlights=True), seen.scale


def _responses(scene: SceneOfPicture, lights: np.ndarray) -> np.ndarray:
    """Responses (J, K, P) under lights (J, P); rows sum to 1."""
    sensed = scene.view.sensitivities * scene.view.grid.weights_nm
    found = lights[:, None, :] * sensed
    return np.asarray(found / found.sum(axis=2, keepdims=True))


def _under(scene: SceneOfPicture, light: np.ndarray) -> Calibration:
    """The calibration with the light (P,) that reaches a pixel in place of the lamp's own."""
    lamp, own = scene.view.light, scene.calibration.light
    factor = np.interp(own.grid.nm, GRID.nm, light / np.maximum(lamp, DARK * lamp.max()))
    error = None if own.standard_error is None else own.standard_error * factor
    return replace(scene.calibration, light=replace(own, values=own.values * factor,
                                                    standard_error=error))
