"""Maps, pictures and plain shapes of the report, and what its own check finds."""
import base64
import dataclasses

import numpy as np
import OpenImageIO as oiio
import pytest
from compact_results import compact
from report_example import GRID, example_session
from report_variants import left_out

from spectrabox.capture.photo.image_files import write_png
from spectrabox.radiometry.errors import InputError
from spectrabox.session import report_check
from spectrabox.session.report import figures, maps, metamers, tables, words
from spectrabox.session.report.checked.cells import of, shows, value_at
from spectrabox.session.report.checked.drawing import drawing_digest
from spectrabox.session.report.checked.page_check import (
    differences,
    embedded_numbers,
    page_faults,
)
from spectrabox.session.report.page import render_report
from spectrabox.session.report.safe_json import json_for_script, plain_values
from spectrabox.session.report.shapes import swatches
from spectrabox.session.report.shapes.field_whiskers import field_whiskers
from spectrabox.session.report.shapes.prior_share import prior_share_figure
from spectrabox.session.report.spectra import every_10_nm
from spectrabox.session.report.svg import band_colours, plain_line
from spectrabox.session.store.rehearsals import FILE

pytestmark = pytest.mark.usefixtures("figures_undrawn")


@pytest.fixture
def results(tmp_path):
    return example_session(tmp_path)


def test_maps_of_photo_and_rendering(results, recorded):
    made, fit = results.reconstruction, results.calibration.sensitivity
    recorded([maps.display_bands(fit), maps.residual_limit(maps.residual_maps(made)),
              maps.residual_maps(made)], case="residuals")
    # 8 bits
    recorded(maps.comparison_rgb8(made, fit), rtol=1e-3, case="side by side")
    recorded(maps.srgb_encoded(np.linspace(-0.1, 1.2, 40)), case="sRGB")
    recorded([maps.residual_limit(np.array([size, np.nan, -size / 3])) for size in (
        0.0, 0.0199, 0.0201, 0.0499, 0.0501, 0.099, 0.101, 0.199, 0.201, 0.29, 0.31, 0.51, 0.99,
        1.2)], case="limits")
    recorded([maps._middle(made.surface == each) for each in range(5)], case="middles")
    recorded([maps.surface_colours(25), maps._panel_height(4.0, 30, 20),
              maps._panel_height(4.0, 300, 20), maps._panel_height(4.0, 3, 90),
              [maps._signed_percent(each, 0) for each in (0.0, 0.05, -0.125)]], case="scales")


def test_pictures_of_the_page(tmp_path, recorded):
    rng = np.random.default_rng(2)
    found = []
    for size in ((40, 50), (1401, 30), (30, 2900)):
        write_png(tmp_path / "p.png", rng.integers(0, 256, (*size, 3), dtype=np.uint8))
        uri = figures.picture_data_uri(tmp_path / "p.png")
        (tmp_path / "q.png").write_bytes(base64.b64decode(uri.partition(",")[2]))
        found.append(np.asarray(oiio.ImageBuf(str(tmp_path / "q.png")).get_pixels(oiio.UINT8)))
    recorded([each.shape for each in found], case="sizes")
    recorded(found, rtol=1e-3, case="pixels")
    (tmp_path / "p.png").write_text("no picture", encoding="utf-8")
    for name, said in (("p.png", "is not a PNG file"), ("none.png", "cannot be read")):
        with pytest.raises(InputError, match=said):
            figures.picture_data_uri(tmp_path / name)


def test_plain_shapes(results, recorded):
    light = {"a": (0.8, 0.02), "b": (1.1, 0.05), "c": (0.95, 0.0)}
    recorded([{name: str(each) for name, each in field_whiskers(light).items()},
              field_whiskers({}), str(field_whiskers({"x": (1.0, 0.0)})["x"])], case="whiskers")
    share = np.linspace(0, 1.1, 3 * GRID.nm.size).reshape(3, -1)**2
    drawing = prior_share_figure("p", share, GRID, ("R", "G", "a long name of a band"))
    recorded(compact([drawing.facts["title"], drawing.facts["axes"]]), case="share of the prior")
    recorded(str(drawing)[-1500:], case="its drawing")
    for number, material in enumerate(results.materials[:2]):
        pair = metamers.metamer_pair(material.samples)
        recorded([pair, compact(metamers.metamer_facts(pair)),
                  str(metamers.metamer_drawing(pair))[:600]], case=f"pair {number}")
    one = dataclasses.replace(results.materials[0].samples, spectra=pair.spectra[:1],
                              coefficients=np.zeros((1, 4)))
    assert tables.metamers_section(one) is None
    two = dataclasses.replace(one, spectra=pair.spectra[:2], coefficients=np.zeros((2, 4)))
    assert tables.metamers_section(two) is not None
    recorded([figures.power_of_ten(each) for each in (1e-3, 1.0, 1e5)], case="ticks")


def test_rows_of_the_tables(results, recorded):
    chart = dataclasses.replace(results.chart, left_out=left_out(0.93))
    fit = dataclasses.replace(results.calibration.sensitivity, held_out_residuals=None)
    recorded(compact([tables.surface_rows(results.reconstruction), tables.input_rows(results),
                      tables._patches(results, results.calibration.sensitivity.residuals, None),
                      tables.held_out_rms(results)]), case="rows")
    for number, each in enumerate((results, dataclasses.replace(results, chart=chart),
                                   dataclasses.replace(results, calibration=dataclasses.replace(
                                       results.calibration, sensitivity=fit)))):
        recorded(compact([plain_values(swatches.swatch_facts(each)),
                          swatches.swatch_section(each)]), case=f"swatches {number}")
    recorded([swatches.css_colour(np.array(each)) for each in (
        (0.0, 0.5, 1.0), (-0.2, 1.2, 0.499), (np.nan, 0, 0))], case="colours")
    nm = np.arange(403.0, 452.0, 3.0)
    recorded(every_10_nm(nm, {"a": nm / 1000, "b": nm**2}), case="every 10 nm")
    sections = [tables.material_section(3, each, results.reconstruction.grid.nm, results.bands)
                for each in results.materials]
    recorded([{name: each[name] for name in ("id", "swatch", "band_width", "columns", "certified",
                                             "in_doubt")} for each in sections], case="sections")


def test_which_texts_show_which_numbers(recorded):
    texts = ["1.23", "1.2", "12.3 %", "−4.5 %", "+4.5 %", "1/60 s", "1.5 × 10⁻⁹", "3e-05",
             "not measured", "–", "", "a  b", "120", "0.5", "yes"]
    values = [1.234, 1.2351, 0.123, 0.1236, -0.045, 0.045, 1 / 60, 1 / 61, 1.5e-9, 3e-5, None,
              "a b", "ab", 120, 119.4, 0.5, 0.551, True, float("nan")]
    recorded([[bool(shows(text, value)) for value in values] for text in texts])
    recorded([str(of("a", 3, ["b/c", "~d"])), value_at({"a": [1, {"b/c": 2}]}, "/a/1/b~1c")],
             case="pointers")
    for pointer in ("/x", "/a/9", "/a/x", "/a/0/1"):
        with pytest.raises(KeyError):
            value_at({"a": [1]}, pointer)
    recorded(list(differences({"a": [1, 2], "b": 3, "c": {"d": 1}},
                              {"a": [1, 5], "c": {"d/e": 1}, "f": None})), case="differences")


def test_of_many_places_the_first_are_named(recorded):
    recorded([report_check._named([f"/{at}" for at in range(count)], "{} differs")
              for count in (0, 1, 12, 13, 30)])


def test_what_the_check_of_a_page_finds(results, recorded):
    rendered = render_report(results)
    numbers = embedded_numbers(rendered.page)
    found = {"as it is": page_faults(rendered.page, numbers)}
    for name, old, new in (("a cell", ">0.0112<", ">0.0212<"), ("a verdict", ">WARN<", ">PASS<"),
                           ("a drawing", 'viewBox="0 0 1 1"', 'style="x"'),
                           ("a plot's name", 'id="loss"', 'id="lost"'),
                           ("a picture", "base64,iVBOR", "base64,iVBOS"),
                           ("a colour", "background: rgb(", "background: rgb(1")):
        assert old in rendered.page, name
        found[name] = page_faults(rendered.page.replace(old, new, 1), numbers)
    found["other data"] = page_faults(rendered.page, numbers | {"plots": {}, "materials": []})[0]
    recorded(found)
    assert embedded_numbers("<p>none</p>") is None
    recorded([drawing_digest('<path d="M1 2"/>text') != drawing_digest('<path d="M1 3"/>text'),
              drawing_digest("<output>a</output>") == drawing_digest("<output>b</output>"),
              drawing_digest('<path fill="x"/>') == drawing_digest('<path fill="y"/>')],
             case="digests")




def test_plain_values_and_lines(recorded):
    recorded([compact(plain_values({1: np.array([1.0, np.nan, np.inf]), "b": np.bool_(True),
                                    "c": (np.float32(0.5), float("nan"), np.arange(3))})),
              str(json_for_script({"a": "</script><b>&", "c": [1.5, None]})),
              [plain_line(each, 12) for each in ("a\nb", "x" * 12, "y" * 13, "\x00z", "")],
              [band_colours(each) for each in (("R", "G", "B"), ("B", "x", "y"),
                                               tuple("abcdefghijkl"))],
              words.OFF, FILE])
