"""A batch from its sessions to their outcomes: those that are up to date are kept, the others are
given to workers as their memory allows.
"""
from __future__ import annotations

import dataclasses
from collections import deque
from collections.abc import Iterable, Iterator
from pathlib import Path

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.files import read_text
from spectrabox.session.batch.manifest import Outcome, store_outcome, stored_outcome
from spectrabox.session.batch.pool import Finished, Lost, Pool
from spectrabox.session.batch.tasks import Order, Task, failed, first_task

TRIES = 2               # a task whose worker dies is tried once more
WORKER_DIED = 7         # exit code: something about this machine


def session_folders(named: Iterable[Path], listed: Path | None) -> list[Path]:
    """Folders of sessions, absolute, each once, in the order in which they are named.

    Parameters
    ----------
    named : iterable of Path
        On the command line.
    listed : Path or None
        A file with one folder a line, relative to its own folder; empty lines and those that begin
        with # are passed over.

    Raises
    ------
    InputError
        If none is named, or the list cannot be read.
    """
    folders = [folder.resolve() for folder in named]
    if listed is not None:
        try:
            text = read_text(listed)
        except (OSError, ValueError) as error:
            raise InputError(f"{listed} cannot be read as a list of sessions ({error}); give a "
                             "text file with one folder a line") from None
        lines = [line.strip() for line in text.splitlines()]
        folders += [(listed.parent / line).resolve() for line in lines
                    if line and not line.startswith("#")]
    if not folders:
        raise InputError("no session is named; give session folders, or --list FILE with one a "
                         "line")
    return list(dict.fromkeys(folders))


def kept_outcomes(order: Order) -> dict[Path, Outcome]:
    """Outcomes of sessions that are up to date already, by folder."""
    kept = {folder: stored_outcome(order.out, folder, order.program) for folder in order.folders}
    return {folder: outcome for folder, outcome in kept.items() if outcome is not None}


def run_batch(order: Order, waiting: list[Path], pool: Pool) -> Iterator[Outcome]:
    """Run sessions on the workers of a pool.

    Parameters
    ----------
    order : Order
    waiting : list of Path
        Sessions that are not up to date.
    pool : Pool

    Yields
    ------
    Outcome
        As sessions end, each stored before.

    Raises
    ------
    EnvironmentProblem
        If the workers are out of reach. What is stored then stays so.
    """
    for outcome in _outcomes(order, waiting, pool):
        store_outcome(order.out, outcome, order.program)
        yield outcome


def _outcomes(order: Order, waiting: list[Path], pool: Pool) -> Iterator[Outcome]:
    # made one by one: a task is known only once its session has been read
    new_tasks = (first_task(folder, order) for folder in waiting)
    retries, running, ended = deque[Task](), list[Task](), deque[Outcome]()
    while True:
        while len(running) < pool.workers:
            task = retries.popleft() if retries else next(new_tasks, None)
            if task is None:
                break
            if isinstance(task, Outcome):
                yield task
            elif pool.largest_bytes is not None and task.needed_bytes > pool.largest_bytes:
                yield failed(task, f"{_mib(task.needed_bytes)} of memory are needed and a worker "
                             f"has {_mib(pool.largest_bytes)}; give the workers more", WORKER_DIED)
            elif running and pool.budget_bytes is not None and pool.budget_bytes < sum(
                    each.needed_bytes for each in (task, *running)):
                retries.appendleft(task)
                break
            else:
                running.append(task)
                pool.start(task)
        # Only now, when all workers have something to do: whoever takes these needs a moment.
        yield from ended
        ended.clear()
        if not running:
            return
        for result in pool.wait():
            running.remove(result.task)
            following = _following(result)
            if isinstance(following, Task):
                retries.append(following)
            else:
                ended.append(following)


def _following(result: Finished | Lost) -> Task | Outcome:
    """The next task of the same session, or its outcome."""
    task = result.task
    if isinstance(result, Finished):
        if result.outcome.state != "ready":
            return result.outcome
        return dataclasses.replace(task, check=False, needed_bytes=result.outcome.needed_bytes,
                                   tries=0)
    if task.tries + 1 < TRIES:
        return dataclasses.replace(task, tries=task.tries + 1)
    return failed(task, f"its worker died twice, the second time {result.why}; run this session by "
                  "itself, with more memory where memory ran out", WORKER_DIED)


def _mib(count: int) -> str:
    return f"{count / 2**20:.0f} MiB"
