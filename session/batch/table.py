"""The outcomes of a batch for a script and for a person."""
from __future__ import annotations

import io
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from spectrabox.session.batch.manifest import Outcome

WIDTH = 110             # of the table, in characters
MAX_SAID = 60           # of a sentence in it; the page has all


def batch_facts(outcomes: Sequence[Outcome], kept: int, page: Path, workers: int) -> dict[str, Any]:
    """The ``--json`` object of ``batch``.

    Parameters
    ----------
    outcomes : sequence of Outcome
        In the order in which the sessions were named.
    kept : int
        How many were done before.
    page : Path
    workers : int
    """
    return {"page": str(page), "workers": workers, "kept": kept, "counts": counts(outcomes),
            "sessions": [{"folder": each.folder, "name": each.name, "state": each.state,
                          "verdict": each.verdict or None, "says": each.says,
                          "exit_code": each.exit_code, "seconds": each.seconds,
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
    """A row a session, and how many of each verdict."""
    from rich.console import Console
    from rich.table import Table

    table = Table(title_justify="left")
    for heading in ("session", "verdict", "s", "says"):
        table.add_column(heading, justify="right" if heading == "s" else "left",
                         overflow="fold" if heading == "session" else "ellipsis")
    for each in outcomes:
        table.add_row(os.path.relpath(each.folder), each.word, f"{each.seconds:.1f}",
                      _shortened(each.says))
    stream = io.StringIO()
    Console(file=stream, width=WIDTH, markup=False, emoji=False, highlight=False).print(table)
    said = ", ".join(f"{count} {name}" for name, count in counts(outcomes).items() if count)
    before = f"; {kept} were done before" if kept else ""
    return f"{stream.getvalue().rstrip()}\n{len(outcomes)} sessions: {said}{before}\npage: {page}"


def _shortened(sentence: str) -> str:
    first = sentence.splitlines()[0] if sentence else ""
    return first if len(first) <= MAX_SAID else f"{first[:MAX_SAID - 1].rstrip()}…"
