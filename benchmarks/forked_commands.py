"""Commands in processes of their own, forked from one that has loaded the libraries: what a command
does, without the second that Python takes to import them.
"""
from __future__ import annotations

import importlib
import os
import pkgutil
import sys
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import spectrabox
from spectrabox.session.cli import main

# Those that start threads are left to the commands: a fork would lose them.
THREADED = ("reconstruct.rendering.llvm",)


@dataclass(frozen=True)
class Forked:
    """A command at work, and the file that takes what it says."""

    process: int
    said: Path

    def wait(self) -> int:
        """Exit code, or minus the signal that ended it."""
        return os.waitstatus_to_exitcode(os.waitpid(self.process, 0)[1])


def load_libraries() -> None:
    """Import every module of the package, once."""
    for module in pkgutil.walk_packages(spectrabox.__path__, "spectrabox."):
        if not module.name.endswith(("__main__", *THREADED)):
            importlib.import_module(module.name)
    for name in ("cv2", "rawpy", "OpenImageIO", "colour", "scipy.stats", "sklearn.mixture"):
        importlib.import_module(name)


def forked(command: tuple[str, ...], said: Path,
           first: Callable[[], None] = lambda: None) -> Forked:
    """Start ``spectrabox`` with these words; ``first`` is called in its process before it.

    Parameters
    ----------
    command : tuple of str
    said : Path
        Takes standard output and standard error.
    """
    def command_of() -> None:
        to = os.open(said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        for stream in (1, 2):
            os.dup2(to, stream)
        sys.argv = ["spectrabox", *command]
        first()
        main()
    return Forked(_fork(command_of), said)


def in_a_child(work: Callable[[], object]) -> None:
    """Do some work in a process of its own.

    Raises
    ------
    RuntimeError
        If it fails.
    """
    if Forked(_fork(work), Path(os.devnull)).wait():
        raise RuntimeError("the work in a child process failed; what it said stands above")


def _fork(work: Callable[[], object]) -> int:
    sys.stdout.flush()
    sys.stderr.flush()
    if process := os.fork():
        return process
    code = 1
    try:
        work()
        code = 0
    except SystemExit as leave:
        code = leave.code if isinstance(leave.code, int) else int(leave.code is not None)
    except BaseException:  # noqa: BLE001  this process ends here, whatever happened
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
