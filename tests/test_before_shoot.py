"""What is expected of spectra before the shoot: nothing known costs, poor lamps are said."""
import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

from spectrabox.calibrate.prior.camera_prior import shipped_prior
from spectrabox.calibrate.prior.plain_priors import prior_of_curves
from spectrabox.measure.advice.before_shoot import Shoot, expected_spectra
from spectrabox.measure.more_bands.further_photos import LampsAtHand
from spectrabox.radiometry.chart import CLASSIC, chart_reflectances
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.records.spectra import Quantity, Spectrum, UnknownLight
from spectrabox.radiometry.spectra.filters import stated_filter
from spectrabox.radiometry.spectra.named_spectra import light, sensitivities
from spectrabox.session.cli import app

CHART = chart_reflectances("BabelColor Average", FINE_GRID)
HAND = LampsAtHand({name: light(name, FINE_GRID) for name in ("A", "LED-B3")}, {})
KNOWN_CAMERA = prior_of_curves(FINE_GRID, sensitivities("Nikon 5100 (NPL)", FINE_GRID), 1e-4)


def spectrum(values):
    return Spectrum(FINE_GRID, values, Quantity.RELATIVE, "lamp")


def expected(stated, cameras, noise, surfaces=3):
    shoot = Shoot(stated, cameras, CHART, CLASSIC.centres_uv, noise)
    return expected_spectra(shoot, HAND, photos=2, surfaces=surfaces)


@pytest.fixture(scope="module")
def in_daylight():
    return expected(spectrum(light("D65", FINE_GRID)), KNOWN_CAMERA, 0.01)


def run(*words):
    return CliRunner().invoke(app, list(words))


def test_a_known_camera_and_lamp_leave_what_metamerism_leaves():
    found = expected(spectrum(light("LED-B3", FINE_GRID)), KNOWN_CAMERA, 1e-3, surfaces=6)
    assert found.mean.rmse == pytest.approx(found.mean.rmse_known, rel=0.03)
    # 84 surfaces, whose bands hold or fail nearly as a whole: 95 % less four standard errors.
    assert found.mean.inside > 0.95 - 4 * np.sqrt(0.95 * 0.05 / 84)


def test_noise_and_an_unknown_light_cost():
    little = expected(UnknownLight(), shipped_prior(), 0.005).mean
    much = expected(UnknownLight(), shipped_prior(), 0.04).mean
    assert much.rmse > little.rmse and much.width > little.width
    assert little.width > little.width_known


def test_a_lamp_that_shows_little_of_a_spectrum_is_said(in_daylight):
    narrow = np.exp(-0.5 * ((FINE_GRID.nm - 560) / 25) ** 2) + 0.002
    poor = expected(spectrum(narrow), KNOWN_CAMERA, 0.01)
    assert any("shows less of a spectrum" in said for said in poor.doubts)
    assert in_daylight.doubts == ()
    assert in_daylight.mean.rmse_known == pytest.approx(in_daylight.rmse_daylight)


def test_a_second_photo_never_harms_and_the_best_comes_first(in_daylight):
    after = [one.width_after for one in in_daylight.advice]
    assert {one.subject for one in in_daylight.advice} <= {"A", "LED-B3"}
    assert after == sorted(after) and after[-1] < in_daylight.advice[0].width_before


def test_a_filter_that_is_badly_known_brings_less():
    stated = stated_filter("exact", 0.02 + 0.88 / (1 + np.exp((560 - FINE_GRID.nm) / 12)))
    vague = replace(stated, modes=10 * stated.modes)
    shoot = Shoot(spectrum(light("D65", FINE_GRID)), shipped_prior(), CHART, CLASSIC.centres_uv,
                  0.01)
    after = {one.subject: one.width_after for one in expected_spectra(
        shoot, LampsAtHand({}, {"exact": stated, "vague": vague}), photos=1, surfaces=6).advice}
    assert after["exact"] < after["vague"]
    assert after["exact and vague"] < after["vague"]


def test_the_command_says_it_without_a_stated_light():
    result = run("advise", "--light", "led", "--surfaces", "1", "--json")
    assert result.exit_code == 0, result.output
    expected_of_it = SimpleNamespace(**json.loads(result.stdout)["expected"])
    assert {"paint", "skin"} <= {one["family"] for one in expected_of_it.families}
    assert expected_of_it.mean["rmse"] == pytest.approx(
        np.mean([one["rmse"] for one in expected_of_it.families]))
    assert expected_of_it.will_do == (expected_of_it.doubts == [])


def test_the_command_names_every_family_in_words():
    text = run("advise", "--light", "D65", "--surfaces", "1").stdout
    assert "paint " in text and "what to do next" in text and "gel" in text


def test_what_cannot_be_asked_is_said():
    for words, said in ((("--surfaces", "0"), "is too few"),
                        (("--noise", "0"), "between 0 and 1"),
                        (("--sensitivity", "a.csv", "--prior", "b.npz"), "give one")):
        result = run("advise", "--light", "D65", *words)
        assert result.exit_code == 3 and said in " ".join(result.output.split())
