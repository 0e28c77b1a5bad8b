"""The session report: one HTML file that opens offline and carries its own numbers."""
from __future__ import annotations

from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup

from spectrabox.radiometry.files import whole_file
from spectrabox.radiometry.records import Calibration, Reconstruction
from spectrabox.session.report import words
from spectrabox.session.report.figures import loss_figure, picture_data_uri
from spectrabox.session.report.maps import (
    pair_figure,
    residual_figure,
    residual_limit,
    residual_maps,
    surface_figure,
)
from spectrabox.session.report.methods import methods_text, scale_words
from spectrabox.session.report.numbers import report_numbers
from spectrabox.session.report.safe_json import json_for_script
from spectrabox.session.report.spectra import light_figure, sensitivity_figure
from spectrabox.session.report.svg import band_colours, report_style
from spectrabox.session.report.tables import (
    chart_section,
    held_out_rms,
    input_rows,
    material_section,
    surface_rows,
)
from spectrabox.session.report.verdict import judge
from spectrabox.session.store.results import CommonResults, SessionResults

TEMPLATES = Path(__file__).parent / "templates"
FILTERS = {"percent": words.percent, "signed_percent": words.signed_percent, "number": words.number,
           "fixed": words.fixed, "exposure": words.exposure, "fact": words.fact}


def write_report(results: SessionResults) -> Path:
    """Write ``report.html`` into the session folder, whole or not at all.

    Returns
    -------
    Path
        The report.

    Raises
    ------
    InputError
        If a picture that the report embeds is missing.
    EnvironmentProblem
        If the folder cannot be written; an older report is left as it was.
    """
    return written_whole(results.folder, render_report(results))


def written_whole(folder: Path, page: str) -> Path:
    """Write a page as ``report.html`` into a session folder, whole or not at all.

    Raises
    ------
    EnvironmentProblem
        If the folder cannot be written; an older report is left as it was.
    """
    report = folder / "report.html"
    with whole_file(report) as unfinished:
        unfinished.write_bytes(page.encode("utf-8", "backslashreplace"))
    return report


def render_report(results: SessionResults) -> str:
    """The page as text; every name, note and file name of the session is escaped."""
    with report_style():
        return rendered("report.html.j2", _page(results))


def rendered(template: str, content: dict[str, Any]) -> str:
    """A page from one of the templates; what it is given is escaped unless it is Markup."""
    environment = jinja2.Environment(loader=jinja2.FileSystemLoader(TEMPLATES), autoescape=True,
                                     trim_blocks=True, lstrip_blocks=True,
                                     undefined=jinja2.StrictUndefined)
    environment.filters.update(FILTERS)
    return environment.get_template(template).render(content)


def _page(results: SessionResults) -> dict[str, Any]:
    verdict = judge(results)
    return {
        "results": results, "verdict": verdict,
        "style": Markup((TEMPLATES / "report.css").read_text()),
        "script": Markup((TEMPLATES / "report.js").read_text()),
        "numbers": json_for_script(report_numbers(results, verdict)),
        "preview": picture_data_uri(results.photo_preview),
        "bands": list(zip(results.bands, band_colours(results.bands), strict=True)),
        "materials": [material_section(number, material, results.reconstruction.grid.nm,
                                       results.signal_bands)
                      for number, material in enumerate(results.materials, start=1)],
        "surfaces": {"title": "Materials", "one": "Material", "fitted": True},
        "agreement": _agreement_section("", results.reconstruction, results.calibration,
                                        results.bands),
        "views": _view_sections(results),
        "calibration": calibration_section(results, scale_words(results.light_scale)),
        "loss": loss_figure("loss", results.reconstruction.loss_history),
        "inputs": input_rows(results), "methods": methods_text(results),
        }


def _agreement_section(name: str, made: Reconstruction, calibration: Calibration,
                       bands: tuple[str, ...]) -> dict[str, Any]:
    """Of one photo; ``name`` keeps its figures apart from those of others."""
    return {
        "words": words.disagreement(made.agreement, bands), "off": words.OFF,
        "pair": pair_figure(f"pair{name}", made, calibration.sensitivity, bands),
        "residuals": residual_figure(f"residuals{name}", made, bands),
        "limit": residual_limit(residual_maps(made)),
        "surfaces": surface_figure(f"surfaces{name}", made), "rows": surface_rows(made),
        "bands": list(zip(bands, band_colours(bands), strict=True)),
        "scale": scale_words(made.light_scale),
        }


def _view_sections(results: SessionResults) -> list[dict[str, Any]]:
    return [_agreement_section(f"-{number}", view.reconstruction, view.calibration, view.bands)
            | {"name": view.name, "preview": picture_data_uri(view.photo_preview),
               "light": light_figure(f"light-{number}", view.calibration.light,
                                     view.calibration.light_posterior),
               "light_source": view.calibration.light.source,
               "scale_source": view.reconstruction.light_scale.source} for number,
            view in enumerate(results.views, start=2)]


def calibration_section(results: CommonResults, scale: str | None) -> dict[str, Any]:
    """What the report shows of the calibration; ``scale`` is that of the light in words, where
    there is one.
    """
    fit = results.calibration.sensitivity
    return {
        "chart": chart_section(results), "held_out_rms": held_out_rms(results),
        "scale": scale,
        "sensitivity": sensitivity_figure("sensitivity", fit, results.bands,
                                          results.sensitivity_truth),
        "light": light_figure("light", results.calibration.light,
                              results.calibration.light_posterior),
        }
