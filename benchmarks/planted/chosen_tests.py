"""Which test files concern a module: those nearest to it by imports, cheap ones first."""
from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

from benchmarks.planted.mistake import Mistake

ROOT = Path(__file__).resolve().parents[2]
ROOMS = ("radiometry", "capture", "calibrate", "reconstruct", "sampling", "measure", "session",
         "fixtures", "spectrabox/api")


def module_of(file: Path) -> str:
    """The name that a source file is imported by."""
    parts = file.with_suffix("").parts
    return ".".join(parts if parts[0] == "spectrabox" else ("spectrabox", *parts))


@cache
def public_names() -> dict[str, str]:
    """The module of each public name, from the stub of the package."""
    stub = ast.parse((ROOT / "spectrabox" / "__init__.pyi").read_text(encoding="utf-8"))
    return {alias.name: f"spectrabox.{node.module}" for node in ast.walk(stub)
            if isinstance(node, ast.ImportFrom) for alias in node.names}


@cache
def sources() -> dict[str, Path]:
    """Every module of the project and of its tests by the name that it is imported by."""
    found = {module_of(path.relative_to(ROOT)): path
             for room in ROOMS for path in (ROOT / room).rglob("*.py")}
    tests = sorted((ROOT / "tests").rglob("*.py"), key=lambda path: -len(path.parts))
    return found | {path.stem: path for path in tests}      # the outer conftest is the one meant


@cache
def imports(module: str) -> frozenset[str]:
    """Modules of the project that a module imports anywhere in its text, or names in a string: the
    stages are called so. A public name, ``sb.flat``, is of its module.
    """
    names: set[str] = set()
    for node in ast.walk(ast.parse(sources()[module].read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            of = node.module.removeprefix("tests.")     # tests are known by their own names
            names |= {of, *(alias.name if of == "tests" else f"{of}.{alias.name}"
                            for alias in node.names)}
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) \
                and node.value.id in ("sb", "spectrabox") and node.attr in public_names():
            names.add(public_names()[node.attr])
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            stage = re.fullmatch(r"\.\w+", node.value)      # behind the name of its room
            names |= {node.value, *(name for name in sources()
                                    if stage and name.endswith(node.value))}
    if module.startswith("test_"):
        names.add("conftest")
    return frozenset(names & sources().keys())


@cache
def distances(test: str) -> dict[str, int]:
    """Imports that lie between a test file and each module that it reaches."""
    reached, edge, steps = {test: 0}, {test}, 0
    while edge:
        steps += 1
        edge = {other for module in edge for other in imports(module)} - reached.keys()
        reached |= dict.fromkeys(edge, steps)
    return reached


def nearest_tests(file: str) -> list[tuple[int, str]]:
    """Distance and path of every test file that reaches a source file, nearest first."""
    module = module_of(Path(file))
    tests = [name for name in sources() if name.startswith("test_")]
    return sorted((distances(test)[module], str(sources()[test].relative_to(ROOT)))
                  for test in tests if module in distances(test))


def running_functions(mistake: Mistake) -> set[str]:
    """Names of the functions of a file that run the line of a mistake: the one that holds it, and
    those that name such a one.
    """
    text = (ROOT / mistake.file).read_text(encoding="utf-8")
    line = text.count("\n", 0, text.index(mistake.old) + len(mistake.old) // 2) + 1
    bodies = [node for node in ast.parse(text).body
              if isinstance(node, ast.FunctionDef | ast.ClassDef)]
    named = {body.name: {node.id for node in ast.walk(body) if isinstance(node, ast.Name)}
             for body in bodies}
    found = {body.name for body in bodies if body.lineno <= line <= (body.end_lineno or 0)}
    while more := {name for name, uses in named.items() if uses & found} - found:
        found |= more
    return {name for name in found if not name.startswith("_")}
