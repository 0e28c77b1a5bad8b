"""Workers as processes of this machine, each with its own cores.

A process that dies takes the one task with it that it was at: another takes its place.
"""
from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import threading
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess

from spectrabox.radiometry.system.free_memory import free_memory
from spectrabox.session.batch.pool import Finished, Lost, Work, do_work
from spectrabox.session.terminal.interruption import stop_on_signals

KEPT_FREE = 0.1         # of the memory: the machine has other work
ENDING_S = 20.0         # a stopped worker removes what it left half done


@dataclass(frozen=True)
class _Worker:
    process: BaseProcess
    line: Connection
    cores: tuple[int, ...]


class Processes:
    """A pool of processes of this machine.

    Parameters
    ----------
    workers : int
    """

    def __init__(self, workers: int) -> None:
        self.workers, self.about = workers, ""
        free = free_memory()
        self.budget_bytes = None if free is None else round(free * (1 - KEPT_FREE))
        self.largest_bytes = None       # one alone may always try: it then says what it lacks
        self._idle = [_started(cores) for cores in shares_of_cores(workers)]
        self._busy: dict[_Worker, Work] = {}

    def start(self, task: Work) -> None:
        """Give a task to an idle worker."""
        worker = self._idle.pop()
        self._busy[worker] = task
        with contextlib.suppress(OSError):      # it died idle: `wait` hears of it
            worker.line.send(task)

    def wait(self) -> list[Finished | Lost]:
        """What came of tasks that have ended."""
        ready = wait([worker.line for worker in self._busy])
        return [self._ended(worker) for worker in [*self._busy] if worker.line in ready]

    def _ended(self, worker: _Worker) -> Finished | Lost:
        task = self._busy.pop(worker)
        try:
            outcome = worker.line.recv()
        except (EOFError, OSError):
            worker.process.join()
            code = worker.process.exitcode or 0
            self._idle.append(_started(worker.cores))
            return Lost(task, f"by signal {-code} ({signal.Signals(-code).name})" if code < 0
                        else f"with exit code {code}")
        self._idle.append(worker)
        return Finished(task, outcome)

    def close(self) -> None:
        """End all workers: those at work as Ctrl-C ends a run, which keeps what is whole."""
        for worker in self._busy:
            worker.process.terminate()
        for worker in self._idle:
            worker.process.kill()       # it holds nothing, and need not take itself apart
        for worker in (*self._idle, *self._busy):
            worker.process.join(ENDING_S)
            worker.process.kill()
            worker.line.close()


@contextlib.contextmanager
def open_processes(workers: int) -> Iterator[Processes]:
    """A pool of processes, which are gone when the block ends."""
    pool = Processes(workers)
    try:
        yield pool
    finally:
        pool.close()


def _started(cores: tuple[int, ...]) -> _Worker:
    context = multiprocessing.get_context("spawn")      # a fork of threads that hold locks hangs
    ours, theirs = context.Pipe()
    process = context.Process(target=_serve, args=(theirs, cores), daemon=True)
    process.start()
    theirs.close()      # else the end of the process would not be heard
    return _Worker(process, ours, cores)


def _serve(line: Connection, cores: Sequence[int]) -> None:
    """The life of a worker: tasks in, outcomes out, until the line or the parent ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)    # Ctrl-C reaches all; the parent says what ends
    stop_on_signals()
    warnings.simplefilter("ignore")                 # as in the command itself
    settle(cores)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with contextlib.suppress(EOFError, OSError, KeyboardInterrupt):
        while True:
            line.send(do_work(line.recv()))


def settle(cores: Sequence[int]) -> None:
    """Keep this process, a worker, on its own cores, where it has such."""
    if cores and hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, cores)


def _end_with_parent() -> None:
    """End as by a signal once the parent is gone: nobody else would end this process."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os.kill(os.getpid(), signal.SIGTERM)


def shares_of_cores(workers: int) -> list[tuple[int, ...]]:
    """Cores of each worker; none where the system does not say, or one worker has them all."""
    if workers == 1 or not hasattr(os, "sched_getaffinity"):
        return [()] * workers
    cores = sorted(os.sched_getaffinity(0))
    if workers >= len(cores):
        return [(cores[number % len(cores)],) for number in range(workers)]
    return [tuple(cores[number * len(cores) // workers:(number + 1) * len(cores) // workers])
            for number in range(workers)]
