"""A signal at any line of the code that makes, fills and replaces results leaves nothing behind."""
import contextlib
import gc
import importlib
import os
import shutil
import signal
import sys
import time
from pathlib import Path

import pytest

from spectrabox.radiometry.files import UNFINISHED, whole_file
from spectrabox.radiometry.outside import interruption
from spectrabox.radiometry.outside.interruption import SIGNALS, Interruptions
from spectrabox.session.command_line import stop_on_signals
from spectrabox.session.store import store
from spectrabox.session.store.store import load_stage, save_stage, stage_folder

TRACED = tuple(str(Path(module.__file__)) for module in (store, interruption, contextlib, shutil,
                                                         sys.modules[whole_file.__module__]))


@pytest.fixture(autouse=True)
def signals_interrupt(monkeypatch):
    """As in the command; and nothing waits for the disk."""
    before = {number: signal.getsignal(number) for number in SIGNALS}
    monkeypatch.setattr(os, "fsync", lambda handle: None)
    stop_on_signals()
    gc.freeze()         # collecting what one trial leaves need not look at all the rest
    yield
    gc.unfreeze()
    for number, handler in before.items():
        signal.signal(number, handler)


class Line(Exception):
    """The work has no line of that number."""


def interrupted_at(line, work, number=signal.SIGHUP):
    """Do ``work`` and raise a signal at its n-th traced line; how it ended.

    Raises
    ------
    Line
        If the work ends before.
    """
    left = line

    def trace(frame, event, argument):
        nonlocal left
        if event == "line":
            left -= 1
            if left == 0:
                signal.raise_signal(number)
        return trace

    before, handlers = sys.gettrace(), {each: signal.getsignal(each) for each in SIGNALS}
    sys.settrace(lambda frame, event, argument: trace(frame, event, argument)
                 if frame.f_code.co_filename in TRACED else None)
    try:
        work()
        ended = None
    except KeyboardInterrupt as error:
        ended = type(error)
    finally:
        sys.settrace(before)
    gc.collect()        # interrupted between two steps of contextlib, a frame that goes tidies up
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(number)         # whatever happened, the next is heard again
    for each, handler in handlers.items():  # an interrupt on the way in or out leaves one that
        signal.signal(each, handler)        # passes on what it hears; the command ends then
    if left > 0:
        raise Line
    return ended


def every_line(work, check):
    """How many lines a signal was raised at, one in each trial; ``check`` gets how it ended."""
    for line in range(1, 2000):
        try:
            check(interrupted_at(line, work))
        except Line:
            return line
    raise AssertionError("the work does not end")


def hidden(folder):
    return [path.name for path in folder.iterdir() if path.name.startswith(".")]


def save(results, value, then=None):
    with stage_folder(results, "photo") as folder:
        save_stage(folder, {"settings": {"v": value}}, {}, 1.0, {})
        if then is not None:
            raise then


def test_a_signal_at_any_line_leaves_the_old_results_or_the_new_ones(tmp_path):
    seen = set()
    save(tmp_path, 1)

    def check(ended):
        stored = load_stage(tmp_path, "photo")
        value = stored.key["settings"]["v"]
        seen.add((ended is not None, value))
        assert hidden(tmp_path) == [] and stored.damage is None
        assert ended is not None    # it is raised, if only when the results are in place
        save(tmp_path, 1)
    assert every_line(lambda: save(tmp_path, 2), check) > 60
    assert seen == {(True, 1), (True, 2)}


@pytest.mark.parametrize("first", [KeyboardInterrupt, ValueError])
def test_a_second_signal_breaks_off_no_tidying_up(tmp_path, first):
    def work():
        with contextlib.suppress(ValueError), stage_folder(tmp_path, "photo") as folder:
            (folder / "a").write_text("half")
            if first is ValueError:
                raise first
            signal.raise_signal(signal.SIGTERM)

    def check(ended):
        assert list(tmp_path.iterdir()) == []
        assert ended is not None
    assert every_line(work, check) > 40


def test_a_file_is_the_old_one_or_the_new_one_at_whatever_line_a_signal_comes(tmp_path):
    seen = set()

    def work():
        with whole_file(tmp_path / "a.csv") as unfinished:
            unfinished.write_text("new")

    def check(ended):
        assert ended is not None
        assert [name for name in hidden(tmp_path) if name.startswith(UNFINISHED)] == []
        seen.add((tmp_path / "a.csv").read_text())
        (tmp_path / "a.csv").write_text("old")
    (tmp_path / "a.csv").write_text("old")
    assert every_line(work, check) > 40
    assert seen == {"old", "new"}


def test_a_signal_inside_one_that_waits_waits_too():
    seen = []
    with pytest.raises(KeyboardInterrupt):
        with Interruptions(held=True):
            with Interruptions(held=True):
                signal.raise_signal(signal.SIGINT)
                seen.append("inner")
            seen.append("outer")
        seen.append("never")
    assert seen == ["inner", "outer"]


@pytest.fixture
def amid_an_import():
    """A frame of Python's own steps of an import."""
    class Finder:
        def find_spec(self, name, path=None, target=None):
            frames.append(sys._getframe().f_back)

    frames, finder = [], Finder()
    sys.meta_path.insert(0, finder)
    try:
        with pytest.raises(ModuleNotFoundError):
            importlib.import_module("a_module_that_nobody_has")
    finally:
        sys.meta_path.remove(finder)
    return frames[0]


@pytest.mark.parametrize("number", SIGNALS)
@pytest.mark.parametrize("held", [contextlib.nullcontext, Interruptions])
def test_a_signal_amid_an_import_interrupts_soon_after_it(amid_an_import, number, held):
    """Raised at once, it could leave a lock taken for which a thread that imports waits."""
    went_on = False
    with pytest.raises(KeyboardInterrupt), held():
        signal.getsignal(number)(number, amid_an_import)
        went_on = True
        time.sleep(60)          # ends with the signal
    assert went_on


def test_an_interrupt_that_a_library_swallowed_can_be_repeated(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    heard = 0
    with contextlib.suppress(KeyboardInterrupt), \
            Interruptions(held=True, again_after_s=5) as interruptions, interruptions.released():
        for now[0] in (0, 1, 4.9, 5.1):
            try:
                signal.raise_signal(signal.SIGINT)
            except KeyboardInterrupt:
                heard += 1
    assert heard == 2


def test_one_that_nobody_repeated_is_raised_at_the_end_though_something_else_failed():
    with pytest.raises(KeyboardInterrupt) as ended, Interruptions(held=True):
        signal.raise_signal(signal.SIGINT)
        raise ValueError("the photo vanished")
    assert isinstance(ended.value.__context__, ValueError)
