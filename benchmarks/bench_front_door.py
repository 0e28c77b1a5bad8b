"""Whole commands as an operator types them: wall time of the process, the least of five.

Each row names what it is compared with: the target of the plan, or the same command of another
checkout, measured in turn (``--before FOLDER``, a checkout with its own ``.venv``).
"""
from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
ROUNDS = 5


@dataclass(frozen=True)
class Command:
    """One row: what is typed, in a demo session, and the time it is to take."""

    what: str
    words: tuple[str, ...]
    target_s: float
    prepare: Callable[[Path], None] = lambda session: None


def without_results(session: Path) -> None:
    """A session as it was captured."""
    shutil.rmtree(session / "results", ignore_errors=True)


COMMANDS = (
    Command("--help", ("--help",), 0.3),
    Command("status", ("status", "SESSION"), 0.4),
    Command("check of the demo", ("check", "SESSION"), 1.2),
    Command("run of the demo from nothing", ("run", "SESSION"), 6.0, without_results),
    Command("run, nothing changed", ("run", "SESSION"), 0.8),
    Command("report", ("report", "SESSION"), 2.0),
    Command("camera fit of a photo", ("camera", "fit", "--chart", "SESSION/photos/chart.dng",
                                      "--light", "SESSION/spectra/light.csv", "--json"), 1.0),
)


def seconds_of(checkout: Path, command: Command, session: Path) -> float:
    """Wall time of one process."""
    command.prepare(session)
    words = [word.replace("SESSION", str(session)) for word in command.words]
    environment = {**os.environ, "PYTHONPATH": str(checkout)}
    start = time.perf_counter()
    subprocess.run([checkout / ".venv" / "bin" / "spectrabox", *words], check=True, cwd=checkout,
                   env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return time.perf_counter() - start


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--before", type=Path, help="another checkout, measured in turn")
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    asked = parser.parse_args()
    checkouts = [ROOT, *([asked.before.resolve()] if asked.before else [])]
    with tempfile.TemporaryDirectory() as folder:
        sessions = [Path(folder) / str(number) for number in range(len(checkouts))]
        for checkout, session in zip(checkouts, sessions, strict=True):
            seconds_of(checkout, Command("demo", ("demo", "SESSION"), 0.0), session)
        print(f"{'what':<30} {'ours':>8} {'target':>8}" + (f" {'before':>8} {'ratio':>6}"
                                                          if asked.before else ""))
        for command in COMMANDS:
            rounds = [[seconds_of(checkout, command, session) for checkout, session
                       in zip(checkouts, sessions, strict=True)] for _ in range(asked.rounds)]
            least = [min(column) for column in zip(*rounds, strict=True)]
            before = f" {least[1]:7.2f}s {least[1] / least[0]:6.1f}" if asked.before else ""
            print(f"{command.what:<30} {least[0]:7.2f}s {command.target_s:7.2f}s{before}",
                  flush=True)


if __name__ == "__main__":
    main()
