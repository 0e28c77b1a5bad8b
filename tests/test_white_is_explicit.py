"""What a perfect white reads is stated, told by a chart or refused: never the sensor's full scale.

Real photos: SPECTRABOX_DATA=DIR, the folder that holds raw_charts/ and raw/.
"""
import json
import os
import re
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from flat_example import picture
from typer.testing import CliRunner

import spectrabox as sb
from spectrabox.api.arguments import relative_response
from spectrabox.capture.photo.image_writers import write_exr, write_png
from spectrabox.fixtures.flat_sample import write_photo
from spectrabox.measure import texts
from spectrabox.measure.pictures.photo_white import chart_residual, white_of_chart
from spectrabox.radiometry.appearance import encode_srgb, reflectance_to_lab
from spectrabox.radiometry.chart import CLASSIC
from spectrabox.radiometry.charts.references import reference_reflectances
from spectrabox.radiometry.errors import CheckError, InputError
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.spectra.given_spectra import as_reflectance
from spectrabox.sampling.prior.mixture import PRIOR_GRID
from spectrabox.session.cli import app

CAMERA = ("--sensitivity", "Nikon 5100 (NPL)", "--light", "D65")
NO_WHITE, NO_NOISE, NEARLY_BLACK = (texts.says(Finding(code, Severity.NOTE)) for code in (
    "signal.no-white", "signal.no-noise", "signal.xyz-nearly-black"))
NAMED = {"camera": "Nikon 5100 (NPL)", "light": "D65"}
DATA = Path(os.environ.get("SPECTRABOX_DATA", "no-data"))
INDOOR = DATA / "raw_charts" / "industrial_indoor1.dng"
NO_CHART = DATA / "raw" / "oecf_10bit_bayer.dng"
needs_data = pytest.mark.skipif(not INDOOR.exists(),
                                reason="SPECTRABOX_DATA names no folder of photos")


def uplift(image, out, *more):
    result = CliRunner().invoke(app, ["uplift", str(image), "-o", str(out), *CAMERA, "--side", "5",
                                      "--json", *more])
    return result.exit_code, json.loads(result.stdout)


@pytest.fixture
def grey(tmp_path):
    """A picture without a chart, relative to white."""
    write_exr(tmp_path / "grey.exr", np.full((40, 60, 3), 0.4, np.float32), ["R", "G", "B"])
    return tmp_path / "grey.exr"


@needs_data
def test_the_white_patch_of_a_real_photo_is_white_by_its_own_chart():
    photo = sb.open_photo(INDOOR)
    x, y = sb.find_chart(photo).corners[18].mean(axis=0) / 2    # a mosaic's cells are 2 x 2 pixels
    patch = (slice(int(y) - 2, int(y) + 2), slice(int(x) - 2, int(x) + 2))
    white, _ = white_of_chart(photo.image, relative_response("Nikon 5100 (NPL)", "D65"))
    mean, _ = sb.uplift(photo.signal[patch], white=white, **NAMED)
    lab = reflectance_to_lab(PRIOR_GRID.nm, mean.mean(axis=(0, 1)))
    usual = reference_reflectances(None, CLASSIC, FINE_GRID)[18]
    # copies of the patch differ by 2, and the camera is another; at full scale it was 76 -43 72
    np.testing.assert_allclose(lab, reflectance_to_lab(FINE_GRID.nm, usual), atol=2.5)


@needs_data
def test_a_camera_and_a_light_that_contradict_the_chart_of_a_photo_are_refused(tmp_path):
    code, facts = uplift(INDOOR, tmp_path / "out")
    assert code == 4 and re.search(
        r"indoor1.dng: The chart's patches are off by 2\d % rms from what this camera and light "
        r"predict .*camera fit", facts["error"])
    assert not (tmp_path / "out").exists()
    with pytest.raises(CheckError, match=r"patches are off by 2\d % rms"):
        sb.uplift(sb.open_photo(INDOOR), **NAMED)


def chart_with(camera, light, **changes):
    """Signals (24, 3) of a ColorChecker by a named camera under a named light, changed."""
    predicted = reference_reflectances(None, CLASSIC, FINE_GRID) @ relative_response(
        camera, light).T
    return predicted * changes.get("times", 1) + changes.get("plus", 0)


def test_only_what_camera_and_light_do_not_explain_is_off():
    across, down = CLASSIC.centres_uv.T
    true, used = chart_with(*NAMED.values()), np.ones((24, 3), bool)
    light = np.exp(0.4 * across - 0.2 * down * across)[:, None] * [0.3, 2.0, 1.1]
    assert chart_residual(true * light, true, used) < 1e-9      # gains and a smooth field are free
    wrong = chart_residual(chart_with("Nikon 5100 (NPL)", "A") * light, true, used)
    assert wrong > 0.03 and wrong == pytest.approx(chart_residual(
        chart_with("Nikon 5100 (NPL)", "A"), true, used))
    assert chart_residual(true + 0.03, true, used) > 0.1        # a veil
    clipped = np.where(np.arange(24)[:, None] == 18, 9.0, true)
    used[18] = False
    assert chart_residual(clipped, true, used) < 1e-9


def test_a_light_that_is_nearly_right_is_warned_of(tmp_path):
    write_photo(tmp_path / "photo.dng", picture(), Fraction(1, 60), np.random.default_rng(3))
    code, facts = uplift(tmp_path / "photo.dng", tmp_path / "out")
    assert code == 0 and 0.04 < facts["chart_residual"] < 0.1
    [found] = [one for one in facts["findings"] if one["code"] == "white.camera-unlike-chart"]
    assert " ".join(found[key] for key in ("sentence", "remedy")) in facts["warnings"]
    code, facts = uplift(tmp_path / "photo.dng", tmp_path / "out", "--white", "0.8,0.8,0.8")
    assert code == 0 and facts["chart_residual"] is None
    assert not [one for one in facts["findings"] if one["code"].startswith("white.")]
    assert facts["white_from"] == "stated; no chart was looked for"
    with pytest.warns(UserWarning, match="patches are off by"):
        sb.uplift(sb.open_photo(tmp_path / "photo.dng"), **NAMED)


def test_a_photo_decoded_from_srgb_stays_one_when_it_is_developed(tmp_path):
    noisy = 0.4 + 0.01 * np.random.default_rng(1).standard_normal((80, 90, 3))
    write_png(tmp_path / "seen.png", np.round(255 * encode_srgb(noisy)).astype(np.uint8))
    done = CliRunner().invoke(app, ["develop", str(tmp_path / "seen.png"), "--not-linear", "-o",
                                    str(tmp_path / "seen.exr")])
    assert done.exit_code == 0, done.output
    for white in ((), ("--white", "1,1,1")):
        code, facts = uplift(tmp_path / "seen.exr", tmp_path / "out", *white)
        assert code == 3 and "was decoded from sRGB" in facts["error"]


@needs_data
def test_a_raw_photo_without_a_chart_needs_its_white(tmp_path):
    code, facts = uplift(NO_CHART, tmp_path / "out")
    assert code == 3 and "no ColorChecker was found" in facts["error"]
    assert "Give --white with what a perfect white reads" in facts["error"]
    with pytest.raises(InputError, match=r"shares of what the sensor can hold.*Give white="):
        sb.uplift(sb.open_photo(NO_CHART), **NAMED)
    code, facts = uplift(NO_CHART, tmp_path / "out", "--white", "1,1,1.0")
    assert code == 0 and facts["white_from"].startswith("stated") and facts["white"] == [1, 1, 1]


def test_a_picture_without_a_chart_is_relative_to_white_and_the_answer_says_so(grey, tmp_path):
    code, facts = uplift(grey, tmp_path / "out")
    assert code == 0 and facts["white"] == [1, 1, 1]
    assert facts["white_from"] == "taken as 1: no --white was given, and no chart was found"


def test_values_of_8_bits_are_no_reflectances(grey, tmp_path):
    with pytest.raises(InputError, match=r"100% of the pixels are brighter than a perfect white"
                                         r".*white="):
        sb.uplift(np.full((4, 6, 3), 120.0), **NAMED)
    code, facts = uplift(grey, tmp_path / "out", "--white", "0.3,0.3,0.3")
    assert code == 3 and "100% of the pixels are brighter than a perfect white" in facts["error"]
    assert not (tmp_path / "out" / "mean.exr").exists()


def test_a_few_highlights_are_no_reason_to_refuse():
    image = np.full((10, 10, 3), 0.4)
    image[0, :5] = 3.0
    mean, _ = sb.uplift(image, **NAMED)
    assert mean.shape == (10, 10, 61)


def test_a_signal_of_which_white_and_noise_are_not_stated_says_so():
    def caveat(*more):
        result = CliRunner().invoke(app, ["sample", *CAMERA, "--signal", "0.346,0.449,0.146",
                                          "--json", *more])
        return json.loads(result.stdout).get("caveat", "")
    assert caveat() == f"{NO_WHITE}\n{NO_NOISE}"
    assert caveat("--white", "0.39,0.51,0.17") == NO_NOISE
    assert caveat("--white", "0.39,0.51,0.17", "--noise", "0.003") == ""


def test_advice_on_a_signal_says_the_same():
    def caveat(*more):
        result = CliRunner().invoke(app, ["advise", *CAMERA, "--signal", "0.346,0.449,0.146",
                                          "--lamps", "A", "--json", *more])
        return json.loads(result.stdout).get("caveat", "")
    assert caveat() == f"{NO_WHITE}\n{NO_NOISE}"
    assert caveat("--white", "0.39,0.51,0.17", "--noise", "0.003") == ""


def test_python_says_what_was_not_stated_of_a_signal_as_the_command_does():
    signal, white = [0.346, 0.449, 0.146], [0.39, 0.51, 0.17]
    bare = sb.sample(signal, **NAMED)
    assert bare.caveats == (NO_WHITE, NO_NOISE)
    for shown in (repr(bare), bare._repr_html_(), repr(sb.sample([signal, signal], **NAMED))):
        assert shown.count(NO_NOISE.split("'")[0]) == 1     # HTML writes the apostrophe its own way
    assert sb.sample(signal, white=white, **NAMED).caveats == (NO_NOISE,)
    stated = sb.sample(signal, white=white, noise=0.003, **NAMED)
    assert stated.caveats == () and "\n" not in repr(stated)
    assert sb.sample(lab=[45, -27, 30]).caveats == (NO_NOISE,)      # white by what it is
    with pytest.raises(InputError, match="relative to white by what it is"):
        sb.sample(lab=[45, -27, 30], white=white)
    nm = np.arange(400, 701, 5)
    library = {"grey": np.full(nm.size, 0.4)}
    assert NO_NOISE in sb.match([0.4, 0.4, 0.4], library, nm=nm, **NAMED).says
    assert NO_NOISE not in sb.match([0.4, 0.4, 0.4], library, nm=nm, noise=0.01, **NAMED).says


def test_a_truth_above_one_is_taken_for_per_cent():
    nm = np.arange(400.0, 701.0, 10.0)
    with pytest.raises(InputError, match=r"vase: a reflectance of 1\.5 looks like percent"):
        as_reflectance((nm, np.full(nm.size, 1.5)), "vase")
    with pytest.raises(InputError, match="cannot be negative"):
        as_reflectance((nm, np.full(nm.size, -0.1)), "vase")
    # brightened paper
    assert as_reflectance((nm, np.where(nm < 450, 1.2, 0.9)), "paper").max() > 1.1


@needs_data
def test_a_signal_of_a_real_photo_is_white_by_the_white_that_is_stated():
    """Of the white patch: without its white it seems green and familiar, which the answer says."""
    signal = sb.find_chart(sb.open_photo(INDOOR)).samples.mean[18]
    bare = sb.sample(signal, noise=0.003, **NAMED)
    assert bare.lab().value[1] < -30 and NO_WHITE in repr(bare)
    usual = reference_reflectances(None, CLASSIC, FINE_GRID)[18]
    white = signal / (relative_response("Nikon 5100 (NPL)", "D65") @ usual)
    stated = sb.sample(signal, white=white, noise=0.003 * signal, **NAMED)
    np.testing.assert_allclose(stated.lab().value, reflectance_to_lab(FINE_GRID.nm, usual),
                               atol=2.5)
    assert stated.caveats == ()


@needs_data
def test_products_of_a_real_photo_are_taken_for_sensitivities_nowhere(tmp_path):
    camera = sb.fit_camera(INDOOR, light="unknown")
    file = camera.to_csv(tmp_path / "mine.csv")
    for given in (camera, camera.calibration, file):
        for ask in (lambda one: sb.sample([0.3, 0.4, 0.2], camera=one, light="D65", noise=0.01),
                    lambda one: sb.uplift(np.full((2, 2, 3), 0.3), camera=one, light="D65"),
                    lambda one: sb.match([0.3, 0.4, 0.2], {"a": np.full(61, 0.3)},
                                         nm=np.arange(400, 701, 5), camera=one, light="D65")):
            with pytest.raises(InputError, match="holds products of sensitivity and light"):
                ask(given)


def test_what_is_brighter_than_white_or_nearly_black_by_its_scale_says_so():
    bright = sb.sample([1.2, 1.3, 1.1], noise=0.01, white=[1, 1, 1], **NAMED)
    assert "No spectrum between 0 and 1 gives the signal" in repr(bright)
    assert "\n" not in repr(sb.sample([0.5, 0.4, 0.3], noise=0.01, white=[1, 1, 1], **NAMED))
    assert NEARLY_BLACK in sb.sample(xyz=[0.145, 0.201, 0.096]).caveats
    assert NEARLY_BLACK not in sb.sample(xyz=[14.5, 20.1, 9.6]).caveats
    result = CliRunner().invoke(app, ["sample", "--xyz", "0.145,0.201,0.096", "--json"])
    assert NEARLY_BLACK in json.loads(result.stdout)["caveat"]
    result = CliRunner().invoke(app, ["sample", "--xyz", "14.5,20.1", "--json"])
    assert result.exit_code == 3 and "write three numbers" in json.loads(result.stdout)["error"]


@pytest.mark.parametrize("noise", [-0.01, 1.0, np.nan])
def test_the_noise_of_a_pixel_is_a_share_of_its_signal(noise, grey, tmp_path):
    with pytest.raises(InputError, match=r"relative to its signal: 0 to 0\.5 is needed"):
        sb.uplift(np.full((4, 6, 3), 0.3), noise=noise, **NAMED)
    code, facts = uplift(grey, tmp_path / "out", "--noise", str(noise))
    assert code == 3 and "0 to 0.5 is needed" in facts["error"]


def test_curves_given_in_python_are_checked_as_those_of_files():
    nm = np.arange(400.0, 701.0, 10.0)
    with pytest.raises(InputError, match="the light is dark or falls below zero"):
        sb.sample([0.3, 0.3, 0.3], camera="Nikon 5100 (NPL)", light=(nm, -np.ones(nm.size)))
    curves = np.array([np.ones(nm.size), nm / 700, -nm])
    with pytest.raises(InputError, match="a band of the camera sees nothing"):
        sb.sample([0.3, 0.3, 0.3], camera=(nm, curves), light="D65")
    with pytest.raises(InputError, match="is not positive in every band"):
        sb.uplift(np.full((4, 6, 3), 0.3), white=[1, 0, 1], **NAMED)
