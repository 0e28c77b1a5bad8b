"""Measure the ledger, compare it with what is recorded, print it and write docs/results/ledger.md.

    python -m benchmarks.ledger [--data FOLDER] [--only NAME ...]
    python -m benchmarks.ledger --record NAME ... --reason "why the values are other ones" [--last]

Ends in 4 where a row is worse than recorded by more than its error, was never recorded, or lacks
an answer that is recorded; else in 0. ``--record`` takes rows by name, or patterns such as
"simulated/greys*" and "*"; a row that is worse is recorded with its reason, which is to stand in
CHANGELOG.md as well. With ``--last`` nothing is measured again: the values are those of the last
run in this checkout, which build/ledger.json keeps. A row that is measured no more is taken out of
ledger.toml by hand. Measured data are found by --data or SPECTRABOX_DATA; rows that need them stay
as recorded where there are none. No row needs a network.
"""
from __future__ import annotations

import argparse
import fnmatch
import os
import sys
from dataclasses import replace
from pathlib import Path

from benchmarks.ledger import (
    boxes,
    real,
    recorded,
    rows,
    scenes,
    signals,
    simulated,
    speed,
    table,
    task,
)

GROUPS = ("real", "simulated", "signals", "speed")
LAST = recorded.ROOT / "build" / "ledger.json"
DATA = "real/"          # rows that need measured data
FILES = (real, boxes, scenes, simulated, signals, speed)      # the longest tasks first


def main(words: list[str] | None = None) -> int:
    """Measure, compare, print, write; the exit code."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.ledger", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=os.environ.get("SPECTRABOX_DATA") or None,
                        help="folder of measured data; SPECTRABOX_DATA by default")
    parser.add_argument("--only", nargs="+", metavar="NAME", default=[],
                        help="groups, blocks or rows; the page is written only with --record then")
    parser.add_argument("--record", nargs="+", metavar="NAME", default=[],
                        help="record what these rows measure now")
    parser.add_argument("--reason", help="why; needed with --record")
    parser.add_argument("--last", action="store_true",
                        help="take the values of the last run, and measure nothing")
    parser.add_argument("--workers", type=int, default=task.WORKERS)
    asked = parser.parse_args(words)
    if asked.record and not asked.reason:
        parser.error("--record needs --reason: why are the values other ones?")
    if asked.last and not LAST.exists():
        parser.error("there is no last run in this checkout: leave --last out")
    done = task.Measured.stored(LAST) if asked.last else measured(parser, asked)
    known = recorded.read_recorded(recorded.FILE)
    judgements = judged_rows(done, known)
    for name in [name for name in done.rows
                 if any(fnmatch.fnmatch(name, pattern) for pattern in asked.record)]:
        known = recorded.record(known, name, done.rows[name], done.commit, asked.reason,
                                judgements[name])
        judgements[name] = rows.Judgement("recorded")
    lines = table.lines_of(done.rows, known, judgements)
    if asked.record:
        recorded.write_recorded({name: known[name] for name in sorted(known, key=_order)},
                                recorded.FILE)
    if asked.record or done.whole:
        table.write(lines, done.commit)
    print(table.text([line for line in lines if done.whole or line.word != "not measured"]))
    print(f"\n{len(done.rows)} rows, {sum(done.seconds.values()):.0f} s of processor")
    if done.whole and not any(name.startswith(DATA) for name in done.rows):
        print("real: skipped, no measured data; name their folder with --data or SPECTRABOX_DATA")
    for (block, case), fault in done.faults.items():
        print(f"no answer: {block}, case {case}: {fault}")
    failed = {name: judgement for name, judgement in judgements.items() if judgement.fails}
    for name, judgement in failed.items():
        print(f"{judgement.word}: {name}: {judgement.says or table.change_of(name, judgement)}")
    if failed:
        print("mend it, or record it: python -m benchmarks.ledger --last --record NAME --reason "
              '"WHY", with the reason in CHANGELOG.md too')
    return 4 if failed else 0


def measured(parser: argparse.ArgumentParser, asked: argparse.Namespace) -> task.Measured:
    """What was asked for, measured, and kept for --last."""
    data = None if asked.data is None else Path(asked.data)
    if data is not None and not data.is_dir():
        parser.error(f"{data} is no folder of measured data")
    every = [one for file in FILES for one in file.tasks(data)]
    wanted = [one for one in every
              if not asked.only or any(_within(one.block, name) for name in asked.only)]
    if not wanted:
        parser.error(f"nothing is named {', '.join(asked.only)}; there are "
                     f"{', '.join(dict.fromkeys(one.block for one in every))}")
    commit = recorded.commit_now()
    done = replace(task.measure_all(wanted, asked.workers), commit=commit,
                   blocks=tuple(dict.fromkeys(one.block for one in wanted)), whole=not asked.only)
    done.store(LAST)
    return done


def judged_rows(done: task.Measured,
                known: dict[str, recorded.Recorded]) -> dict[str, rows.Judgement]:
    """What every row came to that was measured or is recorded: of a block that was measured, and
    of all where the whole ledger was, but for rows of data, a recorded row must be there.
    """
    judgements = {}
    for name in dict.fromkeys([*done.rows, *known]):
        there = name.rsplit("/", 1)[0] in done.blocks \
            or (done.whole and not name.startswith(DATA))
        found = done.rows.get(name, {} if there else None)
        judgements[name] = rows.judged(rows.kind_of(name), found,
                                       known[name].cases if name in known else None)
    return judgements


def _within(block: str, name: str) -> bool:
    """Whether a block is named, by itself, its group or one of its rows."""
    return block == name or block.startswith(f"{name}/") or name.startswith(f"{block}/")


def _order(name: str) -> int:
    return GROUPS.index(name.split("/", 1)[0])


if __name__ == "__main__":
    sys.exit(main())
