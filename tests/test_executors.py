"""Tasks on workers: each has its result, whoever dies on the way."""
import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path

import pytest
from inline_workers import inline_workers

from spectrabox.radiometry.errors import EnvironmentProblem, InputError
from spectrabox.session.batch.executors import (
    open_processes,
    run_tasks,
    shares_of_cores,
)
from spectrabox.session.batch.workers import open_workers


@dataclass(frozen=True)
class Square:
    """A task that may end its own process first."""

    number: int
    signal: int | None = None
    once: Path | None = None        # a file that is there once it has done so, if only once
    needed_bytes: int = 0

    def __call__(self):
        if self.signal is not None and not (self.once and self.once.exists()):
            if self.once:
                self.once.touch()
            os.kill(os.getpid(), self.signal)
            time.sleep(60)
        if self.number < 0:
            raise InputError(f"{self.number} is negative")
        return self.number**2


def results_of(workers, tasks):
    """Results by the tasks' numbers."""
    left = iter(tasks)
    return {task.number: result for task, result in run_tasks(workers, lambda: next(left, None))}


SQUARES = [Square(number) for number in (0, 1, 2, 4, 5)]


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_a_task_that_its_worker_dies_of_is_known_and_the_others_go_on(number):
    with open_processes(2) as workers:
        results = results_of(workers, [*SQUARES[:2], Square(3, number), *SQUARES[2:]])
    assert isinstance(results.pop(3), EnvironmentProblem)
    assert results == {0: 0, 1: 1, 2: 4, 4: 16, 5: 25}


def test_a_worker_that_dies_once_costs_nothing_but_time(tmp_path):
    with open_processes(2) as workers:
        dies_once = Square(3, signal.SIGKILL, tmp_path / "was here")
        assert results_of(workers, [dies_once, *SQUARES]) == {
            0: 0, 1: 1, 2: 4, 3: 9, 4: 16, 5: 25}


@pytest.mark.skipif(not hasattr(signal, "pthread_sigmask"), reason="signals of Unix")
def test_a_worker_that_waits_for_a_task_goes_on_when_it_is_asked_to_end():
    # one that left while it read its next task would leave half a message to the others
    with open_processes(1) as workers:
        executor = workers.new_executor(1)
        worker = executor.submit(os.getpid).result()
        for _ in range(3):
            os.kill(worker, signal.SIGTERM)
            time.sleep(0.05)
        assert executor.submit(os.getpid).result() == worker
    with pytest.raises(ProcessLookupError):
        os.kill(worker, 0)


def test_what_a_task_raises_is_raised_here():
    with open_processes(1) as workers, pytest.raises(InputError, match="-2 is negative"):
        results_of(workers, [Square(-2)])


@pytest.mark.parametrize("total, at_once", [(None, 3), (100, 2), (10, 1)])
def test_no_more_run_at_once_than_memory_allows(total, at_once):
    executor, workers = inline_workers(workers=3, total_bytes=total)
    results = results_of(workers, [Square(number, needed_bytes=40) for number in range(6)])
    assert results == {number: number**2 for number in range(6)}
    assert max(map(len, executor.rounds)) == at_once


def test_a_task_too_large_for_any_worker_is_not_run():
    executor, workers = inline_workers(worker_bytes=2**29)
    results = results_of(workers, [Square(1, needed_bytes=2**30), Square(2, needed_bytes=2**20)])
    assert "1024 MiB of memory are needed and a worker has 512 MiB" in str(results[1])
    assert results[2] == 4 and len(executor.tasks) == 1


@pytest.mark.parametrize("workers", [2, 3, 5, 70])
def test_cores_are_shared_out(workers):
    shares, cores = shares_of_cores(workers), os.sched_getaffinity(0)
    assert len(shares) == workers and all(share and set(share) <= cores for share in shares)
    if workers <= len(cores):
        assert sorted(core for share in shares for core in share) == sorted(cores)


def test_workers_of_a_cluster_are_its_own():
    with pytest.raises(InputError, match="has its own; give one of the two"), \
            open_workers("tcp://localhost:1", 2, 3):
        pass
