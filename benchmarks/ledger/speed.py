"""Speed and weight: processor time of whole commands, memory, lines of code. Printed, never judged.

Times are in those of `import numpy, scipy.optimize` on the same machine, the least of ROUNDS each;
on a busy machine even such ratios lie by a factor of two.
"""
from __future__ import annotations

import ast
import io
import subprocess
import sys
import tempfile
import tokenize
from collections.abc import Iterator
from pathlib import Path

from benchmarks.bench_front_door import CAMERA, LIGHT, Checkout, with_picture, with_signals
from benchmarks.ledger.recorded import ROOT
from benchmarks.ledger.task import Task

ROUNDS = 2
ROOMS = {room: room for room in ("radiometry", "capture", "calibrate", "reconstruct", "sampling",
                                 "measure", "session")} | {"api": "spectrabox/api"}
UNIT = [sys.executable, "-c", "import numpy, scipy.optimize"]
FLAT_SIZE = (400, 600)
COMMANDS = {
    "status": ("status", "SESSION"),
    "run unchanged": ("run", "SESSION"),
    "report": ("report", "SESSION"),
    "flat": ("flat", "SESSION/first.dng", "--session", "SESSION/flat"),
    "sample of 1,000": ("sample", "--sensitivity", CAMERA, "--light", LIGHT, "--json", "--signals",
                        "SESSION/signals.csv"),
    "uplift of 1 Mpx": ("uplift", "SESSION/picture.exr", "-o", "SESSION/uplifted",
                        "--sensitivity", CAMERA, "--light", LIGHT)}
# runs a command and says its processor seconds and memory: a process of its own, since a command
# counts the memory of the process that starts it as its own
LAUNCHER = """
import resource, subprocess, sys
ran = subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL)
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(used.ru_utime + used.ru_stime, used.ru_maxrss)
sys.exit(ran.returncode)
"""
QUIET = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT,
         tokenize.ENDMARKER}


def tasks(data: Path | None) -> Iterator[Task]:
    """One task for all commands, so that they share a session and a unit."""
    yield Task("speed/commands", "all", commands)
    yield Task("speed/code", "all", code)


def commands() -> dict[str, float]:
    """Time of every command and the largest memory of some."""
    figures = {}
    with tempfile.TemporaryDirectory() as written:
        session = Path(written) / "box"
        for words in (("demo", str(session)), ("run", str(session))):
            spent([sys.executable, "-m", "spectrabox", *words])
        checkout = Checkout(ROOT, session)
        with_signals(checkout)
        with_picture(checkout)
        outlined = flat_photo(session / "first.dng")
        unit = min(spent(UNIT)[0] for _ in range(ROUNDS + 1))
        for name, words in COMMANDS.items():
            times, memory = [], []
            for _ in range(ROUNDS):
                for made in ("flat", "uplifted"):
                    subprocess.run(["rm", "-rf", session / made], check=True)
                typed = [word.replace("SESSION", str(session)) for word in words]
                seconds, megabytes = spent([sys.executable, "-m", "spectrabox", *typed,
                                            *(outlined if name == "flat" else ())])
                times.append(seconds)
                memory.append(megabytes)
            figures[f"times, {name}"] = min(times) / unit
            if name in ("flat", "uplift of 1 Mpx", "report"):
                figures[f"MB, {name}"] = min(memory)
    return figures


def flat_photo(path: Path) -> list[str]:
    """Write a shoot of the ledger; the options that outline its samples."""
    import numpy as np

    from spectrabox.fixtures import near_lamps

    from benchmarks.ledger import simulated
    rng = np.random.default_rng(simulated.SEED)
    _, shoot = simulated.drawn_shoot("faultless", rng)
    near_lamps.photograph(path, shoot, [(near_lamps.drawn_lamp(rng), simulated.drawn_light(rng))],
                          rng)
    return [word for name, corners in simulated.regions().items()
            for word in ("--region", f"{name}={','.join(f'{value:.0f}' for value in corners)}")]


def spent(words: list[str]) -> tuple[float, float]:
    """Processor seconds and largest memory in MB of a command.

    Raises
    ------
    RuntimeError
        If it fails.
    """
    ran = subprocess.run([sys.executable, "-S", "-c", LAUNCHER, *words], cwd=ROOT,
                         capture_output=True, text=True, check=False)
    if ran.returncode:
        raise RuntimeError(f"{' '.join(words[2:])} ended in {ran.returncode}: "
                           f"{ran.stderr.strip()[-300:]}")
    seconds, kilobytes = map(float, ran.stdout.split())
    return seconds, kilobytes / 1024


def code() -> dict[str, float]:
    """Lines of code of every room."""
    return {f"lines, {room}": float(sum(lines_of(path.read_text(encoding="utf-8"))
                                        for path in (ROOT / folder).rglob("*.py")))
            for room, folder in ROOMS.items()}


def lines_of(source: str) -> int:
    """Lines that hold code: no blanks, comments and docstrings."""
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type not in QUIET:
            lines.update(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef) \
                and ast.get_docstring(node, clean=False) is not None:
            first = node.body[0]
            lines.difference_update(range(first.lineno, (first.end_lineno or 0) + 1))
    return len(lines)
