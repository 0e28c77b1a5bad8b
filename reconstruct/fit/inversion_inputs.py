"""What a reconstruction is given: materials, photos with all that explains them, settings; and the
checks of each.
"""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records import (
    Calibration,
    LightScale,
    LinearImage,
    Spectrum,
    WavelengthGrid,
)
from spectrabox.reconstruct.fit.transport_fit import SpectrumPrior, learnt_prior
from spectrabox.reconstruct.scene.scene_file import SceneFile
from spectrabox.reconstruct.settings import SPECTRUM_PRIORS, InversionSettings

DARK_BAND = 1e-6         # of the strongest band's light: below, a band has none
NEGATIVE_SIGMA = 6.0     # a pixel this far below zero is no noise
MOST_NEGATIVE = 1e-3     # share of such pixels that defects explain


@dataclass(frozen=True)
class MaterialSpec:
    """One material of the session: its BSDF in the scene, and its reflectance (P,) where that is
    known.
    """

    name: str
    bsdf: str
    reflectance: np.ndarray | None = None


@dataclass(frozen=True)
class View:
    """One photo with all that explains it: several views of the same materials make one
    reconstruction.

    ``light_scale`` is for this photo's exposure; None to find it from a known material, or from
    materials that another view of known scale shows too. ``light_spectra`` gives lights of the
    scene, by id, another spectrum than the calibration's. ``gain`` (H, W) or (H, W, K) is the
    camera's relative response over the picture: a flat field, or ``vignetting.cos4_gain``.
    """

    name: str
    scene_file: SceneFile
    photo: LinearImage
    calibration: Calibration
    bands: tuple[str, ...]
    light_scale: LightScale | None = None
    light_spectra: Mapping[str, Spectrum] = field(default_factory=dict)
    gain: np.ndarray | None = None


def spectrum_prior(settings: InversionSettings, grid: WavelengthGrid,
                   basis: np.ndarray) -> SpectrumPrior | None:
    """The learnt prior of the coefficients; None where the settings ask for smoothness or for
    nothing.

    Raises
    ------
    InputError
        If the settings name an unknown prior, or a learnt one without its data.
    """
    if settings.spectrum_prior not in SPECTRUM_PRIORS:
        raise InputError(f"there is no prior on spectra {settings.spectrum_prior!r}; "
                         f"use one of {', '.join(SPECTRUM_PRIORS)}")
    if settings.spectrum_prior != "learnt":
        return None
    if settings.learnt is None:
        raise InputError("a learnt prior on spectra needs the mean and covariance of measured "
                         "reflectances: give them, or choose the prior \"smooth\"")
    learnt = settings.learnt
    between = np.array([np.interp(grid.nm, learnt.nm, unit) for unit in np.eye(learnt.nm.size)]).T
    return learnt_prior(basis, between @ learnt.mean, between @ learnt.covariance @ between.T)


def gain_of_bands(gain: np.ndarray, shape: tuple[int, ...], source: str) -> np.ndarray:
    """A gain field (H, W, 1 or K) for a photo of ``shape`` (H, W, K), refused where it cannot be
    one.
    """
    full = gain[..., None] if gain.ndim == 2 else gain
    if full.shape[:2] != shape[:2] or full.shape[2] not in (1, shape[2]):
        raise InputError(f"{source}: the gain field has the shape {gain.shape}; {shape[:2]} or "
                         f"{shape} is needed")
    if not (np.isfinite(full).all() and full.min() > 0):
        raise InputError(f"{source}: the gain field must be positive everywhere; its least value "
                         f"is {full.min():.3g}")
    return full


def require_scales(views: Sequence[View], materials: tuple[MaterialSpec, ...]) -> None:
    """Every view needs a scale, a known material, or a material in common with a view that has
    either.
    """
    worn = [set(view.scene_file.surfaces.values()) for view in views]
    found = {material.bsdf for material in materials if material.reflectance is not None}
    waiting = list(range(len(views)))
    while told := [place for place in waiting if views[place].light_scale is not None or worn[place]
                   & found]:
        found |= set().union(*(worn[place] for place in told))
        waiting = [place for place in waiting if place not in told]
    if waiting:
        which = "" if len(views) == 1 else f" of {views[waiting[0]].name}"
        raise InputError(f"the light scale{which} is unknown: give one material its known "
                         "spectrum, or calibrate from a chart photo with [chart] scene")


def require_light(white: np.ndarray, bands: tuple[str, ...]) -> None:
    """Refuse a light that gives a band nothing, by the signal (K,) of a white surface."""
    dark = [name for name, value in zip(bands, white, strict=True) if not value > DARK_BAND
            * white.max()]
    if dark:
        raise InputError(f"the light gives the camera's band {', '.join(dark)} nothing (less than "
                         f"{DARK_BAND:g} of the strongest band): its photo says nothing; leave the "
                         "band out, or check the light spectrum")


def require_sound_pixels(photo: LinearImage) -> None:
    """Refuse a photo with pixels that are no numbers, or with many far below zero."""
    lost = int(np.count_nonzero(~np.isfinite(photo.signal).all(axis=2)))
    if lost:
        raise InputError(f"{photo.source}: {lost} pixels hold no number (NaN or infinity); mend or "
                         "mask them")
    below = photo.signal < -NEGATIVE_SIGMA * np.sqrt(photo.variance)
    if below.any(axis=2).mean() > MOST_NEGATIVE:
        raise InputError(f"{photo.source}: {below.any(axis=2).mean():.1%} of the pixels are "
                         "further below zero than noise explains; the black level taken off is too "
                         "high")
