"""Signals and cameras have one way: command and library enter the same functions and give the same
numbers. What a command enters besides lays out its answer, or reads its options.
"""
import inspect
import json
import sys
from pathlib import Path

import numpy as np
import pytest
from flat_example import write_flat
from typer.testing import CliRunner

import spectrabox as sb
from spectrabox.session.cli import app

ROOT = Path(__file__).resolve().parents[1]
ROOMS = ("capture", "calibrate", "measure", "sampling")
CAMERA, LIGHT, NOISE = "Nikon 5100 (NPL)", "LED-B3", 0.003
SEEN = ("--sensitivity", CAMERA, "--light", LIGHT, "--noise", NOISE)
# how an answer is laid out, and regions and wavelengths as options and files write them
WORDS = {"facts", "text", "light", "words", "verdict", "line", "says", "title", "checks", "fitted",
         "light_words", "_cells", "_cell",
         "coverage_facts", "held_out_facts", "poor_patches", "posterior_facts", "judgement_text",
         "rows", "copy_facts", "camera_fitted", "difference_summary", "patch_differences",
         "left_out"}
OF_TEXTS = {"measure/texts.py", "measure/words.py"}


def entered(call):
    """The functions of the library's rooms that a call enters, and what it returns; bodies of
    classes, which run as their module is first imported, are none.
    """
    codes = set()

    def watch(frame, *_):
        codes.add(frame.f_code)     # and nothing inside of it is watched

    before = sys.gettrace()
    sys.settrace(watch)
    try:
        answer = call()
    finally:
        sys.settrace(before)
    paths = {code: Path(code.co_filename).resolve() for code in codes
             if not code.co_name.startswith("<") and code.co_flags & inspect.CO_NEWLOCALS}
    return {(path.relative_to(ROOT).as_posix(), code.co_name) for code, path in paths.items()
            if path.is_relative_to(ROOT) and path.relative_to(ROOT).parts[0] in ROOMS}, answer


def command(*words):
    result = CliRunner().invoke(app, [*map(str, words), "--json"])
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


def both(library, *words):
    """What library and command answer, which enter the same functions."""
    library(), command(*words)      # so that what is loaded once is loaded
    entered_by_library, estimate = entered(library)
    entered_by_command, said = entered(lambda: command(*words))
    assert not entered_by_library - entered_by_command
    assert not {(path, name) for path, name in entered_by_command - entered_by_library
                if name not in WORDS and path not in OF_TEXTS}
    return estimate, said


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
    def sampled():
        estimate = sb.sample([0.21, 0.33, 0.14], camera=CAMERA, light=LIGHT, noise=NOISE,
                             method=method, draws=1000)
        return estimate, estimate.facts()
    found, said = both(sampled, "sample", *SEEN, "--signal", "0.21,0.33,0.14", "--method", method,
                       "--samples", 1000)
    same_spectrum(*found, said)


def test_many_signals(tmp_path):
    (tmp_path / "many.csv").write_text("name,R,G,B\nwarm,0.4,0.3,0.2\ncool,0.2,0.3,0.4\n")

    def sampled():
        estimates = sb.sample([[0.4, 0.3, 0.2], [0.2, 0.3, 0.4]], camera=CAMERA, light=LIGHT,
                              noise=NOISE, names=["warm", "cool"])
        return {name: (estimate, estimate.facts()) for name, estimate in estimates.items()}
    found, said = both(sampled, "sample", *SEEN, "--signals", tmp_path / "many.csv")
    for one in said["results"]:
        same_spectrum(*found[one["name"]], one)


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    return write_flat(tmp_path_factory.mktemp("doors") / "session")


def test_a_camera_fitted(session):
    photo, light = session / "photos" / "sample.dng", "LED-B3"

    def fitted():
        camera = sb.fit_camera(photo, light=light)
        assert camera.verdict == "pass"
        return camera
    camera, said = both(fitted, "camera", "fit", photo, "--light", light)
    assert said["says"] == camera.says
    np.testing.assert_array_equal(camera.curves, said["sensitivities"])
    np.testing.assert_array_equal(camera.band(), [said["lower"], said["upper"]])
    assert set(camera.checks) <= set(said["checks"])


def test_a_surface_matched(session):
    command("run", session)
    red_wall = sb.Session(session)["red_wall"]
    words = ("match", session, "CES99", "--only", "red_wall")
    by_library, match = entered(lambda: sb.match(red_wall, "CES99"))
    by_command, said = entered(lambda: command(*words))
    assert not by_library - by_command      # which opens the session besides
    assert said["surfaces"][0]["says"] == match.says
    assert [one["log_evidence"] for one in said["matches"]] == [one.log_evidence
                                                                for one in match.matches]
