"""Many sessions: each as 'run' makes it, whatever happens to the others or to a worker."""
import dataclasses
import json
import mmap
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from batch_sessions import (
    batch_of,
    begun,
    copies,
    kill_worker_at,
    process_at,
    results_of,
    write_session,
)
from inline_workers import inline_workers

from spectrabox.radiometry.errors import EnvironmentProblem, InputError
from spectrabox.session.batch import overview
from spectrabox.session.batch.executors import open_processes
from spectrabox.session.batch.overview import (
    BatchProgress,
    Outcome,
    batch_facts,
    batch_text,
    duration_text,
    link,
    store_outcome,
    stored_outcome,
    write_page,
)
from spectrabox.session.batch.tasks import (
    PeakMemory,
    kept_outcomes,
    run_batch,
    session_folders,
)
from spectrabox.session.config.session_file import read_session
from spectrabox.session.outputs.run_outputs import rewritten_outputs
from spectrabox.session.pipeline import run_stages
from spectrabox.session.store.locks import share_stage, sole_user
from spectrabox.session.store.record_files import load_stage

from tests.session_runs import call

ROOT = Path(__file__).resolve().parent.parent


def batch(*words, cwd):
    """The command as an operator types it."""
    return subprocess.Popen([sys.executable, "-m", "spectrabox", "batch", *map(str, words)],
                            cwd=cwd, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                            env=os.environ | {"PYTHONPATH": str(ROOT)})


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    """A session that 'run' has made by itself."""
    folder = write_session(tmp_path_factory.mktemp("one") / "as run")
    config = read_session(folder)
    finished = run_stages(config, device="cpu", only=None, force=False, progress=lambda *_: None)
    rewritten_outputs(config, finished, ["spectrabox", "run"], "cpu")
    return folder


def with_shared(shared, session):
    """The folder of what is shared, after a batch that has made a session's calibration."""
    config = read_session(session)
    for stage in ("chart", "calibrate"):
        share_stage(shared, stage, load_stage(config.results_folder, stage))
    return shared


def calibrated(folder, shared):
    """States of a session's stages, run as a batch runs them until it is calibrated."""
    return run_stages(read_session(folder), device="cpu", only=None, force=False,
                      progress=lambda *_: None, before="signals", shared=shared).states


def arrays_of(folder):
    """Digests of what was calibrated."""
    return {name: digest for name, digest in results_of(folder).items()
            if name.startswith(("results/chart", "results/calibrate"))}


def stand_in(task):
    """The outcome of a session that nobody has run."""
    return Outcome(str(task.folder), "ready" if task.check else "done", verdict="pass",
                   needed_bytes=task.needed_bytes)


# ---- as 'run' makes them

def test_a_batch_makes_what_run_makes_and_the_calibration_once(session, tmp_path, monkeypatch):
    folders = copies(session, tmp_path, ["b b", "ä"])
    (tmp_path / "list.txt").write_text("# of today\n\nä\nnone\n", encoding="utf-8")
    done = batch("b b", "--list", "list.txt", "--workers", 2, "--device", "cpu", "--json",
                 cwd=tmp_path)
    out, said = done.communicate()
    assert done.returncode == 3, said
    facts = json.loads(out)
    assert facts["counts"] == {"pass": 2, "warn": 0, "fail": 0, "could not be run": 1}
    assert [Path(each["folder"]).name for each in facts["sessions"]] == ["b b", "ä", "none"]
    assert "session.toml is missing" in facts["sessions"][2]["says"]
    assert facts["sessions"][2]["exit_code"] == 3
    assert {line.split()[0] for line in said.splitlines()} == {"batch", "PASS", "ERROR"}
    for folder in folders:
        assert results_of(folder) == results_of(session)
    states = [{stage["name"]: stage["state"] for stage in each["stages"]}
              for each in facts["sessions"][:2]]
    for stage in ("chart", "calibrate"):
        assert sorted(each[stage] for each in states) == ["copied", "run"]
    for each in facts["sessions"][:2]:
        # what was foreseen of memory is kept to, and is no fantasy
        assert each["needed_bytes"] / 4 < each["peak_bytes"] < each["needed_bytes"]

    monkeypatch.chdir(tmp_path)
    again = call("batch", "b b", "ä", "--quiet")
    assert (again.exit_code, again.stderr) == (0, "")
    assert "2 sessions: 2 pass; 2 were done before" in again.stdout


def test_what_is_done_is_not_run_again_until_something_changes(session, tmp_path):
    folders = [shutil.copytree(session, tmp_path / name) for name in ("a", "b")]
    tasks, (_, here) = batch_of(folders, tmp_path / "out"), inline_workers()
    assert [each.verdict for each in run_batch(tasks, here)] == ["pass", "pass"]
    assert list(kept_outcomes(tasks)) == folders
    os.utime(folders[0] / "photos" / "sample.dng", ns=(0, 0))
    assert list(kept_outcomes(tasks)) == folders[1:]
    (folders[1] / "report.html").unlink()
    assert kept_outcomes(tasks) == {}
    outcomes = list(run_batch(tasks, here))
    assert {state for each in outcomes for state, _ in each.stages.values()} == {"kept"}
    assert (folders[1] / "report.html").is_file()
    assert list(kept_outcomes(tasks)) == folders
    assert kept_outcomes(batch_of(folders, tmp_path / "out", "another program")) == {}
    path = next((tmp_path / "out" / "sessions").iterdir())
    for damaged in ("", "[]", "{}", "[" * 100_000, path.read_text().replace('"files"', '"off"')):
        path.write_text(damaged, encoding="utf-8")
        assert len(kept_outcomes(tasks)) == 1


def test_a_shared_calibration_that_was_damaged_is_made_again(session, tmp_path):
    folders = copies(session, tmp_path, ["a", "b"])
    shared = with_shared(tmp_path / "shared", session)
    for stage in shared.glob("ca*"):
        (stage / "arrays.npz").write_bytes(b"damaged")
    first, second = (calibrated(folder, shared) for folder in folders)
    assert [first[stage] for stage in ("chart", "calibrate")] == ["copied", "run"]
    assert second["calibrate"] == "copied"
    for folder in folders:
        assert arrays_of(folder) == arrays_of(session)


def test_a_session_that_differs_shares_nothing_with_it(session, tmp_path):
    folders = copies(session, tmp_path, ["a", "b"])
    text = (folders[1] / "session.toml").read_text(encoding="utf-8")
    text = text.replace("[chart]\n", "[chart]\nleave_out = [3]\n")
    (folders[1] / "session.toml").write_text(text, encoding="utf-8")
    shared = with_shared(tmp_path / "shared", session)
    states = [calibrated(folder, shared) for folder in folders]
    assert [each["calibrate"] for each in states] == ["copied", "run"]
    assert [each["chart"] for each in states] == ["copied", "copied"]
    assert arrays_of(folders[0]) == arrays_of(session) != arrays_of(folders[1])


# ---- workers that die, and Ctrl-C

def test_a_worker_killed_costs_nothing_but_time(session, tmp_path):
    folders = begun(session, tmp_path, ["a", "b"], until="signals")
    tasks = batch_of(folders, tmp_path / "out")
    with open_processes(2) as workers, kill_worker_at(folders[0]):
        outcomes = list(run_batch(tasks, workers))
    assert [each.verdict for each in outcomes] == ["pass", "pass"]
    for folder in folders:
        assert results_of(folder) == results_of(session)


def test_ctrl_c_stops_all_workers_and_the_same_command_goes_on(session, tmp_path):
    folders = begun(session, tmp_path, ["a", "b"], until="signals")
    words = ["a", "b", "--workers", 2, "--device", "cpu"]
    stopped = batch(*words, cwd=tmp_path)
    worker = process_at(folders[0])
    stopped.send_signal(signal.SIGINT)
    _, said = stopped.communicate(timeout=120)
    assert stopped.returncode == 130
    assert "run the same command again to go on" in said and "Traceback" not in said
    assert not Path(f"/proc/{worker}").exists() or not Path("/proc").is_dir()
    assert "2 still to be run" in (tmp_path / "batch" / "batch.html").read_text(encoding="utf-8")
    assert [path for folder in folders for path in folder.rglob(".*.new")] == []
    going_on = batch(*words, "-q", cwd=tmp_path)
    out, said = going_on.communicate()
    assert (going_on.returncode, said) == (0, ""), said
    assert "2 sessions: 2 pass" in out
    for folder in folders:
        assert results_of(folder) == results_of(session)


def test_workers_end_with_their_parent(session, tmp_path):
    folders = copies(session, tmp_path, ["a"])
    killed = batch("a", "--workers", 1, "--device", "cpu", cwd=tmp_path)
    worker = process_at(folders[0])
    killed.kill()
    killed.communicate()
    end = time.monotonic() + 60
    while Path(f"/proc/{worker}").exists() and time.monotonic() < end:
        time.sleep(0.05)
    assert not Path(f"/proc/{worker}").exists()


# ---- who runs what

def tasks_of(needs, check=False):
    """Patched in place of reading the sessions: a task for each, which needs so much."""
    each = iter(needs)
    return lambda task: dataclasses.replace(task, check=check, needed_bytes=next(each))


def test_a_scene_is_looked_at_before_it_runs_with_what_it_needs(tmp_path, monkeypatch):
    tasks = batch_of([tmp_path / "a", tmp_path / "b"], tmp_path / "out", "x")
    monkeypatch.setattr("spectrabox.session.batch.tasks.first_task", tasks_of([40, 40], check=True))
    executor, here = inline_workers(lambda task: dataclasses.replace(
        stand_in(task), needed_bytes=70) if task.check else stand_in(task))
    assert len(list(run_batch(tasks, here))) == 2
    # what has been looked at runs before the next is looked at
    assert [(task.folder.name, task.check, task.needed_bytes) for task in executor.tasks] == [
        ("a", True, 40), ("a", False, 70), ("b", True, 40), ("b", False, 70)]


def test_a_session_that_cannot_be_run_is_one_row(tmp_path, monkeypatch):
    tasks = batch_of([tmp_path / "a", tmp_path / "b"], tmp_path / "out", "x")
    monkeypatch.setattr("spectrabox.session.batch.tasks.first_task", tasks_of([2**30, 2**20]))
    _, here = inline_workers(stand_in, worker_bytes=2**29)
    outcomes = list(run_batch(tasks, here))
    assert [(each.word, each.exit_code) for each in outcomes] == [("ERROR", 7), ("PASS", 0)]
    assert "1024 MiB of memory are needed and a worker has 512 MiB" in outcomes[0].says


def test_everything_that_is_wrong_with_a_scene_is_in_its_row(captured, tmp_path):
    (captured / "photos" / "box.dng").write_bytes(b"no photo")
    tasks = batch_of([captured], tmp_path / "out")
    (outcome,) = run_batch(tasks, inline_workers()[1])
    assert outcome.state == "failed" and "box.dng" in outcome.says
    assert stored_outcome(tasks[0].out, captured, tasks[0].program) is None      # it is tried again


def test_a_worker_with_another_program_refuses(session, tmp_path):
    (task,) = batch_of([session], tmp_path, "another")
    outcome = task()
    assert outcome.exit_code == 7 and "program, packages or kept cameras" in outcome.says


@pytest.mark.parametrize("error, said, code", [
    (MemoryError(), "memory ran out", 7), (ZeroDivisionError("by 0"), "unexpected ZeroDiv", 1)])
def test_what_nobody_foresaw_is_a_row_too(session, tmp_path, monkeypatch, error, said, code):
    def fail(*_):
        raise error
    monkeypatch.setattr("spectrabox.session.batch.tasks._run", fail)
    (task,) = batch_of([session], tmp_path)
    outcome = task()
    assert outcome.exit_code == code and said in outcome.says


def test_one_batch_at_a_time_uses_a_folder(tmp_path):
    with sole_user(tmp_path / "out"), \
            pytest.raises(EnvironmentProblem, match="uses this output folder; wait for it"), \
            sole_user(tmp_path / "out"):
        pass


# ---- which sessions, and what is said of them

def test_folders_are_taken_once_in_their_order(tmp_path):
    (tmp_path / "list.txt").write_text("b\n# c\n\n./a\n", encoding="utf-8")
    named = session_folders([tmp_path / "a" / "..", tmp_path / "a"], tmp_path / "list.txt")
    assert named == [tmp_path, tmp_path / "a", tmp_path / "b"]
    with pytest.raises(InputError, match="no session is named"):
        session_folders([], None)
    with pytest.raises(InputError, match="cannot be read as a list of sessions"):
        session_folders([], tmp_path)


HOSTILE = "<script>alert(1)</script>"


def outcomes_in(folder):
    return [Outcome(str(folder / "a"), "done", "wall & paint", "pass", "All is well.", 0, 12.5,
                    str(folder / "a" / "report.html"), {"chart": ("run", 1.0)}, 2**28, 2**27),
            Outcome(str(folder / HOSTILE), "failed", HOSTILE, "", f"{HOSTILE}\nand more", 3),
            Outcome(str(folder / "javascript:alert(1)"), "done", "b", "warn", "Glare.", 0, 3.0,
                    str(folder / "javascript:alert(1)" / "report.html"))]


def test_the_page_escapes_and_links(tmp_path):
    text = write_page(tmp_path / "out", outcomes_in(tmp_path), 5).read_text(encoding="utf-8")
    assert HOSTILE not in text and "&lt;script&gt;" in text
    assert 'href="./../a/report.html"' in text and "wall &amp; paint" in text
    assert 'href="./../javascript%3Aalert%281%29/report.html"' in text
    assert "2 still to be run" in text
    assert link(tmp_path / "a b" / "é#.html", tmp_path) == "./a%20b/%C3%A9%23.html"


def test_the_page_in_a_browser(browser, tmp_path):
    outcomes = outcomes_in(tmp_path)
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "report.html").write_text("<title>the report</title>", encoding="utf-8")
    page = write_page(tmp_path / "out", outcomes, 3)
    for scheme, width in (("light", 1300), ("dark", 400)):
        with browser.new_page(viewport={"width": width, "height": 800}, color_scheme=scheme) as tab:
            tab.goto(page.as_uri())
            assert tab.evaluate("document.documentElement.scrollWidth") <= width
            assert tab.locator("tbody tr").count() == 3
            if scheme == "light":       # worst first, then by what a heading says
                words = ("[...document.querySelectorAll('tbody tr')]"
                         ".map((row) => row.cells[2].innerText)")
                assert tab.evaluate(words) == ["ERROR", "WARN", "PASS"]
                tab.get_by_role("button", name="Seconds").click()
                assert tab.evaluate(words) == ["ERROR", "WARN", "PASS"]
                tab.get_by_role("button", name="Seconds").click()
                assert tab.evaluate(words) == ["PASS", "WARN", "ERROR"]
            colours = tab.eval_on_selector("td.PASS", "cell => getComputedStyle(cell).color")
            assert colours == {"light": "rgb(44, 122, 75)", "dark": "rgb(116, 210, 154)"}[scheme]
            tab.get_by_role("link", name="wall & paint").click()
            assert tab.title() == "the report"


def test_script_and_person_are_told(tmp_path):
    outcomes = outcomes_in(tmp_path)
    facts = batch_facts(outcomes, 1, tmp_path / "batch.html", 2)
    assert facts["counts"] == {"pass": 1, "warn": 1, "fail": 0, "could not be run": 1}
    assert facts["sessions"][0]["stages"] == [{"name": "chart", "state": "run", "seconds": 1.0}]
    json.dumps(facts, allow_nan=False)
    text = batch_text(outcomes, 1, tmp_path / "batch.html")
    assert "3 sessions: 1 pass, 1 warn, 1 could not be run; 1 were done before" in text
    assert "and more" not in text


def test_outcomes_come_back_as_they_were_stored(tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "x").write_text("x", encoding="utf-8")
    state = (tmp_path / "a" / "x").stat()
    outcome = dataclasses.replace(outcomes_in(tmp_path)[0],
                                  files={"x": (state.st_size, state.st_mtime_ns)})
    store_outcome(tmp_path, outcome, "m")
    back = stored_outcome(tmp_path, tmp_path / "a", "m")
    assert dataclasses.asdict(back) == json.loads(json.dumps(dataclasses.asdict(outcome)))
    assert stored_outcome(tmp_path, tmp_path / "a", "n") is None


def test_the_time_left_is_at_the_pace_of_what_ran_now(tmp_path, monkeypatch):
    now, shown = [0.0], []
    monkeypatch.setattr(overview.time, "monotonic", lambda: now[0])
    progress = BatchProgress(lambda *one: shown.append(one), 10, 6, False)
    now[0] = 20.0
    progress.add(outcomes_in(tmp_path)[0])
    assert shown[-1][1] == 0.7 and shown[-1][2].endswith("60 s left")    # three more


@pytest.mark.parametrize("seconds, said", [(7.4, "7 s"), (200, "3 min"), (9000, "2.5 h")])
def test_times_are_spoken_in_a_fitting_unit(seconds, said):
    assert duration_text(seconds) == said


@pytest.mark.skipif(not Path("/proc/self/clear_refs").exists(), reason="no Linux: peaks unknown")
def test_the_peak_of_memory_is_that_of_the_task():
    first, size = PeakMemory(), 200 * 2**20
    # straight from the system: what earlier tests freed may hold an array of this size
    with mmap.mmap(-1, size) as array:
        array[::mmap.PAGESIZE] = b"x" * (size // mmap.PAGESIZE)
    with_array = first.peak()
    assert with_array - PeakMemory().peak() > 150 * 2**20
