"""What of a batch is done: one small file a session in the batch's folder, whole or not there.

A session counts as done while none of the files it was made from, or left, has changed in size or
time, and neither have the program and the cameras that the operator keeps under a name. Whatever is
in doubt is run again, which keeps the stages that are up to date.
"""
from __future__ import annotations

import dataclasses
import functools
import hashlib
import json
from dataclasses import dataclass, field
from pathlib import Path

from spectrabox.radiometry.files import sha256_of, write_text_whole
from spectrabox.radiometry.spectra.kept_cameras import own_cameras
from spectrabox.session.config.session_schema import FILE_NAME, SessionConfig
from spectrabox.session.run_outputs import STAGE
from spectrabox.session.stages.order import stages_of
from spectrabox.session.store.program import program_digest
from spectrabox.session.store.store import fingerprint, load_stage

SESSIONS = "sessions"       # in the batch's folder


@dataclass(frozen=True)
class Outcome:
    """What came of a session, as the manifest keeps it."""

    folder: str
    state: str                  # "done", "failed", or "ready": looked at
    name: str = ""
    verdict: str = ""           # "pass", "warn" or "fail" of a session that is done
    says: str = ""              # the verdict's sentence, or that of the failure
    exit_code: int = 0
    seconds: float = 0.0
    report: str | None = None
    stages: dict[str, tuple[str, float]] = field(default_factory=dict)   # state, seconds
    needed_bytes: int = 0
    peak_bytes: int | None = None       # that it took; None where the system does not say
    of: dict[str, tuple[int, int]] = field(default_factory=dict)    # files: size, time of change

    @property
    def word(self) -> str:
        """What the table calls it."""
        return self.verdict.upper() if self.state == "done" else "ERROR"


@functools.cache
def made_by() -> str:
    """Digest of all that a result depends on beside its session: program, packages, cameras kept
    under a name.
    """
    return fingerprint({"program": program_digest(),
                        "cameras": {name: sha256_of(path) for name, path in own_cameras().items()}})


def files_behind(config: SessionConfig) -> dict[str, tuple[int, int]]:
    """Every file that a finished session was made from, and those that it left, with size and time
    of change.

    Returns
    -------
    dict
        Names as seen from the session folder, to bytes and nanoseconds.
    """
    names = {FILE_NAME}
    for stage in (*stages_of(config.flat), STAGE):
        stored = load_stage(config.results_folder, stage)
        if stored is not None:
            names |= {*stored.key.get("files", {}), *stored.facts.get("outputs", {})}
    states = {name: _state(config.folder / name) for name in sorted(names)}
    return {name: state for name, state in states.items() if state is not None}


def store_outcome(out: Path, outcome: Outcome, made: str) -> None:
    """Keep what came of a session.

    Parameters
    ----------
    out : Path
        The batch's folder.
    outcome : Outcome
    made : str
        As ``made_by`` gave it when the batch began.
    """
    kept = dataclasses.asdict(outcome) | {"made by": made}
    write_text_whole(_path(out, outcome.folder), json.dumps(kept, indent=1))


def stored_outcome(out: Path, folder: Path, made: str) -> Outcome | None:
    """What a session's results say that are as they were left; None where there are none, or
    something has changed since.
    """
    try:
        kept = json.loads(_path(out, str(folder)).read_text(encoding="utf-8"))
        if kept.pop("made by") != made or kept["state"] != "done":
            return None
        outcome = Outcome(**kept)
        unchanged = all(_state(folder / name) == tuple(state)
                        for name, state in outcome.of.items())
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None
    return outcome if unchanged and outcome.of else None


def _path(out: Path, folder: str) -> Path:
    return out / SESSIONS / f"{hashlib.sha256(folder.encode()).hexdigest()[:24]}.json"


def _state(path: Path) -> tuple[int, int] | None:
    try:
        of = path.stat()
    except OSError:
        return None
    return of.st_size, of.st_mtime_ns
