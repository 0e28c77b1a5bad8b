"""A run with nothing changed keeps report and spectra as they are, after looking at them."""
import json
import shutil

import numpy as np
import pytest

from spectrabox.measure.advice.advice import Advised
from spectrabox.measure.scene.rehearsal import Rehearsed
from spectrabox.radiometry.files import sha256_of
from spectrabox.session.config.session_file import read_session
from spectrabox.session.outputs.run_outputs import rewritten_outputs
from spectrabox.session.store.rehearsals import save_rehearsal

from tests.session_runs import call, edit, run

FILES = ("report.html", "spectra.csv", "spectra.csv-metadata.json", "materials.xml",
         "materials.csv", "comparison.exr", "comparison.png")




@pytest.fixture(scope="module")
def _reported(_finished, tmp_path_factory):
    folder = shutil.copytree(_finished, tmp_path_factory.mktemp("reported") / "box")
    call("run", folder)
    return folder


@pytest.fixture
def reported(_reported, tmp_path):
    """A finished session with its report."""
    return shutil.copytree(_reported, tmp_path / "reported" / "box")


def run_again(folder):
    """Facts of another run, and the names of the files that it wrote again."""
    before = {name: (folder / name).stat().st_mtime_ns for name in FILES
              if (folder / name).exists()}
    facts = json.loads(call("run", folder, "--json").stdout)
    return facts, {name for name in FILES
                   if (folder / name).stat().st_mtime_ns != before.get(name)}


def write_truth(folder, change):
    """Change the text of the truth of one material."""
    path = folder / "spectra" / "truth_red.csv"
    path.write_text(change(path.read_text(encoding="utf-8")), encoding="utf-8")


def with_another_digit(text):
    """The last value of a table, a digit longer."""
    return text.rstrip() + "5\n"


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


def test_a_file_that_was_lost_is_made_again(reported):
    right = {name: sha256_of(reported / name) for name in ("spectra.csv", "materials.xml")}
    for name in FILES:
        (reported / name).unlink()
        assert run_again(reported)[1] == set(FILES), name
    assert right == {name: sha256_of(reported / name) for name in right}


def test_a_changed_name_or_truth_makes_the_report_again(reported):
    edit(reported, 'name = "', 'name = "another ')
    assert run_again(reported)[1] == set(FILES)
    write_truth(reported, lambda text: text + "\n")
    assert not run_again(reported)[1]
    write_truth(reported, with_another_digit)
    assert run_again(reported)[1] == set(FILES)


def test_a_truth_that_changed_after_it_was_read_makes_the_report_again(reported):
    finished = run(reported)
    write_truth(reported, with_another_digit)
    rewritten_outputs(read_session(reported), finished, ["spectrabox"], "cpu")
    assert run_again(reported)[1] == set(FILES)
    assert not run_again(reported)[1]


def test_a_rehearsal_since_the_report_is_shown_by_the_next_run(reported):
    config = read_session(reported)
    save_rehearsal(config, Rehearsed(0.95, 1, 40, ("cube",), *np.array([[0.953], [0.01], [0.05],
                                                                        [0.2]]),
                                     np.full((1, 10), 4)))
    assert run_again(reported)[1] == set(FILES)
    page = (reported / "report.html").read_text(encoding="utf-8")
    assert "Known truth inside the band, rehearsed" in page
    assert not run_again(reported)[1]


def test_what_to_do_next_is_forecast_again_only_for_other_results(reported, monkeypatch):
    advice = json.loads(call("run", reported, "--json").stdout)["advice"]
    assert advice["overall"] and advice["surfaces"]
    forecasts = []
    monkeypatch.setattr("spectrabox.measure.advice.advise.advice_on_capture",
                        lambda *_: forecasts.append(1) or Advised())
    (reported / "report.html").unlink()
    assert json.loads(call("run", reported, "--json").stdout)["advice"] == advice
    assert json.loads((reported / "report.json").read_text())["advice"] == advice
    assert not forecasts
    edit(reported, "draws = ", "draws = 1")     # a digit before the number
    call("run", reported)
    assert forecasts == [1]


@pytest.mark.parametrize("command", [["report"], ["relight", "--width", "16", "--spp", "1"],
                                     ["draws", "--out", "all.npz"]])
def test_who_is_shown_results_of_an_earlier_run_is_told(reported, tmp_path, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    name, *options = command
    fresh = call(name, reported, *options, "--json")
    assert json.loads(fresh.stdout)["stale"] == [] and "warning" not in fresh.stderr
    edit(reported, "draws = ", "draws = 1")     # a digit before the number
    told = call(name, reported, *options, "--json")
    assert told.exit_code == 0 and json.loads(told.stdout)["stale"] == ["sample"]
    assert "results are of an earlier run (sample: settings: sampling changed)" in told.stderr
    assert f"'spectrabox run {reported.name}'" in told.stderr
