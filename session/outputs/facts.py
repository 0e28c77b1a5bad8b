"""What a finished run answers, to a script as JSON and to a person as a table."""
from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.measure.chart_check import held_out_facts, light_facts
from spectrabox.measure.verdict.evidence import MaterialResult
from spectrabox.measure.verdict.judge import judge
from spectrabox.measure.verdict.scene import median_surface_error
from spectrabox.measure.words import percent
from spectrabox.radiometry.appearance import reflectance_to_lab
from spectrabox.radiometry.spectra.kept_cameras import known_camera, known_camera_words
from spectrabox.session.outputs.results import FlatResults, SceneResults, SessionResults
from spectrabox.session.pictures.picture_results import picture_facts
from spectrabox.session.report.numbers import family_facts
from spectrabox.session.terminal.tables import text_table

STEP_NM = 5     # of regions' spectra in the facts; spectra.csv holds every nanometre


def run_facts(results: SessionResults, report: Path) -> dict[str, Any]:
    """The ``--json`` object of ``run``, ``demo`` and ``flat``.

    Parameters
    ----------
    results : SessionResults
    report : Path
        Of report.html.
    """
    verdict, chart = judge(results), results.chart
    facts = {"report": str(report), "spectra": str(report.with_name("spectra.csv")),
             "verdict": verdict.status.name.lower(), "says": verdict.sentence,
             "stages": results.stages,
             "left_out": None if chart is None or chart.left_out is None
             else held_out_facts(chart.left_out, chart.layout.names),
             "light": light_facts(results.calibration),
             **({} if results.picture is None else {"picture": picture_facts(results.picture)}),
             "known_camera": known_camera(results.photo.camera), "warnings": results.warnings}
    if isinstance(results, FlatResults):
        return facts | {
            "swatches": results.swatches or None,
            "regions": [_region_facts(region, results) for region in results.materials],
            "photos": [{"name": photo.name, "says": photo.sentence, "shift_px": photo.shift_px,
                        "residual_px": photo.residual_px, "left_out_bands": photo.silent_bands,
                        "chart_held": photo.chart_held} for photo in results.photos],
            "seconds": float(sum(stage["seconds"] for stage in results.stages
                                 if stage["state"] == "run"))}
    agreement, scale = results.reconstruction.agreement, results.light_scale
    return facts | {
        "materials": [_material_facts(material) for material in results.materials],
        "surfaces": [{"name": name, "ratio": ratio.tolist()}
                     for name, ratio in zip(agreement.names, agreement.ratio, strict=True)],
        "median_surface_error": median_surface_error(agreement),
        "light_scale": {"value": scale.value, "standard_error": scale.standard_error,
                        "common_errors": {error.cause: error.relative
                                          for error in scale.common_errors}}}


def _material_facts(material: MaterialResult) -> dict[str, Any]:
    facts = _surface_facts(material)
    if material.summary is not None:
        facts["band_width"] = float(np.mean(material.summary.upper - material.summary.lower))
    if material.scores is not None:
        facts["rmse_inverse_rendering"] = material.scores.rmse_inverse_rendering
    return facts


def _region_facts(region: MaterialResult, results: FlatResults) -> dict[str, Any]:
    seen = np.isfinite(region.signal)
    facts = _surface_facts(region) | {
        "signal": region.signal[seen].tolist(),
        "bands": [band for band, shown in zip(results.signal_bands, seen, strict=True) if shown]}
    if (summary := region.summary) is not None:
        every = slice(None, None, STEP_NM)
        facts |= {"wavelengths_nm": summary.grid.nm[every].tolist(),
                  "lab_d65": reflectance_to_lab(summary.grid.nm, summary.mean).tolist()}
        facts |= {name: getattr(summary, name)[every].tolist()
                  for name in ("mean", "standard_deviation", "lower", "upper", "bound_lower",
                               "bound_upper")}
    light = [photo.light[region.name] for photo in results.photos if region.name in photo.light]
    if scatter := [photo.scatter[region.name] for photo in results.photos
                   if region.name in photo.scatter]:
        facts["scatter"] = max(scatter)
    if light:
        facts |= {"light": light[0][0], "light_error": light[0][1]}
    return facts


def _surface_facts(surface: MaterialResult) -> dict[str, Any]:
    """What is answered of a material and of a region alike."""
    facts: dict[str, Any] = {"name": surface.name, "known": surface.summary is None}
    if surface.summary is not None:
        facts |= {"level": surface.summary.level,
                  "outcome": None if surface.samples is None else surface.samples.outcome.name,
                  "next_measurement_nm": surface.summary.next_measurement_nm,
                  "error_budget": {cause: errors.tolist()
                                   for cause, errors in surface.error_budget.items()},
                  "variance_shares": surface.variance_shares, "families": family_facts(surface)}
    if (scores := surface.scores) is not None:
        facts |= {"rmse_mean": scores.rmse_mean, "coverage_95": scores.coverage_95,
                  "coverage_bounds": scores.coverage_bounds,
                  "delta_e00_mean": scores.delta_e00_mean}
    return facts


def run_text(results: SessionResults) -> str:
    """A line for each surface and the verdict with its reason, for a person.

    Parameters
    ----------
    results : SessionResults
    """
    verdict, lines = judge(results), [_surface_table(results)]
    if results.picture is not None:
        lines.append(results.picture.sentence)
        lines += results.picture.notes
    if results.swatches:
        lines.append(results.swatches)
    if isinstance(results, FlatResults) and len(results.photos) > 1:
        lines += [f"photo {photo.name}: {photo.sentence}" for photo in results.photos]
    if (known := known_camera(results.photo.camera)) is not None:
        lines.append(known_camera_words(known))
    lines += [f"warning: {sentence}" for sentence in results.warnings]
    return "\n".join([*lines, f"verdict: {verdict.status.name}. {verdict.sentence}"])


def _surface_table(results: SessionResults) -> str:
    """A row for each surface: colour, width of the band, and how the truth compares, where given.
    """
    fitted = isinstance(results, SceneResults)
    light = {} if isinstance(results, SceneResults) else {
        name: error for photo in results.photos for name, (_, error) in photo.light.items()}
    truths = any(surface.scores is not None for surface in results.materials)
    headings = ["material" if fitted else "region", "L*a*b* under D65", "band width",
                *(["light known to"] if light else []),
                *(["95 % band holds", "RMSE"] if truths else []),
                *(["RMSE inverse rendering"] if truths and fitted else []),
                *(["dE00"] if truths else []), "measure next"]
    rows = []
    for surface in sorted(results.materials, key=lambda surface: surface.summary is None):
        if (summary := surface.summary) is None:
            rows.append([surface.name, "given", *[""] * (len(headings) - 2)])
            continue
        cells = [" ".join(f"{value:.1f}" for value in reflectance_to_lab(
            summary.grid.nm, summary.mean)), f"{surface.band_width:.3f}"]
        if light:
            error = light.get(surface.name)
            cells.append("" if error is None else percent(error))
        if truths:
            scores = surface.scores
            cells += [""] * (4 if fitted else 3) if scores is None else [
                percent(scores.coverage_95), f"{scores.rmse_mean:.4f}",
                *([f"{scores.rmse_inverse_rendering:.4f}"] if fitted else []),
                f"{scores.delta_e00_mean:.2f}"]
        rows.append([surface.name, *cells, f"{summary.next_measurement_nm:.0f} nm"])
    return text_table(headings, rows, text=headings[:1], title=results.name)
