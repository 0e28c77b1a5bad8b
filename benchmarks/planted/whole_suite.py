"""What the whole suite says of mistakes that a few of its tests did not notice.

Many are planted at once and the suite runs to its end; then each test that failed runs with each
mistake alone. One mistake may hide what another would have shown, so that the share is a lower
bound still.
"""
from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from benchmarks.planted.mistake import Mistake
from benchmarks.planted.reached_tests import TestMap
from benchmarks.planted.scratch_tree import planted, run_tests

SUITE_S = 6000.0        # of processor time, for the whole suite
ALONE_S = 300.0         # the same, for tests that failed, with one mistake
FAILED = re.compile(r"^(?:FAILED|ERROR) (tests/\S+?\.py(?:::.+?)?)(?: - .*)?$", re.MULTILINE)


def failed_tests(log: Path) -> list[str]:
    """Names of the tests that pytest says failed, without repeats."""
    return list(dict.fromkeys(FAILED.findall(log.read_text(encoding="utf-8", errors="replace"))))


@contextlib.contextmanager
def all_planted(tree: Path, mistakes: Sequence[Mistake]) -> Iterator[None]:
    """The tree with several mistakes in it; in one file each later one stands in what the earlier
    ones left.
    """
    with contextlib.ExitStack() as stack:
        for mistake in mistakes:
            stack.enter_context(planted(tree, mistake))
        yield


def apart(mistakes: Sequence[Mistake], most: int) -> list[list[Mistake]]:
    """Groups in which no two mistakes are of one file."""
    groups: list[list[Mistake]] = []
    for mistake in mistakes:
        for group in groups:
            if len(group) < most and mistake.file not in {each.file for each in group}:
                group.append(mistake)
                break
        else:
            groups.append([mistake])
    return groups


def noticed_by_suite(tree: Path, group: Sequence[Mistake], log: Path,
                     reached: TestMap | None) -> dict[str, str]:
    """Names of the mistakes of a group that the suite notices, each with the test that does.

    Parameters
    ----------
    tree : Path
    group : sequence of Mistake
        Of different files.
    log : Path
        What pytest says.
    reached : TestMap or None
        Who runs which line; without it each test that failed is tried with each mistake.
    """
    with all_planted(tree, group):
        run_tests(tree, ["-n", "auto", "--dist", "loadfile", "tests"], SUITE_S, log,
                  first_only=False)
    failed = failed_tests(log)
    if failed:      # what fails with nothing planted notices nothing
        run_tests(tree, failed, SUITE_S, clean := log.with_name("clean.log"), first_only=False)
        failed = [test for test in failed if test not in failed_tests(clean)]
    print(f"{len(failed)} tests fail with {len(group)} mistakes planted at once", flush=True)
    found = {}
    for mistake in group:
        own = failed
        if reached is not None:
            running = reached.tests_of(mistake)
            own = [test for test in running if test in failed] + [
                test for test in failed if "::" not in test]
        if not own:
            continue
        with planted(tree, mistake):
            run = run_tests(tree, own, ALONE_S, log.with_name("alone.log"))
        if run.status:
            found[mistake.name] = run.said
    return found
