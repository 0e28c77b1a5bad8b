"""What must hold of the views before an inversion starts; each check says what to do."""
from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.response import white_signal
from spectrabox.reconstruct.view import View

DARK_BAND = 1e-6         # of the strongest band's light: below, a band has none
NEGATIVE_SIGMA = 6.0     # a pixel this far below zero is no noise
MAX_NEGATIVE = 1e-3      # share of such pixels that defects explain
MIN_PIXELS = 12          # of a material, below which its colour cannot be estimated


def check_views(views: Sequence[View]) -> None:
    """Refuse views from which no spectra can be estimated.

    Parameters
    ----------
    views : sequence of View

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


def _require_scales(views: Sequence[View]) -> None:
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


def _require_pixels(views: Sequence[View]) -> None:
    """Refuse a material that fills too few usable pixels in all views together."""
    for material in {material.bsdf: material for view in views
                     for material in view.materials}.values():
        seen = usable = 0
        for view in views:
            own = np.isin(view.surface,
                          [index for index, bsdf in enumerate(view.scene_file.surfaces.values())
                           if bsdf == material.bsdf])
            seen, usable = seen + int(own.sum()), usable + int((own & view.used).sum())
        if usable < MIN_PIXELS:
            raise InputError(
                f"material {material.name!r} fills {seen} pixels of the rendered "
                f"view{'s' if len(views) > 1 else ''}, {usable} of them usable (unsaturated, "
                f"lit, away from edges); {MIN_PIXELS} are needed: check pose and exposure, or "
                "raise [reconstruct] width")
