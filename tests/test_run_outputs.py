"""A run with nothing changed keeps report and spectra as they are, after looking at them."""
import json

import pytest

from spectrabox.radiometry.files import sha256_of

from tests.test_command_line import call, edit

FILES = ("report.html", "spectra.csv", "spectra.csv-metadata.json", "materials.xml",
         "materials.csv", "comparison.exr", "comparison.png")


@pytest.fixture
def reported(finished):
    """A finished session with its report."""
    call("run", finished)
    return finished


def run_again(folder):
    """Facts of another run, and the names of the files that it wrote again."""
    before = {name: (folder / name).stat().st_mtime_ns for name in FILES
              if (folder / name).exists()}
    facts = json.loads(call("run", folder, "--json").stdout)
    return facts, {name for name in FILES
                   if (folder / name).stat().st_mtime_ns != before.get(name)}


def test_nothing_is_written_again_and_the_same_is_said(reported):
    said = call("run", reported).stdout
    facts, written = run_again(reported)
    assert not written
    assert {stage["state"] for stage in facts["stages"]} == {"kept"}
    call("report", reported)
    again = json.loads(call("run", reported, "--json").stdout)
    assert again == facts
    assert said == call("run", reported).stdout
    assert facts["report"] == str(reported / "report.html")


def test_another_folder_is_named_after_a_move(reported, tmp_path):
    moved = reported.rename(tmp_path / "moved")
    facts, written = run_again(moved)
    assert not written
    assert facts["spectra"] == str(moved / "spectra.csv")


@pytest.mark.parametrize("name", FILES)
def test_a_file_that_was_touched_or_lost_is_made_again(reported, name):
    right = sha256_of(reported / name)
    (reported / name).write_text("edited")
    _, written = run_again(reported)
    assert written == set(FILES)
    if name in ("spectra.csv", "materials.xml"):
        assert sha256_of(reported / name) == right
    (reported / name).unlink()
    assert run_again(reported)[1] == set(FILES)


def test_a_changed_name_truth_or_result_makes_the_report_again(reported):
    edit(reported, 'name = "', 'name = "another ')
    assert run_again(reported)[1] == set(FILES)
    with (reported / "spectra" / "truth_red.csv").open("a") as stream:
        stream.write("\n")
    assert run_again(reported)[1] == set(FILES)
    (reported / "results" / "sample" / "arrays.npz").write_bytes(b"damaged")
    assert run_again(reported)[1] == set(FILES)
