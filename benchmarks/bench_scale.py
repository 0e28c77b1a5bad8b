"""What sessions and pictures take as they become many and large: the figures of docs/scale.md.

``pictures``: a synthetic picture of repeated tiles through ``spectrabox uplift``: seconds, memory
and bytes by megapixels. ``sessions``: seconds and bytes of each stage of a session of flat samples
and of a scene, and what a batch adds to each. ``tasks``: what Dask's scheduler adds to each of many
empty and sleeping tasks. ``model``: what these say of more than was measured.
"""
from __future__ import annotations

import argparse
import json
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from itertools import product
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from spectrabox.fixtures.demos.demo_session import write_demo_session
from spectrabox.fixtures.demos.flat_demo import write_flat_demo
from spectrabox.radiometry.spectra.named_spectra import test_reflectances
from spectrabox.sampling.prior.mixture import PRIOR_GRID
from spectrabox.session.signals.signal_options import response_of_names

CAMERA, LIGHT = "Nikon 5100 (NPL)", "D65"
TASKS_AT_ONCE = 5000        # given to Dask before the first of them is waited for
TILE = 256                  # pixels of a side of the tiles that the synthetic picture repeats


def main() -> None:
    if sys.argv[1:2] == ["uplift"]:
        uplift(*sys.argv[2:])
        return
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("part", nargs="*",
                        default=["pictures", "sessions", "tasks", "model"])
    parser.add_argument("--megapixels", default="10,20")
    parser.add_argument("--width", type=int, help="pixels; square by default. Memory grows with "
                        "the width alone, so that a low picture shows it")
    parser.add_argument("--to", default="tiled-exr,zarr")
    parser.add_argument("--by", default="one", help="who computes a picture: one process on all "
                        "cores, or a number of workers, processes (2) or Dask's (dask2); commas "
                        "between several")
    parser.add_argument("--low-rank", type=int, help="coefficients a pixel, in place of spectra")
    parser.add_argument("--tasks", type=int, default=10_000)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--folder", type=Path, help="where pictures go; a temporary one by default")
    options = parser.parse_args()
    for part in options.part:
        print(f"-- {part}")
        if part == "pictures":
            pictures([float(word) for word in options.megapixels.split(",")],
                     options.to.split(","), options.folder, options.width, options.low_rank,
                     options.by.split(","))
        elif part == "sessions":
            sessions()
        elif part == "tasks":
            tasks(options.tasks, options.workers)
        elif part == "model":
            model()


# ---- pictures

def pictures(megapixels: list[float], forms: list[str], folder: Path | None,
             width: int | None, low_rank: int | None, by: list[str]) -> None:
    """One row a picture, format and who computes it. Memory is that of the largest process."""
    print(f"{'Mpixel':>7} {'to':<10} {'by':<6} {'s':>8} {'CPU s':>8} {'CPU s/Mpixel':>13} "
          f"{'MiB':>6} {'bytes/pixel':>12}  CPU s/Mpixel of each tenth while it is written")
    for count in megapixels:
        for form, who in product(forms, by):
            with tempfile.TemporaryDirectory(dir=folder) as name:
                path, out, marks = (Path(name) / each for each in ("picture.exr", "out", "marks"))
                columns = width or round(1000 * count**0.5)
                rows = round(1e6 * count / columns)
                write_repeated(path, rows, columns)
                taken, used, peak = measured([sys.executable, "-m", __spec__.name, "uplift",
                                              str(path), str(out), form, str(low_rank or 0),
                                              who, str(marks)])
                pixels = rows * columns / 1e6
                seconds, errors = json.loads(marks.read_text())
                tenths = np.diff(seconds) if who == "one" else []    # others are not of this one
                print(f"{pixels:7.1f} {form:<10} {who:<6} {taken:8.1f} {used:8.1f} "
                      f"{used / pixels:13.3f} {peak / 2**20:6.0f} "
                      f"{bytes_in(out) / pixels / 1e6:12.1f}  "
                      + " ".join(f"{each / pixels * 10:.2f}" for each in tenths)
                      + (f"  {errors}" if errors else ""), flush=True)


def uplift(image: str, out: str, form: str, low_rank: str, by: str, marks: str) -> None:
    """What the command does, with the seconds of processor at each tenth of the writing, and what
    a low rank costs.
    """
    from spectrabox.session.commands.requests import UpliftRequest
    from spectrabox.session.pictures.uplift import uplift_answer
    at: list[float] = []

    def progress(stage: str, share: float, message: str) -> None:
        if stage == "spectra" and (not at or share >= len(at) / 10):
            at.append(time.process_time())

    request = UpliftRequest(
        image=Path(image), out=Path(out), sensitivity=CAMERA, light=LIGHT, to=form,
        low_rank=int(low_rank) or None, cluster="local" if by.startswith("dask") else None,
        workers=None if by == "one" else int(by.removeprefix("dask")))
    if by == "one":
        facts, _ = uplift_answer(request, progress)
    else:
        from spectrabox.session.pictures.shared_uplift import shared_uplift_answer
        facts, _ = shared_uplift_answer(request, progress)
    Path(marks).write_text(json.dumps([at, facts.get("errors")]))


def write_repeated(path: Path, height: int, width: int) -> None:
    """An EXR of tiles, all alike: a chart of measured reflectances, shaded, with 1 % of noise."""
    reflectances = next(iter(test_reflectances(PRIOR_GRID).values()))[:24]
    patches = np.clip(reflectances, 0, 1) @ response_of_names(CAMERA, LIGHT).T
    at = np.arange(TILE)
    tile = patches.reshape(4, 6, 3)[at[:, None] * 4 // TILE, at * 6 // TILE]
    noise = 1 + 0.01 * np.random.default_rng(0).standard_normal(tile.shape)
    tile = (tile * noise * (0.7 + 0.3 * np.cos(6 * at / TILE))[:, None]).astype(np.float16)
    row = np.ascontiguousarray(np.tile(tile, (1, -(-width // TILE), 1))[:, :width])
    spec = oiio.ImageSpec(width, height, 3, oiio.HALF)
    spec.tile_width = spec.tile_height = TILE
    file = oiio.ImageOutput.create(str(path))
    assert file.open(str(path), spec), oiio.geterror()
    for first in range(0, height, TILE):
        last = min(first + TILE, height)
        assert file.write_tiles(0, width, first, last, 0, 1, row[:last - first])
    assert file.close()


# ---- sessions

def sessions() -> None:
    """Seconds and bytes of each stage, and of a batch."""
    with tempfile.TemporaryDirectory() as name:
        flat, scene = Path(name) / "flat", Path(name) / "scene"
        write_flat_demo(flat, 1)
        write_demo_session(scene, 1)
        for folder in (flat, scene):
            taken, used, peak = timed(["run", str(folder), "--device", "cpu", "--quiet"])
            stages = {path.parent.name: json.loads(path.read_text())["seconds"]
                      for path in sorted(folder.glob("results/*/facts.json"))}
            print(f"{folder.name}: {taken:.1f} s ({used:.1f} s of processor), "
                  f"{peak / 2**20:.0f} MiB; inputs {bytes_in(folder / 'photos') / 2**20:.1f} MiB")
            for stage, seconds in stages.items():
                kept = bytes_in(folder / "results" / stage)
                print(f"  {stage:<12} {seconds:7.2f} s {kept / 2**10:9.0f} KiB")
            again = timed(["run", str(folder), "--device", "cpu", "--quiet"])
            print(f"  up to date   {again[0]:7.2f} s ({again[1]:.2f} s of processor), with the "
                  "start of the program")
            out = str(Path(name) / "out")
            words = ["batch", str(folder), "--device", "cpu", "--workers", "1", "-o", out,
                     "--quiet"]
            for what in ("up to date", "by manifest"):
                taken, used, _ = timed(words)
                print(f"  batch, {what:<12} {taken:7.2f} s ({used:.2f} s of processor)")
            shutil.rmtree(out)


# ---- the scheduler

def tasks(count: int, workers: int) -> None:
    """Seconds that Dask adds to each task: empty ones, and ones that sleep, for which the rest of
    the time is the scheduler's. They are given in parts, so that memory is bounded.
    """
    import dask
    from distributed import Client, LocalCluster
    dask.config.set({"distributed.worker.memory.terminate": False})
    with LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None,
                      silence_logs=50) as cluster, Client(cluster) as client:
        for words, seconds in (("empty", 0.0), ("sleeping 10 ms", 0.01), ("sleeping 0.1 s", 0.1)):
            each = count if seconds < 0.1 else min(count, 600)
            started, parts = time.perf_counter(), [time.process_time()]
            for first in range(0, each, TASKS_AT_ONCE):
                numbers = range(first, min(first + TASKS_AT_ONCE, each))
                client.gather(client.map(rest, [seconds] * len(numbers), numbers, pure=False))
                parts.append(time.process_time())
            taken, used = time.perf_counter() - started, np.diff(parts)
            ideal = seconds * each / workers
            peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**10
            print(f"{each} {words} tasks on {workers} workers: {taken:.1f} s, "
                  f"{(taken - ideal) / each * 1e3:.2f} ms a task beyond them; scheduler and client "
                  f"{used.sum() / each * 1e3:.2f} ms of processor a task (first part {used[0]:.1f} "
                  f"s, last {used[-1]:.1f} s), {peak:.0f} MiB", flush=True)


def rest(seconds: float, number: int) -> int:
    """A task that uses no processor."""
    if seconds:
        time.sleep(seconds)
    return number


# ---- what follows

SESSION_S, SCENE_S = 4.0, 5.2        # of one core: flat samples, a box
SCHEDULED_S = 1.3e-3                # of one core: a task, in Dask's scheduler and the client
READ_S, GIVEN_S = 0.8e-3, 4e-5      # in the command: a session read, rows given to a worker
READ = 12                           # bytes for a pixel, of three half floats that are read twice
WRITTEN = {"low rank": (0.43e-6, 26), "spectra": (0.75e-6, 56)}     # s of one core, bytes, to Zarr
DISK = 2e9                          # bytes a second: assumed of the file system that all share
TASK_PIXELS = 31_623 * 256          # of one task in a picture of a gigapixel, looked at and written


def model() -> None:
    """What sessions and pixels take on many workers, by the figures above."""
    for workers in (1, 10, 100, 1000, 10_000):
        found = {"10 000 sessions": {
            "workers": 10_000 * SESSION_S / workers,
            "the command that feeds them": 10_000 * (READ_S + SCHEDULED_S)}}
        for kind, (seconds, size) in WRITTEN.items():
            found[f"10^12 pixels, {kind}"] = {
                "workers": 1e12 * seconds / workers,
                "the file system": 1e12 * (size + READ) / DISK,
                "the command that feeds them": 2e12 / TASK_PIXELS * (SCHEDULED_S + GIVEN_S)}
        for what, times in found.items():
            decides = max(times, key=lambda name: times[name])
            each = ", ".join(f"{name} {value / 3600:.3f}" for name, value in times.items())
            print(f"{workers:6d} workers, {what}: {times[decides] / 3600:.3f} h by {decides}; "
                  f"hours of each: {each}")


# ---- common

# What a process has held at most starts with what its parent held: a small one stands between.
MEASURED = """
import resource, subprocess, sys, time
started = time.perf_counter()
code = subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL).returncode
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(time.perf_counter() - started, used.ru_utime + used.ru_stime, used.ru_maxrss * 1024)
sys.exit(code)
"""


def timed(words: list[str]) -> tuple[float, float, int]:
    """Seconds, seconds of processor, and bytes of memory at most, of one command of ours."""
    return measured([sys.executable, "-m", "spectrabox", *words])


def measured(words: list[str]) -> tuple[float, float, int]:
    """The same of any command."""
    done = subprocess.run([sys.executable, "-c", MEASURED, *words], capture_output=True, text=True,
                          check=False)
    if done.returncode:
        raise SystemExit(f"{' '.join(words)} failed")
    taken, used, peak = (float(word) for word in done.stdout.split())
    return taken, used, round(peak)


def bytes_in(folder: Path) -> int:
    """Of all files in a folder."""
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


if __name__ == "__main__":
    main()
