"""Runs of a session that are killed at a change of a file, and two runs at once."""
from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

from spectrabox.radiometry.files import sha256_of

ROOT = Path(__file__).resolve().parent.parent
COMMAND = "from spectrabox.session.cli import main\nmain()"
KILLED = """import sys
from tests.killed_runs import kill_at
kill_at(int(sys.argv.pop(1)), sys.argv.pop(1))
"""


def kill_at(number: int, event: str) -> None:
    """Let this process die just before its n-th rename, or its n-th change of a file among results.

    Nothing in the product helps here: Python itself tells of every change before it is done.

    Parameters
    ----------
    number : int
        n, from 1.
    event : {"rename", "change"}
        A change is a rename, a file opened for writing or removed, a folder made or removed.
    """
    left = number

    def watch(name: str, arguments: tuple[Any, ...]) -> None:
        nonlocal left
        if name == "os.rename" or (event == "change" and _is_change(name, arguments)):
            left -= 1
            if left == 0:
                os.kill(os.getpid(), signal.SIGKILL)
    sys.addaudithook(watch)


def _is_change(name: str, arguments: tuple[Any, ...]) -> bool:
    if not arguments or "results" not in str(arguments[0]):
        return False
    return name in ("os.mkdir", "os.remove", "os.rmdir") or (
        name == "open" and isinstance(arguments[2], int)
        and bool(arguments[2] & (os.O_WRONLY | os.O_RDWR)))


def killed_at(number: int, *command: str, code: str = COMMAND) -> subprocess.CompletedProcess[str]:
    """A command of ours, or other code, that dies just before its n-th rename; ends well if it has
    fewer.

    Parameters
    ----------
    number : int
        n, from 1.
    command : str
        Words after ``spectrabox``.
    code : str
        In Python.
    """
    return subprocess.run([sys.executable, "-c", KILLED + code, str(number), "rename", *command],
                          text=True, capture_output=True, check=False, env=_environment())


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
             *(folder / "spdx").glob("*"), *folder.glob("spectra.csv"),
             *folder.glob("materials.xml"), *folder.glob("comparison.*")]
    return {path.relative_to(folder).as_posix(): sha256_of(path) for path in files}


def leftovers(folder: Path) -> list[str]:
    """Names of what a killed run left and no run swept away; locks stay."""
    return [path.name for path in folder.rglob(".*") if path.suffix != ".lock"]


def _environment() -> dict[str, str]:
    return os.environ | {"PYTHONPATH": str(ROOT)}
