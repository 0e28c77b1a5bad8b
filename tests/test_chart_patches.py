"""The patches of a chart for other programs: positions, values and spread against known truth.

SPECTRABOX_DATA names the folder of real photos, in raw_charts/ and charts/.
"""
import csv
import os
from pathlib import Path

import colour
import numpy as np
import pytest
from scipy.stats import chi2
from test_capture_chart import CAMERA_GAIN, HEIGHT, WIDTH, corners, photograph, true_centres
from typer.testing import CliRunner

import spectrabox as sb
from spectrabox.capture.chart.chart_agreement import TYPICAL_SIGNALS
from spectrabox.capture.photo.image_writers import (
    write_exr,
    write_jpeg,
    write_png,
)
from spectrabox.fixtures.chart_scene import chart_scene
from spectrabox.radiometry.appearance import encode_srgb
from spectrabox.session.cli import app

SIGNALS, NOISE = CAMERA_GAIN * TYPICAL_SIGNALS, 0.004
DATA = Path(os.environ.get("SPECTRABOX_DATA", "/nowhere"))
# Real photos, and how the chart lies in them as one looks at them: clockwise, in degrees.
REAL = {"raw_charts/canon550d_dusk.dng": 0, "raw_charts/industrial_indoor1.dng": 0,
        "charts/classic.png": 90, "charts/passport.jpg": 180, "charts/source1_img.png": 90}


def scene_of(place, **said):
    return chart_scene(HEIGHT, WIDTH, SIGNALS, place, **said)


def noisy(scene, seed=1):
    return (scene + NOISE * np.random.default_rng(seed).standard_normal(scene.shape)
            ).astype(np.float32)


def opened(kind, values, folder):
    """Values as a program holds them, or as a file of a kind."""
    encoded = np.rint(255 * encode_srgb(values.clip(0, 1))).astype(np.uint8)
    if kind == "array":
        return values
    if kind == "integers":
        return np.rint(65535 * values.clip(0, 1)).astype(np.uint16)
    path = folder / f"chart.{kind}"
    if kind == "exr":
        write_exr(path, values, "RGB")
    elif kind == "tiff":
        colour.write_image(values, path, "uint16")
    elif kind == "png":
        write_png(path, encoded)
    else:
        write_jpeg(path, encoded)
    return sb.open_photo(path, not_linear=kind in ("png", "jpg"))


@pytest.mark.parametrize("kind", ["array", "integers", "exr", "tiff", "png", "jpg"])
def test_positions_are_those_of_the_printed_patches_in_every_kind_of_photo(kind, tmp_path):
    place = corners(degrees=20, tilt=0.2)
    chart = sb.find_chart(opened(kind, noisy(scene_of(place)), tmp_path))
    # half a pixel by which OpenCV's outlines of patches scatter, and as much of the fit through
    assert np.abs(chart.centres - true_centres(place)).max() < 1.0
    assert chart.names[0] == "dark skin" and chart.corners.shape == (24, 4, 2)


def test_a_raw_is_positioned_in_pixels_of_its_sensor(tmp_path):
    place = corners(degrees=-10)
    photograph(tmp_path, scene_of(place))
    chart = sb.find_chart(tmp_path / "chart.dng")
    # a cell of the mosaic is two pixels: twice the pixel of above
    assert np.abs(chart.centres - true_centres(place)).max() < 2.0
    assert chart.photo.signal.shape[:2] == (HEIGHT // 2, WIDTH // 2)


@pytest.mark.parametrize("degrees", [0, 30, 90, 180, -90, -135])
def test_the_chart_is_turned_as_its_rows_run(degrees):
    # the fixture turns the other way round: its angles grow against the clock
    chart = sb.find_chart(noisy(scene_of(corners(degrees=degrees, width=450))))
    off = (chart.angle_deg - np.degrees(np.arctan2(*(true_centres(
        corners(degrees=degrees, width=450))[[5, 0]] @ [[0, 1], [1, 0]]).T @ [1, -1]))) % 360
    assert min(off, 360 - off) < 0.3        # a pixel at the end of a row of 450
    quad = chart.corners[0]
    side = quad[1] - quad[0]
    assert np.degrees(np.arctan2(side[1], side[0])) == pytest.approx(chart.angle_deg, abs=1)


def test_values_and_their_errors_hold_the_truth():
    chart = sb.find_chart(noisy(scene_of(corners(15)), seed=4))
    assert not chart.clipped.any()
    square = (((chart.mean - SIGNALS) / chart.standard_error) ** 2).sum()
    # 72 independent means: two-sided chi-square test at 0.2 %
    assert chi2.ppf(0.001, 72) < square < chi2.ppf(0.999, 72)
    # A standard deviation of n pixels is known to 1 in sqrt(2 n): five of these.
    assert np.abs(chart.spread / NOISE - 1).max() < 5 / np.sqrt(2 * chart.samples.pixels.min())
    np.testing.assert_allclose(
        chart.standard_error, chart.spread / np.sqrt(chart.samples.pixels)[:, None])


def test_uneven_light_is_in_the_gradient_and_not_in_the_spread():
    even, uneven = (sb.find_chart(noisy(scene_of(corners(), gradient_stops=stops)))
                    for stops in (0.0, 1.0))
    # as above; light that doubles over the photo bends by too little within a patch to be seen
    assert np.abs(uneven.spread / NOISE - 1).max() < 5 / np.sqrt(2 * even.samples.pixels.min())
    assert uneven.samples.gradient.min() > 0.02


def test_a_saturated_patch_is_marked_in_the_band_that_is(tmp_path):
    values = noisy(scene_of(corners())) * (1.05 / SIGNALS[18, 1])
    chart = sb.find_chart(values.clip(0, 1))
    assert np.argwhere(chart.clipped).tolist() == [[18, 1]]


@pytest.mark.parametrize("values, said", [
    (np.zeros((60, 90), np.float32), r"shape \(60, 90\) is no photo"),
    (np.zeros((60, 90, 2), np.float32), "at least 3 bands"),
    (np.zeros((60, 90, 3), np.uint8), "8-bit values is hardly proportional to light"),
    (np.zeros((60, 90, 3), np.int32), "no known full scale"),
    (np.full((60, 90, 3), np.nan), "photo array has 16200 of 16200 values that are NaN")])
def test_an_array_that_is_no_linear_photo_is_refused(values, said):
    with pytest.raises(sb.InputError, match=said):
        sb.find_chart(values)


def test_an_array_is_a_photo_for_other_functions_too(tmp_path):
    photo = photograph(tmp_path, scene_of(corners(5)))
    of_file, of_array = (sb.fit_camera(one, light="unknown") for one in (
        tmp_path / "chart.dng", sb.open_photo(np.array(photo.signal))))
    # the same pixels at other positions, which the light's fall-off over the chart goes by
    np.testing.assert_allclose(of_array.curves, of_file.curves, atol=0.01)


def test_dark_frames_are_not_taken_off_an_array(tmp_path):
    with pytest.raises(sb.InputError, match="an array is taken as it is"):
        sb.open_photo(np.zeros((60, 90, 3)), flat=tmp_path / "card.dng")


def test_the_table_says_it_all_and_a_camera_is_fitted_to_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    photograph(tmp_path, scene_of(corners(5)))
    run = CliRunner().invoke(app, ["chart", "chart.dng", "--out", "patches.csv"])
    assert run.exit_code == 0, run.output
    chart = sb.find_chart("chart.dng")
    assert chart.to_csv("again.csv").read_text() == Path("patches.csv").read_text()
    with Path("patches.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["patch"] for row in rows] == list(chart.names)
    for number, band in enumerate("RGB"):
        for prefix, values in (("", chart.mean), ("standard_error ", chart.standard_error),
                               ("spread ", chart.spread), ("clipped ", chart.clipped)):
            # seven digits are written
            np.testing.assert_allclose([float(row[prefix + band]) for row in rows],
                                       values[:, number], rtol=1e-6)
    np.testing.assert_allclose([[float(row[f"{axis}_centre_px"]) for axis in "xy"]
                                for row in rows], chart.centres, rtol=1e-6)
    of_photo, of_table = (CliRunner().invoke(app, [
        "camera", "fit", *given, "--light", "unknown"]).output
        for given in (["chart.dng"], ["--patches", "patches.csv"]))
    # but for what bands of a patch have in common, both know the same
    assert of_table.splitlines()[0] == of_photo.splitlines()[0]


def test_clipped_signals_of_a_table_are_none(tmp_path):
    values = noisy(scene_of(corners())) * (1.05 / SIGNALS[18, 1])
    sb.find_chart(values.clip(0, 1)).to_csv(tmp_path / "patches.csv")
    run = CliRunner().invoke(app, ["camera", "fit", "--patches", str(tmp_path / "patches.csv"),
                                   "--light", "unknown"])
    assert run.exit_code == 0 and "Patch white 9.5 is saturated in G" in run.output, run.output


@pytest.mark.parametrize("name", REAL)
def test_real_photos_give_the_patches_as_one_sees_them(name):
    if not (DATA / name).is_file():
        pytest.skip(f"SPECTRABOX_DATA names no folder with {name}")
    chart = sb.find_chart(sb.open_photo(DATA / name, not_linear=True))
    off = (chart.angle_deg - REAL[name]) % 360
    assert min(off, 360 - off) < 30         # by eye
    # the greys as printed, and every mean known far better than the spread of its pixels
    assert np.all(np.diff(chart.mean[18:].sum(axis=1)) < 0)
    # none of either where a JPEG is cut off, at black or at white
    assert np.all(chart.spread >= 5 * chart.standard_error)
    width, height = chart.photo.size_px
    assert np.all((chart.corners >= 0) & (chart.corners < [width, height]))
