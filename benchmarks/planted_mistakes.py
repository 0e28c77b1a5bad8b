"""Plants realistic mistakes, one at a time, and says which of them the tests notice.

    python -m benchmarks.planted_mistakes [--only TEXT] [--budget 60] [--most 50] [--out FOLDER]
    python -m benchmarks.planted_mistakes --drawn 100 --seed 7 [--only calibrate/] [--tests FILE...]

Each mistake is one text of one file replaced by another (``benchmarks/planted/*.toml``), or drawn
by rule from the sources (``--drawn``: a seed that was never used is a set that nobody knows). It is
planted in a copy of the working tree, and the test files nearest to the module run until one fails
or the budget of processor time is spent: those that import it, then those that import what imports
it, first those that name a function that runs the line, cheap ones before dear ones. What the tests
of a budget do not notice may be noticed by the rest of the suite: the share printed is a lower
bound. Mistakes come in an order drawn once, so that a part of them is a fair sample. A later call
goes on where the last one ended, and tries those that survived again if the budget is larger now,
or ``--again`` is given. ``--suite 20`` puts what survives to the whole suite, twenty at once.
"""
from __future__ import annotations

import argparse
import json
import random
import tempfile
from pathlib import Path
from typing import Any

from benchmarks.planted.chosen_tests import ROOMS, ROOT, nearest_tests, running_functions
from benchmarks.planted.drawn_mistakes import drawn_mistakes
from benchmarks.planted.mistake import Mistake, listed_mistakes
from benchmarks.planted.reached_tests import TestMap, map_tests
from benchmarks.planted.scratch_tree import (
    copied_tree,
    import_libraries,
    planted,
    run_tests,
)
from benchmarks.planted.whole_suite import apart, failed_tests, noticed_by_suite

SECONDS_A_LINE = 0.04   # of a test file, a guess
SECONDS_A_SESSION = 4.0  # of each use of a session's results
STARTS_S = 10.0     # of processor time that tests take beside what they are said to
CLEAN_S = 400.0     # the same, for tests that failed, without the mistake
NEAREST = 3         # test files that run before the others
ORDER = 20260122    # seed of the order


def all_mistakes(lists: str = "*") -> list[Mistake]:
    """Every mistake of some lists, in an order drawn once."""
    return sorted(listed_mistakes(lists),
                  key=lambda each: random.Random(f"{ORDER} {each.name}").random())


def chosen(mistake: Mistake, budget_s: float) -> list[str]:
    """Test files for a mistake: the nearest first, of these those that name a function that runs
    its line, cheap ones before dear ones; about twice as many as the budget holds.
    """
    names = running_functions(mistake)
    ranks = []
    for distance, test in nearest_tests(mistake.file):
        text = (ROOT / test).read_text(encoding="utf-8")
        expected = SECONDS_A_LINE * text.count("\n") + SECONDS_A_SESSION * text.count("finished")
        ranks.append((distance, not any(name in text for name in names), expected, test))
    tests, total = [], 0.0
    for *_, expected, test in sorted(ranks):
        tests.append(test)
        total += expected
        if total > 2 * budget_s:
            break
    return tests


def tried(mistake: Mistake, tree: Path, budget_s: float, log: Path,
          tests: list[str] | None = None, reached: TestMap | None = None) -> dict[str, Any]:
    """What came of one mistake; ``tests``, or those that run its lines, take the place of the
    nearest.
    """
    every, limit_s = False, budget_s
    if tests is not None:
        parts = [tests]
    elif reached is not None:
        tests, cost, every = reached.within(mistake, budget_s)
        limit_s, parts = 3 * (cost + STARTS_S) + 30, [tests]
    else:       # to collect tests takes time too: most mistakes are noticed by the nearest
        tests = chosen(mistake, budget_s)
        parts = [tests[:NEAREST], tests[NEAREST:]]
    facts = {"mistake": mistake.name, "file": mistake.file, "what": mistake.what,
             "blind": mistake.blind, "every": every, "budget_s": budget_s}
    if not tests:
        return facts | {"noticed": False, "by": "no test runs it", "every": True,
                        "processor_s": 0.0}
    spent = 0.0
    for part in parts:
        if part and spent < limit_s:
            with planted(tree, mistake):
                run = run_tests(tree, part, limit_s - spent, log)
            spent += run.processor_s
            if run.status > 0:      # else it was ended, perhaps with a test in other processes
                return facts | {"noticed": True, "by": run.said, "failed": failed_tests(log),
                                "processor_s": spent}
    return facts | {"noticed": False, "by": ", ".join(tests[:50]), "processor_s": spent}


def take_back(results: list[dict[str, Any]], tree: Path, log: Path) -> None:
    """Count as not noticed what only a test noticed that fails without any mistake."""
    tests = sorted({test for each in results for test in each.get("failed", ())})
    if tests and run_tests(tree, tests, CLEAN_S, log, first_only=False).status:
        wrong = set(failed_tests(log))
        for each in results:
            if wrong.intersection(each.get("failed", ())):
                each["noticed"] = False
                print(f"{each['by']}: fails without {each['what']!r}, too", flush=True)


def print_shares(results: list[dict[str, Any]]) -> None:
    """One row for each folder, and what survives."""
    print(f"\n{'folder':12} {'noticed':>12} {'of these blind':>16}")
    for room in (*ROOMS, ""):
        own = [each for each in results if each["file"].startswith(room)]
        blind = [each for each in own if each["blind"]]
        if own:
            print(f"{room or 'all':12} " + " ".join(
                f"{sum(each['noticed'] for each in part)} of {len(part)}".rjust(width)
                for part, width in ((own, 12), (blind, 16))))
    for each in results:
        if not each["noticed"]:
            print(f"survives: {each['file']}: {each['what']}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="", help="mistakes whose file or words hold this")
    parser.add_argument("--lists", default="*", help="pattern of the lists' names")
    parser.add_argument("--budget", type=float, default=60.0, help="processor seconds of tests")
    parser.add_argument("--most", type=int, default=None, help="of mistakes tried by this call")
    parser.add_argument("--again", action="store_true", help="try what survived again")
    parser.add_argument("--tests", nargs="+", default=None, metavar="FILE",
                        help="these test files in place of the nearest")
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "planted")
    parser.add_argument("--skip", type=int, default=0, help="leave out so many of the order")
    parser.add_argument("--drawn", type=int, default=0, help="so many drawn by rule from sources")
    parser.add_argument("--seed", type=int, default=1, help="of the drawing")
    parser.add_argument("--suite", type=int, default=0, metavar="N",
                        help="the whole suite for what survives, N mistakes planted at once")
    parser.add_argument("--reached", action="store_true",
                        help="tests that run the lines of a mistake, in place of the nearest")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    path = given.out / "results.json"
    results: dict[str, dict[str, Any]] = (
        json.loads(path.read_text(encoding="utf-8")) if path.exists() else {})
    mistakes = (drawn_mistakes(given.drawn, given.seed, given.only) if given.drawn else
                [each for each in all_mistakes(given.lists)[given.skip:]
                 if given.only in f"{each.file} {each.what}"])
    waiting = [each for each in mistakes if _still_to_try(
        results.get(each.name), given.budget,
        given.again or given.tests is not None)][:given.most]
    if waiting or given.suite:
        import_libraries()
        with tempfile.TemporaryDirectory() as folder:
            tree = copied_tree(Path(folder) / "tree")
            reached = _test_map(given.out, mistakes) if given.reached else None
            for number, mistake in enumerate(waiting, 1):
                try:
                    found = tried(mistake, tree, given.budget, given.out / "tests.log", given.tests,
                                  reached)
                except (ValueError, RuntimeError) as error:
                    print(f"{number}/{len(waiting)} refused: {error}", flush=True)
                    continue
                results[mistake.name] = found
                path.write_text(json.dumps(results, indent=1), encoding="utf-8")
                print(f"{number}/{len(waiting)} {'noticed' if found['noticed'] else 'SURVIVES'} "
                      f"{mistake.file}: {mistake.what} [{found['processor_s']:.0f} s] "
                      f"{found['by'] if found['noticed'] else ''}", flush=True)
            take_back([results[each.name] for each in waiting if each.name in results], tree,
                      given.out / "clean.log")
            path.write_text(json.dumps(results, indent=1), encoding="utf-8")
            if given.suite:
                _try_suite(tree, [each for each in mistakes if each.name in results], results,
                           given.suite, given.out, reached)
    print_shares([results[each.name] for each in mistakes if each.name in results])


def _try_suite(tree: Path, mistakes: list[Mistake], results: dict[str, dict[str, Any]], most: int,
               folder: Path, reached: TestMap | None) -> None:
    """The whole suite for mistakes that survived and did not meet it yet."""
    left = [each for each in mistakes if not results[each.name]["noticed"]
            and not results[each.name].get("suite")]
    for group in apart(left, most):
        found = noticed_by_suite(tree, group, folder / "suite.log", reached)
        for mistake in group:
            results[mistake.name]["suite"] = True
            if mistake.name in found:
                results[mistake.name] |= {"noticed": True, "by": found[mistake.name]}
                print(f"noticed {mistake.file}: {mistake.what} {found[mistake.name]}", flush=True)
        (folder / "results.json").write_text(json.dumps(results, indent=1), encoding="utf-8")


def _test_map(folder: Path, mistakes: list[Mistake]) -> TestMap:
    """Who runs the lines of mistakes; kept in a folder for later calls about the same."""
    if not (folder / "told.tsv").exists():
        mistakes = [each for each in mistakes if (ROOT / each.file).exists()
                    and (ROOT / each.file).read_text(encoding="utf-8").count(each.old) == 1]
        print("all tests run once, to see which lines each runs", flush=True)
        with tempfile.TemporaryDirectory() as scratch:
            map_tests(copied_tree(Path(scratch) / "tree"), mistakes, folder, ["tests"])
    return TestMap(folder)


def _still_to_try(result: dict[str, Any] | None, budget_s: float, again: bool) -> bool:
    if result is None:
        return True
    return not result["noticed"] and (again or budget_s > result["budget_s"])


if __name__ == "__main__":
    main()
