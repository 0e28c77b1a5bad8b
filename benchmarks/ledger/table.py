"""The ledger as a table: on the terminal, and in docs/results/ledger.md."""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from spectrabox.radiometry.files import write_text_whole

from benchmarks.ledger.recorded import ROOT, Recorded
from benchmarks.ledger.rows import Judgement, kind_of, value_of

PAGE = ROOT / "docs" / "results" / "ledger.md"
BEGIN = "<!-- what follows is written by make ledger -->"
COLUMNS = ("row", "value", "recorded", "at", "change", "")
# what work on the product aims at: printed beside the value, and no part of any judgement
GOALS = {
    "real/box/held, green": "at least .9", "real/box/held, red": "at least .9",
    "real/box/held, cube": "at least .9", "real/box/RMSE, green": "at most .09",
    "real/box/RMSE, red": "at most .04",
    "real/marked/relative bias, black": "within .15",
    "real/marked/relative bias, neutral 3.5": "within .05",
    "simulated/greys/bias, dark": "within .004", "simulated/faultless/L* bias": "within .5",
    "simulated/gloss 3 %/held": ".93",
    "speed/commands/times, sample of 1,000": "4", "speed/commands/times, uplift of 1 Mpx": "6",
    "speed/commands/times, status": ".9", "speed/commands/times, run unchanged": ".9",
    "speed/commands/times, report": "2.5"}


@dataclass(frozen=True)
class Line:
    """One row as it is shown."""

    name: str
    value: str
    recorded: str
    commit: str
    change: str
    word: str
    goal: str


def lines_of(measured: Mapping[str, Mapping[str, float]], known: Mapping[str, Recorded],
             judgements: Mapping[str, Judgement]) -> list[Line]:
    """Every row that is recorded or was measured, as it is shown."""
    lines = []
    for name in sorted(judgements, key=lambda each: _rank(each, [*known, *measured])):
        judgement, before = judgements[name], known.get(name)
        lines.append(Line(
            name, number(name, measured[name]) if name in measured else "",
            "" if before is None else number(name, before.cases),
            "" if before is None else before.commit,
            "" if judgement.word in ("recorded", "printed") else change_of(name, judgement),
            judgement.word, GOALS.get(name, "")))
    return lines


def number(name: str, cases: Mapping[str, float]) -> str:
    """Mean and standard error, as many digits as the kind of row has."""
    digits, (value, error) = kind_of(name).digits, value_of(cases)
    shown = f"{value:.{digits}f}"
    return shown if np.isnan(error) else f"{shown} ± {error:.{digits}f}"


def change_of(name: str, judgement: Judgement) -> str:
    """By how much a row is better or worse, with the error of that."""
    if np.isnan(judgement.loss):
        return judgement.says
    digits = kind_of(name).digits
    error = "" if np.isnan(judgement.error) else f" ± {judgement.error:.{digits}f}"
    if abs(judgement.loss) < 0.5 * 10**-digits:
        return "0"
    return f"{abs(judgement.loss):.{digits}f}{error} {'worse' if judgement.loss > 0 else 'better'}"


def text(lines: Sequence[Line]) -> str:
    """The table for a terminal, a blank line between blocks."""
    cells = [(line.name, line.value, line.recorded, line.commit, line.change,
              line.word if line.word != "same" else "") for line in lines]
    widths = [max(len(row[column]) for row in [COLUMNS, *cells]) for column in range(len(COLUMNS))]
    shown, block = [], ""
    for row in [COLUMNS, *cells]:
        if row[0].rsplit("/", 1)[0] != block:
            block = row[0].rsplit("/", 1)[0]
            shown.append("")
        shown.append("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True))
                     .rstrip())
    return "\n".join(shown)


def markdown(lines: Sequence[Line]) -> str:
    """The same for the page, a table for each group."""
    shown = []
    for group in dict.fromkeys(line.name.split("/", 1)[0] for line in lines):
        shown += [f"\n## {group}\n", "| row | value | recorded | at | change | goal |",
                  "|--|--|--|--|--|--|"]
        shown += [f"| {line.name.split('/', 1)[1]} | {line.value or '-'} | {line.recorded} | "
                  f"{line.commit} | {_bold(line)} | {line.goal} |"
                  for line in lines if line.name.startswith(f"{group}/")]
    return "\n".join(shown) + "\n"


def write(lines: Sequence[Line], commit: str) -> None:
    """Write the tables into the page, below what is written there by hand.

    Parameters
    ----------
    lines : sequence of Line
    commit : str
        That was measured.
    """
    above = PAGE.read_text(encoding="utf-8").split(BEGIN)[0]
    missing = ", ".join(dict.fromkeys(line.name.split("/", 1)[0] for line in lines
                                      if line.word == "not measured"))
    left_out = f" Left out in that run: rows of {missing}." if missing else ""
    write_text_whole(PAGE, f"{above}{BEGIN}\n\n`make ledger` at commit {commit}.{left_out}\n"
                           f"{markdown(lines)}")


def _bold(line: Line) -> str:
    if line.word in ("recorded", "printed"):
        return ""
    if line.word in ("worse", "incomplete", "not recorded"):
        return f"**{line.word}** {line.change}".strip()
    return line.change if line.word == "same" else f"{line.word} {line.change}".strip()


def _rank(name: str, order: Sequence[str]) -> int:
    return list(order).index(name)
