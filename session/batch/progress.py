"""How far a batch has come: a bar on a terminal, a line a session elsewhere."""
from __future__ import annotations

import time

from spectrabox.session.batch.manifest import Outcome
from spectrabox.session.command_line import tell
from spectrabox.session.progress_display import StageProgress


class BatchProgress:
    """Counts outcomes, and says how long the rest will take at the pace so far.

    Parameters
    ----------
    show : StageProgress
    sessions, kept : int
        All of them, and those that were done before.
    lines : bool
        A line for each session too.
    """

    def __init__(self, show: StageProgress, sessions: int, kept: int, lines: bool) -> None:
        self._show, self._lines = show, lines
        self._sessions, self._kept = sessions, kept
        self._ended = self._failed = 0
        self._start = time.monotonic()
        show("batch", kept / sessions, f"{kept} of {sessions} were done before" if kept
             else f"{sessions} sessions")

    def heard(self, outcome: Outcome) -> None:
        """Take in one more outcome."""
        self._ended += 1
        self._failed += outcome.state == "failed"
        ended = self._kept + self._ended
        left = self._sessions - ended
        pace = (time.monotonic() - self._start) / self._ended
        said = f"{ended} of {self._sessions}, {self._failed} failed"
        if left:
            said += f", {spoken(pace * left)} left"
        if self._lines:
            tell(f"{outcome.word:<6} {outcome.folder} in {outcome.seconds:.1f} s; {said}")
        self._show("batch", ended / self._sessions, said)


def spoken(seconds: float) -> str:
    """A time in its largest fitting unit."""
    if seconds < 120:
        return f"{seconds:.0f} s"
    if seconds < 7200:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.1f} h"
