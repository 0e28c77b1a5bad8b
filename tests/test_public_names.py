"""The public names of ``spectrabox``: what a notebook calls says what the commands say."""
import json
import subprocess
import sys
from fractions import Fraction

import matplotlib as mpl
import numpy as np
import pytest
from typer.testing import CliRunner

import spectrabox as sb
from spectrabox.fixtures.flat_sample import write_photo
from spectrabox.session.cli import app

mpl.use("Agg")


def answer(*arguments):
    done = CliRunner().invoke(app, [*map(str, arguments), "--json"])
    assert done.exit_code in (0, 4), done.output    # 4: the photo is to be taken again
    return json.loads(done.stdout)


@pytest.fixture(scope="module")
def folder(_captured):
    return _captured


def test_importing_spectrabox_imports_nothing_heavy():
    heavy = "{'numpy', 'scipy', 'matplotlib', 'mitsuba', 'cv2', 'colour', 'pydantic'}"
    code = f"import sys, spectrabox; print({heavy} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


def test_every_public_name_is_there_and_has_a_docstring():
    for name in sb.__all__:
        assert len(getattr(sb, name).__doc__) > 40, name


def test_a_chart_is_found_as_the_command_finds_it(folder):
    photo = sb.open_photo(folder / "photos" / "chart.dng")
    chart = sb.find_chart(photo)
    said = answer("chart", folder / "photos" / "chart.dng")
    assert chart.verdict == said["verdict"] and list(chart.reasons) == said["reasons"]
    np.testing.assert_array_equal(chart.corners, said["corners_px"])
    np.testing.assert_array_equal(chart.samples.mean, said["mean"])
    assert "3 bands" in repr(photo) and said["camera"] in repr(photo)
    assert len(chart.plot().lines) == 2 * len(chart.corners)


def test_a_camera_is_fitted_as_the_command_fits_it(folder, tmp_path):
    chart, light = folder / "photos" / "chart.dng", folder / "spectra" / "light.csv"
    camera = sb.fit_camera(chart, light=light)
    said = answer("camera", "fit", chart, "--light", light)
    np.testing.assert_array_equal(camera.nm, said["wavelengths_nm"])
    np.testing.assert_array_equal(camera.curves, said["sensitivities"])
    np.testing.assert_array_equal(camera.band()[0], said["lower"])
    written = camera.to_csv(tmp_path / "camera.csv")
    again = sb.uplift(np.full((2, 2, 3), 0.3), camera=written, light=light)
    own = sb.uplift(np.full((2, 2, 3), 0.3), camera=camera, light=light)
    # seven digits of the curves are written
    np.testing.assert_allclose(again, own, rtol=0, atol=1e-4)
    assert "<svg" in camera._repr_html_() and camera.plot().get_xlabel() == "Wavelength (nm)"


def test_errors_are_the_sentences_of_the_commands(tmp_path):
    with pytest.raises(sb.InputError, match="nearest are Nikon 5100"):
        sb.uplift(np.zeros((2, 2, 3)), camera="Nikom 5100", light="D65")
    write_photo(tmp_path / "dark.dng", np.full((40, 60, 3), 0.01), Fraction(1, 100),
                np.random.default_rng(1))
    with pytest.raises(sb.ChartNotFoundError):
        sb.find_chart(tmp_path / "dark.dng")
