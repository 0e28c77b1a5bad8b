"""Patches that the operator leaves out, patches that are not as the others make them, other charts
in view, and the smallest chart that is found.
"""
import json

import numpy as np
import pytest
from typer.testing import CliRunner

import spectrabox as sb
from spectrabox.capture.chart.chart_agreement import TYPICAL_SIGNALS
from spectrabox.fixtures.chart_scene import GRID_MM, chart_scene, mosaic
from spectrabox.fixtures.dng import write_dng
from spectrabox.radiometry.chart import CLASSIC
from spectrabox.radiometry.errors import ChartNotFoundError, CheckError
from spectrabox.session.cli import app

SIGNALS = np.array([0.4, 0.7, 0.5]) * TYPICAL_SIGNALS
UNIT = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
BLACK, WHITE = np.array([512, 510, 514, 516]), 16383
HEIGHT, WIDTH = 720, 1000


def place(x, y, width):
    """Corners of a chart of this width about a point."""
    return (UNIT - 0.5) * GRID_MM * width / GRID_MM[0] + np.array([x, y])


def photo(folder, signals=SIGNALS, *, places=None, size=(HEIGHT, WIDTH)):
    """A raw photo with a chart at some places, each in a strip of the picture of its own."""
    places = [place(size[1] / 2, size[0] / 2, 560)] if places is None else places
    strip = size[1] // len(places)
    scene = np.concatenate([chart_scene(size[0], strip, signals, corners) for corners in places],
                           axis=1)
    write_dng(folder / "chart.dng", mosaic(scene, "RGGB", BLACK, WHITE, 20000, 4.0,
                                           np.random.default_rng(1)), black=BLACK, white=WHITE)
    return folder / "chart.dng"


def misprinted(patch, colour):
    signals = SIGNALS.copy()
    signals[patch] = colour
    return signals


@pytest.mark.parametrize("patch", [0, 11, *CLASSIC.neutrals])
def test_a_misprinted_patch_is_left_out_and_the_others_measure(tmp_path, patch):
    path = photo(tmp_path, misprinted(patch, [0.30, 0.03, 0.25]))
    with pytest.raises(CheckError, match=rf"leave-out {patch + 1}\b"):
        sb.find_chart(path)
    chart = sb.find_chart(path, leave_out=[patch + 1])
    assert chart.verdict == "good"
    others = np.arange(24) != patch
    # a patch has 400 samples and more of noise of 1 to 3 %
    np.testing.assert_allclose(chart.mean[others], SIGNALS[others], rtol=0.02, atol=2e-4)


def test_a_camera_is_fitted_to_the_patches_that_are_left(tmp_path):
    path = photo(tmp_path, misprinted(11, [0.30, 0.03, 0.25]))
    fit = sb.fit_camera(path, light="unknown", leave_out=[12])
    whole = sb.fit_camera(photo(tmp_path), light="unknown", leave_out=[12])
    # the same noise but for patch 12, which counts in no figure
    assert fit.verdict == whole.verdict != "fail"


def test_a_plausible_patch_that_is_not_as_the_others_make_it_is_named(tmp_path):
    path = photo(tmp_path, misprinted(11, SIGNALS[11] * 0.71))
    told = json.loads(CliRunner().invoke(app, ["chart", str(path), "--json"]).stdout)
    named, = [one for one in told["findings"] if one["code"].startswith("patches.")]
    assert told["verdict"] == "re-shoot"
    assert [row["patch"] for row in named["values"]["patches"]] == ["orange yellow"]
    left = json.loads(CliRunner().invoke(app, ["chart", str(path), "--leave-out", "12",
                                               "--json"]).stdout)
    assert left["verdict"] == "good"


@pytest.mark.parametrize("patch", [18, 21, 23])
def test_a_grey_that_no_camera_explains_is_named(tmp_path, patch):
    path = photo(tmp_path, misprinted(patch, SIGNALS[patch] * 0.5))
    told = json.loads(CliRunner().invoke(app, ["chart", str(path), "--json"]).stdout)
    named, = [one for one in told["findings"] if one["code"].startswith("patches.")]
    assert told["verdict"] == "re-shoot"
    assert [row["patch"] for row in named["values"]["patches"]] == [CLASSIC.names[patch]]
    if patch == 18:     # it cannot be fitted with the others at all
        with pytest.raises(CheckError, match=r"leave-out 19\b"):
            sb.fit_camera(path, light="unknown")


def test_a_second_chart_in_view_is_mentioned(tmp_path):
    size = (HEIGHT, 2 * WIDTH)
    middle = place(WIDTH / 2, HEIGHT / 2, 560)
    two = sb.find_chart(photo(tmp_path, places=[middle, middle], size=size))
    another, = [one.values for one in two.findings if one.code == "chart.another"]
    assert another["charts"] == 1 and two.verdict == "good"
    centres = sorted([two.centres.mean(axis=0)[0], another["centres_px"][0][0]])
    np.testing.assert_allclose(centres, [WIDTH / 2, 1.5 * WIDTH], atol=10)
    one = sb.find_chart(photo(tmp_path))
    assert not [found for found in one.findings if found.code == "chart.another"]


def test_a_chart_of_a_tenth_of_the_frame_is_found(tmp_path):
    size = (1200, 2400)
    small = sb.find_chart(photo(tmp_path, places=[place(900, 500, 260)], size=size))
    np.testing.assert_allclose(small.centres.mean(axis=0), [900, 500], atol=2)


def test_corners_of_something_else_are_refused_with_the_number(tmp_path):
    path = photo(tmp_path)
    for corners in (place(150, 120, 200), np.roll(place(500, 360, 560), 1, axis=0)):
        with pytest.raises(ChartNotFoundError, match=r"\(relative rms \d+\.\d+, at most 0\.45 is"):
            sb.find_chart(path, corners=corners)
