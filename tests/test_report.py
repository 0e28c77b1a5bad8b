"""The session report: it opens offline, says what the records say, and survives hostile names."""
from __future__ import annotations

import dataclasses
import html
import json
import re
from html.parser import HTMLParser

import numpy as np
import pytest
from report_example import SURFACES, WORST_RATIO, example_session, stated_scene, with_found

from spectrabox.measure import texts
from spectrabox.measure.captured import Surface
from spectrabox.measure.words import exposure, number, percent, signed_percent
from spectrabox.radiometry.error_model import REPEATABILITY, with_common_error
from spectrabox.radiometry.errors import EnvironmentProblem
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.records.calibration import SensitivityFit
from spectrabox.radiometry.records.spectra import Outcome
from spectrabox.sampling.prior.family_coverage import FamilyCertificate
from spectrabox.sampling.prior.mixture import load_prior
from spectrabox.session.report.cards import assumed_of_all
from spectrabox.session.report.maps import display_bands, residual_maps
from spectrabox.session.report.numbers import scene_numbers
from spectrabox.session.report.page import write_report
from spectrabox.session.report.svg import plain_line

VOID = {"meta", "img", "br", "link", "input", "hr"}
HOSTILE = "<script>alert(1)</script>"
NAMES = (HOSTILE, 'a $\\frac{ $ "quoted" \x00\ud800 & </title>', "石膏 wall")


class Page(HTMLParser):
    """Checks that elements close in order; gathers ids, addresses, script texts and visible
    text.
    """

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids: list[str] = []
        self.addresses: list[str] = []
        self.scripts: dict[str | None, str] = {}
        self.texts: list[str] = []
        self._script: str | None = None
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self._note(attrs)
        if tag == "script":
            self._script = dict(attrs).get("id")
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self._note(attrs)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] == "script":
            self.scripts[self._script] = data
        else:
            self.texts.append(data)

    def _note(self, attrs):
        self.ids += [value for key, value in attrs if key == "id"]
        self.addresses += [value for key, value in attrs if key in ("src", "href", "xlink:href")]

    @property
    def numbers(self):
        return json.loads(self.scripts["spectrabox-results"])


def written(results):
    return write_report(results).read_text(encoding="utf-8").replace("\u00a0", " ")


@pytest.fixture(scope="module")
def usual(tmp_path_factory):
    results = example_session(tmp_path_factory.mktemp("usual"))
    return results, written(results)


@pytest.mark.parametrize("case", [
                             {}, {"bands": ("410", "480", "550", "620", "690")}, {"chart": False},
                             {"truth": False}, {"materials": NAMES},
                             {"bands": ("B1", "B2", "B3", "B4"), "chart": False, "truth": False,
                              "name": HOSTILE, "notes": HOSTILE}])
def test_the_page_is_balanced_and_needs_nothing_from_outside(tmp_path, case):
    text = written(example_session(tmp_path, **case))
    page = Page(text)
    assert len(page.ids) == len(set(page.ids))
    assert not re.search(r"https?://|file:|@import", text)
    written_beside = {"spectra.csv", "materials.csv", "spdx/", "materials.xml"}
    assert all(address.startswith(("#", "data:image/png;base64,")) or address in written_beside
               for address in page.addresses)
    targets = {address[1:] for address in page.addresses if address.startswith("#")}
    assert targets | set(re.findall(r"url\(#([^)]+)\)", text)) <= set(page.ids)


def test_hostile_names_are_shown_and_never_run(tmp_path):
    results = example_session(tmp_path, materials=NAMES, name=HOSTILE, notes=HOSTILE,
                              bands=("R", HOSTILE, "B"))
    results = with_found(dataclasses.replace(
        results, inputs=(dataclasses.replace(results.inputs[0], file=HOSTILE),)), kept=(
            Finding("lamp.unexplained", Severity.NOTE, HOSTILE, {
                "off": 0.1, "band": HOSTILE, "one": HOSTILE, "other": HOSTILE}),))
    text = written(results)
    assert HOSTILE not in text
    assert html.escape(HOSTILE) in text
    page = Page(text)
    assert page.numbers["materials"][0]["name"] == HOSTILE
    assert HOSTILE in page.numbers["warnings"][0]
    assert page.numbers["findings"][0]["subject"] == HOSTILE
    assert text.count("<script") == text.count("</script>") == len(re.findall(r"<script[ >]", text))


def test_numbers_in_the_json_equal_the_records(usual):
    results, text = usual
    numbers, made = Page(text).numbers, results.found.reconstruction
    # JSON writes the shortest digits that read back as the same float, so nothing may differ.
    for entry, material in zip(numbers["materials"], results.found.surfaces, strict=True):
        m = made.materials.index(material.name)
        np.testing.assert_array_equal(entry["inverse_rendering"]["reflectance"], made.spectra[m])
        if material.summary is not None:
            np.testing.assert_array_equal(entry["summary"]["mean"], material.summary.mean)
            np.testing.assert_array_equal(entry["summary"]["bound_upper"],
                                          material.summary.bound_upper)
            assert entry["scores"] == dataclasses.asdict(material.scores)
    np.testing.assert_array_equal([row["ratio"] for row in numbers["agreement"]],
                                  made.agreement.ratio)
    np.testing.assert_array_equal(numbers["reconstruction"]["loss_history"], made.loss_history)
    np.testing.assert_array_equal(numbers["calibration"]["sensitivity"]["curves"],
                                  results.found.calibration.sensitivity.curves)
    assert numbers["calibration"]["light_scale"]["value"] == results.found.light_scale.value
    assert numbers["inputs"][0]["sha256"] == results.inputs[0].sha256


def test_the_surface_that_does_not_fit_is_named_in_words(usual):
    results, text = usual
    verdict = results.found.verdict
    assert verdict.severity is Severity.WARN
    found, = verdict.problems
    assert (found.code, found.subject, found.values["band"]) == ("scene.worst", "left wall", "R")
    assert found.values["ratio"] == pytest.approx(WORST_RATIO)
    assert verdict.sentence == texts.says(found) and verdict.sentence in text


@pytest.mark.parametrize("median, worst, status", [
                             (1.01, 1.04, Severity.INFO), (1.03, 1.04, Severity.WARN),
                             (0.94, 0.94, Severity.FAIL), (1.0, 0.9, Severity.WARN),
                             (1.0, 1.2, Severity.FAIL)])
def test_the_verdict_follows_the_worst_criterion(tmp_path, median, worst, status):
    ratio = np.full((len(SURFACES), 3), median)
    ratio[2, 1] = worst
    assert with_ratio(example_session(tmp_path), ratio).found.verdict.severity is status


@pytest.mark.parametrize("outcome, status", [
                             (Outcome.STEP_LIMIT, Severity.WARN),
                             (Outcome.ILL_POSED, Severity.INFO),
                             (Outcome.CONVERGED, Severity.INFO)])
def test_a_fit_that_was_stopped_early_is_a_warning(tmp_path, outcome, status):
    results = with_ratio(example_session(tmp_path), np.ones((len(SURFACES), 3)))
    made = dataclasses.replace(results.found.reconstruction, outcome=outcome)
    verdict = with_found(results, reconstruction=made).found.verdict
    assert verdict.severity is status
    assert outcome.value in [one.values["outcome"] for one in verdict.findings
                            if one.code == "fit.of-scene"]


@pytest.mark.parametrize("deviation, status", [(-0.08, Severity.WARN), (0.31, Severity.FAIL)])
def test_a_surface_beyond_chance_and_stated_errors_is_heard(tmp_path, deviation, status):
    results = example_session(tmp_path)
    ratio = np.ones_like(results.found.reconstruction.agreement.ratio)
    results = with_ratio(results, ratio)
    assert results.found.verdict.word == "pass"
    misfit = Finding("scene.misfit", Severity.WARN, "white / panel", {
        "value": abs(deviation), "level": {}, "scatter": None, "part": None, "p": 0.0})
    made = dataclasses.replace(results.found.reconstruction, misfits=(misfit,))
    verdict = with_found(results, reconstruction=made).found.verdict
    assert verdict.severity is status
    assert [(one.code, one.subject) for one in verdict.problems] == [
        ("scene.misfit", "white / panel")]


@pytest.mark.parametrize("doubt", [
    Finding("light.two-kinds", Severity.WARN,
            values={"photo_number": None, "drift": 0.2, "chance": 1e-6}),
    Finding("calibration.unlike-cameras", Severity.WARN, values={"probability": 0.99})])
def test_a_doubtful_calibration_is_a_warning_of_its_own(tmp_path, doubt):
    results = example_session(tmp_path)
    results = with_ratio(results, np.ones_like(results.found.reconstruction.agreement.ratio))
    doubted = dataclasses.replace(results.found.calibration, findings=(doubt,))
    verdict = with_found(results, calibration=doubted).found.verdict
    assert verdict.severity is Severity.WARN and verdict.problems == (doubt,)


def test_a_signal_unlike_what_the_prior_knows_is_said_where_the_material_is_shown(tmp_path):
    results = example_session(tmp_path)
    first = results.found.surfaces[0]
    samples = dataclasses.replace(first.samples, outcome=Outcome.UNFAMILIAR,
                                  findings=(Outcome.UNFAMILIAR.finding(),))
    summary = dataclasses.replace(first.summary, samples=samples)
    surfaces = (dataclasses.replace(first, summary=summary), *results.found.surfaces[1:])
    page = written(with_found(results, surfaces=surfaces))
    card = card_of(page, 1)
    assert f'href="#material-1">{first.name}</a>' in card
    said = texts.sentence(Outcome.UNFAMILIAR.finding())
    assert f'<p class="doubt">{said}</p>' in card
    assert '<p class="doubt"' not in card_of(page, 2)
    # saturated colours are unlike in faultless photos, and their bands allow for it
    before, after = (one.found.verdict for one in (results, with_found(results, surfaces=surfaces)))
    assert before.severity is after.severity
    assert [one.subject for one in after.findings if one.code == "draws.unfamiliar"] == [first.name]


def test_how_a_family_was_certified_is_said_once_and_marked_where_the_material_is_shown(tmp_path):
    results = example_session(tmp_path)
    certificate = FamilyCertificate(False, 2, 600, {"coverage": 0.915, "width": 0.193},
                                    {"coverage": 0.891, "width": 0.164})
    prior = dataclasses.replace(load_prior(), certificates={"textile": certificate})
    first = results.found.surfaces[0]
    first = dataclasses.replace(first, prior=prior, summary=dataclasses.replace(
        first.summary, family_shares={"textile": 0.7, "paint": 0.04}))
    results = with_found(results, surfaces=(first, *results.found.surfaces[1:]))
    page = written(results)
    said = "textile 89.1 % at a mean width of 0.164 (models, no measured library)"
    assert page.count(said) == page.count("Tested on unseen surfaces") == 1
    assert '<span class="doubt">textile 70 %</span>' in card_of(page, 1)
    assert "textile" not in results.text()
    facts = results.facts()["materials"]
    assert facts[0]["families"] == [{"name": "textile", "share": 0.7, "stated": False,
                                     "measured": False, "coverage": 0.891, "width": 0.164}]
    assert facts[1]["families"] == []
    numbers = scene_numbers(results.found)["materials"]
    assert [each["families"] for each in numbers[:2]] == [facts[0]["families"], []]


def test_what_all_bands_rest_on_is_said_once(usual):
    results, text = usual
    shown = text.split('<script type="application/json" id="spectrabox-results">')[0]
    sentences = [*map(texts.sentence, assumed_of_all(results.found.surfaces))]
    assert sentences and all(shown.count(html.escape(one)) == 1 for one in sentences)


def test_what_is_assumed_between_the_photos_is_said_with_its_cost(tmp_path):
    results = example_session(tmp_path)
    scale = with_common_error(results.found.light_scale, REPEATABILITY, 0.015)
    surfaces = [dataclasses.replace(material, summary=material.summary and dataclasses.replace(
        material.summary, variance_shares={REPEATABILITY: share}))
                for material, share in zip(results.found.surfaces, (0.1, 0.3), strict=False)]
    fit = dataclasses.replace(results.found.reconstruction, light_scale=scale)
    light = with_found(results, reconstruction=fit, surfaces=surfaces).found.conditions[0]
    assert (light.code, light.values["standing"]) == ("condition.scene-light", "assumed")
    assert light.values["error"] == pytest.approx(0.015)
    assert light.values["variance_share"] == pytest.approx(0.2)


def test_a_pass_says_what_no_photo_showed_and_leaves_out_what_was_measured_or_stated(tmp_path):
    results = example_session(tmp_path)

    def named(**changes):
        return {one.code for one in with_found(results, **changes).found.verdict.conditions}
    measurable = {"condition.scene-light", "condition.light-place", "condition.scene-gloss"}
    assert named() >= measurable
    assert not measurable & named(stated=stated_scene(
        materials={"white": Surface(surface="matt")}, scale_from_chart=False))


def test_what_could_not_be_measured_is_said_and_is_not_a_number(tmp_path):
    results = example_session(tmp_path)
    ratio = results.found.reconstruction.agreement.ratio.copy()
    ratio[3] = np.nan
    text = written(with_ratio(results, ratio))
    assert "Not compared in every band: floor." in text
    assert "not measured" in text
    assert Page(text).numbers["agreement"][3]["ratio"] == [None, None, None]
    assert not re.search(r">\s*[+−-]?nan", text)


def test_a_session_without_any_compared_surface_is_no_pass(tmp_path):
    results = with_ratio(example_session(tmp_path), np.full((len(SURFACES), 3), np.nan))
    assert results.found.verdict.severity is Severity.WARN
    assert "No surface could be compared" in written(results)


def test_a_missing_picture_is_named_and_leaves_the_rest_of_the_report(tmp_path):
    results = example_session(tmp_path)
    results.chart_overlay.unlink()
    text = written(results)
    page = Page(text)
    assert page.numbers["failed_extras"] == [{
        "extra": "picture 'chart'", "error": "picture overlay.png cannot be read (No such file or "
        "directory); run the stage that makes it again"}]
    assert "overlay.png cannot be read" in text and "chart" not in page.numbers["pictures"]


def test_a_failing_write_leaves_nothing_behind(tmp_path):
    results = example_session(tmp_path)
    (tmp_path / "report.html").mkdir()  # a folder in the way cannot be replaced by a file
    with pytest.raises(EnvironmentProblem, match=r"report\.html cannot be written"):
        write_report(results)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["overlay.png", "preview.png",
                                                          "report.html"]


def test_the_same_session_gives_the_same_page(usual):
    results, text = usual
    assert written(results) == text


def test_residuals_are_relative_to_the_photo_and_absent_where_not_used(usual):
    made = usual[0].found.reconstruction
    residuals = residual_maps(made)
    # One division and one subtraction of numbers near 1: a few eps.
    np.testing.assert_allclose((1 - residuals[made.used]) * made.measured[made.used],
                               made.rendered[made.used],
                               rtol=8 * np.finfo(float).eps)
    assert np.isnan(residuals[~made.used]).all()


@pytest.mark.parametrize("said, expected", [
                             (percent(0.0213), "2.1 %"), (percent(0.999), "99.9 %"),
                             (percent(1.0), "100 %"), (percent(None), "not measured"),
                             (signed_percent(-0.021), "−2.1 %"), (number(1.5e-9, 2), "1.5 × 10⁻⁹"),
                             (exposure(0.004), "1/250 s"), (exposure(None), "not stated"),
                             (plain_line("a\n b\x07 c" + "d" * 90, 12), "a b c" + "d" * 6 + "…")])
def test_numbers_are_written_for_people(said, expected):
    assert said == expected


def card_of(page, number):
    """The card of a surface, as HTML."""
    return page.split(f'<article class="card" id="material-{number}"')[1].split("</article>")[0]


def with_ratio(results, ratio):
    """The session with other ratios of photo to rendering."""
    made = results.found.reconstruction
    agreement = dataclasses.replace(made.agreement, ratio=ratio)
    return with_found(results, reconstruction=dataclasses.replace(made, agreement=agreement))


def test_bands_are_shown_by_their_wavelengths_however_sensitive_they_are():
    peaks = np.array([460.0, 610.0, 540.0])
    curves = np.array([[5.0], [0.2], [1.0]]) * np.exp(
        -0.5 * ((FINE_GRID.nm - peaks[:, None]) / 30) ** 2)
    fit = SensitivityFit(FINE_GRID, curves, *[None] * 7, "stated", Outcome.CONVERGED)
    assert display_bands(fit) == [1, 2, 0]
