"""One lamp in two places: gloss, plane and shadow of each sample are measured."""
import json

import numpy as np
import pytest
from typer.testing import CliRunner

import spectrabox as sb
from spectrabox.fixtures import lamp
from spectrabox.fixtures.demos.demo_photos import camera_sensitivities
from spectrabox.fixtures.near_lamps import (
    REGIONS,
    Lamp,
    Place,
    Shoot,
    by_instrument,
    gloss_of,
    photograph,
    rectangles,
    with_gloss,
)
from spectrabox.fixtures.paints import NM, chart_copy, random_paints
from spectrabox.measure.regions.moved_lamp import (
    differences_of_photos,
    found_in_places,
    gloss_and_level,
)
from spectrabox.measure.surfaces.surface_signals import measurement
from spectrabox.radiometry.error_model import PHOTO_NOISE
from spectrabox.radiometry.records.spectra import SurfaceSignals
from spectrabox.sampling.prior.mixture import load_prior
from spectrabox.sampling.prior.signal_posterior import solve_posterior
from spectrabox.session.cli import app
from spectrabox.session.config.session_file import read_session
from spectrabox.session.page.marks import Mark, marked

from tests.sampling_cameras import response

GRID, RESPONSE = response()
RED = np.interp(GRID.nm, [400, 500, 560, 620, 700], [0.06, 0.08, 0.1, 0.35, 0.45])
GREY = np.full(GRID.nm.size, 0.4)
PLACES = ["photo"] * 3 + ["photo, moved for b"] * 3
FIRST = Lamp(azimuth=2.0, elevation=np.radians(45), distance=3.0, side=0.2)
ELSEWHERE = Lamp(azimuth=-0.3, elevation=np.radians(40), distance=3.0, side=0.2)


def signals_of(spectrum, gloss=(0.0, 0.0), level=(0.0, 0.0), colour=(0.0, 0.0, 0.0), plane=0.02,
               noise=0.002, rng=None):
    """A sample in two photos: its gloss and level in each, and what changes its first photo's
    bands, relative.
    """
    matt = RESPONSE @ spectrum
    signal = np.r_[matt * (1 + level[0]) * (1 + np.array(colour)) + gloss[0],
                   matt * (1 + level[1]) + gloss[1]]
    if rng is not None:
        signal += noise * rng.standard_normal(6)
    covariance = np.kron(np.eye(2), np.ones((3, 3))) * plane**2 * np.outer(signal, signal)
    return SurfaceSignals(
        ("it",), (False,), GRID, spectrum[None], tuple(
            f"{photo}: {band}" for photo in ("photo", "b") for band in "RGB"),
        np.repeat([0, 1], 3), np.vstack([RESPONSE, RESPONSE]), signal[None],
        {PHOTO_NOISE: noise**2 * np.eye(6)[None]},
        (gloss_and_level(None, signal, PLACES, covariance),))


def found(**what):
    return differences_of_photos(signals_of(RED, **what), ["photo", "b"])


def test_what_two_photos_differ_by_is_named_with_its_cause():
    assert found() == ()
    (gloss,) = found(gloss=(0.035, 0.005))
    assert (gloss.code, gloss.values["more"], gloss.values["less"]) == ("lamp.gloss", "photo", "b")
    assert abs(gloss.values["share"] - 0.03) < 2 * gloss.values["error"] < 0.015
    (shadow,) = found(level=(0.0, -0.12), plane=0.01)
    assert (shadow.code, shadow.values["dark"]) == ("lamp.darker", "b")
    (image,) = found(gloss=(0.12, 0.0))
    assert (image.code, image.values["more"]) == ("lamp.image-mirrored", "photo")
    assert image.values["share"] == pytest.approx(0.12, abs=0.005)
    (moved,) = found(colour=(0.0, 0.2, 0.0))
    assert moved.code == "lamp.unexplained"


def test_nothing_is_named_of_what_chance_explains():
    rng = np.random.default_rng(5)
    named = sum(bool(differences_of_photos(signals_of(
        RED, gloss=tuple(rng.uniform(0, 0.006, 2)), level=tuple(0.02 * rng.standard_normal(2)),
        rng=rng), ["photo", "b"])) for _ in range(300))
    # From 2.5 standard errors on, of gloss and of level: 1 % each, and two standard deviations.
    assert named <= 11


@pytest.mark.parametrize("gloss, level", [((0.03, 0.005), (0.0, 0.0)), ((0.0, 0.0), (-0.1, 0.0))])
def test_gloss_and_level_are_found_within_their_errors(gloss, level):
    signals = signals_of(RED, gloss=gloss, level=level)
    posterior = solve_posterior(load_prior(), measurement(signals, 0))
    found = found_in_places(signals, 0, posterior.states)
    assert [place["photo"] for place in found] == ["photo", "b"]
    for place, true_gloss, true_level in zip(found, gloss, level, strict=True):
        assert abs(place["gloss"] - true_gloss) < 2 * place["gloss_error"]
        assert abs(place["level"] - true_level) < 2 * place["level_error"]
    # what differs is known better than what is common
    assert found[0]["gloss_error"] < 0.02


def test_a_grey_tells_gloss_and_level_by_what_is_likely_alone():
    signals = signals_of(GREY, gloss=(0.03, 0.0))
    posterior = solve_posterior(load_prior(), measurement(signals, 0))
    first, other = found_in_places(signals, 0, posterior.states)
    assert first["gloss_error"] > 0.005 and first["level_error"] > 0.02
    level, gloss = (first[name] - other[name] for name in ("level", "gloss"))
    assert abs(0.4 * level + gloss - 0.03) < 0.01


@pytest.fixture(scope="module")
def shoot():
    rng = np.random.default_rng(11)
    return Shoot(camera_sensitivities(), chart_copy(rng), random_paints(REGIONS, rng), "satin",
                 Place(), Place(), ambient=0.05, glare=0.004, corner=0.9)


def test_lobes_mirror_what_lies_in_their_way(shoot):
    # the higher the lamp, the nearer its image to what the camera sees
    shares = [gloss_of(shoot, Lamp(2.0, np.radians(angle), 3.0, 0.2)) for angle in (35, 45, 55)]
    assert shares == sorted(shares) and shares[0] < 0.005 < 0.02 < shares[2]
    assert abs(gloss_of(shoot, with_gloss(shoot, FIRST, 0.03)) - 0.03) < 1e-3
    # a rough lobe is much the same from everywhere, so that an instrument reads it as well
    assert by_instrument("matt") > 0.01 > by_instrument("satin")


@pytest.mark.usefixtures("no_advice")
def test_the_command_takes_a_photo_with_the_lamp_moved(shoot, tmp_path):
    rng, power = np.random.default_rng(4), lamp.radiance(NM)
    for name, place in (("a", FIRST), ("b", ELSEWHERE)):
        photograph(tmp_path / f"{name}.dng", shoot, [(place, power)], rng)
    rectangle = ",".join(map(str, rectangles()[0]))
    outcome = CliRunner().invoke(app, [
        "flat", str(tmp_path / "a.dng"), "--also", f"{tmp_path / 'b.dng'}=moved",
        "--region", f"s0={rectangle}", "--json"])
    assert outcome.exit_code in (0, 1), outcome.stderr
    answer = json.loads(outcome.stdout)
    (region,) = answer["regions"]
    assert [place["photo"] for place in region["lamp_places"]] == ["photo", "b"]
    assert region["gloss"] == region["lamp_places"][0]["gloss"]
    assert "the lamp of “photo” in another place" in answer["photos"][1]["says"]
    capture = read_session(tmp_path / "a-flat").capture()
    assert capture.lamp_moved and len({view.place for view in capture.views}) == 2
    # the picture of spectra is made of what stands in one light
    assert capture.picture_views == capture.views[:1]


def test_the_page_writes_a_photo_with_the_lamp_moved():
    text = marked('[photos]\nobject = "a.dng"\n', Mark(
        kind="view", name="b", stated={"photo": "b.dng", "same_light_as": "photo",
                                       "lamp": "moved"}))
    assert '[views.b]' in text and 'lamp = "moved"' in text


@pytest.mark.parametrize("gloss, shade", [(0.03, 0.0), (None, 0.1)])
def test_bands_hold_with_gloss_or_a_shadow_in_one_of_two_photos(shoot, tmp_path, gloss, shade):
    first = FIRST if gloss is None else with_gloss(shoot, FIRST, gloss)
    rng, power = np.random.default_rng(3), lamp.radiance(NM)
    mirrored = [photograph(tmp_path / "photo.dng", shoot, [(first, power)], rng, shade=shade),
                photograph(tmp_path / "moved.dng", shoot, [(ELSEWHERE, power)], rng)]
    regions = {f"s{number}": corners for number, corners in enumerate(rectangles())}
    result = sb.flat(tmp_path / "photo.dng", regions, also={tmp_path / "moved.dng": "moved"},
                     draws=1000, progress=False)
    held, misses = [], []
    for each, region, truth, of_both in zip(result.values(), result.found.surfaces,
                                            shoot.surfaces, np.transpose(mirrored), strict=True):
        lower, upper = each.band(0.95)
        at_nm = np.interp(each.nm, NM, truth)
        held.append(np.mean((lower <= at_nm) & (at_nm <= upper)))
        misses += [(place["gloss"] - true) / place["gloss_error"]
                   for place, true in zip(region.places, of_both, strict=True)]
    # .93, less two standard errors of about three independent readings of each of nine paints
    assert np.mean(held) > 0.85
    assert np.sqrt(np.mean(np.square(misses))) < 1.5
