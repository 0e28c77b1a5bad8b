"""Results of a stage that several sessions have in common: one computes them, the others copy.

A stage's key names all that its results depend on (``keys.py``): sessions whose keys agree would
compute the same bits. They lie in a folder named after the key, whose lock is held while they are
computed.
"""
from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from spectrabox.radiometry.files import require_no_link
from spectrabox.session.store.locks import held_lock
from spectrabox.session.store.store import (
    StoredStage,
    copy_stage,
    fingerprint,
    load_stage,
    stage_folder,
)

SHARED = ("chart", "calibrate")     # what photos of one day have in common


@contextlib.contextmanager
def shared_stage(shared: Path | None, stage: str,
                 key: dict[str, Any]) -> Iterator[StoredStage | None]:
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
    require_no_link(shared)
    with held_lock(shared / f".{shared_name(stage, key)}.lock"):
        stored = load_stage(shared, shared_name(stage, key))
        yield stored if stored is not None and not stored.fault and stored.key == key else None


def share_stage(shared: Path | None, stage: str, stored: StoredStage) -> None:
    """Keep a stage's results for other sessions."""
    if shared is not None and stage in SHARED:
        with stage_folder(shared, shared_name(stage, stored.key)) as folder:
            copy_stage(stored, folder)


def shared_name(stage: str, key: dict[str, Any]) -> str:
    """Folder of a stage's shared results."""
    return f"{stage}-{fingerprint(key)[:32]}"
