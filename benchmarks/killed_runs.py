"""Runs of a session that are killed at a rename, and two runs at once: the trials of
bench_killed_runs.py and of its small form among the tests.
"""
from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

from spectrabox.radiometry.files import sha256_of

ROOT = Path(__file__).resolve().parent.parent
# Nothing in the product helps here: Python itself tells of every rename before it is done.
KILLED = """
import os, signal, sys
left = int(sys.argv.pop(1))

def watch(event, arguments):
    global left
    if event == "os.rename":
        left -= 1
        if left == 0:
            os.kill(os.getpid(), signal.SIGKILL)

sys.addaudithook(watch)
"""
COMMAND = "from spectrabox.session.cli import main\nmain()"


def killed_at(rename: int, *command: str, code: str = COMMAND) -> subprocess.CompletedProcess[str]:
    """A command of ours, or other code, that dies just before its n-th rename; ends well if it has
    fewer.

    Parameters
    ----------
    rename : int
        n, from 1.
    command : str
        Words after ``spectrabox``.
    code : str
        In Python.
    """
    return subprocess.run([sys.executable, "-c", KILLED + code, str(rename), *command], text=True,
                          capture_output=True, check=False, env=_environment())


def started(*command: str) -> subprocess.Popen[str]:
    """A command of ours that runs beside others.

    Parameters
    ----------
    command : str
        Words after ``spectrabox``.
    """
    return subprocess.Popen([sys.executable, "-m", "spectrabox", *command], text=True,
                            stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=_environment())


def was_killed(run: subprocess.CompletedProcess[str]) -> bool:
    """Whether the kill came before the end."""
    return run.returncode == -signal.SIGKILL


def results_of(folder: Path) -> dict[str, str]:
    """Digests of all numbers that a session ended with: arrays of its stages, spectra, materials
    and pictures. Facts and report hold times and dates.
    """
    files = [*(folder / "results").glob("*/*.npz"), *(folder / "results").glob("*/*.png"),
             *(folder / "spdx").iterdir(),
             *(folder / name for name in ("spectra.csv", "materials.xml", "comparison.exr",
                                          "comparison.png"))]
    return {path.relative_to(folder).as_posix(): sha256_of(path) for path in files}


def leftovers(folder: Path) -> list[str]:
    """Names of what a killed run left and no run swept away; locks stay."""
    return [path.name for path in folder.rglob(".*") if path.suffix != ".lock"]


def _environment() -> dict[str, str]:
    return os.environ | {"PYTHONPATH": str(ROOT)}
