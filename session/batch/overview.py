"""A batch's outcomes in small files, and as people and scripts see them: progress, JSON object,
table, page of verdicts.

Outcomes of a batch's sessions: one small file a session in the batch's folder.

A session is up to date while none of its input and output files has changed in size or time, and
neither have the program and the cameras that the operator keeps under a name. In doubt it is run
again, which keeps the stages that are up to date.
"""
from __future__ import annotations

import dataclasses
import functools
import hashlib
import json
import os
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import quote

from markupsafe import Markup

from spectrabox.measure.tables import text_table
from spectrabox.radiometry.files import sha256_of, whole_file, write_text_whole
from spectrabox.radiometry.spectra.cameras import own_cameras
from spectrabox.session.config.session_file import FILE_NAME, SessionConfig
from spectrabox.session.kept_stages import stage_names
from spectrabox.session.outputs.run_outputs import STAGE
from spectrabox.session.report.page import TEMPLATES, style_sheet, templates
from spectrabox.session.store import keys, record_files
from spectrabox.session.terminal import command_line, progress_display

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
    return record_files.fingerprint({"program": keys.program_digest(),
                        "cameras": {name: sha256_of(path) for name, path in own_cameras().items()}})


def input_states(config: SessionConfig) -> dict[str, tuple[int, int]]:
    """Size and time of change of every input and output file of a finished session.

    Returns
    -------
    dict
        Names as seen from the session folder, to bytes and nanoseconds.
    """
    names = {FILE_NAME, *keys.input_files(config, config.capture())}
    for stage in (*stage_names(config), STAGE):
        stored = record_files.load_stage(config.results_folder, stage)
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


# ---- a batch as people and scripts see it --------------------------------------------------------

MAX_SENTENCE = 60       # of its characters in the table; the page has all
FILE = "batch.html"
# the status whose colours a row of the page has
BADNESS = {"ERROR": 0, "FAIL": 1, "WARN": 2, "PASS": 3, "": 4}     # the worst come first
ROW_STATUS = {"pass": "PASS", "warn": "WARN", "fail": "FAIL", "": "FAIL"}


class BatchProgress:
    """A bar on a terminal, or a line for each session, with the time left at the pace so far.

    Parameters
    ----------
    show : StageProgress
    sessions, kept : int
        All of them, and those that were up to date before.
    lines : bool
        Print a line for each session too.
    """

    def __init__(self, show: progress_display.StageProgress, sessions: int, kept: int,
                 lines: bool) -> None:
        self._show, self._lines = show, lines
        self._sessions, self._kept = sessions, kept
        self._ended = self._failed = 0
        self._start = time.monotonic()
        show("batch", kept / sessions, f"{kept} of {sessions} were done before" if kept
             else f"{sessions} sessions")

    def add(self, outcome: Outcome) -> None:
        """Count one more outcome."""
        self._ended += 1
        self._failed += outcome.state == "failed"
        ended = self._kept + self._ended
        left = self._sessions - ended
        pace = (time.monotonic() - self._start) / self._ended
        count = f"{ended} of {self._sessions}, {self._failed} failed"
        if left:
            count += f", {duration_text(pace * left)} left"
        if self._lines:
            command_line.tell(
                f"{outcome.word:<6} {outcome.folder} in {outcome.seconds:.1f} s; {count}")
        self._show("batch", ended / self._sessions, count)


def duration_text(seconds: float) -> str:
    """A time in its largest fitting unit."""
    if seconds < 120:
        return f"{seconds:.0f} s"
    if seconds < 7200:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.1f} h"


def batch_facts(outcomes: Sequence[Outcome], kept: int, page: Path, workers: int) -> dict[str, Any]:
    """The ``--json`` object of ``batch``.

    Parameters
    ----------
    outcomes : sequence of Outcome
        In the order in which the sessions were named.
    kept : int
        Number that was up to date before.
    page : Path
    workers : int
    """
    return {"page": str(page), "workers": workers, "kept": kept, "counts": counts(outcomes),
            "sessions": [{"folder": each.folder, "name": each.name, "state": each.state,
                          "verdict": each.verdict or None, "says": each.says,
                          "exit_code": each.exit_code, "seconds": each.seconds,
                          "failed_extras": list(each.failed_extras),
                          "report": each.report, "needed_bytes": each.needed_bytes,
                          "peak_bytes": each.peak_bytes,
                          "stages": [{"name": name, "state": state, "seconds": seconds}
                                     for name, (state, seconds) in each.stages.items()]}
                         for each in outcomes]}


def counts(outcomes: Sequence[Outcome]) -> dict[str, int]:
    """How many passed, are in doubt, failed their verdict, or could not be run."""
    return {name: sum((each.verdict or "could not be run") == name for each in outcomes)
            for name in ("pass", "warn", "fail", "could not be run")}


def batch_text(outcomes: Sequence[Outcome], kept: int, page: Path) -> str:
    """A table with a row for each session, and how many of each verdict."""
    rows = []
    for each in outcomes:
        sentence = each.says.splitlines()[0] if each.says else ""
        if len(sentence) > MAX_SENTENCE:
            sentence = f"{sentence[:MAX_SENTENCE - 1].rstrip()}…"
        rows.append((os.path.relpath(each.folder), each.word, f"{each.seconds:.1f}", sentence))
    table = text_table(("session", "verdict", "s", "says"), rows,
                       text=("session", "verdict", "says"))
    notes = "".join(f"\nnote: {os.path.relpath(each.folder)}: {why}" for each in outcomes
                    for why in each.failed_extras)
    verdicts = ", ".join(f"{count} {name}" for name, count in counts(outcomes).items() if count)
    before = f"; {kept} were done before" if kept else ""
    return (f"{table}{notes}\n{len(outcomes)} sessions: {verdicts}{before}\n"
            f"page: {page}")


def write_page(out: Path, outcomes: Sequence[Outcome], sessions: int) -> Path:
    """Write ``batch.html`` into the batch's folder, whole or not at all.

    Parameters
    ----------
    out : Path
        The batch's folder.
    outcomes : sequence of Outcome
        In the order in which the sessions were named.
    sessions : int
        All that were named; those without an outcome have not been run yet.
    """
    page = out / FILE
    rows = [{"name": each.name, "folder": os.path.relpath(each.folder, out),
             "link": None if each.report is None else link(Path(each.report), out),
             "status": ROW_STATUS[each.verdict], "word": each.word, "seconds": each.seconds,
             "says": [*each.says.splitlines(), *each.failed_extras], "camera": each.camera,
             "taken_at": each.taken_at, "thumbnail": each.thumbnail, "badness": BADNESS[each.word]}
            for each in sorted(outcomes, key=lambda each: BADNESS[each.word])]
    text = templates().get_template("batch.html.j2").render(
        rows=rows, sessions=sessions, counts=counts(outcomes), style=style_sheet(),
        script=Markup((TEMPLATES / "batch.js").read_text(encoding="utf-8")))
    with whole_file(page) as unfinished:
        unfinished.write_bytes(text.encode("utf-8", "backslashreplace"))
    return page


def link(file: Path, folder: Path) -> str:
    """The relative link from a page in a folder to a file, whatever its name."""
    return "./" + quote(os.fsencode(Path(os.path.relpath(file, folder)).as_posix()))
