"""What a newcomer types: near misses are answered with what to do, and commands are alike."""
import json

import pytest

from spectrabox.session.kept_stages import stages_in_order

from tests.session_runs import call


@pytest.mark.parametrize("command", ["check", "run", "status"])
def test_the_session_file_in_place_of_its_folder_is_answered_with_the_folder(captured, command):
    result = call(command, captured / "session.toml")
    assert result.exit_code == 3
    said = " ".join(result.output.split())
    assert f"give the session folder, {captured}" in said and "spectrabox new" not in said


@pytest.mark.parametrize("words", [("chart", "no.jpg"), ("chart", "no.dng"),
                                   ("develop", "no.tif", "--out", "a.exr"),
                                   ("spectrum", "show", "no.csv")])
def test_a_missing_file_without_a_session_is_not_sought_in_one(words):
    result = call(*words)
    assert result.exit_code == 3
    assert "correct its name" in result.stderr and "session.toml" not in result.stderr


def test_photos_of_a_camera_fit_may_stand_first_as_those_of_chart(captured):
    photo = captured / "photos" / "chart.dng"
    light = ["--light", captured / "spectra" / "light.csv", "--json"]
    first, named = (json.loads(call("camera", "fit", *words, *light).stdout)
                    for words in ([photo], ["--chart", photo]))
    assert first == named
    twice = call("camera", "fit", photo, "--chart", photo, *light)
    assert "counted twice" in twice.stderr


def test_measure_wants_a_folder_as_run_does():
    result = call("meter", "measure", "--with", "spotread")
    assert result.exit_code == 2 and "Missing argument 'DIR'" in result.output


@pytest.mark.parametrize("only, expected", [
    (None, [None]), ("sample", ["sample"]), ("sample, calibrate", ["calibrate", "sample"]),
    ("chart,chart", ["chart"]), ("sample,paint", ["paint", "sample"])])
def test_stages_alone_run_in_their_order(only, expected):
    order = ["chart", "photo", "calibrate", "reconstruct", "sample"]
    assert stages_in_order(only, order) == expected


def test_several_stages_run_alone_and_quietly(finished):
    result = call("run", finished, "--only", "sample,calibrate", "--force", "--quiet", "--json")
    assert result.exit_code == 0, result.output
    assert result.stderr == ""
    facts = json.loads(result.stdout)
    assert {stage["name"]: stage["state"] for stage in facts["stages"]}["sample"] in ("run", "kept")
    assert call("run", finished, "--only", "sample,paint").exit_code == 3
