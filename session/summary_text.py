"""What a finished run says on the terminal, to a person and to a script."""
from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.sampling.prior.family_coverage import certified_sentence, mostly_in_doubt
from spectrabox.session.calibration_facts import left_out_facts, light_facts
from spectrabox.session.pictures.picture_results import picture_facts
from spectrabox.session.report.numbers import family_facts
from spectrabox.session.report.verdict import judge, median_surface_error
from spectrabox.session.report.words import percent
from spectrabox.session.store.results import MaterialResult, SessionResults


def run_facts(results: SessionResults, report: Path) -> dict[str, Any]:
    """The ``--json`` object of ``run`` and ``demo``.

    Parameters
    ----------
    report : Path
        Of report.html.
    """
    agreement, verdict = results.reconstruction.agreement, judge(results)
    return {"report": str(report), "spectra": str(report.with_name("spectra.csv")),
            "verdict": verdict.status.name.lower(), "says": verdict.sentence,
            "stages": results.stages,
            "materials": [_material_facts(material, results) for material in results.materials],
            "surfaces": [{"name": name, "ratio": [float(value) for value in ratio]}
                         for name, ratio in zip(agreement.names, agreement.ratio, strict=True)],
            "median_surface_error": median_surface_error(agreement),
            "light_scale": {"value": results.light_scale.value,
                            "standard_error": results.light_scale.standard_error,
                            "common_errors": {error.cause: error.relative for error
                                              in results.light_scale.common_errors}},
            "left_out": None if results.chart is None or results.chart.left_out is None
            else left_out_facts(results.chart.left_out, results.chart.layout.names),
            "light": light_facts(results.calibration),
            **({} if results.picture is None else {"picture": picture_facts(results.picture)}),
            "warnings": results.warnings}


def run_text(results: SessionResults) -> str:
    """A table of materials and the few numbers that matter first."""
    from rich.console import Console
    from rich.table import Table

    table = Table(title=results.name, title_justify="left", title_style="bold")
    for heading in ("material", "RMSE mean", "RMSE inverse rendering", "95 % band holds",
                    "band width", "dE00", "measure next"):
        table.add_column(heading, justify="left" if heading == "material" else "right")
    for material in results.materials:
        table.add_row(material.name, *_cells(material))
    stream = io.StringIO()
    Console(file=stream, width=110, markup=False, emoji=False, highlight=False).print(table)
    lines = [stream.getvalue().rstrip(),
             "rendered signal within "
             f"{percent(median_surface_error(results.reconstruction.agreement))} of the photo "
             "(worst band, median over surfaces)",
             f"verdict: {judge(results).status.name}"]
    lines += [f"{material.name}: {certified_sentence(material.families)}"
              for material in results.materials if mostly_in_doubt(material.families)]
    if results.picture is not None:
        lines += [results.picture.sentence, *results.picture.notes]
    lines += [f"warning: {sentence}" for sentence in results.warnings]
    return "\n".join(lines)


def _cells(material: MaterialResult) -> list[str]:
    if material.summary is None:
        return ["given"] + [""] * 5
    width = f"{np.mean(material.summary.upper - material.summary.lower):.3f}"
    following = f"{material.summary.next_measurement_nm:.0f} nm"
    if material.scores is None:
        return ["", "", "", width, "", following]
    scores = material.scores
    return [f"{scores.rmse_mean:.4f}", f"{scores.rmse_inverse_rendering:.4f}",
            f"{scores.coverage_95:.0%}", width, f"{scores.delta_e00_mean:.2f}", following]


def _material_facts(material: MaterialResult, results: SessionResults) -> dict[str, Any]:
    facts: dict[str, Any] = {"name": material.name, "known": material.summary is None}
    if material.summary is not None:
        facts |= {"band_width": float(np.mean(material.summary.upper - material.summary.lower)),
                  "level": material.summary.level,
                  "outcome": None if material.samples is None else material.samples.outcome.name,
                  "next_measurement_nm": material.summary.next_measurement_nm,
                  "error_budget": {cause: [float(value) for value in errors]
                                   for cause, errors in material.error_budget.items()},
                  "variance_shares": material.variance_shares,
                  "families": family_facts(material)}
    if material.scores is not None:
        facts |= {"rmse_mean": material.scores.rmse_mean,
                  "rmse_inverse_rendering": material.scores.rmse_inverse_rendering,
                  "coverage_95": material.scores.coverage_95,
                  "coverage_bounds": material.scores.coverage_bounds,
                  "delta_e00_mean": material.scores.delta_e00_mean}
    return facts


