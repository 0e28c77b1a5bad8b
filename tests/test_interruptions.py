"""A signal at any line of the code that replaces results leaves the old or the new ones."""
import contextlib
import gc
import os
import signal
import sys
from pathlib import Path

import pytest

from spectrabox.radiometry import files
from spectrabox.radiometry.files import UNFINISHED, whole_file
from spectrabox.session.store import record_files
from spectrabox.session.store.record_files import load_stage, save_stage, stage_folder
from spectrabox.session.terminal.progress_display import SIGNALS, held, stop_on_signals

# Between a file's opening and its block, an interrupt leaves it to the collector to close it.
pytestmark = pytest.mark.filterwarnings("ignore::ResourceWarning",
                                        "ignore::pytest.PytestUnraisableExceptionWarning")
TRACED = tuple(str(Path(module.__file__)) for module in (record_files, contextlib, files))


@pytest.fixture(autouse=True)
def signals_as_before(monkeypatch):
    """Also nothing waits for the disk."""
    before = {number: signal.getsignal(number) for number in SIGNALS}
    monkeypatch.setattr(os, "fsync", lambda handle: None)
    gc.freeze()         # collecting what one trial leaves need not look at all the rest
    yield
    gc.unfreeze()
    for number, handler in before.items():
        signal.signal(number, handler)


def listen():
    """Hear signals as a command does that has just begun."""
    for number in SIGNALS:
        signal.signal(number, signal.SIG_DFL)
    stop_on_signals()


def ended_lines(work, check):
    """Interrupt ``work`` at its first traced line, then at its second, ...; how many it has."""
    for line in range(1, 2000):
        left = line

        def trace(frame, event, argument):
            nonlocal left
            if event == "line":
                left -= 1
                if left == 0:
                    signal.raise_signal(signal.SIGHUP)
            return trace

        listen()
        before = sys.gettrace()
        sys.settrace(lambda frame, event, argument: trace(frame, event, argument)
                     if frame.f_code.co_filename in TRACED else None)
        try:
            work()
        except KeyboardInterrupt:
            pass        # not contextlib.suppress, whose lines are traced
        finally:
            sys.settrace(before)
        gc.collect()    # interrupted between two steps of contextlib, a frame that goes tidies up
        if left > 0:
            return line
        check()
    raise AssertionError("the work does not end")


def save(results, value):
    with stage_folder(results, "photo") as folder:
        save_stage(folder, {"settings": {"v": value}}, {}, 1.0, {})


def test_a_signal_at_any_line_leaves_the_old_results_or_the_new_ones(tmp_path):
    seen = set()
    save(tmp_path, 1)

    def check():
        stored = load_stage(tmp_path, "photo")
        assert stored.damage is None
        seen.add(stored.key["settings"]["v"])
        save(tmp_path, 1)
        assert [path.name for path in tmp_path.iterdir()] == ["photo"]
    assert ended_lines(lambda: save(tmp_path, 2), check) > 60
    assert seen == {1, 2}


def test_a_file_is_the_old_one_or_the_new_one_at_whatever_line_a_signal_comes(tmp_path):
    seen = []

    def work():
        with whole_file(tmp_path / "a.csv") as unfinished:
            unfinished.write_text("new")

    def check():
        assert [path.name for path in tmp_path.iterdir() if path.name.startswith(UNFINISHED)] == []
        seen.append((tmp_path / "a.csv").read_text())
        (tmp_path / "a.csv").write_text("old")
    (tmp_path / "a.csv").write_text("old")
    assert ended_lines(work, check) > 30
    assert {*seen} == {"old", "new"}


def test_one_that_was_held_back_is_raised_at_the_end_though_something_else_failed():
    listen()
    with pytest.raises(KeyboardInterrupt) as ended, held():
        signal.raise_signal(signal.SIGINT)
        raise ValueError("the photo vanished")
    assert isinstance(ended.value.__context__, ValueError)
