"""A session whose runs are killed at their renames, or start twice, ends as one left alone.
"""
import json
import shutil

import pytest

from spectrabox.radiometry.errors import EnvironmentProblem
from spectrabox.session.store.locks import only_writer
from spectrabox.session.store.record_files import load_stage, save_stage, stage_folder

from tests.killed_runs import killed_at, leftovers, results_of, started, was_killed
from tests.session_runs import call

RUN = ("--device", "cpu")


@pytest.fixture(scope="module")
def whole(_finished, tmp_path_factory):
    """A finished session with its report, and the digests of its numbers."""
    folder = shutil.copytree(_finished, tmp_path_factory.mktemp("whole") / "box")
    assert call("run", folder, *RUN).exit_code == 0
    return folder, results_of(folder)


# Three savings of one stage: the second replaces the first, and so the third.
SAVING = """
import sys
from pathlib import Path
from spectrabox.session.store.record_files import save_stage, stage_folder
for value in (1, 2, 3):
    with stage_folder(Path({folder!r}), "photo") as new:
        save_stage(new, {{"settings": {{"v": value}}}}, {{}}, 1.0, {{}})
"""


@pytest.mark.parametrize("rename, value", [(1, None), (2, 1), (3, 1), (4, 2), (5, 2)])
def test_a_stage_killed_at_any_rename_is_the_one_before_or_the_one_after(tmp_path, rename, value):
    assert was_killed(killed_at(rename, code=SAVING.format(folder=str(tmp_path))))
    left = load_stage(tmp_path, "photo")
    assert (left and (left.key["settings"]["v"], left.damage)) == (value and (value, None))
    with stage_folder(tmp_path, "photo") as new:
        save_stage(new, {"settings": {"v": 4}}, {}, 1.0, {})
    assert load_stage(tmp_path, "photo").key == {"settings": {"v": 4}}
    assert leftovers(tmp_path) == []


@pytest.fixture
def stale(whole, tmp_path):
    """The same whose last stage is to be run again."""
    folder = shutil.copytree(whole[0], tmp_path / "box")
    shutil.rmtree(folder / "results" / "sample")
    return folder


def test_a_run_killed_at_a_rename_is_finished_by_the_next_to_the_same_bits(stale, whole):
    (stale / "spectra.csv").unlink()
    assert was_killed(killed_at(3, "run", str(stale), *RUN))
    assert leftovers(stale)
    assert call("status", stale).exit_code == 0
    assert call("run", stale, *RUN).exit_code == 0
    assert results_of(stale) == whole[1]
    assert leftovers(stale) == []


def test_damaged_results_are_made_again_with_a_note(stale, whole):
    shutil.copytree(whole[0] / "results" / "sample", stale / "results" / "sample")
    arrays = stale / "results" / "sample" / "arrays.npz"
    arrays.write_bytes(arrays.read_bytes()[:-1000])
    states = {stage["name"]: stage for stage in json.loads(
        call("status", stale, "--json").stdout)["stages"]}
    assert states["sample"]["reasons"] == ["its stored results are damaged (arrays.npz)"]
    refused = call("report", stale)
    assert refused.exit_code == 3 and "stage 'sample' are damaged (arrays.npz)" in refused.output
    again = call("run", stale, *RUN)
    assert again.exit_code == 0
    assert "run again: its stored results are damaged (arrays.npz)" in again.stderr
    assert results_of(stale) == whole[1]


def test_of_two_runs_one_works_and_the_other_says_who_does(stale, whole):
    with only_writer(stale, "spectrabox run"), only_writer(whole[0], "spectrabox run"):
        second = started("run", str(stale), *RUN, "--json")
        answer, _ = second.communicate(timeout=60)
        assert second.returncode == 7
        assert "'spectrabox run' (process " in json.loads(answer)["error"]
        assert "works in this session; wait for it" in json.loads(answer)["error"]
        assert call("status", stale).exit_code == 0
        assert call("report", whole[0]).exit_code == 0


def test_the_lock_of_a_process_that_was_killed_is_free(stale):
    assert was_killed(killed_at(1, "run", str(stale), *RUN))
    assert "spectrabox run" in (stale / "results" / ".run.lock").read_text()
    with only_writer(stale, "spectrabox run"):
        pass


@pytest.mark.parametrize("name", ["results", "spdx"])
def test_a_session_whose_folders_lead_elsewhere_is_not_written(stale, tmp_path, name):
    shutil.rmtree(stale / name)
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (stale / name).symlink_to(elsewhere)
    (stale / "comparison.part.png").symlink_to(tmp_path / "other")
    with pytest.raises(EnvironmentProblem, match=f"{name} is a symbolic link"), \
            only_writer(stale, "spectrabox run"):
        pass
    assert call("run", stale, *RUN).exit_code == 7
    assert not list(elsewhere.iterdir()) and not (tmp_path / "other").exists()
