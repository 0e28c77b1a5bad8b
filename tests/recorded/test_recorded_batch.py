"""Batches: which task runs when, what follows on its end, and what table, page and manifest say."""
import contextlib
import dataclasses
import json
import os
import sys
from collections import deque
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from compact_results import Texts, compact, without
from flat_example import HEAD, regions_toml

from spectrabox.capture.photo.image_files import write_exr
from spectrabox.radiometry.errors import (
    CheckError,
    EnvironmentProblem,
    InputError,
    SpectraboxError,
)
from spectrabox.session.batch import batch, cluster, manifest, needs, processes, progress, tasks
from spectrabox.session.batch.batch import kept_outcomes, run_batch
from spectrabox.session.batch.folders import session_folders
from spectrabox.session.batch.manifest import store_outcome, stored_outcome
from spectrabox.session.batch.page import link, write_page
from spectrabox.session.batch.pool import Finished, Lost
from spectrabox.session.batch.progress import BatchProgress, spoken
from spectrabox.session.batch.table import batch_facts, batch_text, counts
from spectrabox.session.batch.tasks import Order, Outcome, Task, do_task, tried_task
from spectrabox.session.batch.workers import open_workers
from spectrabox.session.config.session_file import read_session

MIB = 2**20


def an_order(folders, out, made="this program"):
    return Order(tuple(folders), out, "cpu", False, made)


def outcomes(root):
    """Of every kind, each with values of its own."""
    return [
        Outcome(str(root / "a"), "done", "A", "pass", "all is well", 0, 3.25, str(root / "a" /
                "report.html"), {"chart": ("run", 1.5), "photo": ("kept", 0.25)}, 400 * MIB,
                300 * MIB, {"session.toml": (10, 20)}),
        Outcome(str(root / "b b"), "done", "B", "warn", "doubtful " * 12 + "end\nsecond line", 0,
                7.04, str(root / "b b" / "report.html"), {"chart": ("run", 2.0)}, 410 * MIB, None,
                {"x": (1, 2)}),
        Outcome(str(root / "c"), "done", "C", "fail", "", 0, 0.04, None, {}, 1, 2, {"x": (1, 2)}),
        Outcome(str(root / "d"), "failed", "D", says="a sentence\nanother <one>", exit_code=4,
                seconds=61.26, needed_bytes=5),
        Outcome(str(root / "e"), "failed", "E", says="out of reach", exit_code=7)]


def test_table_facts_and_page_of_every_outcome(tmp_path, recorded, monkeypatch):
    monkeypatch.chdir(tmp_path)
    ended, page = outcomes(tmp_path), tmp_path / "out" / "batch.html"
    recorded(compact(batch_facts(ended, 2, page, 3), [tmp_path]), case="facts")
    facts = batch_facts(ended, 2, page, 3)["sessions"]
    recorded([[each["seconds"], each["peak_bytes"], each["stages"]] for each in facts],
             case="seconds")
    recorded([without(line, [tmp_path]) for kept in (0, 2)
              for line in batch_text(ended, kept, page).splitlines()], case="text")
    recorded([counts(ended), counts([]), counts(ended[:2]), [each.word for each in ended]],
             case="counts")
    (tmp_path / "out").mkdir()
    for shown, sessions in ((ended, 7), (ended[:1], 1)):
        page = write_page(tmp_path / "out", shown, sessions)
        recorded([without(line, [tmp_path]) for line in
                  Texts(page.read_text(encoding="utf-8")).lines], case=f"page of {sessions}")
    recorded([link(tmp_path / name, tmp_path / "out") for name in
              ("a/report.html", "b b/r#1.html", "out/x.html", "ü/%.html")], case="links")


def test_which_folders_are_named(tmp_path, recorded, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "lists").mkdir()
    listed = tmp_path / "lists" / "l.txt"
    listed.write_text("\ufeff# a comment\n\n ../b \nc\n../a\n/d\n", encoding="utf-8")
    recorded([each.as_posix().replace(str(tmp_path), "DIR")
              for each in session_folders([Path("b"), Path("x/../a"), Path("b")], listed)])
    for named, file, said in (((), None, "no session is named"), ((), tmp_path / "none", "cannot "
                                                                  "be read as a list")):
        with pytest.raises(InputError, match=said):
            session_folders(named, file)


def test_what_of_a_batch_counts_as_done(tmp_path, recorded):
    """Every change that makes a session count as not done, one after the other."""
    folder, out = tmp_path / "s", tmp_path / "out"
    folder.mkdir()
    for name in ("session.toml", "photo.dng"):
        (folder / name).write_text(name, encoding="utf-8")
    files = {name: manifest._state(folder / name) for name in ("session.toml", "photo.dng")}
    done = dataclasses.replace(outcomes(tmp_path)[0], folder=str(folder), of=files)
    store_outcome(out, done, "this program")
    kept = json.loads(next((out / "sessions").iterdir()).read_text(encoding="utf-8"))
    recorded(compact(kept, [tmp_path]))
    back = stored_outcome(out, folder, "this program")
    assert back == dataclasses.replace(done, stages={
        name: list(each) for name, each in done.stages.items()}, of={
        name: list(each) for name, each in files.items()})
    order = an_order([folder, tmp_path / "other"], out)
    found = {"as it was": len(kept_outcomes(order)),
             "another program": len(kept_outcomes(an_order([folder], out, "another")))}

    def stored(name, **changes):
        store_outcome(out, dataclasses.replace(done, **changes), "this program")
        found[name] = stored_outcome(out, folder, "this program") is not None
    stored("failed", state="failed")
    stored("only looked at", state="ready")
    stored("of no files", of={})
    stored("a file too many", of=files | {"gone": (1, 2)})
    stored("another size", of=files | {"photo.dng": (1, files["photo.dng"][1])})
    stored("another time", of=files | {"photo.dng": (files["photo.dng"][0], 1)})
    stored("as it was again")
    for text in ("{", "[]", "3", '{"made by": "this program", "state": "done", "more": 1}', ""):
        next((out / "sessions").iterdir()).write_text(text, encoding="utf-8")
        found[f"holds {text}"] = stored_outcome(out, folder, "this program") is not None
    os.utime(folder / "photo.dng", ns=(1, 1))
    recorded(found, case="what counts")


class Told:
    """A pool that notes what runs beside what, and ends tasks as it is told."""

    about = ""

    def __init__(self, workers, budget, largest, ends):
        self.workers, self.budget_bytes, self.largest_bytes = workers, budget, largest
        self.running, self.log, self._ends = deque(), [], ends

    def start(self, task):
        self.running.append(task)
        self.log.append(" + ".join(f"{each.folder.name}{'?' if each.look else ''}"
                                   f"{'!' * each.tries}" for each in self.running))

    def wait(self):
        return [self._ends(self.running.popleft())]


def ends(task):
    """Scenes are ready, then done; some die, once or always, and some fail."""
    name = task.folder.name
    if name == "dies" or (name == "dies once" and not task.tries):
        return Lost(task, "by signal 9 (SIGKILL)")
    if task.look:
        return Finished(task, Outcome(str(task.folder), "ready",
                                      needed_bytes=3 * task.needed_bytes))
    state = "failed" if name == "fails" else "done"
    return Finished(task, Outcome(str(task.folder), state, name, "pass" * (state == "done"),
                                  "said", needed_bytes=task.needed_bytes))


NEEDS = {"small": 10, "scene": 20, "large": 70, "too large": 200, "dies": 15, "dies once": 25,
         "fails": 30, "unreadable": None}


@pytest.mark.parametrize("workers, budget, largest", [
    (1, None, None), (2, None, None), (3, 100 * MIB, 150 * MIB), (2, 60 * MIB, None),
    (4, 95 * MIB, 100 * MIB)])
def test_the_order_of_a_batch(workers, budget, largest, tmp_path, recorded, monkeypatch):
    def tried(folder, order):
        if NEEDS[folder.name] is None:
            return Outcome(str(folder), "failed", folder.name, says="cannot be read", exit_code=3)
        return Task(folder, order, folder.name == "scene", NEEDS[folder.name] * MIB)
    monkeypatch.setattr(batch, "tried_task", tried)
    stored = []
    monkeypatch.setattr(batch, "store_outcome", lambda out, outcome, made: stored.append(
        Path(outcome.folder).name))
    folders = [tmp_path / name for name in NEEDS]
    pool = Told(workers, budget, largest, ends)
    told = list(run_batch(an_order(folders, tmp_path), folders, pool))
    assert stored == [Path(each.folder).name for each in told] and set(stored) == set(NEEDS)
    recorded([pool.log, [f"{Path(each.folder).name}: {each.state} {each.exit_code} {each.says} "
                         f"{each.needed_bytes / MIB:g} MiB" for each in told]])


@pytest.fixture
def readable(tmp_path):
    """A session whose photo is there, of 30 x 20 pixels."""
    folder = tmp_path / "flat"
    (folder / "photos").mkdir(parents=True)
    (folder / "spectra").mkdir()
    for name in ("light", "red_wall"):
        kind = "relative" if name == "light" else "reflectance"
        (folder / "spectra" / f"{name}.csv").write_text(
            f"# quantity: {kind}\nnm,value\n380,0.5\n780,0.6\n", encoding="utf-8")
    text = (HEAD + regions_toml(("red_wall",))).replace("sample.dng", "p.exr")
    (folder / "session.toml").write_text(text, encoding="utf-8")
    rng = np.random.default_rng(3)
    for name, size in (("p.exr", (20, 30)), ("flat.exr", (24, 31))):
        write_exr(folder / "photos" / name, rng.uniform(0.1, 0.6, (*size, 3)).astype(np.float32),
                  ["R", "G", "B"], 0.1)
    return folder


def test_the_first_task_of_a_session_and_what_it_needs(readable, tmp_path, recorded):
    order = an_order([readable], tmp_path)
    task = tried_task(readable, order)
    found = [task.look, task.tries, task.needed_bytes - needs.PROGRAM_BYTES]
    assert found[2] == needs.BYTES_A_PIXEL * 20 * 30
    text = (readable / "session.toml").read_text(encoding="utf-8")
    (readable / "session.toml").write_text(
        text.replace("[light]", 'flat = "photos/flat.exr"\n[light]'), encoding="utf-8")
    found.append(needs.needed_bytes(read_session(readable)) - needs.PROGRAM_BYTES)
    (readable / "photos" / "p.exr").unlink()
    (tmp_path / "none").mkdir()
    for folder in (readable, tmp_path / "none"):
        failed = tried_task(folder, order)
        found.append([failed.state, failed.exit_code, without(failed.says, [tmp_path])])
    recorded(found)


@pytest.mark.parametrize("error", [InputError("two\nlines"), CheckError("a chart"), MemoryError(),
                                   OSError(28, "No space left"), ValueError("nobody foresaw"),
                                   SpectraboxError("plain")])
def test_whatever_goes_wrong_is_an_outcome(error, readable, tmp_path, recorded, monkeypatch):
    def run(task):
        raise error
    monkeypatch.setattr(tasks, "_run", run)
    monkeypatch.setattr(tasks, "_made_by", lambda: "this program")
    task = Task(readable, an_order([readable], tmp_path), False, 77)
    found = do_task(task)
    assert found.seconds >= 0 and found.folder == str(readable)
    recorded([found.state, found.name, found.says, found.exit_code, found.needed_bytes, found.of])
    other = do_task(dataclasses.replace(task, order=an_order([], tmp_path, "another")))
    recorded([other.state, other.says, other.exit_code], case="another program")


def test_interrupts_end_a_batch(readable, tmp_path, monkeypatch):
    monkeypatch.setattr(tasks, "_made_by", lambda: "this program")
    task = Task(readable, an_order([readable], tmp_path), False, 77)
    for error in (KeyboardInterrupt, SystemExit, GeneratorExit):
        def run(task, error=error):
            raise error
        monkeypatch.setattr(tasks, "_run", run)
        with pytest.raises(error):
            do_task(task)


@pytest.mark.parametrize("look, problems, tracing", [
    (True, (), 12345), (True, (), None), (True, (("b\nc", 4), ("a", 3)), None)])
def test_a_look_at_a_scene(look, problems, tracing, tmp_path, recorded, monkeypatch):
    found = SimpleNamespace(tracing_bytes=tracing, problems=[
        SimpleNamespace(sentence=said, exit_code=code) for said, code in problems])
    asked = []
    monkeypatch.setattr("spectrabox.session.check.foresee",
                        lambda *words: asked.append(words) or found)
    monkeypatch.setattr(tasks, "_made_by", lambda: "this program")
    outcome = do_task(Task(tmp_path, an_order([tmp_path], tmp_path / "out"), look, 1000))
    recorded([outcome.state, outcome.says, outcome.exit_code, outcome.needed_bytes,
              [str(word).replace(str(tmp_path), "DIR") for word in asked[0]]])


def test_how_far_a_batch_has_come(tmp_path, recorded, monkeypatch, capsys):
    now, shown = [50.0], []
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    for kept, lines in ((0, False), (2, True)):
        far = BatchProgress(lambda *words: shown.append(list(words)), 5 + kept, kept, lines)
        for at, outcome in enumerate(outcomes(Path("/lab"))):
            now[0] += 37.0 * (at + 1)
            far.heard(outcome)
    # times of sessions are what the outcome says
    recorded([shown, capsys.readouterr().err.splitlines()])
    recorded([spoken(each) for each in (0.2, 59.6, 119.4, 119.6, 121, 3599, 7199, 7201, 90000)],
             case="spoken")


@pytest.mark.parametrize("cores", [(0,), (0, 1), (2, 3, 5), tuple(range(8))])
def test_cores_of_each_worker(cores, recorded, monkeypatch):
    monkeypatch.setattr(processes.os, "sched_getaffinity", lambda process: set(cores))
    recorded([[workers, processes.shares_of_cores(workers)] for workers in (1, 2, 3, 5, 8, 9)])


def test_which_workers_are_opened(recorded, monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: {0, 1, 2})
    opened = []

    def opening(kind):
        def opens(*words):
            opened.append([kind, *words])
            return contextlib.nullcontext()
        return opens
    monkeypatch.setattr("spectrabox.session.batch.workers.open_processes", opening("processes"))
    monkeypatch.setattr("spectrabox.session.batch.cluster.open_cluster", opening("cluster"))
    for words in ((None, None, 9), (None, 2, 9), (None, 8, 5), (None, None, 0), ("local", None, 9),
                  ("local", 2, 1), ("local", 2, 0), ("tcp://x", None, 9), ("tcp://x", 2, 9)):
        try:
            with open_workers(*words):
                pass
        except InputError as error:
            opened.append(str(error))
    recorded(opened)


def test_what_a_cluster_says_of_its_workers(recorded):
    found = []
    for limits in ([(100, 1)], [(100, 2), (300, 1)], [(0, 1), (300, 2)], []):
        info = {"workers": {str(at): {"memory_limit": limit, "nthreads": threads}
                            for at, (limit, threads) in enumerate(limits)}}
        client = SimpleNamespace(dashboard_link="http://x", scheduler_info=lambda n_workers=-1,
                                 info=info: info)
        pool = cluster.Cluster(client, 77)
        found.append([pool.about, pool.workers, pool.budget_bytes, pool.largest_bytes])
    recorded([found, cluster._of_workers({"MALLOC_TRIM_THRESHOLD_": 1, "OMP": 2})])


def test_the_peak_of_memory_as_the_system_tells_it(tmp_path, recorded, monkeypatch):
    monkeypatch.setattr(needs, "PEAK", tmp_path / "clear")
    monkeypatch.setattr(needs, "STATUS", tmp_path / "status")
    (tmp_path / "status").write_text("Name:\tx\nVmHWM:\t  1234 kB\nVmRSS:\t 1200 kB\n",
                                     encoding="utf-8")
    found = [needs.PeakMemory().peak()]
    (tmp_path / "clear").write_text("", encoding="utf-8")
    found += [needs.PeakMemory().peak(), (tmp_path / "clear").read_text(encoding="utf-8")]
    monkeypatch.setattr(needs, "PEAK", tmp_path)        # no file
    recorded([*found, needs.PeakMemory().peak()])


class Future:
    """Of a task that was given to Dask."""

    status = "finished"

    def result(self):
        return "done"

    def exception(self):
        return "its end"


class Dask:
    """Stands in for Dask: notes what it is asked for."""

    def __init__(self, fails=None):
        self.asked, self.fails = [], fails
        self.config = SimpleNamespace(set=self.set, get=lambda name: {"MALLOC_TRIM": 1, "A": 2})
        self.scheduler_address, self.dashboard_link = "tcp://here:1", "http://here"
        self.future = Future()

    def set(self, settings):
        self.asked.append(["set", settings])
        return contextlib.nullcontext()

    def scheduler_info(self, n_workers):
        return {"workers": {"a": {"memory_limit": 0, "nthreads": 1}}}

    def client(self, address, timeout):
        if self.fails is not None:
            raise self.fails
        self.asked.append(["client", address, timeout])
        return contextlib.nullcontext(self)

    def local(self, **words):
        self.asked.append(["local", words])
        return contextlib.nullcontext(self)

    def register_plugin(self, plugin):
        self.asked.append(["plugin", plugin.name])

    def wait_for_workers(self, count, timeout):
        self.asked.append(["wait", count, timeout])

    def submit(self, function, task, pure):
        self.asked.append(["submit", function.__name__, pure])
        self.status = "running"
        return self.future


def wait_for_futures(futures, timeout, return_when):
    assert (timeout, return_when) == (cluster.LISTENING_S, "FIRST_COMPLETED")


@pytest.mark.parametrize("address", ["local", "tcp://there:8786"])
def test_what_is_asked_of_dask(address, recorded, monkeypatch):
    def module(dask):
        plugin = type("WorkerPlugin", (), {})
        errors = SimpleNamespace(FuturesCancelledError=RuntimeError)
        parts = SimpleNamespace(Client=dask.client, LocalCluster=dask.local, WorkerPlugin=plugin,
                                wait=wait_for_futures, client=errors)
        for name, each in (("dask", dask), ("distributed", parts), ("distributed.client", errors)):
            monkeypatch.setitem(sys.modules, name, each)
        return dask
    monkeypatch.setattr(cluster, "free_memory", lambda: 1000)
    dask, said = module(Dask()), []
    task = Task(Path("s"), None, False, 7)
    with cluster.open_cluster(address, 3) as pool:
        found = [pool.about, pool.workers, pool.budget_bytes, pool.largest_bytes]
        for status in ("finished", "error"):
            dask.future.status = status
            pool.start(task)
            ended, = pool.wait()
            said.append([type(ended).__name__, ended.task.tries, getattr(ended, "why", ""),
                         getattr(ended, "outcome", "")])
        dask.future.status = "lost"
        pool.start(task)
        with pytest.raises(EnvironmentProblem) as lost:
            pool.wait()
        said.append(str(lost.value))
    recorded([found, dask.asked, said])
    for error in (OSError("x"), ValueError("y"), TimeoutError()):
        module(Dask(error))
        with pytest.raises(EnvironmentProblem) as refused, cluster.open_cluster(address, 2):
            pass
        recorded(str(refused.value), case=type(error).__name__)
