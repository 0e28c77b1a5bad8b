"""Charts made before and after November 2014, and what a photo says of the copy that it shows."""
import dataclasses
import json
import os
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from calibrate_cameras import GRID, cameras_at_10_nm, led, on_grid, prior, samples, signals
from scipy.stats import multivariate_normal
from typer.testing import CliRunner

import spectrabox as sb
from spectrabox.calibrate import chart_findings, copy_errors
from spectrabox.calibrate.chart_calibration import calibrate_chart
from spectrabox.calibrate.chart_photo import ChartPhoto
from spectrabox.fixtures.chart_scene import chart_scene, mosaic
from spectrabox.fixtures.dng import write_dng
from spectrabox.measure.camera import ChartSignals, photos_of_charts
from spectrabox.measure.captured import FlatCapture, LitChart, View
from spectrabox.measure.chart_patches import edition_in_photo
from spectrabox.measure.results.calibration_facts import copy_facts
from spectrabox.radiometry.appearance import tristimulus_weights
from spectrabox.radiometry.chart import (
    AFTER,
    AFTER_2014,
    BEFORE,
    CLASSIC,
    COPIES_BEFORE_2014,
    COPIES_SINCE_2014,
    chart_reflectances,
)
from spectrabox.radiometry.charts.layouts import chart_layout
from spectrabox.radiometry.charts.references import editions
from spectrabox.radiometry.findings import Severity
from spectrabox.radiometry.published.published_tables import published_colours
from spectrabox.radiometry.records.photos import PhotoKind
from spectrabox.radiometry.records.spectra import Quantity, Spectrum, UnknownLight
from spectrabox.session.cli import app

SINCE, BEFORE_2014 = editions(CLASSIC)
LAMP = Spectrum(GRID, led(), Quantity.RELATIVE, "lamp.csv")
WHITE, SEEN = 18, GRID.nm >= 430


def photo_of(surfaces, seed, noise=0.002, of=(SINCE, BEFORE_2014), camera=80):
    """A chart of some reflectances in front of a camera that the prior left out."""
    signal = signals(on_grid(cameras_at_10_nm(1, camera)[0]), led(), surfaces)
    signal *= 1 + noise * np.random.default_rng(seed).standard_normal(signal.shape)
    return ChartPhoto(samples(signal), of[0].mean, LAMP, editions=of)


def calibrated(photo):
    return calibrate_chart([photo], GRID, prior=prior())


def test_colours_of_the_later_chart_have_changed_as_published_and_spectra_smoothly():
    earlier, later = (chart_reflectances(name, GRID) for name in ("BabelColor Average", AFTER_2014))
    to_xyz = tristimulus_weights(GRID.nm, "D50").T
    # Newton's method ends at round-off; 1e-9 is the ridge of its matrix of about 1
    np.testing.assert_allclose((later @ to_xyz) / (earlier @ to_xyz),
                               published_colours(AFTER) / published_colours(BEFORE), rtol=1e-7)
    change = np.log(later / earlier)
    assert np.abs(np.diff(change, axis=1)).max() < 0.005 and np.abs(change).max() < 0.2


def test_a_photo_says_of_which_edition_its_chart_is():
    copy = calibrated(photo_of(SINCE.mean, 81)).copy
    assert copy.edition == COPIES_SINCE_2014 and copy.probability > SINCE.share
    assert copy.evidence[COPIES_BEFORE_2014] < 0 == copy.evidence[COPIES_SINCE_2014]
    made = calibrated(photo_of(BEFORE_2014.mean, 81))
    assert made.copy.evidence[COPIES_BEFORE_2014] > 0
    # what the photo says for the earlier edition must outweigh how rare it is
    assert (made.copy.edition == COPIES_BEFORE_2014) == (
        made.copy.evidence[COPIES_BEFORE_2014] > np.log(SINCE.share / BEFORE_2014.share))


def test_the_level_of_a_dark_white_is_found_within_its_error():
    for darker in (0.0, 0.04, 0.08):
        surfaces = SINCE.mean.copy()
        surfaces[WHITE] *= np.exp(-darker)
        copy = calibrated(photo_of(surfaces, 5)).copy
        assert abs(copy.level[WHITE] + darker) < 2.5 * copy.level_error[WHITE]
        assert copy.level_error[WHITE] < 0.025
    rows = [row for one in chart_findings.departures(copy, CLASSIC.names)
            for row in one.values["patches"]]
    white = next(row for row in rows if row["patch"] == "white 9.5")
    assert white["reading"] == "level" and white["size"] < -0.05
    bluer = dataclasses.replace(copy, tint=np.full(24, 0.2))
    unlike = chart_findings.departures(bluer, CLASSIC.names, "CIE A")[0]
    assert (unlike.code, unlike.severity) == ("copy.unlike", Severity.WARN)
    assert unlike.values["light"] == "CIE A"


@pytest.mark.parametrize("white, unlike", [(0.0, False), (0.03, False), (0.2, True)])
def test_a_copy_is_at_fault_only_beyond_what_copies_differ_by(white, unlike):
    """A level that is known to 0.5 % departs by 6 of its errors: copies do so as well."""
    made = calibrated(photo_of(SINCE.mean, 5)).copy
    level = np.zeros(24)
    level[WHITE] = -white
    copy = replace(made, level=level, level_error=np.full(24, 0.005), tint=np.zeros(24))
    found = {one.code: one for one in chart_findings.departures(copy, CLASSIC.names)}
    assert ("copy.unlike" in found) == unlike
    assert all(one.severity is (Severity.WARN if code == "copy.unlike" else Severity.INFO)
               for code, one in found.items())


@pytest.mark.parametrize("error", [1e-3, 0.03])
def test_faultless_copies_are_seldom_called_unlike(error):
    """Of 400 copies one in twenty at most: binomial, 4 standard deviations. Levels and tints of
    drawn copies, as photos give them that err by nothing, or by more than copies do."""
    rng = np.random.default_rng(11)
    made = calibrated(photo_of(SINCE.mean, 5)).copy
    blue, red = (GRID.nm >= 430) & (GRID.nm <= 490), (GRID.nm >= 600) & (GRID.nm <= 700)
    unlike = 0
    for _ in range(400):
        drawn = SINCE.drawn(rng)
        level, low, high = (np.log(drawn[:, part].sum(axis=1) / SINCE.mean[:, part].sum(axis=1))
                            for part in (SEEN, blue, red))
        level, tint = (true + error * rng.standard_normal(24) for true in (level, low - high))
        copy = replace(made, level=level, level_error=np.full(24, error), tint=tint,
                       tint_error=np.full(24, error))
        unlike += any(one.code == "copy.unlike"
                      for one in chart_findings.departures(copy, CLASSIC.names))
    assert unlike / 400 < 0.05 + 4 * np.sqrt(0.05 * 0.95 / 400)


def test_what_is_said_of_copies_holds_as_often_as_it_says():
    rng, scores, whites = np.random.default_rng(7), [], []
    for number in range(14):
        surfaces = SINCE.drawn(rng)
        copy = calibrated(photo_of(surfaces, number, camera=80 + number)).copy
        truth = np.log(surfaces[:, SEEN].sum(axis=1) / SINCE.mean[:, SEEN].sum(axis=1))
        scores.append((copy.level - truth) / copy.level_error)
        whites.append([truth[WHITE], copy.level[WHITE]])
    square = np.mean(np.square(scores))
    # levels of 24 patches have a part in common: about 8 independent readings a photo, so that
    # the mean square of 112 is 1 within 3 x .13; a camera that the prior left out adds to it
    assert 0.6 < square < 1.5
    assert np.corrcoef(np.transpose(whites))[0, 1] > 0.5


def chart_alone(light, reflectances=SINCE.mean, stated=True):
    chart = LitChart(CLASSIC, reflectances, np.zeros(24, bool), stated=stated)
    return FlatCapture(views=(View("", {}, {}, light, ""),), chart=chart, regions={}, seed=1)


def test_a_photo_of_before_november_2014_shows_no_chart_made_since():
    assert editions(CLASSIC, "2014-10-31 12:00:00") == (BEFORE_2014,)
    assert editions(CLASSIC, "2014-11-01") == editions(CLASSIC) == (SINCE, BEFORE_2014)
    shown = samples(signals(on_grid(cameras_at_10_nm(1, 80)[0]), led(), SINCE.mean))
    old = ChartSignals("chart.dng", replace(shown, taken_at="2010-06-01 10:00:00"), ("R", "G", "B"))
    (photo,) = photos_of_charts([old], [chart_alone(UnknownLight(), stated=False)])
    assert photo.editions == (BEFORE_2014,)
    np.testing.assert_array_equal(photo.reflectances, BEFORE_2014.mean)


def test_a_reference_that_is_stated_is_taken_as_it_is():
    named = chart_reflectances("BabelColor Average", GRID)
    shown = samples(signals(on_grid(cameras_at_10_nm(1, 80)[0]), led(), named))
    (photo,) = photos_of_charts([ChartSignals("chart.dng", shown, ("R", "G", "B"))],
                                [chart_alone(LAMP, named)])
    assert photo.editions == () and np.array_equal(photo.reflectances, named)
    made = calibrated(photo)
    assert made.copy is None and np.array_equal(made.reflectances, named)


@pytest.mark.parametrize("share", [0.05, 0.5])
def test_odds_beforehand_and_evidence_make_the_probability(share):
    of = (replace(SINCE, share=1 - share), replace(BEFORE_2014, share=share))
    copy = calibrated(photo_of(0.5 * (SINCE.mean + BEFORE_2014.mean), 3, of=of)).copy
    odds = np.log(share / (1 - share)) + copy.evidence[COPIES_BEFORE_2014]
    earlier = copy.edition == COPIES_BEFORE_2014
    assert copy.probability == pytest.approx(1 / (1 + np.exp(-odds if earlier else odds)))


def photographed(folder, surfaces, seed, taken_at=""):
    """A raw photo of a chart of some reflectances, by that camera under that lamp."""
    signal = signals(on_grid(cameras_at_10_nm(1, 80)[0]), led(), surfaces)
    corners = np.array([[220.0, 180], [780, 180], [780, 545], [220, 545]])
    scene = chart_scene(720, 1000, 0.8 * signal / signal.max(), corners)
    counts = mosaic(scene, "RGGB", np.full(4, 512), 16383, 60000, 4.0, np.random.default_rng(seed))
    write_dng(folder / "chart.dng", counts, black=np.full(4, 512), exposure_s=Fraction(1, 60))
    chart = sb.find_chart(folder / "chart.dng")
    quality = replace(chart.quality, samples=replace(chart.samples, taken_at=taken_at))
    return replace(chart, quality=quality)


def test_the_chart_command_says_the_edition_with_its_evidence(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    told = photographed(tmp_path, SINCE.mean, 1).edition
    assert told.edition == "since November 2014" and told.evidence > 2
    assert told.finding.code == "edition.told" and told.finding.values["told"] == told.edition
    run = CliRunner().invoke(app, ["chart", "chart.dng", "--json"])
    assert json.loads(run.stdout)["edition"] == told.facts
    assert CliRunner().invoke(app, ["chart", "chart.dng"]).output.splitlines()[-1] == \
        f"edition: {told.says}"
    earlier = photographed(tmp_path, BEFORE_2014.mean, 1).edition
    assert earlier.evidence < told.evidence and earlier.edition != told.edition


def test_an_edition_that_the_photo_does_not_tell_is_not_named(tmp_path):
    # half-way between both editions nothing speaks for either
    told = photographed(tmp_path, np.sqrt(SINCE.mean * BEFORE_2014.mean), 2).edition
    assert told.edition is None and abs(told.evidence) < 2
    assert told.finding.values["nats"] == told.evidence and told.finding.values["told"] is None
    old = photographed(tmp_path, SINCE.mean, 3, taken_at="2010-06-01 10:00:00").edition
    assert (old.edition, old.evidence) == ("before November 2014", None)
    assert old.finding.code == "edition.by-date" and "2010-06-01" in old.says


def test_photos_of_a_camera_that_processed_them_and_other_charts_tell_no_edition(tmp_path):
    chart = photographed(tmp_path, SINCE.mean, 4)
    for kind, layout, code in (
            (PhotoKind.PROCESSED, CLASSIC, "edition.processed"),
            (PhotoKind.RAW, chart_layout("Digital SG"), "edition.unpublished"),
            (PhotoKind.RAW, chart_layout("SpyderCheckr 24"), "edition.unpublished")):
        image = replace(chart.photo.image, kind=kind)
        told = edition_in_photo(image, layout, chart.samples)
        assert (told.edition, told.evidence, told.finding.code) == (None, None, code)


@pytest.mark.parametrize("nats, told", [(0.5, None), (-1.9, None), (3.0, "since November 2014"),
                                        (-3.0, "before November 2014")])
def test_what_is_said_of_a_copy_follows_the_evidence_alone(nats, told):
    copy = calibrated(photo_of(SINCE.mean, 81)).copy
    copy = replace(copy, evidence={COPIES_SINCE_2014: 0.0, COPIES_BEFORE_2014: -nats})
    facts = copy_facts(copy, CLASSIC.names)
    assert facts["edition"] == told and f"by {abs(nats):.1f} nats" in facts["says"]
    # taken for a copy of the edition since, whatever the photo says
    values = chart_findings.edition(copy).values
    assert (values["made"], values["told"]) == ("since November 2014", told)


@pytest.mark.parametrize("name", ["canon550d_dusk", "industrial_indoor1", "industrial_outdoor4"])
def test_real_photos_say_the_same_edition_whatever_their_light(name):
    path = Path(os.environ.get("SPECTRABOX_DATA", "/nowhere")) / "raw_charts" / f"{name}.dng"
    if not path.is_file():
        pytest.skip(f"SPECTRABOX_DATA names no folder with {path.name}")
    # nobody noted the editions; the industrial sensor's photos are most likely of one chart
    assert sb.find_chart(path).edition.edition == "since November 2014"


def test_an_edition_is_as_likely_as_the_signals_that_it_foretells():
    """Independent: the densities of scipy, over the components of the prior on cameras."""
    rng = np.random.default_rng(12)
    spread = rng.standard_normal((5, 9))
    covariance, residuals = spread @ spread.T, rng.standard_normal((3, 5))
    weights, others = np.array([0.5, 0.3, 0.2]), rng.standard_normal((2, 5))
    explained = copy_errors.Explained(weights, np.linalg.solve(covariance, residuals.T).T,
                                      np.linalg.inv(covariance))
    law = multivariate_normal(np.zeros(5), covariance)
    expected = [np.log(weights @ (law.pdf(residuals - other) / law.pdf(residuals)))
                for other in others]
    np.testing.assert_allclose(copy_errors.edition_log_odds(explained, others), expected)
