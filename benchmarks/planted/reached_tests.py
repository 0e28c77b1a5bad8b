"""Which tests run the line that a mistake changes, and how long they take: told by a copy of the
tree in which each such line is preceded by one that says who runs it.

What another process runs is told too: it inherits the name of the test.
"""
from __future__ import annotations

import ast
import json
from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path

from benchmarks.planted.mistake import Mistake
from benchmarks.planted.scratch_tree import run_tests

HOURS = 7200.0          # of processor time, for one run of all tests

TELLER = '''
import contextlib, os
_TOLD = set()

def tell(key):
    who = os.environ.get("PLANTED_FIXTURE", "") or os.environ.get("PYTEST_CURRENT_TEST", "")
    if (key, who) not in _TOLD:
        _TOLD.add((key, who))
        with contextlib.suppress(Exception), open({log!r}, "a", encoding="utf-8") as stream:
            stream.write(key + "\\t" + who + "\\n")
'''

PLUGIN = '''
import json, os, time
import pytest

WIDE = ("session", "package", "module", "class")
seconds, shared = {{}}, {{}}

@pytest.hookimpl(wrapper=True)
def pytest_fixture_setup(fixturedef, request):
    before, since = os.environ.get("PLANTED_FIXTURE", ""), time.monotonic()
    if fixturedef.scope in WIDE:
        os.environ["PLANTED_FIXTURE"] = "fixture " + fixturedef.argname
    try:
        return (yield)
    finally:
        os.environ["PLANTED_FIXTURE"] = before
        took = round(time.monotonic() - since, 2)
        if fixturedef.scope in WIDE and took > 0.2:
            with open({prepared!r}, "a", encoding="utf-8") as stream:
                stream.write(fixturedef.argname + "\\t" + str(took) + "\\n")

def pytest_collection_modifyitems(items):
    for item in items:
        known = item._fixtureinfo.name2fixturedefs
        shared[item.nodeid] = [name for name, defs in known.items() if defs[-1].scope in WIDE]

def pytest_runtest_logreport(report):
    seconds[report.nodeid] = seconds.get(report.nodeid, 0) + report.duration
    if report.when == "teardown" and report.nodeid in shared:      # of the worker that ran it
        with open({log!r}, "a", encoding="utf-8") as stream:
            stream.write(json.dumps([report.nodeid, round(seconds[report.nodeid], 3),
                                     shared[report.nodeid]]) + "\\n")
'''


def marked(text: str, lines: dict[str, range]) -> str:
    """A source text in which a statement before each of some lines tells a key.

    Lines outside of functions, and those of functions that are compiled, are told by every other
    function of the file.
    """
    tree = ast.parse(text)
    everywhere = [key for key, place in lines.items() if not _mark(tree, key, place)]
    for function in _functions(tree):
        if not _compiled(function):
            for key in everywhere:
                function.body.insert(ast.get_docstring(function) is not None, _telling(key))
    return ast.unparse(ast.fix_missing_locations(tree))


def _telling(key: str) -> ast.stmt:
    return ast.parse(f"__import__('planted_teller').tell({key!r})").body[0]


def _functions(tree: ast.AST) -> list[ast.FunctionDef]:
    return [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]


def _compiled(function: ast.FunctionDef) -> bool:
    return any("jit" in ast.unparse(each) for each in function.decorator_list)


def _blocks(node: ast.AST) -> Iterator[list[ast.stmt]]:
    for each in ast.walk(node):
        for _, value in ast.iter_fields(each):
            if isinstance(value, list) and value and isinstance(value[0], ast.stmt):
                yield value


def _mark(tree: ast.Module, key: str, place: range) -> bool:
    """Whether a mark could be set right before the innermost statement that holds the lines."""
    inside = [function for function in _functions(tree) if function.body[0].lineno <= place.start
              and place.stop - 1 <= (function.end_lineno or 0)]
    if not inside or any(_compiled(function) for function in inside):
        return False
    found: tuple[int, list[ast.stmt], ast.stmt] | None = None
    for block in _blocks(inside[-1]):
        for statement in block:
            if statement.lineno <= place.start and place.stop - 1 <= (statement.end_lineno or 0):
                length = (statement.end_lineno or 0) - statement.lineno
                if found is None or length <= found[0]:
                    found = length, block, statement
    if found is None:       # several statements
        inside[-1].body.insert(ast.get_docstring(inside[-1]) is not None, _telling(key))
        return True
    _, block, statement = found
    block.insert(block.index(statement), _telling(key))
    return True


def mark_tree(tree: Path, mistakes: Sequence[Mistake], log: Path) -> None:
    """Have the lines that mistakes would change tell who runs them, in a file."""
    by_file = defaultdict(list)
    for mistake in mistakes:
        by_file[mistake.file].append(mistake)
    for file, own in by_file.items():
        path = tree / file
        text = path.read_text(encoding="utf-8")
        lines = {}
        for mistake in own:
            first = text.count("\n", 0, text.index(mistake.old)) + 1
            lines[mistake.name] = range(first, first + mistake.old.rstrip("\n").count("\n") + 1)
        path.write_text(marked(text, lines), encoding="utf-8")
    (tree / "planted_teller.py").write_text(TELLER.format(log=str(log)), encoding="utf-8")


def map_tests(tree: Path, mistakes: Sequence[Mistake], folder: Path,
              tests: Sequence[str]) -> None:
    """Run tests of a tree, which is marked, and keep who ran what in a folder."""
    for name in ("told.tsv", "items.jsonl", "shared.tsv"):
        (folder / name).write_text("", encoding="utf-8")
    mark_tree(tree, mistakes, folder / "told.tsv")
    (tree / "planted_items.py").write_text(PLUGIN.format(
        log=str(folder / "items.jsonl"), prepared=str(folder / "shared.tsv")),
                                           encoding="utf-8")
    run_tests(tree, ["-p", "planted_items", "-n", "auto", "--dist", "loadfile", *tests], HOURS,
              folder / "map.log", first_only=False)


class TestMap:
    """Who ran which line, as ``map_tests`` kept it in a folder."""

    def __init__(self, folder: Path) -> None:
        self._seconds: dict[str, float] = {}
        self._shared: dict[str, list[str]] = {}
        for line in (folder / "items.jsonl").read_text(encoding="utf-8").splitlines():
            test, seconds, shared = json.loads(line)
            self._seconds[test], self._shared[test] = seconds, shared
        self._of_shared: dict[str, float] = {}
        for line in (folder / "shared.tsv").read_text(encoding="utf-8").splitlines():
            name, _, seconds = line.partition("\t")
            self._of_shared[name] = max(float(seconds), self._of_shared.get(name, 0.0))
        self._told: dict[str, set[str]] = defaultdict(set)
        for line in (folder / "told.tsv").read_text(encoding="utf-8").splitlines():
            key, _, who = line.partition("\t")
            self._told[key].add(who)

    def tests_of(self, mistake: Mistake) -> list[str]:
        """Tests that run the lines of a mistake, cheap ones first."""
        whose = self._told.get(mistake.name, set())
        prepared = {who.removeprefix("fixture ") for who in whose if who.startswith("fixture ")}
        direct = {who.rpartition(" (")[0] for who in whose}
        tests = {test for test, shared in self._shared.items()
                 if test in direct or prepared.intersection(shared)}
        return sorted(tests, key=lambda test: self.cost(test, set()))

    def cost(self, test: str, ready: set[str]) -> float:
        """Seconds of a test, with what it shares with others as far as that is not ready."""
        return self._seconds[test] + sum(self._of_shared.get(name, 0.0)
                                         for name in self._shared[test] if name not in ready)

    def within(self, mistake: Mistake, budget_s: float) -> tuple[list[str], float, bool]:
        """Tests for a mistake, how long they take, and whether they are all that run its lines.

        One test always fits.
        """
        chosen: list[str] = []
        total, ready = 0.0, set[str]()
        tests = self.tests_of(mistake)
        for test in tests:
            cost = self.cost(test, ready)
            if chosen and total + cost > budget_s:
                continue
            chosen.append(test)
            total += cost
            ready |= set(self._shared[test])
        return chosen, total, len(chosen) == len(tests)
