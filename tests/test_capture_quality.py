"""The field of the light over a chart, the verdict on a chart photo, and the commands chart and
develop.
"""
import json
from fractions import Fraction

import numpy as np
import pytest
from typer.testing import CliRunner

from spectrabox.capture.chart import quality
from spectrabox.capture.chart.chart_agreement import TYPICAL_SIGNALS
from spectrabox.capture.chart.detection import find_chart, locate_chart, patch_gap
from spectrabox.capture.chart.quality import judge_chart
from spectrabox.capture.develop.developed import open_any
from spectrabox.capture.photo.image_files import read_linear_file
from spectrabox.capture.photo.image_writers import NO_DATE, write_linear_exr, write_png
from spectrabox.capture.photo.linear import open_photo
from spectrabox.capture.photo.preview import encode_srgb8, signal_rgb8
from spectrabox.fixtures.chart_scene import GRID_MM, PITCH_MM, chart_scene, mosaic
from spectrabox.fixtures.dng import write_dng
from spectrabox.measure import texts
from spectrabox.measure.photo_quality import DARKEST, MAX_CLIPPED, exposed
from spectrabox.radiometry import chart as published
from spectrabox.radiometry.errors import CheckError
from spectrabox.radiometry.findings import faults
from spectrabox.radiometry.grid import visible_grid
from spectrabox.session.cli import app

HEIGHT, WIDTH = 720, 1000
BLACK, WHITE, ELECTRONS, READ_DN = np.array([512, 510, 514, 516]), 16383, 20000, 4.0
CAMERA_GAIN = np.array([0.4, 0.7, 0.5])
UNIT = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
SIGNALS = CAMERA_GAIN * TYPICAL_SIGNALS
PLACE = (UNIT - 0.5) * GRID_MM * 560 / GRID_MM[0] + np.array([WIDTH, HEIGHT]) / 2


def write_photo(path, scene, seed=1, electrons=ELECTRONS, **changes):
    counts = mosaic(scene, "RGGB", BLACK, WHITE, electrons, READ_DN, np.random.default_rng(seed))
    write_dng(path, counts, black=BLACK, **({"exposure_s": Fraction(1, 60)} | changes))
    return path


def chart_photo(folder, signals=SIGNALS, place=PLACE, **changes):
    return write_photo(folder / "chart.dng", chart_scene(HEIGHT, WIDTH, signals, place, **changes))


def faults_of(verdict):
    """Codes of what speaks against a photo, with the values."""
    return {one.code: one.values for one in faults(verdict.findings)}


def judged(folder, **changes):
    image = open_photo(chart_photo(folder, **changes))
    return judge_chart(image, find_chart(image, TYPICAL_SIGNALS), TYPICAL_SIGNALS)


# ---- reference -----------------------------------------------------------------------------------

def test_the_stored_reference_is_that_of_the_published_reflectances():
    grid = visible_grid(10.0)
    computed = published.typical_camera_signals(
        published.chart_reflectances("BabelColor Average", grid), grid)
    # Four decimals are stored.
    np.testing.assert_allclose(TYPICAL_SIGNALS, computed, atol=0.5e-4)


# ---- verdict -------------------------------------------------------------------------------------

def test_a_good_photo_is_good(tmp_path):
    verdict = judged(tmp_path)
    assert (verdict.verdict, faults_of(verdict)) == ("good", {})
    # 3 sigma cuts keep 99.2 % of three independent bands; the highest of 24 patches of 300 samples
    # stays below 5 %.
    assert verdict.excluded.max() < 0.05 and verdict.blur < 0.1 and verdict.tilt_deg < 5


@pytest.mark.parametrize("changes, code, holds", [
    ({"signals": 1.8 * SIGNALS, "background": 0.1}, "chart.clipped",
     lambda values: "white 9.5" in values["names"] and values["clipped"] < values["patches"] == 24),
    ({"signals": 0.04 * SIGNALS, "background": 0.01, "frame": 0.001}, "chart.dark",
     # the exposure that is advised brings the white patch to 0.7
     lambda values: 0.02 < values["white"] < 0.03
     and values["times"] * values["white"] == pytest.approx(0.7)),
    ({"gradient_stops": 2.5}, "chart.uneven-light",
     lambda values: values["uneven"] > values["limit"])])
def test_exposure_and_light_are_judged(tmp_path, changes, code, holds):
    verdict = judged(tmp_path, **changes)
    assert verdict.verdict == "re-shoot" and holds(faults_of(verdict)[code])


def test_light_that_a_scene_explains_is_no_reason_to_shoot_again():
    x = np.tile(np.linspace(0, 1, 6), 4)
    light = 2.0**(2 * x)
    alone, = quality.uneven_light(light)
    assert (alone.code, alone.values["uneven"]) == ("chart.uneven-light", 3.0)
    # Photo and scene agree within 10 %.
    assert quality.uneven_light(light, light * (1 + 0.1 * x)) == []
    beyond, = quality.uneven_light(light, light**-1, "a.dng")
    assert (beyond.code, beyond.subject) == ("chart.uneven-beyond-scene", "a.dng")


def test_a_light_without_power_in_a_band_is_named_and_not_the_chart(tmp_path):
    grid = visible_grid(1.0)
    led = np.exp(-0.5 * ((grid.nm - 660) / 10) ** 2)
    bands = np.array([np.exp(-0.5 * ((grid.nm - peak) / width) ** 2)
                      for peak, width in published.TYPICAL_BANDS_NM])
    signals = published.chart_reflectances("BabelColor Average", grid) @ (bands * led).T
    signals *= 0.6 / signals.max()
    image = open_photo(chart_photo(tmp_path, signals=signals, background=0.3 * signals[18],
                                   frame=0.03 * signals[18]))
    with pytest.raises(CheckError, match=r"band 3 reads 0\.\d% of the brightest band: the "
                                         "light has no power there"):
        find_chart(image, TYPICAL_SIGNALS)


def test_glare_is_named_with_its_patches(tmp_path):
    scene = chart_scene(HEIGHT, WIDTH, SIGNALS, PLACE)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    centre = PLACE.mean(axis=0) + np.array([60, 100])
    scene = scene + 0.08 * SIGNALS[18] * np.exp(-((x - centre[0]) ** 2 + (y - centre[1]) ** 2) / 2
                                                / 70**2)[..., None]
    image = open_photo(write_photo(tmp_path / "chart.dng", scene))
    verdict = judge_chart(image, find_chart(image, TYPICAL_SIGNALS), TYPICAL_SIGNALS)
    values = faults_of(verdict)["chart.glare"]
    assert values["glare"] == verdict.glare > values["limit"] and values["names"]


LIMITS = {"chart.dark": (lambda value: quality.dark(1 - value), 1 - quality.MIN_WHITE_SIGNAL),
          "chart.tilted": (quality.tilted, quality.MAX_TILT_DEG),
          "chart.blurred": (lambda value: quality.blurred(np.array([value, 0.2])),
                            quality.MAX_BLUR),
          "chart.moved": (lambda value: quality.blurred(np.array([0.1, value])), quality.MAX_BLUR),
          "chart.glare": (lambda value: quality.glaring(np.array([0, value]), "ab", 0.03), 0.03),
          "chart.glints": (lambda value: quality.glints(np.array([0, value]), "ab"),
                           quality.MAX_EXCLUDED),
          "chart.uneven-light": (lambda value: quality.uneven_light(np.array([1, 1 + value])),
                                 quality.MAX_UNEVEN),
          "photo.clipped": (lambda value: exposed((0, value), (0.5, 0.5)), MAX_CLIPPED),
          "photo.dark": (lambda value: exposed((0, 0), (0, 1 - value)), 1 - DARKEST)}


@pytest.mark.parametrize("code", LIMITS)
def test_a_rule_finds_a_fault_beyond_its_limit_and_none_within(code):
    rule, limit = LIMITS[code]
    assert rule(0.99 * limit) == []
    fault, = rule(1.01 * limit)
    assert fault.code == code and faults([fault])
    # plain data, as JSON keeps it, and a text that its values fill
    assert json.loads(json.dumps(texts.facts(fault)))["remedy"]


@pytest.mark.parametrize("axis, along", [(0, "columns"), (1, "rows")])
def test_a_movement_is_told_from_a_photo_out_of_focus(tmp_path, axis, along):
    from scipy.ndimage import uniform_filter1d
    scene = uniform_filter1d(chart_scene(HEIGHT, WIDTH, SIGNALS, PLACE), 35, axis=axis)
    image = open_photo(write_photo(tmp_path / "chart.dng", scene))
    verdict = judge_chart(image, find_chart(image, TYPICAL_SIGNALS, PLACE), TYPICAL_SIGNALS)
    values = faults_of(verdict)["chart.moved"]
    # a movement by 35 px of 87: 80 % of it from 10 to 90 %; for the tolerance see below
    assert values["blur"] == pytest.approx(0.8 * 35 / 87, abs=0.06)
    assert values["along"] == along and values["other"] < 0.1


def test_blur_and_tilt_are_measured(tmp_path):
    from scipy.ndimage import gaussian_filter
    scene = gaussian_filter(chart_scene(HEIGHT, WIDTH, SIGNALS, PLACE), (5, 5, 0))
    image = open_photo(write_photo(tmp_path / "chart.dng", scene))
    verdict = judge_chart(image, find_chart(image, TYPICAL_SIGNALS), TYPICAL_SIGNALS)
    # A Gaussian of 5 px: 2.56 sigma from 10 to 90 %, a patch being 87 px; the profile has points
    # every 1.2 % of a side, and the background beside the frame changes the plateau.
    assert verdict.blur == pytest.approx(2.56 * 5 / 87, abs=0.06)
    squeezed = (PLACE - PLACE.mean(axis=0)) * np.array([1, np.cos(np.deg2rad(50))]) + PLACE.mean(
        axis=0)
    tilted = judged(tmp_path, place=squeezed)
    # The geometry of the fitted chart is right to about 1 %.
    assert tilted.tilt_deg == pytest.approx(50, abs=2)
    assert faults_of(tilted)["chart.tilted"]["tilt_deg"] == tilted.tilt_deg


@pytest.mark.parametrize("electrons, small", [(ELECTRONS, False), (150, True)])
def test_a_small_chart_is_too_small_where_its_means_are_not_known(tmp_path, electrons, small):
    place = (PLACE - PLACE.mean(axis=0)) / 3.2 + PLACE.mean(axis=0)
    image = open_photo(write_photo(tmp_path / "chart.dng",
                                   chart_scene(HEIGHT, WIDTH, SIGNALS, place),
                                   electrons=electrons))
    verdict = judge_chart(image, find_chart(image, TYPICAL_SIGNALS, place), TYPICAL_SIGNALS)
    # 64 pixels of 12 % noise are 1.5 %, and of 1 % noise 0.1 %
    assert verdict.pixels <= 81
    assert ("chart.small" in faults_of(verdict)) == small
    assert small or verdict.verdict == "good"


def test_a_veil_is_told_from_a_tone_curve_and_named(tmp_path):
    scene = chart_scene(HEIGHT, WIDTH, SIGNALS, PLACE) + 0.12 * SIGNALS[18]
    image = open_photo(write_photo(tmp_path / "veiled.dng", scene))
    verdict = judge_chart(image, find_chart(image, TYPICAL_SIGNALS), TYPICAL_SIGNALS)
    # the veil is 0.12 / 1.12 of the white patch; it is tried in steps of 0.01
    assert verdict.veil == pytest.approx(0.107, abs=0.011) and verdict.glare < 0.03
    assert faults_of(verdict) == {"chart.veiled": {"veil": verdict.veil, "limit": 0.03}}
    for power in (0.6, 1 / 2.4):
        curved = open_photo(write_photo(tmp_path / "curved.dng", (0.8 * scene) ** power))
        with pytest.raises(CheckError, match=r"its values go with the power 0\.\d\d of the light"):
            find_chart(curved, TYPICAL_SIGNALS)


# ---- what is no Classic --------------------------------------------------------------------------

def test_a_card_whose_patches_nearly_touch_is_refused(tmp_path):
    image = open_photo(chart_photo(tmp_path, patch_mm=42.6))
    with pytest.raises(
            CheckError,
            match=r"patches stand only \d\.\d% of their pitch apart.*another maker's card"):
        locate_chart(image, TYPICAL_SIGNALS)


def test_the_gap_between_patches_is_measured(tmp_path):
    image = open_photo(chart_photo(tmp_path))
    corners_px = find_chart(image, TYPICAL_SIGNALS).corners_px
    gap = patch_gap(signal_rgb8(image.signal), (corners_px + 0.5) / 2 - 0.5)
    # 3.5 of 43.5 mm; the strip is sampled every 1.5 % of the pitch, and a binned pixel is 4 %.
    assert gap == pytest.approx(3.5 / PITCH_MM, abs=0.02)


def test_a_covered_patch_is_named(tmp_path):
    signals = SIGNALS.copy()
    signals[14] = SIGNALS[13] * 2
    with pytest.raises(CheckError,
                       match=r"patch 15 of the chart reads unlike a ColorChecker Classic"):
        locate_chart(open_photo(chart_photo(tmp_path, signals=signals)), TYPICAL_SIGNALS)


# ---- developed files -----------------------------------------------------------------------------

def test_a_developed_photo_comes_back_whole(tmp_path):
    image = open_photo(chart_photo(tmp_path))
    write_linear_exr(tmp_path / "photo.exr", image)
    assert NO_DATE.encode() in (tmp_path / "photo.exr").read_bytes()[:2000]   # not that of writing
    back = read_linear_file(tmp_path / "photo.exr")
    for name in ("signal", "variance", "saturated"):
        np.testing.assert_array_equal(getattr(back, name), getattr(image, name))
    assert (back.kind, back.camera, back.sensor_step,
            back.iso) == (image.kind, image.camera, 2.0, 100.0)
    # Exposure is stored in single precision.
    assert back.exposure_s == pytest.approx(image.exposure_s, rel=1e-7)


# ---- commands ------------------------------------------------------------------------------------

def call(*words):
    result = CliRunner().invoke(app, [str(word) for word in words])
    return result.exit_code, result.stdout


def test_chart_answers_good_with_the_keys_of_the_contract(tmp_path):
    code, text = call("chart", chart_photo(tmp_path), "--overlay", tmp_path / "overlay.png",
                      "--json")
    facts = json.loads(text)
    assert (code, facts["verdict"], facts["reasons"], facts["mirrored"]) == (0, "good", [], False)
    assert np.shape(facts["corners_px"]) == (24, 4,
                                             2) and np.shape(facts["standard_error"]) == (24, 3)
    error = (np.array(facts["mean"]) - SIGNALS) / facts["standard_error"]
    # 72 normal deviates: rms 1 within 4 standard deviations.
    assert np.sqrt(np.mean(error**2)) == pytest.approx(1, abs=4 / np.sqrt(2 * 72))
    assert (tmp_path / "overlay.png").read_bytes().startswith(
        b"\x89PNG") and 0.9 < facts["confidence"] <= 1


def test_chart_says_re_shoot_with_exit_code_4(tmp_path):
    code, text = call("chart", chart_photo(tmp_path, gradient_stops=2.5))
    assert code == 4 and text.startswith("RE-SHOOT") and "The light changes by" in text


def test_chart_gives_codes_and_values_beside_its_reasons(tmp_path):
    code, text = call("chart", chart_photo(tmp_path, gradient_stops=2.5), "--json")
    facts = json.loads(text)
    reasons = [f"{one['sentence']} {one['remedy']}" for one in facts["findings"]
               if one["severity"] in ("warn", "fail")]
    assert code == 4 and reasons == facts["reasons"] and len(reasons) >= 1
    figures = {one["code"]: one["values"] for one in facts["findings"]}["chart.figures"]
    assert figures["uneven"] == facts["uneven"]


def test_chart_refuses_and_says_why(tmp_path):
    tiles = np.random.default_rng(2).uniform(0.1, 0.6, (HEIGHT // 40, WIDTH // 40, 3))
    photo = write_photo(tmp_path / "no_chart.dng", np.kron(tiles, np.ones((40, 40, 1))))
    code, text = call("chart", photo, "--json")
    facts = json.loads(text)
    assert (code, facts["verdict"]) == (4,
                                        "refused") and "no ColorChecker was found" in facts[
        "reasons"][0]


def test_chart_takes_corners_by_hand(tmp_path):
    words = " ".join(f"{x:.1f},{y:.1f}" for x, y in PLACE)
    code, text = call("chart", chart_photo(tmp_path), "--corners", words, "--json")
    assert code == 0 and "corners given by hand" in json.loads(text)["how_found"]
    code, text = call("chart", chart_photo(tmp_path), "--corners", "1,2 3", "--json")
    assert code == 3 and "8 numbers in pixels of the photo are needed" in json.loads(text)["error"]


def test_a_jpeg_or_png_is_taken_as_encoded_and_marked(tmp_path):
    scene = chart_scene(HEIGHT, WIDTH, 0.9 * TYPICAL_SIGNALS, PLACE)
    noisy = scene + np.random.default_rng(1).normal(scale=0.002, size=scene.shape)
    write_png(tmp_path / "chart.png", encode_srgb8(noisy))
    code, text = call("chart", tmp_path / "chart.png", "--json")
    facts = json.loads(text)
    assert (code, facts["verdict"]) == (0, "good")
    assert facts["kind"] == "image processed by the camera, decoded as sRGB"
    assert "chart.processed-photo" in [one["code"] for one in facts["findings"]]
    code, text = call("chart", tmp_path / "chart.png", "--linear", "--json")
    assert code == 3 and "not proportional to light" in json.loads(text)["error"]


def test_develop_merges_a_bracket_with_dark_frames(tmp_path):
    scene = chart_scene(HEIGHT // 2, WIDTH // 2, SIGNALS, PLACE / 2)
    photos = [write_photo(tmp_path / f"photo{seconds.denominator}.dng", 60 * float(seconds) * scene,
                          index, exposure_s=seconds)
              for index, seconds in enumerate((Fraction(1, 60), Fraction(1, 240)))]
    darks = [write_photo(tmp_path / f"dark{seconds.denominator}.dng", 0 * scene, 5 + index,
                         exposure_s=seconds)
             for index, seconds in enumerate((Fraction(1, 60), Fraction(1, 240)))]
    code, text = call("develop", *photos, "--dark", darks[0], "--dark", darks[1], "-o",
                      tmp_path / "out.exr", "--json")
    facts = json.loads(text)
    assert code == 0
    ratios = [one["values"]["measured"] for one in facts["findings"]
              if one["code"] == "bracket.ratio"]
    assert len(facts["notes"]) == len(facts["findings"]) == 3
    # noise of thousands of pixels
    assert ratios == [pytest.approx(4, rel=0.01)]
    developed = read_linear_file(tmp_path / "out.exr")
    plain = open_photo(photos[1])
    assert developed.exposure_s == pytest.approx(1 / 240) and "bracket of" in developed.source
    assert developed.variance.mean() < 0.6 * plain.variance.mean()


def test_develop_takes_what_is_not_linear_only_when_told_and_marks_it(tmp_path):
    scene = np.random.default_rng(3).uniform(0.2, 0.8, (64, 96, 3))
    write_png(tmp_path / "photo.png", encode_srgb8(scene))
    code, text = call("develop", tmp_path / "photo.png", "-o", tmp_path / "out.exr", "--json")
    assert code == 3 and "not proportional to light" in json.loads(text)["error"]
    code, text = call("develop", tmp_path / "photo.png", "-o", tmp_path / "out.exr", "--not-linear",
                      "--json")
    facts = json.loads(text)
    assert code == 0 and "NOT LINEAR" in facts["source"]
    assert [one["code"] for one in facts["findings"]] == ["photo.not-linear"]
    assert "NOT LINEAR" in open_photo(tmp_path / "out.exr").source


def test_develop_wants_an_exr_name(tmp_path):
    assert call("develop", chart_photo(tmp_path), "-o", tmp_path / "out.png")[0] == 2


@pytest.mark.parametrize("power", [0.75, 1.3])
def test_a_tone_curve_is_undone_before_a_reflection_is_looked_for(tmp_path, power):
    write_png(tmp_path / "curved.png", encode_srgb8(
        chart_scene(HEIGHT, WIDTH, 0.9 * SIGNALS / SIGNALS.max(), PLACE) ** power))
    image = open_any(tmp_path / "curved.png", not_linear=True)
    verdict = judge_chart(image, find_chart(image, TYPICAL_SIGNALS), TYPICAL_SIGNALS)
    assert verdict.glare < 0.05


def test_a_gap_is_as_wide_beside_dark_patches_as_beside_bright_ones(tmp_path):
    """A chequerboard: every gap has one of each at its ends."""
    dark = (np.arange(24) + np.arange(24) // 6) % 2 == 1
    image = open_photo(chart_photo(tmp_path, signals=np.where(dark[:, None], 0.08, 0.8)
                                   * CAMERA_GAIN, frame=0.001))
    corners_px = find_chart(open_photo(chart_photo(tmp_path)), TYPICAL_SIGNALS).corners_px
    gap = patch_gap(signal_rgb8(image.signal), (corners_px + 0.5) / 2 - 0.5)
    assert gap == pytest.approx(3.5 / PITCH_MM, abs=0.03)
