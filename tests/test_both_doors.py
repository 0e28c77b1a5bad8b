"""Signals and cameras have one way: command and library give the same numbers."""
import json

import numpy as np
import pytest
from typer.testing import CliRunner

import spectrabox as sb
from spectrabox.session.cli import app

CAMERA, LIGHT, NOISE = "Nikon 5100 (NPL)", "LED-B3", 0.003
SEEN = ("--sensitivity", CAMERA, "--light", LIGHT, "--noise", NOISE)


def command(*words):
    result = CliRunner().invoke(app, [*map(str, words), "--json"])
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


def same_spectrum(estimate, facts, said):
    """Whether the command says what the estimate does, and that is what its methods give."""
    assert {name: value for name, value in json.loads(json.dumps(facts)).items()
            if name != "name"} == {name: said[name] for name in facts if name != "name"}
    assert {*said} - {*facts} <= {"seed", "seconds"}
    np.testing.assert_array_equal(estimate.mean, said["mean"])
    np.testing.assert_array_equal(estimate.band(), [said["lower"], said["upper"]])
    np.testing.assert_array_equal(estimate.bounds(), [said["bound_lower"], said["bound_upper"]])
    assert estimate.outcome == said["outcome"]
    assert estimate.next_reading_nm == said["next_measurement_nm"]


@pytest.mark.parametrize("method", ["prior", "uniform", "paper"])
def test_one_signal(method):
    estimate = sb.sample([0.21, 0.33, 0.14], camera=CAMERA, light=LIGHT, noise=NOISE,
                         method=method, draws=1000)
    said = command("sample", *SEEN, "--signal", "0.21,0.33,0.14", "--method", method,
                   "--samples", 1000)
    same_spectrum(estimate, estimate.facts(), said)


def test_many_signals(tmp_path):
    (tmp_path / "many.csv").write_text("name,R,G,B\nwarm,0.4,0.3,0.2\ncool,0.2,0.3,0.4\n")
    estimates = sb.sample([[0.4, 0.3, 0.2], [0.2, 0.3, 0.4]], camera=CAMERA, light=LIGHT,
                          noise=NOISE, names=["warm", "cool"])
    for one in command("sample", *SEEN, "--signals", tmp_path / "many.csv")["results"]:
        same_spectrum(estimates[one["name"]], estimates[one["name"]].facts(), one)


def test_a_camera_fitted(finished_flat):
    photo, light = finished_flat / "photos" / "sample.dng", "LED-B3"
    camera = sb.fit_camera(photo, light=light)
    said = command("camera", "fit", photo, "--light", light)
    assert camera.verdict == "pass"
    assert said["says"] == camera.says
    np.testing.assert_array_equal(camera.curves, said["sensitivities"])
    np.testing.assert_array_equal(camera.band(), [said["lower"], said["upper"]])
    assert set(camera.checks) <= set(said["checks"])


def test_a_surface_matched(finished_flat):
    red_wall = sb.Session(finished_flat)["red_wall"]
    match = sb.match(red_wall, "CES99")
    said = command("match", finished_flat, "CES99", "--only", "red_wall")
    assert said["surfaces"][0]["says"] == match.says
    assert [one["log_evidence"] for one in said["matches"]] == match.log_evidence.tolist()
