"""What a finished session of flat samples says to a script and to a person."""
from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.radiometry.appearance import lab_from_xyz, tristimulus
from spectrabox.session.calibration_facts import left_out_facts
from spectrabox.session.flat.flat_results import FlatResults
from spectrabox.session.pictures.picture_results import picture_facts
from spectrabox.session.report.numbers import family_facts
from spectrabox.session.report.verdict import judge
from spectrabox.session.report.words import percent
from spectrabox.session.store.results import MaterialResult

STEP_NM = 5     # of the spectra in the facts; spectra.csv holds every nanometre


def flat_facts(results: FlatResults, report: Path) -> dict[str, Any]:
    """The ``--json`` object of ``flat``, and of ``run`` on a session of flat samples.

    Parameters
    ----------
    report : Path
        Of report.html.
    """
    verdict = judge(results)
    return {"report": str(report), "spectra": str(report.with_name("spectra.csv")),
            "verdict": verdict.status.name.lower(), "says": verdict.sentence,
            "stages": results.stages,
            "regions": [_region(region, results) for region in results.materials],
            "left_out": None if results.chart is None or results.chart.left_out is None
            else left_out_facts(results.chart.left_out, results.chart.layout.names),
            "light": results.light,
            **({} if results.picture is None else {"picture": picture_facts(results.picture)}),
            "warnings": results.warnings,
            "seconds": float(sum(stage["seconds"] for stage in results.stages
                                 if stage["state"] == "run"))}


def flat_text(results: FlatResults) -> str:
    """A table of regions and the verdict."""
    from rich.console import Console
    from rich.table import Table

    table = Table(title=results.name, title_justify="left", title_style="bold")
    for heading in ("region", "L*a*b* under D65", "band width", "light known to", "RMSE",
                    "95 % band holds", "dE00"):
        table.add_column(heading, justify="left" if heading == "region" else "right")
    light = {name: error for photo in results.photos for name, (_, error) in photo.light.items()}
    for region in results.materials:
        table.add_row(region.name, *_cells(region, light.get(region.name)))
    stream = io.StringIO()
    Console(file=stream, width=110).print(table)
    verdict = judge(results)
    lines = [stream.getvalue().rstrip(), f"verdict: {verdict.status.name}. {verdict.sentence}"]
    if results.picture is not None:
        lines.append(results.picture.sentence)
    lines += [f"warning: {sentence}" for sentence in results.warnings]
    return "\n".join(lines)


def _cells(region: MaterialResult, light_error: float | None) -> list[str]:
    if region.summary is None:
        return ["given"] + [""] * 5
    summary = region.summary
    lab = " ".join(f"{value:.1f}" for value in _lab(summary.grid.nm, summary.mean))
    cells = [lab, f"{np.mean(summary.upper - summary.lower):.3f}",
             "" if light_error is None else percent(light_error)]
    if region.scores is None:
        return [*cells, "", "", ""]
    return [*cells, f"{region.scores.rmse_mean:.4f}", f"{region.scores.coverage_95:.0%}",
            f"{region.scores.delta_e00_mean:.2f}"]


def _region(region: MaterialResult, results: FlatResults) -> dict[str, Any]:
    seen = np.isfinite(region.signal)
    facts: dict[str, Any] = {
        "name": region.name, "known": region.summary is None,
        "signal": region.signal[seen].tolist(),
        "bands": [band for band, shown in zip(results.signal_bands, seen, strict=True) if shown]}
    if region.summary is not None:
        summary = region.summary
        every = slice(None, None, STEP_NM)
        facts |= {"wavelengths_nm": summary.grid.nm[every].tolist()}
        facts |= {name: getattr(summary, name)[every].tolist()
                  for name in ("mean", "standard_deviation", "lower", "upper", "bound_lower",
                               "bound_upper")}
        facts |= {"level": summary.level, "next_measurement_nm": summary.next_measurement_nm,
                  "lab_d65": _lab(summary.grid.nm, summary.mean),
                  "families": family_facts(region),
                  "outcome": None if region.samples is None else region.samples.outcome.name,
                  "error_budget": {cause: errors.tolist()
                                   for cause, errors in region.error_budget.items()},
                  "variance_shares": region.variance_shares}
    light = [photo.light[region.name] for photo in results.photos if region.name in photo.light]
    if light:
        facts |= {"light": light[0][0], "light_error": light[0][1]}
    if region.scores is not None:
        facts |= {"rmse_mean": region.scores.rmse_mean, "coverage_95": region.scores.coverage_95,
                  "coverage_bounds": region.scores.coverage_bounds,
                  "delta_e00_mean": region.scores.delta_e00_mean}
    return facts


def _lab(nm: np.ndarray, reflectance: np.ndarray) -> list[float]:
    """L*, a*, b* of a reflectance under D65, 2 degree observer."""
    white = tristimulus(nm, np.ones(nm.size))
    return [float(value) for value in lab_from_xyz(tristimulus(nm, reflectance), white)]
