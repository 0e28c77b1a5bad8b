"""A copy of the working tree in which mistakes are planted and tests run, each run in a fork of a
process that has imported the heavy libraries and nothing of this project.
"""
from __future__ import annotations

import contextlib
import importlib
import os
import resource
import shutil
import signal
import sys
import time
import traceback
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.planted.chosen_tests import ROOT
from benchmarks.planted.mistake import Mistake

LIBRARIES = ("numpy", "scipy.optimize", "scipy.stats", "scipy.linalg", "scipy.interpolate", "cv2",
             "sklearn.mixture", "colour", "matplotlib.pyplot", "pydantic", "rawpy",
             "OpenImageIO", "typer", "rich", "pytest")
NOT_RUN = (4, 5)        # exit codes of pytest: used wrongly, no tests found
LEFT_BEHIND = shutil.ignore_patterns(".git", ".venv", "build", ".mypy_cache", ".ruff_cache",
                                     ".pytest_cache", "demo-session*")
NO_MORE_S = 600.0       # of the clock, for tests that wait for ever


@dataclass(frozen=True)
class TestRun:
    """How a run of tests ended."""

    status: int             # of pytest; 0: all passed
    processor_s: float
    said: str               # the first failure, or the end of the output


def copied_tree(folder: Path) -> Path:
    """The working tree copied to a folder; a copy that is there is replaced."""
    shutil.rmtree(folder, ignore_errors=True)
    return Path(shutil.copytree(ROOT, folder, symlinks=True, ignore=LEFT_BEHIND))


@contextlib.contextmanager
def planted(tree: Path, mistake: Mistake) -> Iterator[None]:
    """The tree with a mistake in it, and as it was afterwards.

    Raises
    ------
    ValueError
        If the old text does not stand in the file exactly once.
    """
    path = tree / mistake.file
    text = path.read_text(encoding="utf-8")
    if (count := text.count(mistake.old)) != 1:
        raise ValueError(f"{mistake.file} holds {count} times what {mistake.what!r} replaces: "
                         f"{mistake.old!r}; write the mistake anew")
    try:
        _write(path, text.replace(mistake.old, mistake.new))
        yield
    finally:
        _write(path, text)


def _write(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8")
    for compiled in (path.parent / "__pycache__").glob(f"{path.stem}.*.py[co]"):
        compiled.unlink()


def import_libraries() -> None:
    """Import what every run of tests would import again."""
    for name in LIBRARIES:
        importlib.import_module(name)


def run_tests(tree: Path, tests: Sequence[str], limit_s: float, log: Path,
              first_only: bool = True) -> TestRun:
    """Run tests of a tree until the first failure, or all of them.

    Parameters
    ----------
    tree : Path
    tests : sequence of str
        Paths from the tree's root, names of tests, options of pytest.
    limit_s : float
        Of processor time, beyond which the run counts as one that does not end.
    log : Path
        What pytest says.
    """
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    child = os.fork()
    if not child:
        _in_the_child(tree, ["-x", *tests] if first_only else tests, limit_s, log)
    deadline = time.monotonic() + max(NO_MORE_S, 10 * limit_s)
    while not (ended := os.waitpid(child, os.WNOHANG))[0]:
        if time.monotonic() > deadline:
            os.kill(child, signal.SIGKILL)
        time.sleep(0.1)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    status = os.waitstatus_to_exitcode(ended[1])
    if status in NOT_RUN:
        raise RuntimeError(f"the tests did not run: {_first_failure(log)} (see {log})")
    return TestRun(status, round(spent, 1), _first_failure(log) if status >= 0
                   else f"ended by {signal.Signals(-status).name}")


def _in_the_child(tree: Path, tests: Sequence[str], limit_s: float, log: Path) -> None:
    status = 70
    try:
        whole = round(limit_s) + 1
        resource.setrlimit(resource.RLIMIT_CPU, (whole, whole))
        with log.open("wb") as stream:
            os.dup2(stream.fileno(), 1)
            os.dup2(stream.fileno(), 2)
        os.chdir(tree)
        os.environ["PYTHONPATH"] = str(tree)
        sys.dont_write_bytecode = True
        sys.path[:] = [str(tree), *(path for path in sys.path if path not in ("", str(ROOT)))]
        for name in [name for name in sys.modules if name.partition(".")[0] == "benchmarks"]:
            del sys.modules[name]
        import pytest
        status = int(pytest.main(["-q", "--no-header", "--tb=line", "--durations=10",
                                  "-p", "no:cacheprovider", *tests]))
    except BaseException:
        traceback.print_exc()
        raise
    finally:        # whatever happens, nothing of the parent's goes on here
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)


def _first_failure(log: Path) -> str:
    lines = log.read_text(encoding="utf-8", errors="replace").splitlines()
    return next((line for line in lines if line.startswith(("FAILED", "ERROR"))),
                lines[-1] if lines else "")[:200]
