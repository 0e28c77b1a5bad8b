"""What to do next: forecasts are those of the solver, and name what can be done."""
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from flat_example import rect_of, write_flat

import spectrabox as sb
from spectrabox.measure.advice.advice import HOW_TO, TIMES, advice, advised, ranked
from spectrabox.measure.advice.advise import advice_on_capture, usual_at_hand
from spectrabox.measure.advice.flat_actions import FlatPhotos, with_level
from spectrabox.measure.advice.forecast import (
    COLOUR,
    WIDTH,
    Unknown,
    left_errors,
    outlook_after,
    outlook_of,
    outlook_of_signals,
)
from spectrabox.measure.advice.further import with_photos, with_reading
from spectrabox.measure.more_bands.filter_fit import (
    curves_and_light,
    photos_at_hand,
    white_of_bands,
)
from spectrabox.measure.more_bands.joined_errors import ChartFitted
from spectrabox.measure.surfaces.surface_signals import alone
from spectrabox.radiometry.appearance import ciede2000, reflectance_to_lab
from spectrabox.radiometry.error_model import CAUSES, LIGHT_FIELD
from spectrabox.sampling.prior.mixture import PRIOR_GRID, load_prior
from spectrabox.sampling.prior.signal_posterior import solve_posterior

ROOT = Path(__file__).resolve().parents[1]
REGIONS = ("green_wall", "red_wall", "cube")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("advice")
    write_flat(folder)
    return folder


def measured(folder, names=REGIONS, **stated):
    return sb.flat(folder / "photos" / "sample.dng", {name: rect_of(name) for name in names},
                   light=folder / "spectra" / "light.csv", **stated)


@pytest.fixture(scope="module")
def plain(folder):
    return measured(folder)


def unknown_of(result, name):
    """A surface of a result, as it is known now."""
    capture, records = result.found.advise.args
    signals = alone(records.signals, records.signals.names.index(name))
    found = records.spectra[name]
    return Unknown(load_prior(), 0.95, signals, found.samples.spectra.mean(axis=0),
                   found.states.mean, np.ones(2), np.ones(2),
                   550.0), FlatPhotos(capture, records)


def outlook_now(unknown):
    return outlook_of_signals(unknown.prior, unknown.level, unknown.signals)


def test_every_action_is_explained_on_its_page():
    page = (ROOT / HOW_TO).read_text(encoding="utf-8")
    anchors = {title.lower().replace(" ", "-") for title in re.findall(r"^## (.+)$", page, re.M)}
    assert set(TIMES) <= anchors


def test_doing_nothing_brings_nothing(plain):
    unknown, sample = unknown_of(plain, "red_wall")
    now, after = outlook_now(unknown), outlook_after(unknown, unknown.signals)
    assert after[WIDTH] == pytest.approx(now[WIDTH], rel=1e-6)
    again = outlook_after(unknown, sample.signals("red_wall"))
    assert again[WIDTH] == pytest.approx(now[WIDTH], rel=1e-3)
    assert again[COLOUR] == pytest.approx(now[COLOUR], rel=1e-3)


def test_a_level_that_is_a_variable_errs_as_one_that_is_an_error(plain):
    unknown, _ = unknown_of(plain, "red_wall")
    now, turned = outlook_now(unknown), outlook_now(with_level(unknown))
    assert turned[WIDTH] == pytest.approx(now[WIDTH], rel=1e-3)


def test_colours_err_as_those_of_draws(plain):
    unknown, _ = unknown_of(plain, "cube")
    posterior = solve_posterior(unknown.prior, plain["cube"].measurement)
    drawn = reflectance_to_lab(PRIOR_GRID.nm, posterior.draws(4000, 1))
    middle = reflectance_to_lab(PRIOR_GRID.nm, posterior.mean)
    by_draws = np.sqrt(np.mean(ciede2000(middle, drawn)**2))
    assert outlook_of(posterior, 0.95)[COLOUR] == pytest.approx(by_draws, rel=0.1)


def test_less_error_is_a_narrower_band_and_the_forecast_signal_stays(plain):
    unknown, _ = unknown_of(plain, "green_wall")
    widths = [outlook_after(unknown, replace(unknown.signals, errors={
        cause: share * covariance for cause, covariance in unknown.signals.errors.items()}))[WIDTH]
        for share in (1.0, 0.5, 0.1)]
    assert widths == sorted(widths, reverse=True) and widths[0] > 1.02 * widths[2]


def test_errors_in_proportion_are_forecast_at_the_brightness_that_is_expected(plain):
    """Three times as bright, with errors that are three times as large, signals forecast the same,
    where those of now are explained without an error."""
    unknown, sample = unknown_of(plain, "cube")
    unknown = replace(unknown, signals=replace(
        unknown.signals, signal=unknown.signals.signal - left_errors(unknown)))
    after = sample.signals("cube")
    brighter = replace(after, signal=3 * after.signal, errors={
        cause: covariance * (1 if CAUSES[cause].kind == "added" else 9)
        for cause, covariance in after.errors.items()})
    np.testing.assert_allclose(outlook_after(unknown, brighter), outlook_after(unknown, after),
                               rtol=1e-6)


def test_a_reading_is_forecast_as_it_comes(plain):
    unknown, _ = unknown_of(plain, "red_wall")
    now, after = outlook_now(unknown), outlook_after(unknown, with_reading(unknown, 650.0))
    assert after[WIDTH] < now[WIDTH]


def test_the_list_is_of_what_can_still_be_done(folder, plain):
    actions = {one.action for one in plain["cube"].advice}
    assert {"gel", "reading"} <= actions
    capture, records = measured(folder, (*REGIONS, "white_wall"), known={
        "white_wall": folder / "spectra" / "white_wall.csv"}, surface="matt").found.advise.args
    later = advice_on_capture(capture, records)
    assert "white_wall" not in later.by_surface
    assert not {"white-card", "matt"} & {one.action for each in later.by_surface.values()
                                        for one in each}


def test_a_white_card_brings_what_was_said(folder, plain):
    """Carried out: the white paint beside the others is the card."""
    carded = measured(folder, (*REGIONS, "white_wall"),
                      known={"white_wall": folder / "spectra" / "white_wall.csv"})
    sample, _ = unknown_of(plain, REGIONS[0])
    for name in REGIONS:
        unknown, sample = unknown_of(plain, name)
        said = outlook_after(unknown, sample.signals(name, card=True))[WIDTH]
        ratio = said / outlook_now(unknown)[WIDTH]
        got = carded[name].band_width / plain[name].band_width
        assert ratio == pytest.approx(got, abs=0.1)


def test_advice_is_of_a_result_a_session_or_a_folder_and_of_nothing_else(tmp_path):
    with pytest.raises(sb.InputError, match=r"session\.toml is missing"):
        sb.advise(tmp_path / "none")
    for other in (None, 5, (0.3, 0.2, 0.1)):
        with pytest.raises(sb.InputError, match=type(other).__name__):
            sb.advise(other)
    with pytest.raises(sb.InputError, match="give both"):
        sb.advise(sb.sample([0.3, 0.2, 0.1], camera="Nikon 5100 (NPL)", light="D65"),
                  camera="Nikon 5100 (NPL)")


def test_under_a_light_that_is_hardly_known_a_gel_brings_little(plain):
    """All photos share such an error; a chart beside the sample takes it away."""
    unknown, _ = unknown_of(plain, "red_wall")
    now, brighter, error = unknown.signals, 1.5, 0.5
    light = error**2 * np.outer(now.signal[0], now.signal[0])[None]
    dark = replace(unknown, signals=replace(now, signal=brighter * now.signal, errors={
        cause: brighter**2 * covariance
        for cause, covariance in {**now.errors, LIGHT_FIELD: light}.items()}))
    capture, records = plain.found.advise.args
    calibration = records.calibrations(capture.views)[0]
    curves, present = curves_and_light(calibration)
    fitted = ChartFitted(calibration, capture.lit_chart.reflectances, 0.01)
    gels = [photo for photo in photos_at_hand(curves, present, usual_at_hand())
            if photo.filter is not None]
    before = outlook_now(dark)
    for gel in gels[:3]:
        after = outlook_after(dark, with_photos(dark, [gel], white_of_bands(curves, present),
                                                fitted))
        # it tells of the shape of the spectrum, which is a sixth of the band at most
        assert after[WIDTH] > 0.8 * before[WIDTH]
    known = outlook_after(dark, now)
    assert known[WIDTH] < 0.6 * before[WIDTH]


def test_the_narrowest_comes_first_and_little_is_not_said(plain):
    for each in (plain.advice, *(one.advice for one in plain.values())):
        left = [(one.width_after / one.width_before) ** (1 / one.times) for one in each]
        assert left == sorted(left)
        assert all(one.width_after < 0.98 * one.width_before for one in each)
        assert all(one.width_before == pytest.approx(each[0].width_before) for one in each)
    # one width is said of a surface, by the report and by the advice
    assert plain["cube"].advice[0].width_before == plain["cube"].band_width


def test_a_list_of_all_has_means():
    wide, narrow = np.array([0.2, 3.0]), np.array([0.1, 1.0])
    gel = advice("gel", wide, np.array([0.1, 1.5]), "a gel")
    together = advised({"one": [gel], "other": []}, {"one": wide, "other": narrow})
    (found,) = together.overall
    assert found.width_before == pytest.approx(0.15) and found.width_after == pytest.approx(0.1)
    assert found.colour_before == pytest.approx(2.0) and found.colour_after == pytest.approx(1.25)
    assert together.by_surface == {"one": (gel,), "other": ()}
    # a reading of each surface takes as many readings, a gel one photo
    reading = advice("reading", wide, np.array([0.09, 1.4]), "450 nm")
    many = dict.fromkeys("abcd", wide)
    first, second = advised(dict.fromkeys(many, (reading, gel)), many).overall
    assert (first.action, second.action, second.times) == ("gel", "reading", 4)
    assert second.cost == "4 readings" and second.width_after < first.width_after
    assert not ranked([advice("matt", wide, np.array([0.199, 3.0]))])


def test_text_and_json_say_the_same(plain):
    said = plain.facts()["advice"]
    several = len(said["surfaces"])
    assert plain.text().splitlines()[-1] == f"next: {plain.advice[0].text}" + (
        f" (means of {several})" if several > 1 else "")
    assert said["overall"][0] == plain.advice[0].facts
    assert [one["action"] for one in said["surfaces"]["cube"]] == [
        one.action for one in plain["cube"].advice]
