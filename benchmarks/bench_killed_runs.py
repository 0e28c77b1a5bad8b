"""A session killed at its changes of files, one after the other, and started twice at once: does it
always end with the bits of a run that was left alone, and does anything stay behind?

The sessions are small ones of the two demos. Each kill falls on the next rename, or on another
opening, making or removing of a file: of a run from the beginning, of one that makes the last stage
and the outputs again, and, most of them, of one that makes a single stage again. All numbers of the
session are compared. Runs are processes forked from one that has loaded the libraries.

    python -m benchmarks.bench_killed_runs [--kills 200] [--double-starts 40] [--json]
"""
from __future__ import annotations

import argparse
import json
import resource
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from spectrabox.fixtures.demo_session import write_demo_session
from spectrabox.fixtures.flat_demo import write_flat_demo

from benchmarks.forked_commands import forked, in_a_child, load_libraries
from benchmarks.killed_runs import kill_at, leftovers, results_of

RUN = ("--device", "cpu")
POINTS = {"rename": 12, "change": 60}     # of a whole run
STAGE_POINTS = {"rename": 2, "change": 16}      # of a single stage


@dataclass(frozen=True)
class Trials:
    """A session as it is before its first run and after it."""

    fresh: Path
    finished: Path
    wanted: dict[str, str]

    @property
    def stages(self) -> list[str]:
        return sorted(path.name for path in (self.finished / "results").iterdir()
                      if path.is_dir() and path.name != "report")


def scene_session(folder: Path) -> None:
    """The scene demo with small photos, few steps and few draws."""
    write_demo_session(folder, 1, size=(208, 312), spp=4)
    _rewrite(folder, {"width = 96": "width = 40", "draws = 4000": "draws = 1000"})


def flat_session(folder: Path) -> None:
    """The flat demo with a small photo, half of its chart and two regions."""
    write_flat_demo(folder, 1, size=(416, 624))
    text = (folder / "session.toml").read_text(encoding="utf-8")
    head, *regions = text.split("[regions.")
    half = f"[chart]\nleave_out = {list(range(2, 25, 2))}\n\n"
    _rewrite(folder, {text: f"{head}{half}[regions." + "[regions.".join(regions[:2])})


def _rewrite(folder: Path, words: dict[str, str]) -> None:
    text = (folder / "session.toml").read_text(encoding="utf-8")
    for before, now in words.items():
        assert before in text
        text = text.replace(before, now)
    (folder / "session.toml").write_text(text, encoding="utf-8")


def prepared(scratch: Path) -> list[Trials]:
    """Both sessions, each run once without a disturbance.

    Raises
    ------
    RuntimeError
        If such a run does not end well.
    """
    made = []
    for write in (scene_session, flat_session):
        fresh, finished = scratch / f"{write.__name__}-fresh", scratch / write.__name__
        in_a_child(partial(write, fresh))     # a renderer starts threads, which no fork keeps
        shutil.copytree(fresh, finished)
        if said := finish(finished, ()):
            raise RuntimeError(f"the undisturbed run of the {write.__name__} failed: {said}")
        made.append(Trials(fresh, finished, results_of(finished)))
    return made


def finish(folder: Path, only: tuple[str, ...]) -> str:
    """Run a session that nobody disturbs; what it said if it failed."""
    run = forked(("run", str(folder), *RUN, *only), folder.parent / "said")
    return run.said.read_text() if run.wait() else ""


def stale_copy(trials: Trials, number: int, folder: Path) -> tuple[str, ...]:
    """A session in which something is to be made; options that make it."""
    if number % 10 == 0:
        shutil.copytree(trials.fresh, folder)
        return ()
    shutil.copytree(trials.finished, folder)
    if number % 5 == 0:
        shutil.rmtree(folder / "results" / "sample")
        return ()
    stages = [name for name in trials.stages if name != "sample"]      # it writes the outputs too
    stage = stages[number // 2 % len(stages)]
    return ("--only", stage, "--force")


def kill_trial(trials: Trials, number: int, folder: Path) -> tuple[str, tuple[str, ...]]:
    """One run killed at a change of a file; what happened, and the options that repeat it."""
    only = stale_copy(trials, number, folder)
    event = ("rename", "change")[number % 2]
    points = (STAGE_POINTS if only else POINTS)[event]
    at = 1 + (number // 2 * 7) % points
    code = forked(("run", str(folder), *RUN, *only), folder.parent / "killed",
                  lambda: kill_at(at, event)).wait()
    what = f"a stage, at a {event}" if only else f"a run, at a {event}"
    return what if code == -signal.SIGKILL else f"{what} that it did not reach", only


def double_start(trials: Trials, number: int, folder: Path) -> tuple[str, tuple[str, ...]]:
    """Two runs at once; how they ended, and the options that repeat them."""
    only = stale_copy(trials, number or 1, folder)
    runs = []
    for which in ("first", "second"):
        runs.append(forked(("run", str(folder), *RUN, *only, "--json"), folder.parent / which))
        time.sleep(number % 8 * 0.1)
    codes = [run.wait() for run in runs]
    told = all("works in this session" in run.said.read_text()
               for run, code in zip(runs, codes, strict=True) if code)
    return f"exit codes {sorted(codes)}{'' if told else ', NOT SAID'}", only


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--double-starts", type=int, default=6)
    parser.add_argument("--json", action="store_true", help="one object on standard output")
    arguments = parser.parse_args()
    counts: Counter[str] = Counter()
    load_libraries()
    with tempfile.TemporaryDirectory() as name:
        sessions = prepared(Path(name))
        plan = [(trial, number) for trial, count in (
            (kill_trial, arguments.kills), (double_start, arguments.double_starts))
            for number in range(count)]
        for trial, number in plan:
            trials = sessions[number // 2 % 4 != 3]     # one of four is the scene
            folder = Path(name) / "trial"
            said, only = trial(trials, number, folder)
            failure = finish(folder, only)
            bad = [what for what, is_so in (
                ("NOT FINISHED", failure), ("OTHER BITS", results_of(folder) != trials.wanted),
                ("LEFTOVERS", leftovers(folder))) if is_so]
            counts.update([f"{trial.__name__.replace('_', ' ')}: {said}", *bad])
            if bad or "NOT" in said:
                print(f"{trial.__name__} {number}: {said}, {bad}, {leftovers(folder)} {failure}",
                      file=sys.stderr, flush=True)
            if not number % 10:
                print(f"{trial.__name__} {number}: {dict(counts)}", file=sys.stderr, flush=True)
            shutil.rmtree(folder)
    failed = sum(count for what, count in counts.items() if "NOT" in what or what.isupper())
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    minutes = (used.ru_utime + used.ru_stime) / 60
    if arguments.json:
        print(json.dumps({"trials": len(plan), "bad": failed, "counts": dict(counts),
                          "processor_minutes": round(minutes, 1)}))
    else:
        print("\n".join(f"{count:5d}  {what}" for what, count in sorted(counts.items())))
        print(f"{failed} of {len(plan)} ended in anything but the bits of a run left alone, in "
              f"{minutes:.0f} minutes of processor")
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
