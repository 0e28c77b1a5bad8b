"""Locks by which one process at a time writes to a folder, and results that several sessions have
in common.

Results of a stage that several sessions have in common: one computes them, the others copy.

A stage's key names all that its results depend on (``keys.py``): sessions whose keys agree would
compute the same bits. They lie in a folder named after the key, whose lock is held while they are
computed.
"""


from __future__ import annotations

import contextlib
import datetime
import json
import os
import platform
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from spectrabox.measure.steps.declared_steps import FLAT_STEPS, SCENE_STEPS
from spectrabox.radiometry import errors, files
from spectrabox.session.store import record_files

try:
    import fcntl
except ImportError:     # Windows
    fcntl = None        # type: ignore[assignment]

RUN, OUTPUTS = ".run.lock", ".outputs.lock"     # among the results
BATCH = ".batch.lock"     # in its output folder


@contextlib.contextmanager
def only_writer(folder: Path, command: str) -> Iterator[None]:
    """Be the only run of a session, and begin with what a killed one left swept away.

    Parameters
    ----------
    folder : Path
        The session.
    command : str
        Of this process, for those that find the session taken.

    Raises
    ------
    EnvironmentProblem
        If another process works in this session, saying which; if its folder cannot be written or
        its results are a link.
    """
    results = folder / "results"
    for name in ("results", "spdx"):
        files.require_no_link(folder / name)
    with held_lock(results / RUN, wait=False, command=command):
        for stage in {step.name for step in (*FLAT_STEPS, *SCENE_STEPS)}:
            record_files.sweep_stage(results, stage)
        for inside in (folder, folder / "spdx", results):
            files.sweep_unfinished(inside)
        yield


@contextlib.contextmanager
def outputs_writer(folder: Path) -> Iterator[None]:
    """Be the only one that writes report and spectra, after any other."""
    for name in ("results", "spdx"):
        files.require_no_link(folder / name)
    with held_lock(folder / "results" / OUTPUTS):
        yield


@contextlib.contextmanager
def sole_user(out: Path) -> Iterator[None]:
    """Be the only batch that uses an output folder, which is made.

    Parameters
    ----------
    out : Path

    Raises
    ------
    EnvironmentProblem
        If another process does, saying which; if the folder cannot be written.
    """
    files.require_no_link(out)
    with held_lock(out / BATCH, wait=False, command="spectrabox batch",
                   where="uses this output folder"):
        for inside in (out, *(each for each in out.iterdir() if each.is_dir())):
            files.sweep_unfinished(inside)
        yield


@contextlib.contextmanager
def held_lock(file: Path, *, wait: bool = True, command: str = "",
              where: str = "works in this session") -> Iterator[None]:
    """Hold the lock of a file, which is made; where the system or the file system has no locks,
    several processes may.

    Parameters
    ----------
    file : Path
    wait : bool
        For another process to free it.
    command : str
        Of this process, for those that find it taken.
    where : str
        What the owner does, for the sentence of the error.

    Raises
    ------
    EnvironmentProblem
        If another process holds it and ``wait`` is false, or the folder cannot be written.
    """
    if fcntl is None:       # Windows: there a file that is open cannot be replaced in any case
        yield
        return
    with files.writable(file.parent):
        handle = os.open(file, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o666)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        except BlockingIOError:
            raise errors.EnvironmentProblem(
                f"{_owner(handle)} {where}; wait for it, or stop it: two "
                "would write over each other") from None
        except OSError:         # a file system without locks: better a run than none
            pass
        else:
            os.truncate(handle, 0)
            os.write(handle, json.dumps({
                "command": command, "process": os.getpid(), "machine": platform.node(),
                "since": datetime.datetime.now().astimezone().isoformat(" ", "seconds")}).encode())
        yield
    finally:
        os.close(handle)        # which frees it, as the end of the process does


def _owner(handle: int) -> str:
    try:
        owner = json.loads(os.pread(handle, 4096, 0))
        return (f"'{owner['command']}' (process {owner['process']} on {owner['machine']}, since "
                f"{owner['since']})")
    except (ValueError, KeyError, TypeError):
        return "another process"


# ---- results of a stage that several sessions have in common -------------------------------------

SHARED = ("chart", "calibrate")     # what photos of one day have in common


@contextlib.contextmanager
def shared_stage(shared: Path | None, stage: str,
                 key: dict[str, Any]) -> Iterator[record_files.StoredStage | None]:
    """Results of a stage that another session has stored, whole and of this very key; None where
    there are none. While the block computes them, others that need them wait.

    Parameters
    ----------
    shared : Path or None
        Folder of what is shared; None where nothing is.
    stage : str
    key : dict
        As JSON gives it back.
    """
    if shared is None or stage not in SHARED:
        yield None
        return
    files.require_no_link(shared)
    with held_lock(shared / f".{shared_name(stage, key)}.lock"):
        stored = record_files.load_stage(shared, shared_name(stage, key))
        yield stored if stored is not None and not stored.fault and stored.key == key else None


def share_stage(shared: Path | None, stage: str, stored: record_files.StoredStage) -> None:
    """Keep a stage's results for other sessions."""
    if shared is not None and stage in SHARED:
        with record_files.stage_folder(shared, shared_name(stage, stored.key)) as folder:
            record_files.copy_stage(stored, folder)


def shared_name(stage: str, key: dict[str, Any]) -> str:
    """Folder of a stage's shared results."""
    return f"{stage}-{record_files.fingerprint(key)[:32]}"
