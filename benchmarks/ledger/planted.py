"""Mistakes planted one at a time, each of which must make the ledger fail.

    python -m benchmarks.ledger.planted [--only WORDS]

Each of planted.toml is planted in a copy of the working tree, and its blocks of the ledger measured
there beside the recorded values. Ends in 4 where the ledger does not notice one; a block that fails
without the mistake too (``make ledger`` says so) proves nothing.
"""
from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

from benchmarks.planted.mistake import Mistake
from benchmarks.planted.scratch_tree import copied_tree, planted

LIST = Path(__file__).with_name("planted.toml")
WORSE = 4               # exit code of the ledger


def listed() -> list[tuple[Mistake, list[str]]]:
    """Every mistake, and the blocks that are to notice it."""
    mistakes = tomllib.loads(LIST.read_text(encoding="utf-8"))["mistake"]
    return [(Mistake(**{key: value for key, value in each.items() if key != "blocks"}),
             each["blocks"]) for each in mistakes]


def noticed(tree: Path, mistake: Mistake, blocks: list[str]) -> list[str]:
    """What the ledger says of blocks with a mistake; nothing where it does not fail.

    Raises
    ------
    RuntimeError
        If the ledger could not be measured.
    """
    with planted(tree, mistake):
        ran = subprocess.run([sys.executable, "-m", "benchmarks.ledger", "--only", *blocks],
                             cwd=tree, env={**os.environ, "PYTHONPATH": str(tree)},
                             capture_output=True, text=True, check=False)
    if ran.returncode not in (0, WORSE):
        raise RuntimeError(f"the ledger ended in {ran.returncode}: {ran.stderr.strip()[-500:]}")
    said = ("worse: ", "incomplete: ", "no answer: ")
    return [line for line in ran.stdout.splitlines() if line.startswith(said)]


def main() -> int:
    """Plant all, and print what was noticed."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="", help="mistakes whose words hold this")
    asked, survived = parser.parse_args(), 0
    with tempfile.TemporaryDirectory() as folder:
        tree = copied_tree(Path(folder) / "tree")
        for mistake, blocks in listed():
            if asked.only not in mistake.what:
                continue
            lines = noticed(tree, mistake, blocks)
            survived += not lines
            print(f"{'noticed' if lines else 'SURVIVES'}: {mistake.what}", *lines, sep="\n    ",
                  flush=True)
    return WORSE if survived else 0


if __name__ == "__main__":
    sys.exit(main())
