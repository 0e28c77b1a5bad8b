"""What is measured in one go, and several of these at a time."""
from __future__ import annotations

import json
import multiprocessing
import os
import sys
import time
import traceback
from collections.abc import Callable, Iterable, Iterator
from concurrent import futures
from concurrent.futures import process
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from spectrabox.radiometry.files import write_text_whole

WORKERS = 2


@dataclass(frozen=True)
class Task:
    """One case of a block, and the function that measures it.

    Attributes
    ----------
    block : str
        ``group/block``, the first parts of its rows' names.
    case : str
        Which case of these rows.
    measure : function
        Returns a number for each kind of row, by its name.
    arguments : tuple
    """

    block: str
    case: str
    measure: Callable[..., dict[str, float]]
    arguments: tuple[Any, ...] = ()


@dataclass(frozen=True)
class Measured:
    """What came of tasks.

    Attributes
    ----------
    rows : dict
        Numbers by row and case.
    faults : dict
        What a task without an answer ended in, by (block, case).
    seconds : dict
        Of processor, by block.
    blocks : tuple of str
        That were measured.
    whole : bool
        Whether these are all.
    commit : str
        That was measured.
    """

    rows: dict[str, dict[str, float]] = field(default_factory=dict)
    faults: dict[tuple[str, str], str] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    blocks: tuple[str, ...] = ()
    whole: bool = False
    commit: str = ""

    def store(self, path: Path) -> None:
        """Write it down."""
        path.parent.mkdir(exist_ok=True)
        faults = [[*where, fault] for where, fault in self.faults.items()]
        write_text_whole(path, json.dumps(vars(self) | {"faults": faults}, indent=1))

    @classmethod
    def stored(cls, path: Path) -> Measured:
        """What was written down."""
        kept = json.loads(path.read_text(encoding="utf-8"))
        faults = {(block, case): fault for block, case, fault in kept["faults"]}
        return cls(**kept | {"faults": faults, "blocks": tuple(kept["blocks"])})


def measure_all(tasks: Iterable[Task], workers: int = WORKERS) -> Measured:
    """Measure tasks in processes of their own, with a word on every one to standard error."""
    # one thread for small algebra, so that results repeat; before the workers load it
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[name] = "1"
    tasks, done = list(tasks), Measured()
    left = tasks
    while left:
        ended = _measure_until_one_ends(left, workers, done)
        left = [task for number, task in enumerate(left) if number not in ended]
        if left and workers == 1:       # in order: the first one left has ended its process
            _put(done, left.pop(0), {}, "it ended its process", 0.0)
        workers = 1
    # as the tasks came, whichever ended first
    return Measured(dict(_ordered(done, tasks)), done.faults, done.seconds)


def _measure_until_one_ends(tasks: list[Task], workers: int, done: Measured) -> set[int]:
    """Measure tasks until all are, or one takes the workers with it: the numbers of those that
    were.
    """
    finished = set[int]()
    with futures.ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as pool:
        waiting = {pool.submit(_tried, task): number for number, task in enumerate(tasks)}
        for future in futures.as_completed(waiting):
            number = waiting[future]
            try:
                _put(done, tasks[number], *future.result())
            except process.BrokenProcessPool:
                continue
            finished.add(number)
    return finished


def _put(done: Measured, task: Task, numbers: dict[str, float], fault: str,
         seconds: float) -> None:
    """Add what came of one task."""
    for kind, number in numbers.items():
        done.rows.setdefault(f"{task.block}/{kind}", {})[task.case] = number
    if fault:
        done.faults[task.block, task.case] = fault
    done.seconds[task.block] = done.seconds.get(task.block, 0.0) + seconds
    print(f"{task.block} {task.case} {seconds:.1f} s" + f": {fault}" * bool(fault),
          file=sys.stderr, flush=True)


def _ordered(done: Measured, tasks: list[Task]) -> Iterator[tuple[str, dict[str, float]]]:
    blocks = list(dict.fromkeys(task.block for task in tasks))
    for block in blocks:
        cases = [task.case for task in tasks if task.block == block]
        for row, numbers in done.rows.items():
            if row.rsplit("/", 1)[0] == block:
                yield row, {case: numbers[case] for case in cases if case in numbers}


def _tried(task: Task) -> tuple[dict[str, float], str, float]:
    """Numbers, why there are none, and processor seconds."""
    start = time.process_time()
    try:
        numbers, fault = task.measure(*task.arguments), ""
    except Exception as error:      # noqa: BLE001 - the others go on, and the row fails
        place = traceback.extract_tb(error.__traceback__)[-1]
        said = (str(error).splitlines() or [""])[0]
        numbers, fault = {}, (f"{type(error).__name__}: {said} ({Path(place.filename).name}, "
                              f"{place.name})")
    return numbers, fault, time.process_time() - start
