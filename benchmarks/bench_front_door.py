"""Whole commands as an operator types them, and stages beside what else does their work: one table.

Of a command, wall time of the process, the least of five or of as many as fit into half a minute;
the alternative is the same command of another checkout, run in turn (``--before FOLDER``, with its
own ``.venv``), or else the time it is to take. The other rows compare two ways within this process:
decoding with rawpy's own development, exact bounds with HiGHS, uniform draws with hopsy's
(which the benchmark installs in ``build/hopsy``, or says that it cannot), the inversion with
gradient descent through the renderer. A second table says where the time of a run goes.

``--only WORDS`` measures the rows whose name holds the words. With ``--keep FOLDER`` sessions and
finished rows stay there, and a benchmark that was stopped goes on where it was.
"""
from __future__ import annotations

import argparse
import itertools
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.sampling.prior.mixture import load_prior, reflectance
from spectrabox.session.signals.signal_options import response_of_names

from benchmarks.bench_flat_speed import regions_of, write_colours
from benchmarks.bench_uplift import write_picture

ROOT = Path(__file__).resolve().parent.parent
ROUNDS, ENOUGH_S = 5, 30.0      # of one command of one checkout
LIMIT_S = 120.0                 # after which a process is stopped
FLAT_MEGAPIXELS = 24
CAMERA, LIGHT = "CIE 1931 2 Degree Standard Observer", "D65"
SAMPLE = ("sample", "--sensitivity", CAMERA, "--light", LIGHT, "--json")
RUN_TABLE = "where a run goes"


@dataclass(frozen=True)
class Checkout:
    """A program and the demo session that it made."""

    folder: Path
    session: Path

    def has(self, word: str) -> bool:
        """Whether there is such a command, or option."""
        asked = [word] if word.startswith("-") else [word, "--help"]
        return subprocess.run([self.folder / ".venv" / "bin" / "spectrabox", *asked],
                              cwd=self.folder, env={**os.environ, "PYTHONPATH": str(self.folder)},
                              capture_output=True, check=False).returncode == 0

    def call(self, *words: str, limit_s: float | None = None) -> float:
        """Wall time of a command; the limit where it takes longer and is stopped."""
        environment = {**os.environ, "PYTHONPATH": str(self.folder)}
        environment.pop("PYTHONDONTWRITEBYTECODE", None)    # installed modules are compiled
        start = time.perf_counter()
        try:
            subprocess.run([self.folder / ".venv" / "bin" / "spectrabox",
                            *(word.replace("SESSION", str(self.session)) for word in words)],
                           check=True, cwd=self.folder, env=environment, capture_output=True,
                           timeout=limit_s)
        except subprocess.TimeoutExpired as stopped:
            return float(stopped.timeout)
        except subprocess.CalledProcessError as fault:
            raise SystemExit(f"{self.folder}: spectrabox {' '.join(words)} failed: "
                             f"{fault.stderr.decode().strip()}") from None
        return time.perf_counter() - start


def finished(checkout: Checkout) -> None:
    """Results of all stages, and the report."""
    if not (checkout.session / "results" / "sample").is_dir():
        checkout.call("run", "SESSION")


def without_results(checkout: Checkout) -> None:
    """A session as it was captured."""
    shutil.rmtree(checkout.session / "results", ignore_errors=True)


def without_report(checkout: Checkout) -> None:
    """All results, and no report."""
    finished(checkout)
    (checkout.session / "report.html").unlink(missing_ok=True)


def with_signals(checkout: Checkout) -> None:
    """1000 signals of spectra drawn from the prior, beside the session."""
    path, prior = checkout.session / "signals.csv", load_prior()
    if not path.exists():
        rng = np.random.default_rng(5)
        counts = rng.multinomial(1000, prior.weights / prior.weights.sum())
        logits = [rng.multivariate_normal(mean, covariance, count) for mean, covariance, count
                  in zip(prior.means, prior.covariances, counts, strict=True)]
        signals = reflectance(np.vstack(logits)) @ response_of_names(CAMERA, LIGHT).T
        np.savetxt(path, signals, delimiter=",", header="X,Y,Z", comments="")


def with_picture(checkout: Checkout) -> None:
    """A picture of one megapixel, beside the session, and nothing made of it."""
    if not (checkout.session / "picture.exr").exists():
        write_picture(checkout.session / "picture.exr", 1000, 1000)
    shutil.rmtree(checkout.session / "uplifted", ignore_errors=True)


def with_flat_photo(checkout: Checkout) -> None:
    """A raw photo of a flat sample of 24 megapixels beside the session, and no session of it."""
    shutil.rmtree(checkout.session / "flat", ignore_errors=True)
    if not (checkout.session / "flat.dng").exists():
        write_colours(checkout.session / "flat.dng", FLAT_MEGAPIXELS)


@dataclass(frozen=True)
class Command:
    """One row: what is typed, in a demo session, and the time it is to take."""

    what: str
    words: tuple[str, ...]
    target_s: float
    prepare: Callable[[Checkout], None] = finished


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
    Command("check of the demo, never run", ("check", "SESSION"), 1.2, without_results),
    Command("run of the demo from nothing", ("run", "SESSION"), 6.0, without_results),
    Command("run, nothing changed", ("run", "SESSION"), 0.8),
    Command("report", ("report", "SESSION"), 2.0, without_report),
    Command("camera fit of a photo", ("camera", "fit", "--chart", "SESSION/photos/chart.dng",
                                      "--light", "SESSION/spectra/light.csv", "--json"), 1.0),
    Command("flat, 24 megapixels, three regions", ("flat", "SESSION/flat.dng", "--session",
                                                   "SESSION/flat", *regions_of(FLAT_MEGAPIXELS)),
            4.0, with_flat_photo),
)


@dataclass(frozen=True)
class Row:
    """One line of the table."""

    what: str
    ours: str
    alternative: str
    ratio: str              # of the alternative's time over ours


def row_of_command(command: Command, checkouts: list[Checkout], rounds: int) -> Row:
    """Times of a command in each checkout that has it, in turn."""
    checkouts = [checkout for checkout in checkouts if checkout.has(command.words[0])]
    times: list[list[float]] = [[] for _ in checkouts]
    for _ in range(rounds):
        for checkout, taken in zip(checkouts, times, strict=True):
            if sum(taken) < ENOUGH_S:
                command.prepare(checkout)
                taken.append(checkout.call(*command.words, limit_s=LIMIT_S))
    least = [min(taken) for taken in times]
    more = ["over " if seconds >= LIMIT_S else "" for seconds in least]
    other, name = (least[1], "before") if len(least) > 1 else (command.target_s, "to reach")
    return Row(command.what, f"{more[0]}{least[0]:.2f} s", f"{more[-1]}{other:.2f} s {name}",
               f"{more[-1]}{other / least[0]:.1f}")


def where_a_run_goes(checkout: Checkout) -> dict[str, float]:
    """Seconds of a run from nothing, from each line that it says to the next."""
    without_results(checkout)
    spent, now, what = dict[str, float](), time.perf_counter(), "start of the program, inputs read"
    ran = subprocess.Popen([sys.executable, "-m", "spectrabox", "run", str(checkout.session)],
                           cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    assert ran.stderr is not None
    for line in itertools.chain(ran.stderr, ["end"]):
        before, now = now, time.perf_counter()
        spent[what] = spent.get(what, 0.0) + now - before
        stage, _, words = line.strip().partition(" ")
        said = words.strip().replace("started", "")
        # a stage that says its seconds has ended, and been kept
        what = "between stages" if said.endswith(" s") else f"{stage} {said}".strip()
        if stage == "report" and said.endswith(".html"):
            what = "end of the program"
    if ran.wait():
        raise SystemExit("the run failed")
    return spent


def row_of_decoding(folder: Path) -> Row:
    """A raw photo of 24 megapixels."""
    from benchmarks.bench_capture import decoding
    raw = decoding(folder, 24, 5)
    return Row("", f"{raw['seconds']:.2f} s",
               f"{raw['postprocess_seconds']:.2f} s rawpy.postprocess", f"{raw['ratio']:.1f}")


def row_of_bounds(folder: Path) -> Row:
    """Exact bounds of many signals, without noise."""
    from benchmarks.bench_bulk_draws import bounds_row
    bounds = bounds_row(13, 1000)
    return Row("", f"{bounds['ms']:.2f} ms", f"{bounds['highs_ms']:.0f} ms HiGHS",
               f"{bounds['ratio']:.0f}")


def row_of_draws(folder: Path) -> Row:
    """Uniform draws a second, all independent."""
    from benchmarks.bench_bulk_draws import uniform_row
    fault = installed_hopsy()
    draws = uniform_row(13, 100_000)
    peer = draws["hopsy"]
    return Row("", f"{draws['per_second']:.2g}",
               f"{peer['effective_per_s']:.2g} hopsy" if peer else f"hopsy is missing: {fault}",
               f"{draws['per_second'] / peer['effective_per_s']:.0f}" if peer else "")


def row_of_inversion(folder: Path) -> Row:
    """Spectra of a box's three materials from its photo."""
    from spectrabox.reconstruct.rendering.renderer import start_mitsuba

    from benchmarks.bench_inversion import (
        PHOTO_SPP,
        RUNS,
        STEPS,
        by_gradient,
        by_transport,
        cornell_view,
    )
    start_mitsuba("cpu")
    view = cornell_view(64, 6, False, PHOTO_SPP).view
    by_transport(view)                      # compiles the kernels of both, which are not counted
    by_gradient(view, 4)
    ours = float(np.median([sum(by_transport(view, seed)[1:]) for seed in range(RUNS)]))
    theirs = by_gradient(view, STEPS)[1]
    return Row("", f"{ours:.2f} s", f"{theirs:.1f} s gradient descent", f"{theirs / ours:.0f}")


STAGES: dict[str, Callable[[Path], Row]] = {
    "24 megapixels of raw decoded": row_of_decoding,
    "exact bounds of a signal, N = 13, of 1000": row_of_bounds,
    "effective uniform draws a second, N = 13": row_of_draws,
    "inversion of a box, three materials": row_of_inversion,
}


def installed_hopsy() -> str:
    """Make hopsy importable, beside this environment; why it cannot be, or nothing."""
    try:
        import hopsy
        return ""
    except ImportError:
        target = ROOT / "build" / "hopsy"
    if not target.is_dir():
        asked = [sys.executable, "-m", "pip", "install", "-q", "--only-binary", ":all:", "--target",
                 str(target.with_suffix(".part")), "hopsy"]
        ran = subprocess.run(asked, capture_output=True, text=True, check=False)
        if ran.returncode:
            return "pip could not install it"
        target.with_suffix(".part").rename(target)
    sys.path.append(str(target))            # last: our own versions of NumPy and others stay
    try:
        import hopsy  # noqa: F401
        return ""
    except ImportError as fault:
        return str(fault)


def checkouts_of(folder: Path, before: Path | None) -> list[Checkout]:
    """This checkout and perhaps another, each with its demo session."""
    folders = [ROOT, *([before.resolve()] if before else [])]
    found = []
    for number, checkout in enumerate(folders):
        if not (checkout / ".venv" / "bin" / "spectrabox").exists():
            raise SystemExit(f"{checkout} has no .venv: make -C {checkout} setup")
        found.append(Checkout(checkout, folder / ("ours", "before")[number]))
        if not (found[-1].session / "session.toml").exists():
            found[-1].call("demo", "SESSION")
    return found


def rows(folder: Path, asked: argparse.Namespace, kept: dict[str, Any]) -> Iterator[Row]:
    """Rows whose names were asked for, those that are kept as they are."""
    def wanted(what: str) -> bool:
        return not asked.only or any(words.lower() in what.lower() for words in asked.only)

    checkouts: list[Checkout] = []
    for command in filter(lambda command: wanted(command.what), COMMANDS):
        if command.what not in kept:
            checkouts = checkouts or checkouts_of(folder, asked.before)
            kept[command.what] = asdict(row_of_command(command, checkouts, asked.rounds))
        yield Row(**kept[command.what])
    for what in () if asked.commands else filter(wanted, STAGES):
        if what not in kept:
            kept[what] = asdict(STAGES[what](folder)) | {"what": what}
        yield Row(**kept[what])
    if wanted(RUN_TABLE) and RUN_TABLE not in kept:
        kept[RUN_TABLE] = where_a_run_goes(checkouts_of(folder, None)[0])


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--before", type=Path, help="another checkout, measured in turn")
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    parser.add_argument("--commands", action="store_true", help="only whole commands")
    parser.add_argument("--only", action="append", metavar="WORDS",
                        help=f"only rows with these words; {RUN_TABLE!r} is one")
    parser.add_argument("--keep", type=Path, metavar="FOLDER",
                        help="of sessions and finished rows, for another call")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = asked.keep or Path(name)
        folder.mkdir(parents=True, exist_ok=True)
        store = folder / "rows.json"
        kept = json.loads(store.read_text()) if store.exists() else {}
        print(f"{'what':<42} {'ours':>9} {'alternative':>28} {'ratio':>9}")
        for row in rows(folder.resolve(), asked, kept):
            print(f"{row.what:<42} {row.ours:>9} {row.alternative:>28} {row.ratio:>9}", flush=True)
            store.write_text(json.dumps(kept, indent=1))
        store.write_text(json.dumps(kept, indent=1))
        if spent := kept.get(RUN_TABLE):
            whole = sum(spent.values())
            print("\nwhere a run of the demo from nothing goes")
            for what, seconds in {**spent, "whole": whole}.items():
                print(f"  {what:<40} {seconds:7.2f} s {100 * seconds / whole:5.0f} %")


if __name__ == "__main__":
    main()
