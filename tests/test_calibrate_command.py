"""The camera commands: the contract of their JSON, the same numbers as from Python, and exit
codes.
"""
import json
from pathlib import Path

import numpy as np
import pytest
from calibrate_cameras import GRID, cameras, led, on_grid
from typer.testing import CliRunner

import spectrabox as sb
from spectrabox.calibrate.camera_curves import curve_band, curve_draws
from spectrabox.calibrate.chart_calibration import calibrate_chart
from spectrabox.calibrate.chart_photo import ChartPhoto
from spectrabox.calibrate.prior.camera_prior import load_camera_prior
from spectrabox.capture.photo.image_writers import write_exr
from spectrabox.radiometry.chart import chart_reflectances
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.records.spectra import Quantity, UnknownLight
from spectrabox.radiometry.spectra.named_spectra import light, sensitivities
from spectrabox.radiometry.spectra.spectrum_files import read_curves, read_spectrum
from spectrabox.session.camera.camera_files import read_patches, signals_of_patches
from spectrabox.session.cli import app

runner = CliRunner()
CONTRACT = ("wavelengths_nm", "sensitivities", "lower", "upper", "condition_number",
            "chart_delta_e00", "held_out_delta_e00", "outcome")


@pytest.fixture(scope="module")
def chart(tmp_path_factory):
    """Patch signals of a simulated camera under an LED, and that light's spectrum, as files."""
    folder = tmp_path_factory.mktemp("chart")
    surfaces = chart_reflectances("BabelColor Average", GRID)
    signal = surfaces @ (on_grid(cameras(1, 90)[0]) * led() * GRID.weights_nm).T
    signal *= 0.5 / signal.max() * (1
                                    + 0.005 * np.random.default_rng(5).standard_normal(
                                        signal.shape))
    rows = "\n".join(",".join(f"{value:.9g}" for value in row) for row in signal)
    (folder / "patches.csv").write_text(f"R,G,B\n{rows}\n", encoding="utf-8")
    lines = "\n".join(f"{nm:g},{value:.9g}" for nm, value in zip(GRID.nm, led(), strict=True))
    (folder / "light.csv").write_text(f"wavelength_nm,value\n{lines}\n", encoding="utf-8")
    return folder


def run(*words):
    return runner.invoke(app, [str(word) for word in words])


@pytest.mark.parametrize("method", ["prior", "smooth", "nonnegative", "paper"])
def test_the_command_gives_what_python_gives(chart, method, tmp_path):
    result = run("camera", "fit", "--patches", chart / "patches.csv", "--light",
                 chart / "light.csv", "--reference", "BabelColor Average",
                 "--method", method, "--out", tmp_path / "curves.csv", "--json")
    assert result.exit_code == 0, result.output
    facts = json.loads(result.stdout)
    assert not set(CONTRACT) - set(facts)
    samples = read_patches(chart / "patches.csv").samples
    light = read_spectrum(chart / "light.csv", role=Quantity.RELATIVE)
    photo = ChartPhoto(samples, chart_reflectances("BabelColor Average", GRID), light)
    fit = calibrate_chart([photo], GRID, method)
    curves_fitted = fit.calibration.sensitivity.curves
    # The same code on the same numbers; JSON keeps every digit.
    np.testing.assert_array_equal(facts["sensitivities"], curves_fitted)
    np.testing.assert_array_equal(facts["lower"], curve_band(fit, curve_draws(fit))[0])
    _, names, curves = read_curves(tmp_path / "curves.csv")
    assert names == ("R", "G", "B")
    np.testing.assert_allclose(curves, curves_fitted, atol=1e-8)  # nine digits


def test_noise_free_signals_that_were_simulated_at_5_nm_are_fitted(tmp_path):
    coarse = visible_grid(5.0)
    curves = sensitivities("CIE 1931 2 Degree Standard Observer", coarse) * light("D65", coarse)
    np.savetxt(tmp_path / "p.csv", chart_reflectances("BabelColor Average", coarse) @ curves.T,
               delimiter=",", header="X,Y,Z", comments="")
    result = run("camera", "fit", "--patches", tmp_path / "p.csv", "--light", "D65", "--json")
    assert result.exit_code == 0, result.output      # as exact ones no camera explains them
    assert "patches.errors-assumed" in {one["code"]
                                        for one in json.loads(result.stdout)["findings"]}


def test_draws_can_be_kept(chart, tmp_path):
    result = run("camera", "fit", "--patches", chart / "patches.csv", "--light",
                 chart / "light.csv",
                 "--draws-file", tmp_path / "draws.npz", "--json")
    assert result.exit_code == 0, result.output
    facts = json.loads(result.stdout)
    with np.load(tmp_path / "draws.npz") as stored:
        curves = stored["curves"]
    assert curves.shape == (1000, 3, 301) and facts["level"] == 0.9
    lower, upper = np.array(facts["lower"]), np.array(facts["upper"])
    above, below = (curves > upper).mean(axis=0), (curves < lower).mean(axis=0)
    # Of 1000 draws 50 lie beyond each end, but where more are 0, or are the largest value, 1.
    np.testing.assert_allclose(above[(upper > 0) & (upper < 1)], 0.05, atol=0.0011)
    np.testing.assert_allclose(below[(lower > 0) & (lower < 1)], 0.05, atol=0.0011)
    assert np.count_nonzero((lower > 0) & (upper < 1)) > 500


def test_measured_curves_are_checked_against_the_chart(chart, tmp_path):
    rows = "\n".join(f"{nm:g}," + ",".join(f"{value:.9g}" for value in column)
                     for nm, column in zip(GRID.nm, on_grid(cameras(1, 90)[0]).T, strict=True))
    (tmp_path / "curves.csv").write_text(f"nm,R,G,B\n{rows}\n", encoding="utf-8")
    result = run("camera", "fit", "--patches", chart / "patches.csv", "--light",
                 chart / "light.csv",
                 "--method", "file", "--curves", tmp_path / "curves.csv", "--json")
    assert result.exit_code == 0, result.output
    # 0.5 % noise in the signals is about 0.3 CIEDE2000.
    assert json.loads(result.stdout)["chart_delta_e00"] < 1


def test_a_prior_is_built_from_a_folder(tmp_path):
    for index, curves in enumerate(cameras(14, 91)):
        rows = "\n".join(f"{nm:g}," + ",".join(f"{value:.9g}" for value in column)
                         for nm, column in zip(np.arange(400, 701, 5), curves.T, strict=True))
        (tmp_path / f"camera{index}.csv").write_text(f"nm,R,G,B\n{rows}\n", encoding="utf-8")
    (tmp_path / "broken.json").write_text("{", encoding="utf-8")
    result = run("camera", "prior", tmp_path, "--out", tmp_path / "mine.npz", "--licence", "CC0",
                 "--json")
    assert result.exit_code == 0, result.output
    facts = json.loads(result.stdout)
    assert len(facts["cameras"]) == 14 and len(facts["skipped"]) == 1
    assert load_camera_prior(tmp_path / "mine.npz").licence == "CC0"


@pytest.mark.parametrize("words, code, message", [
                             (("--light", "D65"), 2,
                              "give either photos of a chart or --patches CSV"),
                             (("--light", "D65", "--patches", "none.csv"), 3,
                              "none.csv is missing"),
                             (("--light", "D65", "--patches", "none.csv", "--method", "magic"), 2,
                              "--method magic is not known"),
                             (("--light", "none.csv", "--patches", "none.csv"), 3,
                              "none.csv is missing"),
                             (("--light", "D65", "--patches", "none.csv", "--method", "file"), 2,
                              "both --method file and --curves"),
                             ])
def test_what_is_missing_is_said_with_its_exit_code(words, code, message):
    result = run("camera", "fit", *words)
    assert result.exit_code == code
    assert message in result.stderr


def test_inputs_are_not_written_over_and_photos_not_counted_twice(chart, tmp_path):
    given = ("camera", "fit", "--patches", chart / "patches.csv", "--light", "D65")
    before = (chart / "patches.csv").read_bytes()
    for words, message in (((*given, "--out", chart / "patches.csv"), "is an input of this"),
                           ((*given, "--out", tmp_path), "is a folder"),
                           ((*given, "--patches", chart / "patches.csv"), "give each photo once")):
        result = run(*words)
        assert result.exit_code == 3 and message in result.stderr
    assert (chart / "patches.csv").read_bytes() == before


def test_two_bands_are_too_few(chart, tmp_path):
    rows = [line.rpartition(",")[0] for line in (chart
                                                 / "patches.csv").read_text(
                encoding="utf-8").splitlines()]
    (tmp_path / "two.csv").write_text("\n".join(rows), encoding="utf-8")
    result = run("camera", "fit", "--patches", tmp_path / "two.csv", "--light", "D65")
    assert result.exit_code == 3 and "the photo has 2 bands; 3 or more are needed" in result.stderr


@pytest.mark.parametrize("words", [
    ("sample", "--light", "D65", "--signal", "0.4,0.3,0.2", "--sensitivity"),
    ("camera", "profile", "--light", "D65", "--camera", "A B", "--out", "p.dcp")])
def test_products_with_an_unknown_light_are_no_sensitivities(chart, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    made = run("camera", "fit", "--patches", chart / "patches.csv", "--light", "unknown",
               "--out", "products.csv")
    assert made.exit_code == 0, made.output
    refused = run(*words, "products.csv")
    assert refused.exit_code == 3 and not Path("p.dcp").exists()
    assert "products.csv holds products of sensitivity and light" in refused.output \
        and "--light FILE, a CIE name or 3200K" in refused.output


def test_errors_that_nobody_stated_are_each_bands_own():
    """A band that is read a thousand times brighter errs by as much more, and no other does."""
    signal = np.random.default_rng(5).uniform(0.02, 1, size=(24, 3))
    signal[18:] *= 1e-3         # darker than their error
    one, other = (signals_of_patches("table", scale * signal, None, ("R", "G", "B"),
                                     np.zeros(signal.shape)).samples.covariance_of_mean
                  for scale in (np.ones(3), np.array([1000.0, 1, 1])))
    errors = np.sqrt(np.diagonal(other, axis1=1, axis2=2) / np.diagonal(one, axis1=1, axis2=2))
    np.testing.assert_allclose(errors, [[1000, 1, 1]] * 24)


def test_a_camera_of_an_unknown_light_is_refused_where_a_light_is_given(chart, tmp_path):
    samples = read_patches(chart / "patches.csv").samples
    photo = ChartPhoto(samples, chart_reflectances("BabelColor Average", GRID), UnknownLight())
    camera = calibrate_chart([photo], GRID).calibration
    assert camera.products
    with pytest.raises(InputError, match="the camera holds products of sensitivity and light"):
        sb.sample([0.4, 0.3, 0.2], camera=camera, light="D65")
    write_exr(tmp_path / "photo.exr", np.full((24, 24, 3), 0.2), "RGB")
    with pytest.raises(InputError, match="the camera holds products of sensitivity and light"):
        sb.reconstruct_scene(tmp_path / "photo.exr", scene="box.xml", camera=camera, light="D65",
                             materials=["wall"])
