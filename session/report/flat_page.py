"""The report of a session of flat samples: one HTML file that opens offline, with its numbers."""
from __future__ import annotations

from pathlib import Path
from typing import Any

from markupsafe import Markup

from spectrabox.session.flat.flat_results import FlatResults
from spectrabox.session.report import flat_figures
from spectrabox.session.report.figures import picture_data_uri
from spectrabox.session.report.flat_methods import flat_methods
from spectrabox.session.report.flat_verdict import judge_flat
from spectrabox.session.report.numbers import flat_numbers
from spectrabox.session.report.page import TEMPLATES, calibration_section, rendered, written_whole
from spectrabox.session.report.safe_json import json_for_script
from spectrabox.session.report.svg import band_colours, report_style
from spectrabox.session.report.tables import input_rows, material_section


def write_flat_report(results: FlatResults) -> Path:
    """Write ``report.html`` into the session folder, whole or not at all.

    Raises
    ------
    InputError
        If a picture that the report embeds is missing.
    EnvironmentProblem
        If the folder cannot be written; an older report is left as it was.
    """
    with report_style():
        return written_whole(results.folder, rendered("flat.html.j2", _page(results)))


def _page(results: FlatResults) -> dict[str, Any]:
    verdict = judge_flat(results)
    nm = results.signals.grid.nm
    return {
        "results": results, "verdict": verdict,
        "style": Markup((TEMPLATES / "report.css").read_text()),
        "script": Markup((TEMPLATES / "report.js").read_text()),
        "numbers": json_for_script(flat_numbers(results, verdict)),
        "preview": picture_data_uri(results.photo_preview),
        "bands": list(zip(results.bands, band_colours(results.bands), strict=True)),
        "surfaces": {"title": "Regions", "one": "Region", "fitted": False},
        "materials": [material_section(number, region, nm, results.signal_bands)
                      for number, region in enumerate(results.materials, start=1)],
        "photos": [{"name": photo.name, "figure": flat_figures.photo_figure(f"photo-{i}", photo),
                    "light": flat_figures.light_figure(f"light-map-{i}", photo),
                    "regions": photo.light} for i, photo in enumerate(results.photos, start=1)],
        "picture": results.picture and [(title, picture_data_uri(path))
                                        for title, path in results.picture.maps],
        "calibration": calibration_section(results, None),
        "inputs": input_rows(results), "methods": flat_methods(results),
        }
