"""The light on every pixel of a photo of a scene, and the errors of the pixels' signals.

Light from other surfaces depends on the spectra that are sought: the mean spectrum of some pixels
of each material, under the current light, gives the next light, until it converges.
"""
from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy.sparse import csr_array

from spectrabox.measure.pictures import (
    lit_photo,
    photo_white,
    pixel_errors,
    pixel_flags,
    traced_photo,
)
from spectrabox.measure.pictures.crop import crop_photo
from spectrabox.measure.pictures.illumination import illumination
from spectrabox.radiometry import error_model, findings, gloss
from spectrabox.radiometry.records.calibration import Calibration, LightScale
from spectrabox.reconstruct.agreement import BRIGHTEST_PERCENTILE
from spectrabox.reconstruct.scene.surfaces import hits_of
from spectrabox.sampling.prior.mixture import PRIOR_GRID

MAX_ROUNDS, TOLERANCE = 12, 0.005   # largest relative change of light that counts as none
STEP = 0.65                 # under-relaxation: full steps oscillate, as brighter walls send on more
                            # light, under which they look darker
PIXELS_OF_MATERIAL = 200    # from which the mean spectrum of a material is computed
MISPLACED_PX = 0.5          # of a pixel: photo against scene
PENUMBRA_ERROR = 0.03       # relative, of light that changes quickly: beyond, there is no answer
UNLIT = 1e-3                # of the median light: changes of less are none
DARK_LAMP = 1e-9            # of the lamp's strongest wavelength


def converge_light(scene: traced_photo.TracedPhoto, progress: Callable[[float], None]
                   ) -> tuple[lit_photo.LitPhoto, LightScale, np.ndarray, list[float]]:
    """The light on every pixel, with the spectra of the materials that the pixels themselves show.

    Parameters
    ----------
    scene : TracedPhoto
    progress : function of the share of the rounds that are done

    Returns
    -------
    photo : LitPhoto
    scale : LightScale
        From the light to the signal of the photo.
    spectra : (M, P) array
        Of the materials, by which light is coloured.
    changes : list of float
        Largest relative change of the light in each round.
    """
    view, joint = scene.view, scene.joint
    spectra = np.array([joint.spectra[joint.materials.index(material.name)]
                        for material in view.scene_materials])
    unknown = [index for index, material in enumerate(view.scene_materials)
               if material.reflectance is None]
    light = scene.light(spectra)
    photo, scale = light_photo(scene, light)
    sample = _sample_pixels(scene, photo, unknown, np.random.default_rng(scene.seed))
    changes: list[float] = []
    while len(changes) < MAX_ROUNDS and (not changes or changes[-1] > TOLERANCE):
        for index, mean in mean_spectra(scene, photo, *sample).items():
            spectra[index] += STEP * (mean - spectra[index])
        before, light = light, scene.light(spectra)
        after, earlier = light[~scene.lamp], before[~scene.lamp]
        changes.append(float(np.max(np.abs(after - earlier) / np.maximum(
            earlier, UNLIT * np.median(earlier)))) if after.size else 0.0)
        photo, scale = light_photo(scene, light)
        progress(len(changes) / MAX_ROUNDS)
    return photo, scale, spectra, changes


def light_finding(changes: Sequence[float]) -> findings.Finding:
    """Whether the light converged, by its largest relative change in each round."""
    values = {"rounds": len(changes), "last": changes[-1]}
    if changes[-1] <= TOLERANCE:
        return findings.Finding("picture.light-converged", findings.Severity.INFO, values=values)
    return findings.Finding("picture.light-not-converged", findings.Severity.NOTE, values=values)


def _sample_pixels(scene: traced_photo.TracedPhoto, photo: lit_photo.LitPhoto,
                   materials: Sequence[int], rng: np.random.Generator
                   ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Pixels (n,) spread evenly over the visible area of each material: material, row and column in
    the whole photo, and the area that each stands for.
    """
    view, crop = scene.view, scene.crop
    assert photo.flags is not None
    inside = scene.nodes.surface[crop.rows, crop.columns]
    usable = (photo.flags == pixel_flags.SEEN) & ~photo.photo.saturated.any(axis=2)
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
    row, column = row + crop.rows.start, column + crop.columns.start
    _, area, _ = hits_of(scene.unit.scene, view.size, row, column)
    return np.repeat(materials, [place.size for place in places]), row, column, area


def mean_spectra(scene: traced_photo.TracedPhoto, photo: lit_photo.LitPhoto,
                 material: np.ndarray, row: np.ndarray, column: np.ndarray, area: np.ndarray
                 ) -> dict[int, np.ndarray]:
    """Mean (P,) of the spectra of each material's pixels, weighted by the light that they send on.

    Parameters
    ----------
    scene : TracedPhoto
    photo : LitPhoto
        The light on it.
    material, row, column, area : (n,) arrays
        Of the pixels, in the whole photo; the area that each stands for.
    """
    if not row.size:
        return {}
    whole = scene.view.photo
    weights = scene.nodes.weights(row, column)
    alone = replace(whole, **{name: getattr(whole, name)[row, column][None]
                              for name in ("signal", "variance", "saturated")})
    few = lit_photo.LitPhoto(alone, replace(photo.errors, between=lambda first, last: weights))
    block = few.block(0, 1, direct=True)
    mean, _, _ = few.direct(block, coarse=True)
    light = (weights @ photo.errors.white.signal).mean(axis=1)
    weight = area * light * block.seen
    means = {}
    for number in np.unique(material):
        own = material == number
        if weight[own].any():
            means[int(number)] = np.interp(scene.view.grid.nm, PRIOR_GRID.nm,
                                           weight[own] @ mean[own] / weight[own].sum())
    return means


def light_photo(scene: traced_photo.TracedPhoto,
                light: np.ndarray) -> tuple[lit_photo.LitPhoto, LightScale]:
    """The pixels under a light, and the light scale that makes it signals.

    Parameters
    ----------
    scene : TracedPhoto
    light : (N, P) array
        Radiance of a perfect white at the nodes, for a light scale of 1.
    """
    view, nodes, crop = scene.view, scene.nodes, scene.crop
    uneven = nodes.unevenness(light @ scene.to_signals.sum(axis=(0, 2)), MISPLACED_PX)
    scale, disagreement = photo_white.compare_reference_surfaces(scene, light,
                                                                 uneven < PENUMBRA_ERROR)
    lighting = illumination(light, scale.value * scene.to_signals)
    white = lighting.white
    grey = np.maximum(white.mean(axis=1), 1e-30)
    bands = white.shape[1]
    ambient = scene.ambient * np.percentile(grey, BRIGHTEST_PERCENTILE) / grey
    common = scene.relative_variance + uneven**2 + ambient**2
    of_scale = sum(error_model.scale_covariances(scene.calibration, scale).values())
    log = of_scale + common[:, None, None] * np.ones((bands, bands))
    width = crop.columns.stop - crop.columns.start

    def between(first: int, last: int) -> csr_array:
        row, column = np.divmod(np.arange(first * width, last * width), width)
        return nodes.weights(row + crop.rows.start, column + crop.columns.start)

    typical = lighting.typical @ lighting.spectra
    responses = typical[:, None, :] * (view.sensitivities * view.grid.weights_nm)
    errors = pixel_errors.PixelErrors(
        between, pixel_errors.White(np.maximum(white, 1e-30), log, np.zeros_like(log)), lighting,
        np.zeros(bands), np.outer(scene.veil, scene.veil),
        gloss.gloss_states(scene.surface, [""] * bands), disagreement,
        [(_calibration_under(scene, colour),) for colour in typical], np.zeros(bands, int),
        responses / responses.sum(axis=2, keepdims=True), scene.prior)
    flags = np.full(nodes.surface.shape, pixel_flags.SEEN, np.uint8)
    region = nodes.region
    flags[(uneven > PENUMBRA_ERROR)[region]] = pixel_flags.PENUMBRA
    flags[(lighting.maps == 0).all(axis=1)[region]] = pixel_flags.DARK
    flags[scene.edges | (region < 0) | scene.lamp[region]] = pixel_flags.EDGE
    return lit_photo.LitPhoto(crop_photo(view.photo, crop), errors, flags[crop.rows, crop.columns],
                    highlights=True), scale


def _calibration_under(scene: traced_photo.TracedPhoto, light: np.ndarray) -> Calibration:
    """The calibration with the light (P,) that reaches a pixel in place of the lamp's own."""
    lamp, own = scene.view.light, scene.calibration.light
    factor = np.interp(own.grid.nm, scene.view.grid.nm,
                       light / np.maximum(lamp, DARK_LAMP * lamp.max()))
    error = None if own.standard_error is None else own.standard_error * factor
    return replace(scene.calibration, light=replace(own, values=own.values * factor,
                                                    standard_error=error))
