"""Tasks given to workers, those of a batch as those of a picture: an executor, as
``concurrent.futures`` has it, over processes of this machine or over the workers of a cluster.

A worker that dies takes its pool with it. Each task that the pool was at is then run again, in a
pool of one worker: if that dies too, it died of this task.
"""
from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    wait,
)
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.queues import SimpleQueue
from types import FrameType
from typing import Any, Protocol, TypeVar

from spectrabox.radiometry.errors import EnvironmentProblem
from spectrabox.radiometry.system.archives import free_memory

KEPT_FREE = 0.1         # of the memory: the machine has other work
ENDING_S = 20           # a stopped worker removes what it left half done
DEATHS = (BrokenExecutor, KeyboardInterrupt)    # of a worker: by itself, or asked to end
WORKER_DIED = ("its worker died, and so did another that tried again; most often memory ran out: "
               "give the workers more, then run the same command again")


class Work(Protocol):
    """A task, done on a worker by calling it."""

    @property
    def needed_bytes(self) -> int:
        """Memory that it takes, with the program."""

    def __call__(self) -> Any:
        """Do it."""


Task = TypeVar("Task", bound=Work)


@dataclass(frozen=True)
class Workers:
    """Workers, open between the two ends of a ``with`` block."""

    about: str                              # a line for the operator, or empty
    # at present: tasks that run at once, and bytes of memory of all workers together and of the
    # largest; None where they are not known, or a worker alone may always try
    capacity: Callable[[], tuple[int, int | None, int | None]]
    new_executor: Callable[[int], Executor]     # of so many workers, in place of the one before
    killed: tuple[type[Exception], ...] = ()    # raised for a task of which workers died, tried
                                                # again already


def run_tasks(workers: Workers, next_task: Callable[[], Task | None]
              ) -> Iterator[tuple[Task, Any]]:
    """Run tasks, as many at a time as there are workers, and as memory allows.

    Parameters
    ----------
    workers : Workers
    next_task : function
        The next task, or None if there is none at present. It is asked when a worker has nothing
        to do.

    Yields
    ------
    task, result
        As tasks end. The result is an ``EnvironmentProblem`` if the task's worker died or no
        worker has the memory.

    Raises
    ------
    EnvironmentProblem
        If the workers are out of reach.
    Exception
        That a task raised.
    """
    executor = workers.new_executor(workers.capacity()[0])
    running: dict[Future[Any], Task] = {}
    waits: Task | None = None           # for memory
    while True:
        at_once, total_bytes, worker_bytes = workers.capacity()
        while len(running) < at_once:
            task, waits = waits or next_task(), None
            if task is None:
                break
            if worker_bytes is not None and task.needed_bytes > worker_bytes:
                yield task, EnvironmentProblem(
                    f"{_mib(task.needed_bytes)} of memory are needed and a worker has "
                    f"{_mib(worker_bytes)}; give the workers more, then run the same "
                    "command again")
            elif running and total_bytes is not None and total_bytes < sum(
                    each.needed_bytes for each in (task, *running.values())):
                waits = task
                break
            else:
                running[_submitted(executor, task)] = task
        if not running:
            return
        done, _ = wait(running, return_when=FIRST_COMPLETED)
        broken = any(isinstance(_error(future), DEATHS) for future in done)
        if broken:
            done, _ = wait(running)
        ended = {future: running.pop(future) for future in done}
        for future, task in ended.items():
            if not isinstance(_error(future), DEATHS):
                yield task, _result(future, workers)
        for future, task in ended.items():
            if isinstance(_error(future), DEATHS):
                yield task, _result(_submitted(workers.new_executor(1), task), workers)
        if broken:
            executor = workers.new_executor(at_once)


def _submitted(executor: Executor, task: Work) -> Future[Any]:
    """The future of a task; of an executor that broke before, one that says so."""
    try:
        return executor.submit(task)
    except BrokenExecutor as error:
        future = Future[Any]()
        future.set_exception(error)
        return future


def _error(future: Future[Any]) -> BaseException | None:
    """What a task raised, once it has ended."""
    try:
        return future.exception()
    except CancelledError:      # not by us
        raise EnvironmentProblem(
            "the cluster's scheduler is out of reach: what is finished is kept; start it again, "
            "then run the same command again to go on") from None


def _result(future: Future[Any], workers: Workers) -> Any:
    """What a task returned, once it has ended, or that its worker died."""
    error = _error(future)
    if error is None:
        return future.result()
    if isinstance(error, (*DEATHS, *workers.killed)):
        return EnvironmentProblem(WORKER_DIED)
    raise error


def _mib(count: int) -> str:
    return f"{count / 2**20:.0f} MiB"


# ---- the workers that were asked for

@contextlib.contextmanager
def open_processes(workers: int) -> Iterator[Workers]:
    """Processes of this machine, which are gone when the block ends."""
    capacity = workers, memory_for_workers(), None
    with contextlib.ExitStack() as stack:
        def new_executor(count: int) -> Executor:
            stack.close()
            return stack.enter_context(_processes(count))

        yield Workers("", lambda: capacity, new_executor)


def memory_for_workers() -> int | None:
    """Bytes that workers of this machine may take together."""
    free = free_memory()
    return None if free is None else round(free * (1 - KEPT_FREE))


class _Processes(ProcessPoolExecutor):
    """Processes whose tasks end by SIGTERM as a run ends by Ctrl-C, keeping what is whole."""

    def submit(self, task: Callable[..., Any], /, *args: Any, **named: Any) -> Future[Any]:
        """Start a task, and perhaps a process for it, which never hears of Ctrl-C and the end of
        the terminal: the parent hears of them too and says what ends.
        """
        if not hasattr(signal, "pthread_sigmask"):      # Windows
            return super().submit(_interruptible, task)
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGHUP})
        try:
            return super().submit(_interruptible, task)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextlib.contextmanager
def _processes(count: int) -> Iterator[Executor]:
    """An executor whose processes end with the block, whatever they are at."""
    context = multiprocessing.get_context("spawn")      # a fork of threads that hold locks hangs
    ended, block = context.Pipe(duplex=False)
    shares = context.SimpleQueue()
    for cores in shares_of_cores(count):
        shares.put(cores)
    executor = _Processes(max(count, 1), context, _prepare, (ended, shares))
    try:
        yield executor
    finally:
        block.close()
        executor.shutdown(cancel_futures=True)
        ended.close()


def _prepare(ended: Connection, shares: SimpleQueue[list[int]]) -> None:
    """Begin the life of a process that runs tasks."""
    signal.signal(signal.SIGTERM, _leave)
    signal.signal(signal.SIGINT, signal.SIG_IGN)    # Windows, where it cannot be blocked
    warnings.simplefilter("ignore")                 # as in the command itself
    cores = shares.get()
    if cores and hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, cores)
    threading.Thread(target=_end_with_block, args=(ended,), daemon=True).start()


def _end_with_block(ended: Connection) -> None:
    """End this process once the parent closes the other end of a pipe, or dies."""
    with contextlib.suppress(EOFError, OSError):
        ended.recv()
    for _ in range(ENDING_S):       # the first may interrupt a task, another ends the process
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(1)
    os.kill(os.getpid(), signal.SIGKILL)


def _interruptible(task: Callable[[], Any]) -> Any:
    """What a task returns. SIGTERM interrupts it, once."""
    signal.signal(signal.SIGTERM, _interrupt)
    try:
        return task()
    finally:
        signal.signal(signal.SIGTERM, _leave)


def _interrupt(number: int, frame: FrameType | None) -> None:
    signal.signal(number, signal.SIG_IGN)
    raise KeyboardInterrupt


def _leave(number: int, frame: FrameType | None) -> None:
    """End a process that waits for a task, if nobody is left to give it one.

    A parent that lives ends it itself. A process that left while it read its next task would have
    taken half of a message, and another process would read the rest as a message of its own.
    """
    parent = multiprocessing.parent_process()
    if parent is None or not parent.is_alive():
        raise SystemExit(128 + number)


def shares_of_cores(workers: int) -> list[list[int]]:
    """Cores of each worker; none where the system does not say, or one worker has them all."""
    if workers <= 1 or not hasattr(os, "sched_getaffinity"):
        return [[]] * max(workers, 1)
    cores = available_cores()
    if workers >= len(cores):
        return [[cores[number % len(cores)]] for number in range(workers)]
    return [cores[number * len(cores) // workers:(number + 1) * len(cores) // workers]
            for number in range(workers)]


def available_cores() -> list[int]:
    return sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") \
        else [*range(os.cpu_count() or 1)]
