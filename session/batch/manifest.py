"""Outcomes of a batch's sessions: one small file a session in the batch's folder.

A session is up to date while none of its input and output files has changed in size or time, and
neither have the program and the cameras that the operator keeps under a name. In doubt it is run
again, which keeps the stages that are up to date.
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
from spectrabox.session.config.session_file import FILE_NAME, SessionConfig
from spectrabox.session.kept_stages import stage_names
from spectrabox.session.outputs.run_outputs import STAGE
from spectrabox.session.store.input_roles import input_files
from spectrabox.session.store.program import program_digest
from spectrabox.session.store.store import fingerprint, load_stage

SESSIONS = "sessions"       # in the batch's folder


@dataclass(frozen=True)
class Outcome:
    """The outcome of a session, as its file in the batch's folder holds it."""

    folder: str
    state: str                  # "done", "failed", or "ready": checked
    name: str = ""
    verdict: str = ""           # "pass", "warn" or "fail" of a session that is done
    says: str = ""              # the verdict's sentence, or that of the failure
    exit_code: int = 0
    seconds: float = 0.0
    report: str | None = None
    stages: dict[str, tuple[str, float]] = field(default_factory=dict)   # state, seconds
    needed_bytes: int = 0
    peak_bytes: int | None = None       # that it took; None where the system does not say
    files: dict[str, tuple[int, int]] = field(default_factory=dict)     # size, time of change
    camera: str = ""
    taken_at: str = ""                  # of the first photo, by the camera's clock
    thumbnail: str = ""                 # of the first photo, as a data URI
    failed_extras: tuple[str, ...] = ()     # what could not be made beside its answer, and why

    @property
    def word(self) -> str:
        """Its word in the table."""
        return self.verdict.upper() if self.state == "done" else "ERROR"


@functools.cache
def program_of_batch() -> str:
    """Digest of what results depend on besides their session: the program, packages, and cameras
    kept under a name.
    """
    return fingerprint({"program": program_digest(),
                        "cameras": {name: sha256_of(path) for name, path in own_cameras().items()}})


def input_states(config: SessionConfig) -> dict[str, tuple[int, int]]:
    """Size and time of change of every input and output file of a finished session.

    Returns
    -------
    dict
        Names as seen from the session folder, to bytes and nanoseconds.
    """
    names = {FILE_NAME, *input_files(config, config.capture())}
    for stage in (*stage_names(config), STAGE):
        stored = load_stage(config.results_folder, stage)
        if stored is not None:
            names |= {*stored.key.get("files", {}), *stored.facts.get("outputs", {})}
    states = {name: _state(config.folder / name) for name in sorted(names)}
    return {name: state for name, state in states.items() if state is not None}


def store_outcome(out: Path, outcome: Outcome, program: str) -> None:
    """Store the outcome of a session.

    Parameters
    ----------
    out : Path
        The batch's folder.
    outcome : Outcome
    program : str
        Of ``program_of_batch``, when the batch began.
    """
    record = dataclasses.asdict(outcome) | {"program": program}
    write_text_whole(_path(out, outcome.folder), json.dumps(record, indent=1))


def stored_outcome(out: Path, folder: Path, program: str) -> Outcome | None:
    """Stored outcome of a session, or None if anything has changed since, or an extra failed."""
    try:
        record = json.loads(_path(out, str(folder)).read_text(encoding="utf-8"))
        if record.pop("program") != program or record["state"] != "done":
            return None
        outcome = Outcome(**record)
        if outcome.failed_extras:
            return None
        unchanged = all(_state(folder / name) == tuple(state)
                        for name, state in outcome.files.items())
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None
    return outcome if unchanged and outcome.files else None


def _path(out: Path, folder: str) -> Path:
    return out / SESSIONS / f"{hashlib.sha256(folder.encode()).hexdigest()[:24]}.json"


def _state(path: Path) -> tuple[int, int] | None:
    try:
        stat = path.stat()
    except OSError:
        return None
    return stat.st_size, stat.st_mtime_ns
