"""Results of a stage that several sessions have in common, made by one of them and copied by the
others.

A stage's key names all that its results are made from (``store.py``): sessions whose keys agree
would make the same bits. They lie in a folder named after the key, of which whoever makes them
holds the lock.
"""
from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from spectrabox.radiometry.files import require_no_link, writable
from spectrabox.session.store.store import (
    StoredStage,
    copy_stage,
    fingerprint,
    load_stage,
    stage_folder,
)

SHARED = ("chart", "calibrate")     # what photos of one day have in common


@contextlib.contextmanager
def made_once(shared: Path | None, stage: str, key: dict[str, Any]) -> Iterator[StoredStage | None]:
    """Results of a stage that another session has made, whole and of this very key; None where
    there are none. While the block makes them, others that want them wait.

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
    with _held(shared, shared_name(stage, key)):
        stored = load_stage(shared, shared_name(stage, key))
        yield stored if stored is not None and not stored.damage and stored.key == key else None


def share(shared: Path | None, stage: str, made: StoredStage) -> None:
    """Keep a stage's results for other sessions."""
    if shared is not None and stage in SHARED:
        with stage_folder(shared, shared_name(stage, made.key)) as folder:
            copy_stage(made, folder)


def shared_name(stage: str, key: dict[str, Any]) -> str:
    """Folder of a stage's shared results."""
    return f"{stage}-{fingerprint(key)[:32]}"


@contextlib.contextmanager
def _held(shared: Path, name: str) -> Iterator[None]:
    """Be the only process that makes this; where a file system has no locks, several may."""
    try:
        import fcntl
    except ImportError:     # Windows
        yield
        return
    require_no_link(shared)
    with writable(shared):
        handle = os.open(shared / f".{name}.lock",
                         os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o666)
    try:
        with contextlib.suppress(OSError):
            fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)
