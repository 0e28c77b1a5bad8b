"""The session report: one HTML file that opens offline and embeds its own numbers."""
from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup

from spectrabox.measure import words
from spectrabox.measure.plot_style import band_colours
from spectrabox.measure.verdict.criteria import Verdict
from spectrabox.measure.verdict.judge import judge
from spectrabox.radiometry.files import whole_file
from spectrabox.radiometry.records import Calibration, Reconstruction
from spectrabox.session.outputs.results import FlatResults, SceneResults, SessionResults
from spectrabox.session.report import flat_figures
from spectrabox.session.report.cards import answer_card
from spectrabox.session.report.figures import loss_figure
from spectrabox.session.report.maps import (
    geometry_section,
    pair_figure,
    residual_figure,
    residual_limit,
    residual_maps,
    surface_figure,
)
from spectrabox.session.report.methods import methods_text, scale_words
from spectrabox.session.report.numbers import report_numbers
from spectrabox.session.report.pictures import picture_data_uri, picture_digest
from spectrabox.session.report.safe_json import json_for_script
from spectrabox.session.report.small_figures import field_whiskers
from spectrabox.session.report.spectra import light_figure, sensitivity_figure
from spectrabox.session.report.svg import Drawing
from spectrabox.session.report.tables import (
    chart_section,
    held_out_rms,
    input_rows,
    material_section,
    surface_rows,
)

PAGE_NAME, NUMBERS_NAME = "report.html", "report.json"
TEMPLATES = Path(__file__).parent / "templates"
FILTERS = {"percent": words.percent, "signed_percent": words.signed_percent, "number": words.number,
           "fixed": words.fixed, "exposure": words.exposure, "fact": words.fact, "lab": words.lab}
# a number and its unit stay on one line, "0.8 %" is written one way; not in scripts and styles
UNITS = re.compile(r"<(script|style)\b.*?</\1>|>[^<]+", re.DOTALL)
NUMBER_AND_UNIT = re.compile(r"(?<=\d) (?=(?:nm|px|s|mm|cm|m|K)\b)|(?<=\d) ?(?=%(?!\.?\w))")


@dataclass(frozen=True)
class RenderedReport:
    """A page, and the JSON that it embeds."""

    page: str
    numbers: str


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
    report, folder = render_report(results), results.folder
    with whole_file(folder / NUMBERS_NAME) as numbers, whole_file(folder / PAGE_NAME) as page:
        for path, text in ((numbers, report.numbers + "\n"), (page, report.page)):
            path.write_bytes(text.encode("utf-8", "backslashreplace"))
    return folder / PAGE_NAME


def render_report(results: SessionResults) -> RenderedReport:
    """The page as text; every name, note and file name of the session is escaped."""
    verdict = judge(results)
    content = _common_content(results, verdict) | (
        _flat_content(results) if isinstance(results, FlatResults) else _scene_content(results))
    numbers = json_for_script(report_numbers(results, verdict) | {
        "plots": {drawing.name: {"title": drawing.heading, "axes": drawing.axes}
                  for drawing in _drawings(content)},
        "pictures": {name: picture_digest(uri) for name, uri in content["pictures"].items()}})
    page = templates().get_template("report.html.j2").render(
        content | {"numbers": numbers, "style": style_sheet(),
                   "script": Markup((TEMPLATES / "report.js").read_text(encoding="utf-8"))})
    return RenderedReport(UNITS.sub(_with_units_kept, page), numbers)


def _with_units_kept(part: re.Match[str]) -> str:
    return part[0] if part[1] else NUMBER_AND_UNIT.sub("\u00a0", part[0])


@cache
def templates() -> jinja2.Environment:
    """The templates of all pages; they escape whatever is not Markup."""
    environment = jinja2.Environment(loader=jinja2.FileSystemLoader(TEMPLATES), autoescape=True,
                                     trim_blocks=True, lstrip_blocks=True,
                                     undefined=jinja2.StrictUndefined)
    environment.filters.update(FILTERS)
    return environment


def style_sheet() -> Markup:
    """The style sheet of all pages."""
    return Markup((TEMPLATES / "report.css").read_text(encoding="utf-8"))


def _common_content(results: SessionResults, verdict: Verdict) -> dict[str, Any]:
    """What the page of any session shows."""
    flat = isinstance(results, FlatResults)
    fit, light = results.calibration.sensitivity, results.calibration.light
    surfaces = sorted(results.materials, key=lambda surface: surface.summary is None)
    doubts = verdict.doubts
    pictures = {}
    if results.chart is not None and (not isinstance(results, FlatResults) or all(
            photo.chart_px is None for photo in results.photos)):
        pictures["chart"] = picture_data_uri(results.chart_overlay)
    if isinstance(results, SceneResults):
        pictures |= {f"photo {view.name}": picture_data_uri(results.previews[view.name])
                     for view in results.views}
    if results.picture is not None:
        pictures |= {title: picture_data_uri(path) for title, path in results.picture.maps}
    return {
        "results": results, "verdict": verdict, "scene": not flat, "pictures": pictures,
        "picture": results.picture,
        "bands": list(zip(results.bands, band_colours(results.bands), strict=True)),
        "surfaces": {"title": "Regions" if flat else "Materials",
                     "one": "Region" if flat else "Material", "fitted": not flat},
        "cards": [answer_card(number, surface, results.grid.nm, doubts.get(surface.name, ()))
                  for number, surface in enumerate(surfaces, start=1)],
        "level": next((surface.summary.level for surface in surfaces
                       if surface.summary is not None), None),
        "truths": any(surface.scores is not None for surface in surfaces),
        "problems": sorted((c for c in verdict.criteria if not c.passed),
                           key=lambda c: -c.status.value),
        "passed": [c for c in verdict.criteria if c.passed], "files": _files(results),
        "materials": [material_section(number, surface, results.grid.nm, results.signal_bands)
                      for number, surface in enumerate(surfaces, start=1)],
        "calibration": {
            "chart": chart_section(results), "held_out_rms": held_out_rms(results),
            "scale": None if isinstance(results, FlatResults) else scale_words(
                results.light_scale),
            "sensitivity": sensitivity_figure("sensitivity", fit, results.bands,
                                              results.sensitivity_truth),
            "light": light_figure("light", light, results.calibration.light_posterior)},
        "inputs": input_rows(results), "methods": methods_text(results),
        }


def _files(results: SessionResults) -> list[tuple[str, str]]:
    """Files next to the page that hold the spectra, and what is in each."""
    files = [("spectra.csv", "means, bands and bounds"), ("materials.csv", "colours"),
             ("spdx/", "one IES TM-27 file a surface")]
    if isinstance(results, SceneResults):
        files.append(("materials.xml", "for Mitsuba"))
    if results.picture is not None:
        files += [(str(name), "a spectrum for every pixel") for name in results.picture.files[:1]]
    return files


def _flat_content(results: FlatResults) -> dict[str, Any]:
    """What only the page of flat samples shows: its photos, with regions and light."""
    return {
        "geometry": None,
        "photos": [{"name": photo.name, "says": photo.sentence, "regions": photo.light,
                    "figure": flat_figures.photo_figure(f"photo-{number}", photo,
                                                            results.previews[photo.view]),
                    "light": flat_figures.light_figure(f"light-map-{number}", photo),
                    "whiskers": field_whiskers(photo.light)}
                   for number, photo in enumerate(results.photos, start=1)]}


def _scene_content(results: SceneResults) -> dict[str, Any]:
    """What only the page of a scene shows: photo against rendering, geometry, convergence."""
    fit = results.reconstruction
    return {
        "agreement": _agreement_section("", fit, results.calibration, results.bands) | {
            "surfaces": surface_figure("surfaces", fit)},
        "views": [_agreement_section(f"-{number}", view.reconstruction, view.calibration,
                                     view.bands)
                  | {"name": view.name, "light_source": view.calibration.light.source,
                     "light": light_figure(f"light-{number}", view.calibration.light,
                                           view.calibration.light_posterior),
                     "scale_source": view.reconstruction.light_scale.source}
                  for number, view in enumerate(results.views, start=2)],
        "geometry": geometry_section(results.geometry, results.previews),
        "loss": loss_figure("loss", fit.loss_history)}


def _agreement_section(name: str, fit: Reconstruction, calibration: Calibration,
                       bands: tuple[str, ...]) -> dict[str, Any]:
    """Photo against rendering of one photo; ``name`` ends the names of its figures."""
    return {
        "words": words.disagreement(fit.agreement, bands), "off": words.OFF,
        "pair": pair_figure(f"pair{name}", fit, calibration.sensitivity, bands),
        "residuals": residual_figure(f"residuals{name}", fit, bands),
        "limit": residual_limit(residual_maps(fit)),
        "rows": surface_rows(fit),
        "bands": list(zip(bands, band_colours(bands), strict=True)),
        "scale": scale_words(fit.light_scale),
        }


def _drawings(content: Any) -> Iterator[Drawing]:
    """Every drawing among the values of a page."""
    if isinstance(content, Drawing):
        yield content
    elif isinstance(content, dict):
        for value in content.values():
            yield from _drawings(value)
    elif isinstance(content, list | tuple):
        for value in content:
            yield from _drawings(value)
