"""A batch from its sessions to their outcomes: what is done is kept, the rest is given to workers
as their memory allows.
"""
from __future__ import annotations

import dataclasses
from collections import deque
from collections.abc import Iterator
from pathlib import Path

from spectrabox.session.batch.manifest import Outcome, store_outcome, stored_outcome
from spectrabox.session.batch.pool import Finished, Lost, Pool
from spectrabox.session.batch.tasks import Order, Task, failed, tried_task

TRIES = 2               # a task whose worker dies is tried once more
WORKER_DIED = 7         # exit code: something about this machine


def kept_outcomes(order: Order) -> dict[Path, Outcome]:
    """Sessions that are done already."""
    kept = {folder: stored_outcome(order.out, folder, order.made_by) for folder in order.folders}
    return {folder: outcome for folder, outcome in kept.items() if outcome is not None}


def run_batch(order: Order, waiting: list[Path], pool: Pool) -> Iterator[Outcome]:
    """Outcomes of sessions, run on the workers of a pool, each stored before it is told.

    Parameters
    ----------
    waiting : list of Path
        Those that are not done.
    pool : Pool

    Raises
    ------
    EnvironmentProblem
        If the workers are out of reach. What is stored then stays so.
    """
    for outcome in _outcomes(order, waiting, pool):
        store_outcome(order.out, outcome, order.made_by)
        yield outcome


def _outcomes(order: Order, waiting: list[Path], pool: Pool) -> Iterator[Outcome]:
    # made when they are wanted: a task is known only once its session has been read
    coming = (tried_task(folder, order) for folder in waiting)
    again, running, told = deque[Task](), list[Task](), deque[Outcome]()
    while True:
        while len(running) < pool.workers:
            task = again.popleft() if again else next(coming, None)
            if task is None:
                break
            if isinstance(task, Outcome):
                yield task
            elif pool.largest_bytes is not None and task.needed_bytes > pool.largest_bytes:
                yield failed(task, f"{_mib(task.needed_bytes)} of memory are needed and a worker "
                             f"has {_mib(pool.largest_bytes)}; give the workers more", WORKER_DIED)
            elif running and not _fits(pool, task, running):
                again.appendleft(task)
                break
            else:
                running.append(task)
                pool.start(task)
        # once all workers have something to do: to store and to tell takes a moment
        yield from told
        told.clear()
        if not running:
            return
        for ended in pool.wait():
            running.remove(ended.task)
            following = _after(ended)
            if isinstance(following, Task):
                again.append(following)
            else:
                told.append(following)


def _fits(pool: Pool, task: Task, running: list[Task]) -> bool:
    needed = task.needed_bytes + sum(each.needed_bytes for each in running)
    return pool.budget_bytes is None or needed <= pool.budget_bytes


def _after(ended: Finished | Lost) -> Task | Outcome:
    """What follows on a task: its session's outcome, or another task."""
    task = ended.task
    if isinstance(ended, Finished):
        if ended.outcome.state != "ready":
            return ended.outcome
        return dataclasses.replace(task, look=False, needed_bytes=ended.outcome.needed_bytes,
                                   tries=0)
    if task.tries + 1 < TRIES:
        return dataclasses.replace(task, tries=task.tries + 1)
    return failed(task, f"its worker died twice, the second time {ended.why}; run this session by "
                  "itself, with more memory where memory ran out", WORKER_DIED)


def _mib(count: int) -> str:
    return f"{count / 2**20:.0f} MiB"
