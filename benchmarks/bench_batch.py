"""``spectrabox batch`` as an operator types it: seconds of many small sessions on one process, on
several, and on a local Dask cluster.

The sessions are synthetic photos of paints beside a chart, each with noise of its own, so that none
shares a calibration with another. They are run anew each time. On a machine that does nothing else.

One process uses more than one core where there is one: parts of the fit and of the report are made
by a second process, and draws by threads. So there are two rows of it: on one core, as each of
several processes has it, and on all of them.
"""
from __future__ import annotations

import argparse
import functools
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from spectrabox.fixtures.flat_demo import write_flat_demo

SIZE = (480, 720)       # of a photo, rows and columns
LEFT = ("results", "spdx")
ONE_CORE = "1 process, one core"


@dataclass(frozen=True)
class Measured:
    """What a whole command took."""

    seconds: float          # with its start and its end
    processor_s: float      # of all its processes
    outside_s: float        # in which a worker was at no session: start, handing over, end
    peak_bytes: int         # of memory, at most, of one process


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sessions", type=int, default=40)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--no-cluster", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder, workers = Path(name), options.workers
        write_sessions(folder, options.sessions)
        several = f"{workers} processes, one core each"
        ways = {ONE_CORE: (1, [], 1), "1 process, all cores": (1, [], None),
                several: (workers, [], workers)}
        if not options.no_cluster:
            ways[f"{workers} Dask workers"] = (workers, ["--cluster", "local"], workers)
        print(f"{f'{options.sessions} sessions':<31} {'s':>7} {'s outside':>10} "
              f"{'s of processor':>15} {'cores busy':>11} {'peak MiB':>9}")
        measured = {}
        for way, (of, words, cores) in ways.items():
            made = measured[way] = batch(folder, of, words, cores)
            print(f"{way:<31} {made.seconds:7.1f} {made.outside_s:10.1f} "
                  f"{made.processor_s:15.1f} {made.processor_s / made.seconds:11.2f} "
                  f"{made.peak_bytes / 2**20:9.0f}", flush=True)
        for slower, faster in (*((way, several) for way in list(ways)[:2]),
                               *((several, way) for way in list(ways)[3:])):
            ratio = measured[slower].seconds / measured[faster].seconds
            print(f"{faster}: {ratio:.2f} times as fast as {slower}")


def write_sessions(folder: Path, sessions: int) -> None:
    """Write sessions that nobody has run, and a list of them."""
    names = [f"{number:03d}" for number in range(sessions)]
    for number, name in enumerate(names):
        write_flat_demo(folder / name, number, size=SIZE)
    (folder / "list.txt").write_text("\n".join(names), encoding="utf-8")


def batch(folder: Path, workers: int, words: Sequence[str], cores: int | None) -> Measured:
    """What the whole command takes on sessions without results.

    Parameters
    ----------
    cores : int or None
        On which everything runs; None for all of them.
    """
    for session in folder.iterdir():
        for left in LEFT:
            shutil.rmtree(session / left, ignore_errors=True)
    shutil.rmtree(folder / "batch", ignore_errors=True)
    here = sorted(os.sched_getaffinity(0))
    before, started = _processor_s(), time.perf_counter()
    done = subprocess.run([sys.executable, "-m", "spectrabox", "batch", "--list", "list.txt",
                           "--json", "--quiet", "--workers", str(workers), *words], cwd=folder,
                          text=True, capture_output=True, check=False,
                          preexec_fn=functools.partial(os.sched_setaffinity, 0, here[:cores]))
    seconds = time.perf_counter() - started
    if done.returncode:
        raise SystemExit(done.stdout + done.stderr)
    facts = json.loads(done.stdout)
    assert facts["kept"] == 0 and facts["counts"]["could not be run"] == 0
    at_sessions = sum(each["seconds"] for each in facts["sessions"])
    return Measured(seconds, _processor_s() - before, seconds - at_sessions / workers,
                    max(each["peak_bytes"] or 0 for each in facts["sessions"]))


def _processor_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


if __name__ == "__main__":
    main()
