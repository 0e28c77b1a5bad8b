"""Commands with hostile files and option values, and in odd environments: how each case ended.

A case is a sound command with one thing wrong: an input damaged or exchanged for another thing, or
a value of an option; or its environment alone. A result is right, and so is one sentence with a
documented exit code. Every other end is printed with the words that repeat it. Cases run in forks
of a process that has imported the program; those of environments are processes of their own.

    python -m benchmarks.bench_hostile_inputs --folder /dev/shm/cases --cases 1000 --seed 3
"""
from __future__ import annotations

import argparse
import collections
import contextlib
import importlib
import json
import os
import pkgutil
import random
import resource
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from typer.main import get_command

from spectrabox.calibrate.geometry.board import read_board
from spectrabox.calibrate.geometry.projection import board_picture
from spectrabox.capture.photo.image_writers import write_exr, write_png
from spectrabox.fixtures import lamp
from spectrabox.fixtures.demos.demo_photos import camera_sensitivities
from spectrabox.fixtures.demos.demo_session import write_demo_session
from spectrabox.fixtures.mutations import NUMBERS, WORDS, mutated, rewritten
from spectrabox.fixtures.paints import NM, chart_copy
from spectrabox.session.cli import app
from spectrabox.session.cli import main as run_command

from tests.damaged_inputs import subjects
from tests.flat_example import write_flat

ROOT = Path(__file__).resolve().parent.parent
TYPED = tomllib.loads(Path(__file__).with_name("hostile_inputs.toml").read_text(encoding="utf-8"))
COMMANDS, ENVIRONMENTS, VALUES = TYPED["commands"], TYPED["environments"], TYPED["values"]
DOCUMENTED = range(8)
LIMIT_S, MEMORY_BYTES, PROCESSES = 90.0, 6 << 30, 64
RENDERING = ("relight", "geometry light")       # need threads, which a fork has not
NOT_GIVEN = ("--debug", "--json", "--help", "--cluster")
ANSWERED = ("batch", "check", "doctor", "chart")    # say with a result what is wrong
PLACES = ("missing", ".", "..", "/", "loop", "sealed.csv", "empty", "/dev/null", "/dev/zero", "-",
          "/proc/self/mem", "--", "~", "a\nb", "http://localhost/x", "x" * 5000, "\udce9.csv")
ROOMS = ("session", "measure", "capture", "calibrate", "sampling", "radiometry")
LIBRARIES = ("rawpy", "OpenImageIO", "cv2", "scipy.optimize", "scipy.stats", "colour")


def write_inputs(folder: Path) -> None:
    """Sound inputs of all commands; their sessions are finished."""
    kinds = {subject.name: subject.path for subject in subjects(folder / "kinds")}
    for name, kind in TYPED["files"].items():
        shutil.copy(kinds[kind], folder / name)
    shutil.copytree(kinds["camera database .csv"].parent, folder / "cameras")
    shutil.copy(folder / "cameras" / "b.csv", folder / "cameras" / "d.csv")
    write_flat(folder / "flat")
    for file in ("photos/sample.dng", "spectra/light.csv", "spectra/white_wall.csv"):
        shutil.copy(folder / "flat" / file, folder)
    rng = np.random.default_rng(8)
    for library in ("spectra", "more"):
        (folder / library).mkdir()
        write_rows(folder / library / "a.csv", np.arange(400, 701, 10),
                   *rng.uniform(0.1, 0.9, (40, 31)).cumsum(axis=1) / 31)
    write_rows(folder / "patches.csv", "RGB",
               *chart_copy(rng) @ (camera_sensitivities() * lamp.radiance(NM)).T)
    (folder / "white.csv").write_text("nm,white\n400,0.8\n700,0.8\n")
    (folder / "wall.toml").write_text(TYPED["wall"])
    (folder / "sessions").write_text("flat\n")
    (folder / "points.toml").write_text("".join(
        f"[points.p{number}]\nscene = [{x}, {y}, {z}]\n"
        f"px = [{325 + 70 * x / (1 + z / 9)}, {236 + 70 * y / (1 + z / 9)}]\n"
        for number, (x, y, z) in enumerate(rng.uniform(-1, 1, (6, 3)).round(2))))
    write_exr(folder / "wide.exr", rng.uniform(0.3, 0.5, (480, 640, 3)), ("R", "G", "B"), 0.1)
    board = 50 + 0.6 * board_picture(read_board(folder / "board.toml"), 40)[..., None]
    noisy = np.repeat(board, 3, axis=2) + rng.normal(0, 2, (*board.shape[:2], 3))
    write_png(folder / "board.png", noisy.astype(np.uint8))
    write_demo_session(folder / "box", 1, size=(208, 312), spp=4)
    session = folder / "box" / "session.toml"
    session.write_text(session.read_text().replace("width = 96", "width = 40\nsteps = 80"))
    for name in ("flat", "box"):
        subprocess.run([sys.executable, "-m", "spectrabox", "run", folder / name, "-q"],
                       check=True, stdout=subprocess.DEVNULL)


def write_rows(path: Path, *rows: Iterable[Any]) -> None:
    """A CSV of rows."""
    path.write_text("\n".join(",".join(map(str, row)) for row in rows))


def spoil_option(rng: random.Random, words: list[str]) -> None:
    """Give one option of a command a value that does harm."""
    node = get_command(app)
    for word in words[:2]:
        node = getattr(node, "commands", {}).get(word, node)
    names = [max(each.opts, key=len) for each in node.params
             if each.opts[0].startswith("-") and not getattr(each, "is_flag", False)]
    option = rng.choice([name for name in names if name not in NOT_GIVEN] or ["--device"])
    if option not in words:
        words += [option, VALUES.get(option, "1")]
    at, kind = words.index(option) + 1, rng.randrange(4)
    value = rng.choice(PLACES) if kind == 0 else os.fsdecode(
        rng.choice(NUMBERS + WORDS) if kind == 1
        else rewritten(os.fsencode(words[at]), rng.randrange(10**6)))
    words[at] = value.replace("\0", "")[:100_000]


def spoil_file(rng: random.Random, words: list[str], work: Path, kinds: Path) -> None:
    """Damage one of the files in a folder, or put another thing in its place."""
    paths = sorted(path for path in work.iterdir()
                   if path.name not in ("loop", "sealed.csv", "empty"))
    if not paths:
        spoil_option(rng, words)
        return
    path = rng.choice(paths)
    if path.is_dir() and rng.random() < 0.9:
        path = rng.choice(sorted(file for file in path.rglob("*") if file.is_file()))
    content = None if path.is_dir() else path.read_bytes()
    damage = rng.choice((mutated, rewritten, None))
    if content is not None and damage is not None:
        path.write_bytes(damage(content, rng.randrange(10**6)))
        return
    shutil.rmtree(path) if content is None else path.unlink()
    other = rng.choice(sorted(file for file in kinds.rglob("*") if file.is_file()))
    rng.choice((lambda: shutil.copy(other, path), lambda: shutil.copy(other, path), path.mkdir,
                path.touch, lambda: path.symlink_to(path.name), lambda: path.touch(0),
                lambda: path.symlink_to("/dev/zero")))()


def run_forked(words: list[str], case: Path) -> None:
    """Run a command in this process, and leave it."""
    for number, name in ((1, "stdout"), (2, "stderr")):
        os.dup2(os.open(case / name, os.O_WRONLY | os.O_CREAT), number)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    resource.setrlimit(resource.RLIMIT_NPROC, (PROCESSES, PROCESSES))
    sys.argv = ["spectrabox", *words]
    code = 0
    try:
        run_command()
    except SystemExit as left:
        code = left.code if isinstance(left.code, int) else int(left.code is not None)
    with contextlib.suppress(OSError):
        sys.stdout.flush()
    os._exit(code)


def exit_code(words: list[str], case: Path, shell: str | None) -> int | None:
    """Of a command, in a process of its own behind words of a shell; None where it did not end."""
    sys.stdout.flush()
    child = os.fork()
    if child == 0:
        os.setsid()
        os.chdir(case / "work")
        os.environ |= {"HOME": str(case / "home"), "TMPDIR": str(case / "tmp"),
                       "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
        if shell is None:
            run_forked(words, case)
        run = subprocess.run(["bash", "-c", f'{shell} exec "$@"', "-", sys.executable, "-m",
                              "spectrabox", *words], capture_output=True, check=False,
                             stdin=subprocess.DEVNULL)
        (case / "stdout").write_bytes(run.stdout)
        (case / "stderr").write_bytes(run.stderr)
        os._exit(run.returncode % 256)
    started = time.monotonic()
    while (ended := os.waitpid(child, os.WNOHANG))[0] == 0:
        if time.monotonic() - started > LIMIT_S:
            os.killpg(child, signal.SIGKILL)
            os.waitpid(child, 0)
            return None
        time.sleep(0.004)
    with contextlib.suppress(ProcessLookupError):
        os.killpg(child, signal.SIGKILL)
    return os.waitstatus_to_exitcode(ended[1])


def end_of(words: list[str], code: int | None, case: Path, shell: str) -> str:
    """"result", "sentence", or what is wrong."""
    out, err = ((case / name).read_text(errors="replace") if (case / name).exists() else ""
                for name in ("stdout", "stderr"))
    if code not in DOCUMENTED or code == 1:
        return "no end" if code is None else f"code {code}"
    for sign in ("Traceback", "unexpected ", "Exception ignored", "Warning:", "\x1b", "leaked"):
        if sign in err:
            return f"standard error holds {sign!r}"
    if list((case / "tmp").iterdir()):
        return "files left behind"
    if code != 2 and ">" not in shell:      # both streams are there
        if "--json" in words:
            try:
                answer = json.loads(out, parse_constant=float.fromhex)
            except ValueError:      # also of NaN
                return f"no JSON with code {code}"
            if code and "error" not in answer and words[0] not in ANSWERED:
                return f"no sentence in JSON with code {code}"
        if code and not err.strip() and words[0] not in ANSWERED:
            return f"no sentence with code {code}"
    return "sentence" if code else "result"


def run_case(name: str, environment: str, rng: random.Random, case: Path, inputs: Path) -> str:
    """How one case ended, told where it is wrong."""
    for folder in ("work", "home", "tmp"):
        (case / folder).mkdir()
    words, work = shlex.split(COMMANDS[name]), case / "work"
    names = {path.name for path in inputs.iterdir()}
    for word in names.intersection(part for each in words for part in each.split("=")):
        copy = shutil.copytree if (inputs / word).is_dir() else shutil.copy
        copy(inputs / word, work / word)
    words = words[:words.index("#")] if "#" in words else words
    words += ["--json"] if rng.random() < 0.85 else []
    (work / "loop").symlink_to("loop")
    (work / "sealed.csv").touch(0)
    (work / "empty").touch()
    if not environment and rng.random() < 0.5:
        spoil_option(rng, words)
    elif not environment:
        spoil_file(rng, words, work, inputs / "kinds")
    shell = ENVIRONMENTS[environment] if environment else "" if name in RENDERING else None
    started = time.monotonic()
    code = exit_code(words, case, shell)
    end = end_of(words, code, case, shell or "")
    if end not in ("result", "sentence"):
        error = (case / "stderr").read_text(errors="replace") if (case / "stderr").exists() else ""
        print(f"[{name}] {environment} {end} after {time.monotonic() - started:.1f} s\n    "
              f"{shlex.join(word[:200] for word in words)}\n    {error.strip()[-600:]}")
    return end


def main() -> None:
    """Run cases; print the wrong ones, and a table of all."""
    parser = argparse.ArgumentParser(description="hostile inputs and odd environments")
    parser.add_argument("--folder", type=Path, required=True, help="takes inputs and cases")
    parser.add_argument("--cases", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--commands", default=",".join(COMMANDS))
    parser.add_argument("--environments", action="store_true", help="in place of hostile inputs")
    options = parser.parse_args()
    if os.geteuid() == 0:
        parser.error("run this as an ordinary user: root may write over /dev/null")
    if not (options.folder / "inputs").exists():
        write_inputs(options.folder / "inputs")
    signal.signal(signal.SIGINT, signal.default_int_handler)    # also in the background of a shell
    warnings.simplefilter("ignore")     # of modules that are imported where they are not needed
    for room in ROOMS:
        package = importlib.import_module(f"spectrabox.{room}")
        for each in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            if "render" not in each.name and "cluster" not in each.name:
                importlib.import_module(each.name)
    for library in LIBRARIES:
        importlib.import_module(library)
    ends: dict[str, collections.Counter[str]] = collections.defaultdict(collections.Counter)
    with contextlib.suppress(KeyboardInterrupt):    # the table is of the cases until then
        for seed in range(options.seed, options.seed + options.cases):
            rng = random.Random(seed)
            name = rng.choice(options.commands.split(","))
            environment = rng.choice(list(ENVIRONMENTS)) if options.environments else ""
            case = Path(tempfile.mkdtemp(dir=options.folder))
            end = run_case(name, environment, rng, case, options.folder / "inputs")
            ends[environment or name][end] += 1
            subprocess.run(["chmod", "-R", "u+rwx", case], check=False, stderr=subprocess.DEVNULL)
            shutil.rmtree(case, ignore_errors=True)
    print("| | cases | results | sentences | wrong |\n|---|--|--|--|--|")
    for name, counts in sorted(ends.items()):
        right = (counts["result"], counts["sentence"])
        row = (name, counts.total(), *right, counts.total() - sum(right))
        print(f"| {' | '.join(map(str, row))} |")


if __name__ == "__main__":
    main()
