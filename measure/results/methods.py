"""Paragraphs for the methods section of a paper, with the numbers of one measurement."""
from __future__ import annotations

from typing import TYPE_CHECKING

from spectrabox.calibrate.chart_findings import root_mean_square
from spectrabox.measure import rules, texts, words
from spectrabox.radiometry.records import calibration, spectra

if TYPE_CHECKING:
    from spectrabox.measure.results import capture_result, flat_result, scene_result


def flat_methods(result: flat_result.FlatResult) -> list[str]:
    """Paragraphs of a measurement of flat samples."""
    return [_capture(result, "Flat samples were"), _camera(result), _flat_light(result),
            _sampling(result)]


def scene_methods(result: scene_result.SceneResult) -> list[str]:
    """Paragraphs of a measurement of a scene."""
    scale = (f"The factor from rendered signal to the photo's signal, from "
             f"{result.light_scale.source}, is {scale_words(result.light_scale)}.")
    return [_capture(result, "The scene was"), f"{_camera(result)} {scale}",
            _reconstruction(result), _sampling(result), _agreement(result)]


def _capture(result: capture_result.CaptureResult, subject: str) -> str:
    photo = result.photo
    settings = [
        f"exposure {words.exposure(photo.exposure_s)}" if photo.exposure_s is not None else "",
        f"ISO {photo.iso:g}" if photo.iso is not None else "",
        f"f/{photo.f_number:g}" if photo.f_number is not None else ""
    ]
    stated = ", ".join(s for s in settings if s) or "exposure not stated"
    return (
        f"{subject} photographed with "
        f"{photo.camera or 'a camera that the file does not name'} ({photo.kind.value}; "
        f"{stated}). Signals are linear and black-subtracted, without white balance, in "
        f"{len(result.bands)} bands ({', '.join(result.bands)}); "
        f"{words.percent(photo.clipped_share)} of the pixels were clipped and left out.")


def _camera(result: capture_result.CaptureResult) -> str:
    fit = result.calibration.sensitivity
    parts = [f"Camera sensitivities: {fit.method}."]
    rms = root_mean_square(rules.chart_residuals(result))
    if rms is not None:
        parts.append(f"The rms residual over the chart patches is {words.percent(rms)}.")
    held_out = root_mean_square(fit.held_out_residuals)
    if held_out is not None:
        parts.append(
            f"Left out of its own fit, a patch is predicted within {words.percent(held_out)} "
            "rms.")
    if fit.condition_number is not None:
        parts.append(f"The condition number of the fit is {words.number(fit.condition_number, 3)}.")
    light: spectra.Spectrum = result.calibration.light
    parts.append(f"Light spectrum: {light.source}.")
    return " ".join(parts)


def scale_words(scale: calibration.LightScale) -> str:
    """A light scale with its standard error."""
    if scale.standard_error is None:
        return f"{words.number(scale.value)} (standard error not stated)"
    return (
        f"{words.number(scale.value)} ± {words.number(scale.standard_error, 2)} (standard error, "
        f"{words.percent(scale.standard_error / abs(scale.value))})")


def _reconstruction(result: scene_result.SceneResult) -> str:
    made = result.reconstruction
    unknown = [material.name for material in result.surfaces if material.summary is not None]
    given = [material.name for material in result.surfaces if material.summary is None]
    spectra = f"reflectances of {words.listed(unknown)} were" if unknown else "no reflectance was"
    known = f"; {words.listed(given)} given" if given else ""
    further = f" and {len(result.views)} more photo(s) in one fit " \
              f"({words.listed([*result.views])})" if result.views else ""
    nm = made.grid.nm
    return (f"By inverse rendering (engine: {made.engine}; {made.spp} samples per pixel, seed "
            f"{made.seed}), {spectra} found from {int(made.used.sum())} of {made.used.size} "
            f"pixels{further}{known}. Reflectances are clamped uniform cubic B-splines with "
            f"{made.basis.shape[1]} coefficients on {nm[0]:g}–{nm[-1]:g} nm. "
            f"{texts.sentence(made.outcome.finding())}")


def _sampling(result: capture_result.CaptureResult) -> str:
    drawn = [m for m in result.surfaces if m.samples is not None and m.summary is not None]
    if not drawn:
        return "No spectra were drawn: every material was given."
    methods = words.listed(sorted({m.samples.method for m in drawn if m.samples}))
    counts = sorted({len(m.samples.spectra) for m in drawn if m.samples})
    draws = str(counts[0]) if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"
    seeds = ", ".join(str(seed) for seed in sorted({m.samples.seed for m in drawn if m.samples}))
    effective = min(m.samples.effective_samples for m in drawn if m.samples)
    levels = words.listed(sorted({words.percent(m.summary.level) for m in drawn if m.summary}))
    return (f"Spectra that the camera cannot tell apart were drawn with {methods} ({draws} draws "
            f"per surface, seed {seeds}; at least {effective:.0f} effective). Bands are pointwise "
            f"central {levels} bands of the draws, conditional on the sampler's prior or spline "
            "class and on the stated errors of each signal.")


def _agreement(result: scene_result.SceneResult) -> str:
    agreement = result.reconstruction.agreement
    worst = rules.worst_entry(agreement)
    if worst is None:
        return "No surface could be compared between photo and rendering."
    half, name = words.percent(rules.median_surface_error(agreement)), agreement.names[worst[0]]
    off = words.deviation_words(float(agreement.ratio[worst]))
    return (f"Photo and rendering agree within {half} (worst of {len(result.bands)} bands, median "
            f"over {len(agreement.names)} surfaces); the worst surface is “{name}”, where the "
            f"photo is {off} in band {result.bands[worst[1]]}.")


def _flat_light(result: flat_result.FlatResult) -> str:
    errors = [error for photo in result.photos for _, error in photo.light.values()]
    known = list(dict.fromkeys(name for photo in result.photos for name in photo.level_misfits))
    given = f" Regions of known spectrum ({words.listed(known)}) corrected it." if known else ""
    card = " The photos were divided by one of a white card." if result.stated.flat_fields else ""
    return ("Signals of regions were divided by what a perfect white would read there: the white "
            "level and the quadratic light field of the chart fit, the field carried from the "
            "chart to the regions by regression over arrangements of lamps at unknown distances "
            f"and the lens's fall-off.{card}{given} The light on the regions is known within "
            f"{words.percent(min(errors))} to {words.percent(max(errors))}.")
