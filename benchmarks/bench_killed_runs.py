"""A session killed at its renames, one after the other, and started twice at once: does it always
end with the bits of a run that was left alone, and does anything stay behind?

The session is the demo's, small. Half of the trials run one or two late stages again, so that
replacements are cut too.

    python benchmarks/bench_killed_runs.py [--kills 200] [--double-starts 40] [--json]
"""
from __future__ import annotations

import argparse
import json
import shutil
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from spectrabox.fixtures.demo_session import write_demo_session

from benchmarks.killed_runs import killed_at, leftovers, results_of, started, was_killed

RUN = ("--device", "cpu")


def small_session(folder: Path) -> None:
    """The demo session with small photos, few steps and few draws."""
    write_demo_session(folder, 1, size=(208, 312), spp=4)
    text = (folder / "session.toml").read_text(encoding="utf-8")
    text = text.replace("width = 96", "width = 40").replace("draws = 4000", "draws = 1000")
    (folder / "session.toml").write_text(text, encoding="utf-8")


def finish(folder: Path) -> int:
    """Exit code of a run that nobody disturbs."""
    run = started("run", str(folder), *RUN, "--json")
    run.communicate()
    return run.returncode


def kill_trial(finished: Path, fresh: Path, number: int, scratch: Path) -> tuple[str, Path]:
    """One run killed at a rename, then finished; what happened, and the folder."""
    folder = scratch / f"kill-{number}"
    if number % 2:
        shutil.copytree(finished, folder)
        shutil.rmtree(folder / "results" / ("sample" if number % 4 == 1 else "reconstruct"))
        (folder / "report.html").unlink()
    else:
        shutil.copytree(fresh, folder)
    killed = was_killed(killed_at(1 + number // 2 % 15, "run", str(folder), *RUN))
    return ("killed" if killed else "ended before its kill"), folder


def double_start(finished: Path, number: int, scratch: Path) -> tuple[str, Path]:
    """Two runs at once; how they ended, and the folder."""
    folder = scratch / f"double-{number}"
    shutil.copytree(finished, folder)
    shutil.rmtree(folder / "results" / ("sample" if number % 2 else "reconstruct"))
    first = started("run", str(folder), *RUN, "--json")
    time.sleep(number % 8 * 0.25)
    second = started("run", str(folder), *RUN, "--json")
    answers = [run.communicate()[0] for run in (first, second)]
    codes = sorted((first.returncode, second.returncode))
    told = all("works in this session" in answer for answer, run
               in zip(answers, (first, second), strict=True) if run.returncode)
    return f"exit codes {codes[0]} and {codes[1]}{'' if told else ', NOT SAID'}", folder


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--double-starts", type=int, default=6)
    parser.add_argument("--json", action="store_true", help="one object on standard output")
    arguments = parser.parse_args()
    counts: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as name:
        fresh, finished = Path(name) / "fresh", Path(name) / "finished"
        small_session(fresh)
        shutil.copytree(fresh, finished)
        if finish(finished):
            print("the undisturbed run did not end well", file=sys.stderr)
            return 1
        wanted = results_of(finished)
        trials = [(kill_trial, (finished, fresh, number)) for number in range(arguments.kills)]
        trials += [(double_start, (finished, number)) for number in range(arguments.double_starts)]
        for trial, given in trials:
            said, folder = trial(*given, Path(name))  # type: ignore[operator]
            counts[f"{trial.__name__}: {said}"] += 1
            counts["NOT FINISHED"] += finish(folder) != 0
            counts["OTHER BITS"] += results_of(folder) != wanted
            counts["LEFTOVERS"] += leftovers(folder) != []
            shutil.rmtree(folder)
    bad = sum(count for what, count in counts.items() if "NOT" in what or what.isupper())
    if arguments.json:
        print(json.dumps({"trials": len(trials), "bad": bad, "counts": dict(counts)}))
    else:
        print("\n".join(f"{count:5d}  {what}" for what, count in sorted(counts.items())))
        print(f"{bad} of {len(trials)} ended in anything but the bits of a run left alone")
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
