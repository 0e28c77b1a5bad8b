"""Criteria of scenes: photo against rendering, the fit."""
from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from spectrabox.calibrate import chart_findings
from spectrabox.measure.captured import FIRST_PHOTO
from spectrabox.measure.verdict.criterion import (
    CLIPPED_LIMITS,
    Criterion,
    Status,
    graded,
    limit_words,
    outcome_criterion,
    where_of,
)
from spectrabox.measure.words import deviation_words, listed, percent
from spectrabox.radiometry.records.scenes import Reconstruction, SurfaceAgreement
from spectrabox.reconstruct.known_light import LAMP_COLOUR_ERROR
from spectrabox.reconstruct.misfit import FALSE_ALARM, common_cause

if TYPE_CHECKING:
    from spectrabox.measure.results.scene_result import SceneResult

# |photo / rendering - 1|: pass up to the first, fail beyond the second
MEDIAN_LIMITS = (0.02, 0.05)
WORST_LIMITS = (0.05, 0.15)
CHART_WARNING, SURFACE_WARNING = 0.03, 0.05     # of what a warning names
MAX_NAMED = 3                         # surfaces that the verdict names
# Standard errors: by which known surfaces and chart may differ in the level of the light, or a band
# of it in colour. One of a hundred right pairs of photos differs by 2.6 in level.
LIGHT_DOUBTED = 3.0
# of sessions with a picture, whose surfaces may have as many spectra as pixels
PATTERNS = ("One spectrum for each material does not fit every surface. It cannot fit those with "
            "patterns, and the picture, with a spectrum for every pixel, does not rest on it; of "
            "plain surfaces check light, position and paint.")


def scene_criteria(found: SceneResult) -> list[Criterion]:
    """Photo against rendering, misfits, the fit, rehearsal."""
    photos = [("", found.reconstruction, found.bands)]
    photos += [(where_of(view.name), view.reconstruction, view.bands)
               for view in found.views]
    agreement = [*(_median_surface(photo.agreement, where) for where, photo, _ in photos),
                 *(_worst_surface(photo.agreement, bands, where) for where, photo, bands in photos)]
    misfits = [_misfits(photo, bands, where) for where, photo, bands in photos]
    if found.picture is not None:
        agreement = [replace(each, status=Status.INFO) for each in agreement]
        misfits = [each if each.status is Status.PASS else
                   replace(each, status=Status.WARN, sentence=PATTERNS) for each in misfits]
    return [*agreement, *misfits,
            outcome_criterion("Inverse rendering", found.reconstruction.outcome),
            *_known_light(found), *_rehearsal(found)]


def _median_surface(agreement: SurfaceAgreement, where: str) -> Criterion:
    name = f"Photo against rendering, |ratio − 1| of the worst band, median over surfaces{where}"
    value = median_surface_error(agreement)
    if value is None:
        return Criterion(name, None, "not measured", limit_words(MEDIAN_LIMITS), Status.WARN,
                         f"No surface could be compared with the photo{where}.")
    return graded(name, value, MEDIAN_LIMITS,
                   f"Half of the surfaces agree with the photo within {percent(value)} in every "
                   f"band{where}.")


def _worst_surface(agreement: SurfaceAgreement, bands: tuple[str, ...], where: str) -> Criterion:
    name = f"Photo against rendering, worst surface{where}"
    worst = worst_entry(agreement)
    if worst is None:
        return Criterion(name, None, "not measured", limit_words(WORST_LIMITS), Status.WARN,
                         f"The worst surface{where} is unknown.")
    surface, band = worst
    ratio = float(agreement.ratio[worst])
    fits = "fits least" if abs(ratio - 1) <= WORST_LIMITS[0] else "does not fit"
    return graded(name, abs(ratio - 1), WORST_LIMITS,
                   f"The surface “{agreement.names[surface]}”{where} {fits}: in band {bands[band]} "
                   f"the photo is {deviation_words(ratio)} than the rendering.",
                   (agreement.materials[surface],))


def _misfits(made: Reconstruction, bands: tuple[str, ...], where: str) -> Criterion:
    """Surfaces whose deviation neither chance nor the stated errors explain."""
    name = f"Surfaces beyond chance and stated errors (p < {FALSE_ALARM:g}){where}"
    limit = f"none; fail beyond {percent(WORST_LIMITS[1], 0)}"
    if not made.misfits:
        return Criterion(name, 0.0, "none", limit, Status.PASS,
                         f"No surface{where} is off by more than chance and stated errors explain.")
    worst = max(abs(misfit.deviation) for misfit in made.misfits)
    status = Status.WARN if worst <= WORST_LIMITS[1] else Status.FAIL
    sentence = common_cause(made.agreement, made.misfits, bands)
    if sentence is None:
        named = [misfit.sentence for misfit in made.misfits[:MAX_NAMED]]
        if (more := len(made.misfits) - MAX_NAMED) > 0:
            named.append(f"{more} more do not fit")
        sentence = f"{'. '.join(named)}."
    materials = dict(zip(made.agreement.names, made.agreement.materials, strict=True))
    return Criterion(name, worst, f"{len(made.misfits)}, off by up to {percent(worst)}", limit,
                     status, f"In{where[3:]}: {sentence}" if where else sentence,
                     tuple(dict.fromkeys(materials[misfit.surface] for misfit in made.misfits
                                         if misfit.surface in materials)))


def _known_light(found: SceneResult) -> list[Criterion]:
    """How the light on known surfaces differs from the chart's, and whether it may."""
    photos = [("", found.reconstruction),
              *((where_of(view.name), view.reconstruction) for view in found.views)]
    rows = []
    for where, made in photos:
        light = made.known_light
        if light is None:
            continue
        names = listed([f"“{name}”" for name in light.materials])
        if light.level is not None:
            rows.append(_doubted(
                f"Level of the light on known surfaces against the chart's{where}",
                abs(light.level - 1), light.contradiction,
                f"On {names}, of known spectrum, the light is {deviation_words(light.level)} than "
                "chart, positions and exposures give", light.materials))
        colour = float(np.abs(light.colour - 1).max())
        rows.append(_doubted(
            f"Colour of the light on known surfaces against the chart's{where}", colour,
            colour / LAMP_COLOUR_ERROR,
            f"On {names} the light of a band is up to {percent(colour)} off the colour that the "
            "chart's photo gives", light.materials))
    return rows


def _doubted(name: str, size: float, errors: float, sentence: str,
             materials: tuple[str, ...]) -> Criterion:
    """What a known surface corrects, doubted where it is beyond what can have changed."""
    status = Status.PASS if errors <= LIGHT_DOUBTED else Status.WARN
    return Criterion(name, errors, f"{percent(size)}, {errors:.1f} standard errors",
                     f"pass up to {LIGHT_DOUBTED:.0f} standard errors", status,
                     f"{sentence}, which is corrected." if status is Status.PASS else
                     f"{sentence}, {errors:.1f} standard errors: check its stated spectrum, its "
                     "place in the scene, and lamp and exposure of both photos.", materials)


def _rehearsal(found: SceneResult) -> list[Criterion]:
    """Whether bands held known truths in the last rehearsal."""
    rehearsed = found.rehearsal
    if rehearsed is None:
        return []
    worst = rehearsed.worst.coverage
    return [Criterion("Known truth inside the band, rehearsed; worst material", worst,
                      percent(worst), f"{percent(rehearsed.level)} intended",
                      Status.WARN if rehearsed.too_narrow else Status.PASS,
                      f"R{rehearsed.sentence[1:]}.")]


def clipped_pixels(share: float) -> Criterion:
    """Whether much of the object photo is clipped."""
    return graded("Clipped pixels, left out of the fit", share, CLIPPED_LIMITS,
                  f"{percent(share)} of the object photo is clipped and was left out.")


def scene_warnings(found: SceneResult) -> list[str]:
    """What to beware of in the reconstruction of a scene."""
    warnings = []
    views = {FIRST_PHOTO: found.reconstruction,
             **{view.name: view.reconstruction for view in found.views}}
    misfits = [(name, misfit) for name, made in views.items() for misfit in made.misfits]
    named = {misfit.surface: None for _, misfit in misfits}
    if misfits and found.picture is not None:
        warnings.append(f"One spectrum each does not fit {', '.join(named)}: it cannot where there "
                        "are patterns, of which the picture has every pixel's; elsewhere check "
                        "light, position and paint.")
    elif len(views) == 1:
        warnings += [misfit.sentence for _, misfit in misfits]
    else:
        warnings += [f"In the photo “{name}” {misfit.sentence}" for name, misfit in misfits]
    rms = chart_findings.root_mean_square(found.calibration.sensitivity.residuals)
    if rms is not None and rms > CHART_WARNING:
        warnings.append(f"The chart's patches disagree with the fitted camera by {rms:.1%} rms: "
                        "look for glare, uneven light or another chart.")
    agreement = found.reconstruction.agreement
    for name, ratio in zip(agreement.names, agreement.ratio, strict=True):
        off = ratio - 1
        if np.abs(off).max() > SURFACE_WARNING and name not in named:
            warnings.append(f"Photo and rendering disagree on {name} by "
                            f"{off[np.argmax(np.abs(off))]:+.0%} in the worst band: geometry, "
                            "light or material of this surface is not as the scene says.")
    if not found.by_flat_field:
        warnings.append("No flat-field photo: vignetting is not corrected and counts as "
                        "reflectance.")
    if not found.scale_from_chart or found.calibration.light_scale is None:
        warnings.append("The light scale rests on the spectrum given for a known material.")
    fit = found.calibration.sensitivity
    if fit.basis is None and fit.residuals is None:
        warnings.append("The sensitivities were taken from a file and not checked against a chart "
                        "photo.")
    return warnings


def worst_entry(agreement: SurfaceAgreement) -> tuple[int, int] | None:
    """Surface and band of the largest |ratio - 1|, None where no surface was compared.

    Returns
    -------
    tuple of int or None
        Its row and column in ``agreement.ratio``.
    """
    deviation = np.abs(agreement.ratio - 1)
    if not np.isfinite(deviation).any():
        return None
    surface, band = np.unravel_index(np.nanargmax(deviation), deviation.shape)
    return int(surface), int(band)


def median_surface_error(agreement: SurfaceAgreement) -> float | None:
    """Median over surfaces of |ratio - 1| in the worst band, None where no surface was compared."""
    worst = np.abs(agreement.ratio - 1).max(axis=1, initial=0)
    finite = worst[np.isfinite(worst)]
    return float(np.median(finite)) if finite.size else None
