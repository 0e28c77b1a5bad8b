"""What a result rests on: which conditions are measured, stated or assumed, what the verdict names,
and what the error of the light costs.
"""
from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from report_example import example_session, stated_scene, with_found

from spectrabox.measure import rules, texts
from spectrabox.measure.captured import Surface
from spectrabox.measure.conditions import (
    COPY_FAULT,
    GLOSS_FAULT,
    NAMED_CHANGE,
    emitted,
    exponent_of_greys,
)
from spectrabox.measure.results.surface_result import SurfaceResult
from spectrabox.radiometry.appearance import delta_e00, reflectance_to_lab
from spectrabox.radiometry.chart import CLASSIC
from spectrabox.radiometry.error_model import LIGHT_FIELD, PHOTO_NOISE
from spectrabox.radiometry.findings import Finding, Severity

NM = np.arange(400.0, 701.0, 5.0)


def condition(found, name):
    return next(each for each in found.conditions if each.code == f"condition.{name}")


def grey(level: float, light_error: float, light_share: float, tmp_path) -> SurfaceResult:
    """A grey of a reflectance whose light is known to an error, which is a share of its variance.
    """
    surface = example_session(tmp_path).found.surfaces[0]
    summary = dataclasses.replace(
        surface.summary, mean=np.full_like(surface.summary.mean, level),
        variance_shares={LIGHT_FIELD: light_share, PHOTO_NOISE: 1 - light_share})
    return dataclasses.replace(with_errors(surface, {LIGHT_FIELD: light_error}), summary=summary)


def with_errors(surface: SurfaceResult, relative: dict[str, float]) -> SurfaceResult:
    """The surface with a signal that errs by causes relative to it, alike in all bands."""
    of_signal = np.outer(surface.signal, surface.signal)[None]
    return dataclasses.replace(surface, signals=dataclasses.replace(
        surface.signals, errors={cause: error**2 * of_signal
                                for cause, error in relative.items()}))


def test_what_is_stated_of_every_surface_is_not_named_assumed(tmp_path):
    results = example_session(tmp_path)
    assert condition(results.found, "scene-gloss").values["standing"] == "assumed"
    matt = stated_scene(materials={"white": Surface(surface="matt")})
    stated = with_found(results, stated=matt).found
    gloss = condition(stated, "scene-gloss")
    assert gloss.values["standing"] == "stated" and gloss.values["names"] == ["matt"]
    assert not gloss.values["named"]


@pytest.mark.parametrize("error, standing", [(0.005, "measured"), (0.011, "measured"),
                                             (0.015, "assumed")])
def test_a_lamp_that_moved_measures_gloss_where_its_error_would_show_a_fault(
        tmp_path, monkeypatch, error, standing):
    results = example_session(tmp_path)
    moved = with_found(results, stated=stated_scene(moved="photo")).found
    # a photo that shows none of the samples with the lamp elsewhere measures nothing
    assert condition(moved, "scene-gloss").values["standing"] == "assumed"
    monkeypatch.setattr(SurfaceResult, "places", [
        {"photo": photo, "gloss": 0.0, "gloss_error": gloss_error, "level": 0.0,
         "level_error": 0.03} for photo, gloss_error in (("photo", 0.004), ("b", error))])
    moved = with_found(results, stated=stated_scene(moved="photo")).found
    gloss = condition(moved, "scene-gloss").values
    assert gloss["standing"] == standing and gloss["error"] == error
    assert gloss["named"] == (standing == "assumed")


def test_the_verdict_names_the_assumed_conditions_whose_failing_is_seen_and_no_other(tmp_path):
    found = example_session(tmp_path).found
    for each in found.conditions:
        values = each.values
        seen = max(abs(values["lightness"] or 0), abs(values["b_star"] or 0)) >= NAMED_CHANGE
        assert values["named"] == (values["standing"] == "assumed" and seen)
        assert (each in found.verdict.conditions) == values["named"]


@pytest.mark.parametrize("severity, word", [
    (Severity.INFO, "PASS"), (Severity.NOTE, "PASS"), (Severity.WARN, "WARN"),
    (Severity.FAIL, "FAIL")])
def test_a_verdict_of_any_kind_says_what_it_rests_on(severity, word):
    right = Finding("flat.right", Severity.INFO)
    found = Finding("photo.not-linear", severity)
    gloss, plane = Finding("condition.gloss", Severity.INFO), Finding("condition.plane",
                                                                      Severity.INFO)
    verdict = rules.Verdict((found,), right, (gloss, plane))
    said = texts.sentence(right) if word == "PASS" else texts.says(found)
    if word == "FAIL":          # which no condition mends
        assert (verdict.line, verdict.says) == (f"verdict: FAIL. {said}", said)
    else:
        assert verdict.line == f"verdict: {word} if matt and in the chart's plane. {said}"
        assert verdict.says.lower() == f"If matt and in the chart's plane: {said}".lower()
    assert rules.Verdict((found,), right).line == f"verdict: {word}. {said}"
    assert verdict.problems == (() if word == "PASS" else (found,))


@pytest.mark.parametrize("level, named", [(0.85, True), (0.6, True), (0.2, False), (0.04, False)])
def test_brighteners_are_named_of_surfaces_that_are_light_in_the_blue(tmp_path, level, named):
    results = example_session(tmp_path)
    found = dataclasses.replace(results.found, surfaces=[grey(level, 0.01, 0.1, tmp_path)])
    fluorescence = condition(found, "fluorescence")
    assert fluorescence.values["b_star"] < 0 and fluorescence.values["named"] == named
    # emission at 440 nm is bluer than any reflectance, and hardly lighter
    reflected = np.full(NM.size, level)
    assert reflectance_to_lab(NM, emitted(NM, reflected))[0] \
        < reflectance_to_lab(NM, reflected)[0] + 1


def test_costs_are_those_of_the_surface_that_the_fault_changes_most(tmp_path):
    found = example_session(tmp_path).found
    estimated = [surface for surface in found.surfaces if not surface.known]
    lightness = [surface.lab().value[0] for surface in estimated]
    mirrored = [reflectance_to_lab(surface.nm, surface.mean + GLOSS_FAULT)[0] - now
                for surface, now in zip(estimated, lightness, strict=True)]
    assert condition(found, "scene-gloss").values["lightness"] == pytest.approx(max(mirrored))
    darker = [reflectance_to_lab(surface.nm, surface.mean * (1 - COPY_FAULT))[0] - now
              for surface, now in zip(estimated, lightness, strict=True)]
    assert condition(found, "chart").values["lightness"] == pytest.approx(min(darker))


def drawn(level: float, spread: float, tmp_path) -> SurfaceResult:
    """A grey whose draws are greys too, of levels evenly about it, the last off by the spread."""
    surface = grey(level, 0.3, 0.9, tmp_path)
    spectra = np.ones_like(surface.samples.spectra)
    levels = level + spread * np.linspace(-1, 1, len(spectra))
    samples = dataclasses.replace(surface.samples, spectra=levels[:, None] * spectra)
    return dataclasses.replace(surface, summary=dataclasses.replace(surface.summary,
                                                                    samples=samples))


@pytest.mark.parametrize("level, spread", [(0.2, 0.01), (0.2, 0.1), (0.7, 0.1)])
def test_a_surface_is_known_as_its_draws_lie_about_the_mean(tmp_path, level, spread):
    surface = drawn(level, spread, tmp_path)
    colour, spectrum = surface.within
    off = surface.summary.level * spread            # of evenly spread draws, on either side
    assert spectrum == pytest.approx(off, rel=0.01)
    # of two greys CIEDE2000 is what their lightness differs by, which is more below than above
    colours = [delta_e00(NM, np.full(NM.size, level), np.full(NM.size, level + side * off))
               for side in (-1, 1)]
    assert min(colours) < colour < max(colours)


def test_weak_surfaces_are_counted_and_change_no_verdict(tmp_path):
    results = example_session(tmp_path)
    sure, weak = (dataclasses.replace(drawn(0.5, spread, tmp_path), name=name)
                  for name, spread in (("sure", 0.01), ("weak", 0.4)))
    verdicts = [with_found(results, surfaces=surfaces).found.verdict
                for surfaces in ([sure], [sure, weak])]
    assert [verdict.right.values["weak"] for verdict in verdicts] == [[], ["weak"]]
    assert verdicts[0].word == verdicts[1].word
    said = {one.subject: one for one in verdicts[1].findings if one.code == "surface.known-to"}
    assert not said["sure"].values["weak"] and not texts.remedy(said["sure"])
    # nearly all of it is the light's, and what makes that better is said
    assert said["weak"].values["cause"] == LIGHT_FIELD
    assert texts.remedy(said["weak"]) == texts.LIGHT_REMEDY
    assert "1 of 2" in texts.sentence(verdicts[1].right)


@pytest.mark.parametrize("exponent", [1.0, 0.95, 1.1])
def test_greys_of_a_chart_measure_the_exponent_of_the_light(tmp_path, exponent):
    result = example_session(tmp_path).found
    predicted = result.chart.predicted
    rng = np.random.default_rng(3)
    noise = rng.normal(0, 0.01, (24, 1))        # a patch errs in all bands alike
    samples = dataclasses.replace(
        result.measured_chart.samples,
        mean=predicted ** exponent * np.array([0.5, 1.0, 2.0]) * np.exp(noise))
    found, error = exponent_of_greys(samples, predicted, CLASSIC)
    # 6 greys over a factor 28: 0.01 / sqrt(sum of squares of the logarithm, 7.4) is 0.0037
    assert 0.001 < error < 0.01
    assert abs(found - exponent) < 5 * 0.0037
