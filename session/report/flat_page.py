"""The report of a session of flat samples: one HTML file that opens offline, with its numbers."""
from __future__ import annotations

from pathlib import Path
from typing import Any

from spectrabox.session.flat.flat_results import FlatResults
from spectrabox.session.report import flat_figures
from spectrabox.session.report.flat_methods import flat_methods
from spectrabox.session.report.flat_verdict import judge_flat
from spectrabox.session.report.numbers import flat_numbers
from spectrabox.session.report.page import (
    RenderedReport,
    calibration_section,
    maps_of,
    pictures_of,
    rendered,
    written_whole,
)
from spectrabox.session.report.shapes.field_whiskers import field_whiskers
from spectrabox.session.report.svg import band_colours, report_style
from spectrabox.session.report.tables import input_rows, material_sections
from spectrabox.session.report.verdict import Verdict

REPORT = "flat.html.j2"


def write_flat_report(results: FlatResults) -> Path:
    """Write ``report.html`` and ``report.json`` into the session folder, each whole or not at all.

    Raises
    ------
    InputError
        If a picture that the report embeds is missing.
    EnvironmentProblem
        If the folder cannot be written; an older report is left as it was.
    """
    return written_whole(results.folder, render_flat_report(results))


def render_flat_report(results: FlatResults) -> RenderedReport:
    """The page as text; every name, note and file name of the session is escaped."""
    with report_style():
        verdict = judge_flat(results)
        return rendered(REPORT, _page(results, verdict), flat_numbers(results, verdict))


def _page(results: FlatResults, verdict: Verdict) -> dict[str, Any]:
    photos = [{"name": photo.name, "regions": photo.light,
               "figure": flat_figures.photo_figure(f"photo-{i}", photo),
               "light": flat_figures.light_figure(f"light-map-{i}", photo),
               "whiskers": field_whiskers(photo.light)}
              for i, photo in enumerate(results.photos, start=1)]
    return {
        "results": results, "verdict": verdict,
        "pictures": pictures_of(results) | maps_of(results.picture),
        "picture": results.picture,
        "bands": list(zip(results.bands, band_colours(results.bands), strict=True)),
        "surfaces": {"title": "Regions", "key": "regions", "one": "Region", "fitted": False},
        "materials": material_sections(results.materials, results.signals.grid.nm,
                                       results.signal_bands),
        "photos": photos, "calibration": calibration_section(results, None),
        "inputs": input_rows(results), "methods": flat_methods(results),
        }
