"""How many functions a photo passes on its way to the report, and a signal on its way to its draws.

Runs all stages of a small demo session from nothing, and ``spectrabox sample`` on one signal with
the learnt prior, and counts every function and method of the product that is entered. Lambdas and
comprehensions are left out:

    python -m benchmarks.count_functions
"""
from __future__ import annotations

import argparse
import contextlib
import inspect
import io
import json
import os
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path

from spectrabox.fixtures.demos.demo_session import write_demo_session
from spectrabox.session.cli import app
from spectrabox.session.config.session_file import read_session
from spectrabox.session.pipeline import run_stages

ROOT = Path(__file__).resolve().parents[1]
ROOMS = ("radiometry", "capture", "calibrate", "reconstruct", "sampling", "measure", "session")
SAMPLE = ("sample", "--sensitivity", "Nikon 5100 (NPL)", "--light", "D65", "--signal",
          "0.53,0.24,0.08", "--noise", "0.003,0.003,0.003", "--samples", "1000", "--seed", "1",
          "--json")


def functions_entered(work: Callable[[], object]) -> Counter[str]:
    """How many functions of each room are entered."""
    entered: set[tuple[str, str]] = set()

    def note(frame, event, argument) -> None:  # type: ignore[no-untyped-def]
        code = frame.f_code
        # not the bodies of classes and modules, which are entered when they are imported
        if event == "call" and code.co_flags & inspect.CO_OPTIMIZED and "/" in code.co_filename:
            entered.add((code.co_filename, code.co_qualname))

    sys.setprofile(note)
    try:
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            work()
    finally:
        sys.setprofile(None)
    rooms: Counter[str] = Counter()
    for file, name in entered:
        path = Path(os.path.realpath(file))
        if path.is_relative_to(ROOT) and not name.endswith(">"):
            room = path.relative_to(ROOT).parts[0]
            rooms[room] += room in ROOMS
    return rooms


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "box"
        write_demo_session(folder, 1, size=(208, 312), spp=4)
        photo = functions_entered(lambda: run_stages(
            read_session(folder), device="cpu", only=None, force=False, progress=lambda *_: None))
    signal = functions_entered(lambda: app(list(SAMPLE), standalone_mode=False))
    if asked.json:
        print(json.dumps({"photo": photo, "signal": signal}))
        return
    print(f"{'room':<14}{'photo to report':>16}{'signal to draws':>17}")
    for room in (*ROOMS, "all"):
        count = [sum(each.values()) if room == "all" else each[room] for each in (photo, signal)]
        print(f"{room:<14}{count[0]:>16}{count[1]:>17}")


if __name__ == "__main__":
    main()
