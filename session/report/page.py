"""The session report: one HTML file that opens offline and embeds its own numbers."""
from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from functools import cache, partial
from pathlib import Path
from typing import Any, TypeVar

import jinja2
from markupsafe import Markup

from spectrabox.calibrate import chart_findings
from spectrabox.measure import extras, plots, rules, texts, words
from spectrabox.measure.extras import attempt, different
from spectrabox.measure.results import capture_result, flat_result, methods, scene_result
from spectrabox.measure.surfaces import colour_comparison
from spectrabox.radiometry.appearance import reflectance_to_srgb
from spectrabox.radiometry.files import whole_file
from spectrabox.radiometry.findings import Finding
from spectrabox.radiometry.records.calibration import HeldOutPatches
from spectrabox.session.outputs.session_results import SessionResults
from spectrabox.session.report import figures, maps, spectra, svg
from spectrabox.session.report.cards import Card, answer_cards, assumed_of_all, tested_families
from spectrabox.session.report.numbers import flat_numbers, report_numbers, scene_numbers
from spectrabox.session.report.pictures import json_for_script, picture_data_uri, picture_digest
from spectrabox.session.report.spectra import swatch_pairs

PAGE_NAME, NUMBERS_NAME = "report.html", "report.json"
TEMPLATES = Path(__file__).parent / "templates"
PIECES = Path(__file__).parent.parent / "pieces"    # parts that the page of a session has too
FILTERS = {"percent": words.percent, "signed_percent": words.signed_percent, "number": words.number,
           "name": texts.name, "says": texts.says, "shown": texts.shown, "limit": texts.limit,
           "sentence": texts.sentence, "paragraph": texts.paragraph,
           "fixed": words.fixed, "exposure": words.exposure, "fact": words.fact, "lab": words.lab,
           "apart_nm": colour_comparison.apart_nm, "agreement_in": rules.agreement_in,
           "scale_words": methods.scale_words,
           "surface_colours": lambda names: maps.surface_colours(len(names)),
           "residual_limit": lambda fit: maps.residual_limit(maps.residual_maps(fit)),
           "in_colour": lambda bands: zip(bands, plots.band_colours(bands), strict=True)}
# a number and its unit stay on one line, "0.8 %" is written one way; not in scripts and styles
UNITS = re.compile(r"<(script|style)\b.*?</\1>|>[^<]+", re.DOTALL)
Kind = TypeVar("Kind", bound=Markup)
NUMBER_AND_UNIT = re.compile(r"(?<=\d) (?=(?:nm|px|s|mm|cm|m|K)\b)|(?<=\d) ?(?=%(?!\.?\w))")


# A page, the JSON that it embeds, and what of the session's extras could not be made.
Report = tuple[str, str, tuple[Finding, ...]]


def write_report(results: SessionResults) -> Path:
    """Write the report of a session.

    Parameters
    ----------
    results : SessionResults

    Returns
    -------
    Path
        As of ``store_report``.

    Raises
    ------
    EnvironmentProblem
        Likewise.
    """
    page, numbers, _ = rendered_report(results)
    return store_report(page, numbers, results.folder)


def rendered_report(results: SessionResults) -> Report:
    """The report; a plain page of what the terminal says where the full one cannot be laid out.

    Parameters
    ----------
    results : SessionResults
    """
    report, failed = attempt("full report", lambda: render_report(results), None)
    if report is not None:
        return report
    assert failed is not None
    every = (*results.found.failed_extras, failed)
    text = f"{results.text()}\nnote: {texts.sentence(failed)}"
    page = Markup('<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>Spectrabox '
                  "report: {}</title></head><body><h1>{}</h1><pre>{}</pre></body></html>\n").format(
        results.name, results.name, text)
    return str(page), json_for_script(
        results.facts() | {"failed_extras": [extras.facts(one) for one in every]}), every


def store_report(page: str, numbers: str, folder: Path) -> Path:
    """Write ``report.html`` and ``report.json`` into the session folder, each whole or not at all.

    Parameters
    ----------
    page, numbers : str
        As of ``rendered_report``.
    folder : Path

    Returns
    -------
    Path
        The report.

    Raises
    ------
    EnvironmentProblem
        If the folder cannot be written; an older report is left as it was.
    """
    with whole_file(folder / NUMBERS_NAME) as json_file, whole_file(folder / PAGE_NAME) as html:
        for path, text in ((json_file, numbers + "\n"), (html, page)):
            path.write_bytes(text.encode("utf-8", "backslashreplace"))
    return folder / PAGE_NAME


def render_report(results: SessionResults) -> Report:
    """The page as text; every name, note and file name of the session is escaped."""
    result = results.found
    cards = answer_cards(result.surfaces, result.verdict.doubts, result.advice)
    links = {card.surface.name: (card.id, card.index) for card in cards}
    if isinstance(result, flat_result.FlatResult):
        sections, numbers = _flat_sections(result, results, links), flat_numbers(result)
    else:
        sections, numbers = _scene_sections(result, results, links), scene_numbers(result)
    content = sections | _content(results, cards)
    failed = different((*result.failed_extras, *content.pop("failed"),
                        *(missing.failed for missing in _of_kind(content, svg.MissingDrawing))))
    written = json_for_script(report_numbers(results) | numbers | {
        "failed_extras": [extras.facts(one) for one in failed],
        "plots": {drawing.name: {"title": drawing.heading, "axes": drawing.axes}
                  for drawing in _of_kind(content, svg.Drawing)},
        "pictures": {name: picture_digest(uri) for name, uri in content["pictures"].items()}})
    page = templates().get_template("report.html.j2").render(
        content | {"failed": failed, "numbers": written, "style": style_sheet(),
                   "script": _texts(PIECES / "spectra.js", TEMPLATES / "report.js")})
    return UNITS.sub(_with_units_kept, page), written, failed


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
    return _texts(PIECES / "pieces.css", TEMPLATES / "report.css")


def _texts(*files: Path) -> Markup:
    return Markup("\n".join(file.read_text(encoding="utf-8") for file in files))


def _flat_sections(result: flat_result.FlatResult, results: SessionResults,
                   links: Mapping[str, tuple[str, int]]) -> dict[str, Any]:
    """Photos with regions and light, for the templates."""
    photos = [(photo, figures.photo_figure(f"photo-{number}", photo, results.previews[photo.view],
                                           links, results.calibrated.get(photo.view)),
               figures.light_figure(f"light-map-{number}", photo), _whiskers(photo))
              for number, photo in enumerate(result.photos, start=1)]
    return {"photos": photos, "geometry": None}


def _whiskers(photo: flat_result.PhotoOfRegions) -> dict[str, Markup]:
    """By region its light with its error, or why that is not drawn."""
    drawn, failed = attempt("picture of the light on regions",
                            lambda: figures.field_whiskers(photo.light), {})
    return drawn if failed is None else dict.fromkeys(photo.light, svg.MissingDrawing(failed))


def _scene_sections(result: scene_result.SceneResult, results: SessionResults,
                    links: Mapping[str, tuple[str, int]]) -> dict[str, Any]:
    """Photo against rendering, geometry, convergence, for the templates."""
    fit = result.reconstruction
    views = [(name, maps.pair_figure(f"pair-{number}", made, calibration.sensitivity, result.bands),
              maps.residual_figure(f"residuals-{number}", made, result.bands),
              spectra.light_figure(f"light-{number}", calibration.light,
                                   calibration.light_posterior))
             for number, (name, (calibration, made)) in enumerate(result.views.items(), start=2)]
    return {"pair_figure": maps.pair_figure("pair", fit, result.calibration.sensitivity,
                                            result.bands),
            "residual_maps": maps.residual_figure("residuals", fit, result.bands),
            "surface_map": maps.surface_figure("surfaces", fit), "views": views,
            "linked_photo": maps.linked_photo("photo", fit, result.calibration, links),
            "geometry": maps.geometry_section(result.placements, result.marked_views,
                                              results.previews),
            "loss": figures.loss_figure("loss", fit.loss_history)}


def _chart_section(result: capture_result.CaptureResult) -> dict[str, Any]:
    """The chart and the calibration by it, for the templates; no ``chart`` where none was used.

    ``left_out`` is of each patch by a calibration without it, where there is one, its colour as
    estimated and as the reference has it, as CSS writes them, and CIEDE2000 between both.
    """
    residuals, chart = rules.chart_residuals(result), result.chart
    swatches = swatch_pairs(result)
    if chart is None or residuals is None or swatches is None:
        return {"chart": None}
    fit, left_out = result.calibration.sensitivity, chart.left_out
    limit = chart_findings.chart_limits(result.stated.chart_stated)[0]
    of_prior = {"prior_figure": None} if chart.prior_share is None else {
        "prior_figure": figures.prior_share_figure("prior-share", chart.prior_share, fit.grid,
                                                   result.bands),
        "camera_families": chart.families}
    of_left_out = {"left_out": []} if left_out is None else {
        "left_out": _left_out(left_out),
        "left_out_difference": chart_findings.colours(left_out).values,
        "left_out_sentence": texts.sentence(
            chart_findings.held_out(left_out, result.layout.names)[0])}
    return {"chart": chart, "chart_residuals": residuals, "swatches": swatches, **of_prior,
            "residual_figure": figures.chart_residual_figure(
                "chart-residuals", residuals, fit.held_out_residuals, result.bands, limit),
            "irradiance_figure": figures.irradiance_figure("irradiance", chart.irradiance,
                                                           result.layout.rows),
            "chart_rms": chart_findings.root_mean_square(residuals), "chart_limit": limit,
            **of_left_out}


def _left_out(patches: HeldOutPatches) -> list[tuple[str, str, float]]:
    estimates, references = (
        [spectra.css_colour(reflectance_to_srgb(patches.grid.nm, one)) for one in each]
        for each in (patches.mean, patches.reference))
    return list(zip(estimates, references, chart_findings.patch_differences(patches).tolist(),
                    strict=True))


def _content(results: SessionResults, cards: list[Card]) -> dict[str, Any]:
    """What the templates of the page know of every capture, by name."""
    result, verdict = results.found, results.found.verdict
    files: dict[str, Path] = {}
    chart_shown = False         # among the photos of the samples
    if isinstance(result, flat_result.FlatResult):
        chart_shown = any(photo.chart_px is not None for photo in result.photos)
    else:
        files = {f"photo {name}": results.previews[name] for name in result.views}
    if result.chart is not None and not chart_shown:
        files["chart"] = results.chart_overlay
    pictures, missing = {}, []
    for title, path in (files | dict(results.picture_maps)).items():
        picture, failed = attempt(f"picture {title!r}", partial(picture_data_uri, path), None)
        if picture is not None:
            pictures[title] = picture
        if failed is not None:
            missing.append(failed)
    of_chart, failed_chart = attempt("section on the chart", lambda: _chart_section(result),
                                     {"chart": None})
    light, fit = result.calibration.light, result.calibration.sensitivity
    return {
        "results": results, "found": result, "verdict": verdict,
        "scene": isinstance(result, scene_result.SceneResult),
        "surfaces_word": f"{result.surface_word.capitalize()}s",
        "pictures": pictures, "picture": result.picture,
        "failed": [*missing, *(() if failed_chart is None else (failed_chart,))],
        "cards": cards, "assumed_of_all": assumed_of_all(result.surfaces),
        "tested_families": tested_families(result.surfaces),
        "level": next((surface.summary.level for surface in result.surfaces
                       if surface.summary is not None), None),
        "truths": any(surface.scores is not None for surface in result.surfaces),
        "files": _files(result),
        **of_chart, "surface_off": rules.SURFACE_OFF,
        "held_out_rms": chart_findings.root_mean_square(fit.held_out_residuals),
        "sensitivity_figure": spectra.sensitivity_figure("sensitivity", fit, result.bands,
                                                 results.sensitivity_truth),
        "light_figure": spectra.light_figure("light", light, result.calibration.light_posterior),
        }


def _files(result: capture_result.CaptureResult) -> list[tuple[str, str]]:
    """Files next to the page that hold the spectra, and what is in each."""
    files = [("spectra.csv", "means, bands and bounds"), ("materials.csv", "colours"),
             ("spdx/", "one IES TM-27 file a surface")]
    if isinstance(result, scene_result.SceneResult):
        files.append(("materials.xml", "for Mitsuba"))
    if result.picture is not None:
        files.append((f"{result.picture_folder}/{result.picture.files[0]}",
                      "a spectrum for every pixel"))
    return files


def _of_kind(content: Any, kind: type[Kind]) -> Iterator[Kind]:
    """Every drawing of a kind among the values of a page."""
    if isinstance(content, kind):
        yield content
    elif isinstance(content, dict):
        for value in content.values():
            yield from _of_kind(value, kind)
    elif isinstance(content, list | tuple):
        for value in content:
            yield from _of_kind(value, kind)
    elif isinstance(content, Card):
        yield from _of_kind(vars(content), kind)
