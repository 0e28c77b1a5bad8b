"""Which tables under docs/results are older than the code that they rest on, by what git knows.

Below each table stands a line of one form, which whoever runs the command again brings up to date:

    Last run: `python -m benchmarks.bench_gloss`, commit `4d9e294c`; rests on radiometry, sampling.

A table is older where a commit after that one changed one of the folders that it rests on. Without
git, or where history does not reach back so far, that is said of the table.

    python -m benchmarks.table_ages
"""
from __future__ import annotations

import re
import subprocess
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "docs" / "results"
FORM = re.compile(r"^Last run: (`(?P<command>[^`]+)`|by hand), commit "
                  r"`(?P<commit>[0-9a-f]{8,40})`; rests on (?P<folders>[\w/, ]+)\.$")
BY_HAND = "by hand"
# written by its own command, at each run
WRITTEN = ("ledger.md",)


@dataclass(frozen=True)
class Table:
    """A table of a page and what is stated of its last run; empty where nothing is."""

    page: str
    line: int                   # of its first row, from 1
    command: str = ""
    commit: str = ""
    folders: tuple[str, ...] = ()


def tables_of(page: str, text: str) -> list[Table]:
    """Every table of a page, with the line of the form above that follows it."""
    lines, tables = text.splitlines(), list[Table]()
    starts = [number for number, line in enumerate(lines) if line.startswith("|")
              and not (number and lines[number - 1].startswith("|"))]
    for start in starts:
        after = next((line for line in lines[start:] if line and not line.startswith("|")), "")
        stated = FORM.match(after)
        tables.append(Table(page, start + 1) if stated is None else Table(
            page, start + 1, stated["command"] or BY_HAND, stated["commit"],
            tuple(stated["folders"].split(", "))))
    return tables


def all_tables() -> list[Table]:
    """Of every page that is written by hand."""
    return [table for path in sorted(RESULTS.glob("*.md")) if path.name not in WRITTEN
            for table in tables_of(path.name, path.read_text(encoding="utf-8"))]


def changes_since(table: Table) -> int | None:
    """How many commits since changed what a table rests on; None where git cannot tell."""
    try:
        ran = subprocess.run(["git", "-C", str(ROOT), "rev-list", "--count",
                              f"{table.commit}..HEAD", "--", *table.folders],
                             capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    return int(ran.stdout)


def main() -> None:
    """Print the tables that are older."""
    older = 0
    for table in all_tables():
        changes = changes_since(table) if table.commit else None
        if changes != 0:
            older += 1
            said = "the commit of its last run is not known here" if changes is None else \
                f"{changes} commits to {', '.join(table.folders)} since {table.commit}"
            print(f"docs/results/{table.page}:{table.line}: "
                  f"{table.command or 'no command'}: {said}")
    print(f"{older} tables are older than the code that they rest on, or may be")


if __name__ == "__main__":
    main()
