"""Damaged and hostile copies of every kind of file through its reader, or through the commands.

Is anything but a result or a sentence the end, how long does it take, how much memory?

Each kind is read in a process of its own, so that a crash of a library is counted, not suffered.

    python -m benchmarks.bench_damaged_inputs [--commands] [--copies 1600] [--first 0]
        [--kind NAME] [--json]
"""
from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import resource
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from pathlib import Path
from types import FrameType
from typing import Any

from spectrabox.fixtures.mutations import mutated, rewritten
from spectrabox.radiometry.errors import SpectraboxError

from benchmarks.damaged_commands import CommandBrokeError, command_subjects
from benchmarks.damaged_inputs import Subject, subjects

HANG_S = 10
INPUTS = "inputs"
LIMIT_BYTES = 2 * 1024**3


class Hang(BaseException):
    """A read that takes longer than ``HANG_S`` of processor time."""


def tally(subject: Subject, seeds: range, said: Any) -> None:
    """Read damaged copies in this process; outcomes go to ``said`` one by one.

    Parameters
    ----------
    seeds : range
        Of the copies; odd ones of a text exchange words, others damage bytes.
    said : multiprocessing queue
        Takes (seed, outcome, seconds, peak memory in bytes).
    """
    warnings.simplefilter("ignore")
    for alarm in (signal.SIGPROF, signal.SIGALRM):
        signal.signal(alarm, _hang)
    with Path("/proc/self/statm").open() as file:
        held = int(file.read().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (held + LIMIT_BYTES,) * 2)
    touched: list[str] = []
    inside = next(str(parent) for parent in subject.path.parents if parent.name == INPUTS)
    sys.addaudithook(lambda event, given: _note_writes(event, given, inside, touched))
    content = subject.path.read_bytes()
    subject.read(subject.path)      # as it is, it is read
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stderr.fileno())  # libraries say what they think
    for seed in seeds:
        subject.path.write_bytes(rewritten(content, seed) if subject.text and seed % 2
                                 else mutated(content, seed))
        said.put((seed, "began", 0.0, 0))
        started = time.process_time()
        # Of processor time, which other work on the machine does not lengthen; and of the clock,
        # for what sleeps.
        signal.setitimer(signal.ITIMER_PROF, HANG_S)
        signal.alarm(6 * HANG_S)
        try:
            subject.read(subject.path)
            outcome = "read"
        except SpectraboxError as error:
            outcome = "sentence" if len(str(error)) < 5000 else "CRASH sentence too long"
        except Hang:
            outcome = "HANG"
        except CommandBrokeError as error:
            outcome = "HANG" if "unexpected Hang" in str(error) else f"CRASH {str(error)[:200]}"
        except BaseException as error:  # noqa: BLE001  what must not happen is what is counted here
            where = traceback.extract_tb(error.__traceback__)[-1]
            outcome = (f"CRASH {type(error).__name__} at {Path(where.filename).name}:"
                       f"{where.lineno}")
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.alarm(0)
        peak = 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        if touched:
            outcome = f"CRASH wrote to {touched.pop()}"
        said.put((seed, outcome, time.process_time() - started, peak))
    subject.path.write_bytes(content)


def _hang(number: int, frame: FrameType | None) -> None:
    raise Hang


def _note_writes(event: str, given: tuple[Any, ...], inside: str, touched: list[str]) -> None:
    # TemporaryFile opens the folder itself: what it writes has no name
    if event == "open" and isinstance(given[0], str) and isinstance(given[2], int) \
            and given[2] & (os.O_WRONLY | os.O_RDWR) and given[0] != tempfile.gettempdir() \
            and not given[0].startswith((inside, "/dev/")):
        touched.append(given[0])


def outcomes(subject: Subject, first: int, copies: int) -> dict[str, Any]:
    """Counts of outcomes, the first seed of each that must not happen, time and memory."""
    counts: Counter[str] = Counter()
    bad: dict[str, int] = {}
    longest, peak, seed, end = 0.0, 0, first, first + copies
    while seed < end:
        said: Any = multiprocessing.SimpleQueue()
        child = multiprocessing.Process(target=tally, args=(subject, range(seed, end), said))
        child.start()
        began = seed
        while seed < end:
            waited = time.monotonic()
            while said.empty() and child.is_alive():
                child.join(0.001)
                if time.monotonic() - waited > 12 * HANG_S:  # in a library that no alarm stops
                    child.kill()
            if said.empty():
                outcome, seconds = f"DIED {child.exitcode}", time.monotonic() - waited
            else:
                began, outcome, seconds, used = said.get()
                peak = max(peak, used)
            if outcome == "began":
                continue
            counts[outcome] += 1
            if outcome not in ("read", "sentence"):
                bad.setdefault(outcome, began)
            longest, seed = max(longest, seconds), began + 1
            if outcome.startswith("DIED"):
                break
        child.join()
    return {"counts": dict(counts), "bad_seeds": bad, "longest_s": round(longest, 2),
            "peak_mib": round(peak / 1024**2)}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--copies", type=int, default=100, help="damaged copies of each kind")
    parser.add_argument("--first", type=int, default=0, help="seed of the first copy of each kind")
    parser.add_argument("--commands", action="store_true", help="commands in place of readers")
    parser.add_argument("--kind", action="append",
                        help="kinds whose name holds this word; may be repeated")
    parser.add_argument("--json", action="store_true", help="one object on standard output")
    arguments = parser.parse_args()
    results = {}
    multiprocessing.set_start_method("fork")
    with tempfile.TemporaryDirectory() as folder:
        os.environ["HOME"] = folder
        kinds = command_subjects if arguments.commands else subjects
        for subject in kinds(Path(folder) / INPUTS):
            if not arguments.kind or any(word in subject.name for word in arguments.kind):
                results[subject.name] = outcomes(subject, arguments.first, arguments.copies)
                if not arguments.json:
                    print(_line(subject.name, results[subject.name]), flush=True)
    total = sum(sum(result["counts"].values()) for result in results.values())
    bad = sum(count for result in results.values() for outcome, count in result["counts"].items()
              if outcome not in ("read", "sentence"))
    bad += sum(result["peak_mib"] * 1024**2 > LIMIT_BYTES for result in results.values())
    if arguments.json:
        print(json.dumps({"copies": total, "bad": bad, "kinds": results}))
    else:
        print(f"{bad} of {total} ended in anything but a result or a sentence")
    return int(bad > 0)


def _line(name: str, result: dict[str, Any]) -> str:
    counts = ", ".join(f"{outcome} {count}" + (f" (seed {result['bad_seeds'][outcome]})"
                                               if outcome in result["bad_seeds"] else "")
                       for outcome, count in sorted(result["counts"].items()))
    return f"{name:<24} {result['longest_s']:6.2f} s {result['peak_mib']:6d} MiB   {counts}"


if __name__ == "__main__":
    sys.exit(main())
