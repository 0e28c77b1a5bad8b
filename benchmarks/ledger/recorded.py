"""What is recorded of the ledger: ``docs/results/ledger.toml``, a table for each row.

    ["simulated/faultless/RMSE"]
    value = 0.0355
    standard_error = 0.0019
    commit = "7c330ef8"         # that was measured; "+" where files were changed since
    cases = { "00" = 0.031, ... }
    reasons = ["7c330ef8: recorded as it is"]       # the latest last, "worse: ..." where it was
"""
from __future__ import annotations

import json
import subprocess
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from spectrabox.radiometry.files import write_text_whole

from benchmarks.ledger.rows import Judgement, value_of

ROOT = Path(__file__).resolve().parents[2]
FILE = ROOT / "docs" / "results" / "ledger.toml"
HEAD = ("# Recorded values of the ledger, written by `python -m benchmarks.ledger --record`; what\n"
        "# the rows mean stands in ledger.md. Not to be edited by hand.\n")
DIGITS = 6              # of a number of one case: far below any floor


@dataclass(frozen=True)
class Recorded:
    """A recorded row."""

    cases: Mapping[str, float]
    commit: str
    reasons: tuple[str, ...]

    @property
    def value(self) -> float:
        """Mean over the cases."""
        return value_of(self.cases)[0]


def read_recorded(path: Path) -> dict[str, Recorded]:
    """Every recorded row by name; none where there is no file."""
    if not path.exists():
        return {}
    with path.open("rb") as file:
        return {name: Recorded(table["cases"], table["commit"], tuple(table["reasons"]))
                for name, table in tomllib.load(file).items()}


def write_recorded(rows: Mapping[str, Recorded], path: Path) -> None:
    """Write all rows, whole or not at all."""
    write_text_whole(path, HEAD + "".join(_table(name, rows[name]) for name in rows))


def record(rows: Mapping[str, Recorded], name: str, cases: Mapping[str, float], commit: str,
           reason: str, judgement: Judgement) -> dict[str, Recorded]:
    """The rows with one recorded anew.

    Parameters
    ----------
    rows : mapping of Recorded
    name : str
        Of the row.
    cases : mapping
        Its numbers.
    commit, reason : str
    judgement : Judgement
        Beside what was recorded: that it was worse, or lacks an answer, is written down with the
        reason.
    """
    before = rows.get(name)
    lost = judgement.word in ("worse", "incomplete")
    said = f"{commit}: {'worse: ' * lost}{reason}"
    rounded = {case: float(f"{value:.{DIGITS}g}") for case, value in cases.items()}
    return {**rows, name: Recorded(rounded, commit, (*(before.reasons if before else ()), said))}


def commit_now() -> str:
    """The commit of the working tree, with "+" where files of it are changed; "unknown" without
    git.
    """
    words = ["git", "-C", str(ROOT)]
    try:
        name = subprocess.run([*words, "rev-parse", "--short=8", "HEAD"], capture_output=True,
                              text=True, check=True).stdout.strip()
        # what the ledger itself writes is no change
        changed = subprocess.run([*words, "status", "--porcelain", "--", ".",
                                  ":!docs/results/ledger.md", ":!docs/results/ledger.toml"],
                                 capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return name + "+" * bool(changed)




def _table(name: str, row: Recorded) -> str:
    value, error = value_of(row.cases)
    numbers = ", ".join(f"{json.dumps(case)} = {float(number)!r}"
                        for case, number in row.cases.items())
    reasons = ", ".join(json.dumps(reason, ensure_ascii=False) for reason in row.reasons)
    stated = "" if error != error else f"standard_error = {float(f'{error:.3g}')!r}\n"
    return (f"\n[{json.dumps(name)}]\nvalue = {float(f'{value:.{DIGITS}g}')!r}\n{stated}"
            f"commit = {json.dumps(row.commit)}\nreasons = [{reasons}]\n"
            f"cases = {{ {numbers} }}\n")
