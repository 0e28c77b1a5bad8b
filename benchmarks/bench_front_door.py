"""Whole commands as an operator types them, and stages beside what else does their work: one table.

Of a command, wall time of the process, the least of five; the alternative is the same command of
another checkout, run in turn (``--before FOLDER``, a checkout with its own ``.venv``), or else the
time it is to take. The other rows compare two ways within this process: decoding with rawpy's own
development, exact bounds with HiGHS, draws with hopsy's where it is installed, the inversion with
gradient descent through the renderer (minutes; left out by ``--commands``).
"""
from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from spectrabox.sampling.prior.mixture import load_prior, reflectance
from spectrabox.session.signals.signal_options import response_of_names

from benchmarks.bench_uplift import write_picture

ROOT = Path(__file__).resolve().parent.parent
ROUNDS = 5
CAMERA, LIGHT = "CIE 1931 2 Degree Standard Observer", "D65"
SAMPLE = ("sample", "--sensitivity", CAMERA, "--light", LIGHT, "--json")


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


def with_signals(session: Path) -> None:
    """1000 signals of spectra drawn from the prior, beside the session."""
    path, prior = session / "signals.csv", load_prior()
    if not path.exists():
        rng = np.random.default_rng(5)
        counts = rng.multinomial(1000, prior.weights / prior.weights.sum())
        logits = [rng.multivariate_normal(mean, covariance, count) for mean, covariance, count
                  in zip(prior.means, prior.covariances, counts, strict=True)]
        signals = reflectance(np.vstack(logits)) @ response_of_names(CAMERA, LIGHT).T
        np.savetxt(path, signals, delimiter=",", header="X,Y,Z", comments="")


def with_picture(session: Path) -> None:
    """A picture of one megapixel, beside the session."""
    if not (session / "picture.exr").exists():
        write_picture(session / "picture.exr", 1000, 1000)


COMMANDS = (
    Command("--help", ("--help",), 0.3),
    Command("sample, 1000 signals", (*SAMPLE, "--signals", "SESSION/signals.csv"), 4.0,
            with_signals),
    Command("sample, one signal", (*SAMPLE, "--signal", "0.3,0.4,0.2"), 1.0),
    Command("uplift, one megapixel", ("uplift", "SESSION/picture.exr", "-o", "SESSION/uplifted",
                                      "--sensitivity", CAMERA, "--light", LIGHT), 6.0,
            with_picture),
    Command("status", ("status", "SESSION"), 0.4),
    Command("check of the demo", ("check", "SESSION"), 1.2),
    Command("run of the demo from nothing", ("run", "SESSION"), 6.0, without_results),
    Command("run, nothing changed", ("run", "SESSION"), 0.8),
    Command("report", ("report", "SESSION"), 2.0),
    Command("camera fit of a photo", ("camera", "fit", "--chart", "SESSION/photos/chart.dng",
                                      "--light", "SESSION/spectra/light.csv", "--json"), 1.0),
)


@dataclass(frozen=True)
class Row:
    """One line of the table."""

    what: str
    ours: str
    alternative: str
    ratio: float | None             # of the alternative's time over ours


def seconds_of(checkout: Path, command: Command, session: Path) -> float:
    """Wall time of one process."""
    command.prepare(session)
    words = [word.replace("SESSION", str(session)) for word in command.words]
    environment = {**os.environ, "PYTHONPATH": str(checkout)}
    start = time.perf_counter()
    subprocess.run([checkout / ".venv" / "bin" / "spectrabox", *words], check=True, cwd=checkout,
                   env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return time.perf_counter() - start


def commands(folder: Path, before: Path | None, rounds: int) -> Iterator[Row]:
    """Rows of the commands."""
    checkouts = [ROOT, *([before.resolve()] if before else [])]
    sessions = [folder / str(number) for number in range(len(checkouts))]
    for checkout, session in zip(checkouts, sessions, strict=True):
        seconds_of(checkout, Command("demo", ("demo", "SESSION"), 0.0), session)
    for command in COMMANDS:
        times = [[seconds_of(checkout, command, session) for checkout, session
                  in zip(checkouts, sessions, strict=True)] for _ in range(rounds)]
        least = [min(column) for column in zip(*times, strict=True)]
        if before:
            yield Row(command.what, f"{least[0]:.2f} s", f"{least[1]:.2f} s before",
                      least[1] / least[0])
        else:
            yield Row(command.what, f"{least[0]:.2f} s", f"{command.target_s:.1f} s to reach",
                      command.target_s / least[0])


def where_a_run_goes(session: Path) -> list[str]:
    """Lines of a table: seconds of every stage of a run from nothing, and of all that is none."""
    without_results(session)
    start = time.perf_counter()
    ran = subprocess.run([sys.executable, "-m", "spectrabox", "run", str(session), "--json"],
                         check=True, cwd=ROOT, capture_output=True, text=True)
    whole = time.perf_counter() - start
    taken = {stage["name"]: stage["seconds"] for stage in json.loads(ran.stdout)["stages"]}
    taken["start, checks, report, files"] = whole - sum(taken.values())
    return [f"  {name:<40} {seconds:7.2f} s {100 * seconds / whole:5.0f} %"
            for name, seconds in {**taken, "whole": whole}.items()]


def stages(folder: Path) -> Iterator[Row]:
    """Rows of what has an alternative in the same process."""
    from spectrabox.reconstruct.rendering.renderer import start_mitsuba

    from benchmarks.bench_bulk_draws import bounds_row, bulk_row
    from benchmarks.bench_capture import decoding
    from benchmarks.bench_inversion import STEPS, small

    raw = decoding(folder, 24, 5)
    yield Row("24 megapixels of raw decoded", f"{raw['seconds']:.2f} s",
              f"{raw['postprocess_seconds']:.2f} s rawpy.postprocess", raw["ratio"])
    bounds = bounds_row(13, 1000)
    yield Row("exact bounds of a signal, N = 13, of 1000", f"{bounds['ms']:.2f} ms",
              f"{bounds['highs_ms']:.0f} ms HiGHS", bounds["ratio"])
    draws = bulk_row(13, 100_000)
    peer = draws["hopsy"]
    yield Row("effective uniform draws a second, N = 13", f"{draws['effective_per_s']:.2g}",
              f"{peer['effective_per_s']:.2g} hopsy" if peer else "hopsy is not installed",
              draws["effective_per_s"] / peer["effective_per_s"] if peer else None)
    start_mitsuba("cpu")
    inversion = small(STEPS)
    yield Row("inversion of a box, three materials", f"{inversion['transport']['seconds']:.2f} s",
              f"{inversion['gradient']['seconds']:.1f} s gradient descent",
              inversion["ratio_gradient"])


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--before", type=Path, help="another checkout, measured in turn")
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    parser.add_argument("--commands", action="store_true", help="only whole commands")
    asked = parser.parse_args()
    print(f"{'what':<42} {'ours':>9} {'alternative':>28} {'ratio':>7}")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        rows = [commands(folder, asked.before, asked.rounds)]
        if not asked.commands:
            rows.append(stages(folder))
        for row in (row for some in rows for row in some):
            ratio = "" if row.ratio is None else f"{row.ratio:.1f}"
            print(f"{row.what:<42} {row.ours:>9} {row.alternative:>28} {ratio:>7}", flush=True)
        print("\nwhere a run of the demo from nothing goes",
              *where_a_run_goes(folder / "0"), sep="\n")


if __name__ == "__main__":
    main()
