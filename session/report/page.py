"""The session report: one HTML file that opens offline and carries its own numbers, and the same
numbers beside it.
"""
from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from markupsafe import Markup

from spectrabox.radiometry.files import whole_file
from spectrabox.radiometry.records import Calibration, Reconstruction
from spectrabox.session.picture.picture_results import PictureOfSpectra
from spectrabox.session.report import words
from spectrabox.session.report.checked.drawing import drawings_in
from spectrabox.session.report.figures import loss_figure, picture_data_uri, picture_digest
from spectrabox.session.report.geometry import geometry_section
from spectrabox.session.report.maps import (
    pair_figure,
    residual_figure,
    residual_limit,
    residual_maps,
    surface_figure,
)
from spectrabox.session.report.methods import methods_text, scale_words
from spectrabox.session.report.numbers import report_numbers
from spectrabox.session.report.page_templates import TEMPLATES, compiled
from spectrabox.session.report.safe_json import json_for_script
from spectrabox.session.report.spectra import light_figure, sensitivity_figure
from spectrabox.session.report.svg import band_colours, report_style
from spectrabox.session.report.tables import (
    chart_section,
    held_out_rms,
    input_rows,
    material_sections,
    surface_rows,
)
from spectrabox.session.report.verdict import Verdict, judge
from spectrabox.session.store.results import CommonResults, SessionResults

PAGE_NAME, NUMBERS_NAME = "report.html", "report.json"
REPORT = "report.html.j2"


def write_report(results: SessionResults) -> Path:
    """Write ``report.html`` and ``report.json`` into the session folder, each whole or not at all.

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


@dataclass(frozen=True)
class RenderedReport:
    """A page, and the JSON that it carries."""

    page: str
    numbers: str


def written_whole(folder: Path, report: RenderedReport) -> Path:
    """Write ``report.json`` and ``report.html`` into a session folder, each whole or not at all.

    Raises
    ------
    EnvironmentProblem
        If the folder cannot be written; an older report is left as it was.
    """
    with whole_file(folder / NUMBERS_NAME) as numbers, whole_file(folder / PAGE_NAME) as page:
        for path, text in ((numbers, report.numbers + "\n"), (page, report.page)):
            path.write_bytes(text.encode("utf-8", "backslashreplace"))
    return folder / PAGE_NAME


def render_report(results: SessionResults) -> RenderedReport:
    """The page as text; every name, note and file name of the session is escaped."""
    with report_style():
        verdict = judge(results)
        return rendered(REPORT, _page(results, verdict), report_numbers(results, verdict))


def rendered(template: str, content: dict[str, Any], numbers: dict[str, Any]) -> RenderedReport:
    """A page from one of the templates; what it is given is escaped unless it is Markup.

    Parameters
    ----------
    content : dict
        Of the page.
    numbers : dict
        Of its data; what is plotted, and digests of the pictures, are added.
    """
    written = json_for_script(numbers | {
        "plots": {drawing.name: drawing.facts for drawing in drawings_in(content)},
        "pictures": {name: picture_digest(uri) for name, uri in content["pictures"].items()}})
    common = {"numbers": written, "style": Markup((TEMPLATES / "report.css").read_text()),
              "script": Markup((TEMPLATES / "report.js").read_text()),
              "check_script": Markup((TEMPLATES / "check.js").read_text())}
    return RenderedReport(compiled(template).render(content | common), written)


def pictures_of(results: CommonResults) -> dict[str, str]:
    """The pictures that every report embeds, as data URIs by the name the page gives them."""
    pictures = {"photo": picture_data_uri(results.photo_preview)}
    if results.chart is not None:
        pictures["chart"] = picture_data_uri(results.chart.overlay)
    return pictures


def maps_of(picture: PictureOfSpectra | None) -> dict[str, str]:
    """The maps of a picture of spectra, as data URIs by their titles."""
    return {} if picture is None else {title: picture_data_uri(path)
                                       for title, path in picture.maps}


def _page(results: SessionResults, verdict: Verdict) -> dict[str, Any]:
    agreement = _agreement_section("", results.reconstruction, results.calibration,
                                   results.bands) | {
        "surfaces": surface_figure("surfaces", results.reconstruction)}
    return {
        "results": results, "verdict": verdict,
        "pictures": pictures_of(results) | {f"photo {view.name}": picture_data_uri(
            view.photo_preview) for view in results.views} | maps_of(results.picture),
        "picture": results.picture,
        "bands": list(zip(results.bands, band_colours(results.bands), strict=True)),
        "materials": material_sections(results.materials, results.reconstruction.grid.nm,
                                       results.signal_bands),
        "surfaces": {"title": "Materials", "key": "materials", "one": "Material",
                     "fitted": True},
        "agreement": agreement, "views": _view_sections(results),
        "calibration": calibration_section(results, scale_words(results.light_scale)),
        "geometry": geometry_section(results.geometry, {"": results.photo_preview} | {
            view.name: view.photo_preview for view in results.views}),
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
        "rows": surface_rows(made),
        "bands": list(zip(bands, band_colours(bands), strict=True)),
        "scale": scale_words(made.light_scale),
        }


def _view_sections(results: SessionResults) -> list[dict[str, Any]]:
    return [_agreement_section(f"-{number}", view.reconstruction, view.calibration, view.bands)
            | {"name": view.name,
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
