"""``spectrabox batch`` as an operator types it: seconds of many small sessions on one worker, on
several, and on a local Dask cluster.

The sessions are synthetic photos of paints beside a chart, each with noise of its own, so that none
shares a calibration with another. They are run anew each time. On a machine that does nothing else.
"""
from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from spectrabox.fixtures.flat_demo import write_flat_demo

SIZE = (480, 720)       # of a photo, rows and columns
LEFT = ("results", "spdx")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sessions", type=int, default=40)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--no-cluster", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for number in range(options.sessions):
            write_flat_demo(folder / f"{number:03d}", number, size=SIZE)
        (folder / "list.txt").write_text("\n".join(f"{number:03d}" for number
                                                   in range(options.sessions)), encoding="utf-8")
        ways = {"1 process": ["--workers", "1"],
                f"{options.workers} processes": ["--workers", str(options.workers)]}
        if not options.no_cluster:
            ways[f"{options.workers} Dask workers"] = ["--workers", str(options.workers),
                                                       "--cluster", "local"]
        print(f"{'':<18} {'s':>8} {'s a session':>12} {'of 1 process':>13} {'peak MiB':>9}")
        first = None
        for way, words in ways.items():
            seconds, peak = batch(folder, words)
            first = seconds if first is None else first
            print(f"{way:<18} {seconds:8.1f} {seconds / options.sessions:12.2f} "
                  f"{first / seconds:13.2f} {peak / 2**20:9.0f}", flush=True)


def batch(folder: Path, words: list[str]) -> tuple[float, int]:
    """Seconds of the whole command on sessions without results, and the most memory that one of
    them took.
    """
    for session in folder.iterdir():
        for left in LEFT:
            shutil.rmtree(session / left, ignore_errors=True)
    shutil.rmtree(folder / "batch", ignore_errors=True)
    started = time.perf_counter()
    done = subprocess.run([sys.executable, "-m", "spectrabox", "batch", "--list", "list.txt",
                           "--json", "--quiet", *words], cwd=folder, text=True,
                          capture_output=True, check=False)
    taken = time.perf_counter() - started
    if done.returncode:
        raise SystemExit(done.stdout + done.stderr)
    facts = json.loads(done.stdout)
    assert facts["kept"] == 0 and facts["counts"]["could not be run"] == 0
    return taken, max(each["peak_bytes"] or 0 for each in facts["sessions"])


if __name__ == "__main__":
    main()
