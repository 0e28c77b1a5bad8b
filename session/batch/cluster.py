"""Workers of a Dask cluster, which see the same folders as this process.

The scheduler keeps nothing that is not stored by then: results lie in the sessions, outcomes in the
batch's folder. A worker that dies costs its task, which the scheduler gives to another.
"""
from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from spectrabox.radiometry.errors import EnvironmentProblem
from spectrabox.radiometry.system.free_memory import free_memory
from spectrabox.session.batch.pool import Finished, Lost, Work, do_work
from spectrabox.session.batch.processes import KEPT_FREE, settle, shares_of_cores

LOCAL = "local"
# Scheduler, workers and dashboard: whoever reaches them can run code as this user.
LOOPBACK = "127.0.0.1"
DASHBOARD_PORT = 8787   # Dask takes a free one where this one is taken
CONNECTING_S = 20.0
LISTENING_S = 2.0       # between two looks whether the scheduler is there
RETRIES = 1             # of a task whose worker died
ENVIRONMENT = "distributed.nanny.pre-spawn-environ"
# What a scheduler and workers of this machine alone do without. Each interval wakes every one of
# them, on cores that all have a session to work at: the profile, every 10 ms, walks the stack of
# the session that runs.
CALM = {"distributed.worker.profile.enabled": False,
        "distributed.admin.tick.interval": "1s",
        "distributed.admin.system-monitor.interval": "2s"}


class Cluster:
    """A pool of the workers of a Dask scheduler.

    Parameters
    ----------
    client : distributed.Client
        Connected.
    budget_bytes : int or None
        Memory of all workers together, where they have no limits of their own.
    """

    def __init__(self, client: Any, budget_bytes: int | None) -> None:
        self._client = client
        self._running: dict[Any, Any] = {}
        self._own_budget = budget_bytes
        self.about = f"dashboard: {client.dashboard_link}"
        self._look()

    def _look(self) -> None:
        workers = self._client.scheduler_info(n_workers=-1)["workers"].values()
        limits = [(each["memory_limit"], each["nthreads"]) for each in workers]
        known = all(limit for limit, _ in limits)
        self.workers = sum(threads for _, threads in limits)
        self.budget_bytes = sum(limit for limit, _ in limits) if known and limits \
            else self._own_budget
        self.largest_bytes = max((limit for limit, _ in limits), default=None) if known else None

    def start(self, task: Work) -> None:
        """Give a task to the scheduler."""
        self._running[self._client.submit(do_work, task, pure=False)] = task

    def wait(self) -> list[Finished | Lost]:
        """What came of tasks that have ended."""
        from distributed import wait
        from distributed.client import FuturesCancelledError
        while True:
            with contextlib.suppress(TimeoutError, asyncio.CancelledError, FuturesCancelledError):
                wait([*self._running], timeout=LISTENING_S, return_when="FIRST_COMPLETED")
            ended = [future for future in self._running if future.status in ("finished", "error")]
            if ended:
                self._look()
                return [self._ended(future) for future in ended]
            if self._client.status != "running" or \
                    any(future.status in ("cancelled", "lost") for future in self._running):
                raise EnvironmentProblem(
                    "the cluster's scheduler is out of reach: what is finished is kept; start it "
                    "again, then run the same command again to go on")

    def _ended(self, future: Any) -> Finished | Lost:
        task = self._running.pop(future)
        if future.status == "finished":
            return Finished(task, future.result())
        # the scheduler has tried again by itself
        return Lost(replace(task, tries=RETRIES), f"as the scheduler says: {future.exception()}")


@contextlib.contextmanager
def open_cluster(address: str, workers: int) -> Iterator[Cluster]:
    """The workers of a scheduler, or of one that is started on this machine and ends with the
    block.

    Parameters
    ----------
    address : str
        Such as tcp://host:8786, or "local".
    workers : int
        Processes of a local one.

    Raises
    ------
    EnvironmentProblem
        If Dask is not installed, or the scheduler cannot be reached or has no workers.
    """
    try:
        import dask
        from distributed import Client, LocalCluster
    except ImportError:
        raise EnvironmentProblem("--cluster needs Dask: pip install 'spectrabox[cluster]', or "
                                 "leave it out to use processes of this machine") from None
    with contextlib.ExitStack() as stack:
        stack.enter_context(dask.config.set({"distributed.scheduler.allowed-failures": RETRIES}))
        stack.enter_context(_silent_loggers())
        budget = None
        if address == LOCAL:
            stack.enter_context(dask.config.set(CALM | {ENVIRONMENT: _of_workers(
                dask.config.get(ENVIRONMENT))}))
            free = free_memory()
            budget = None if free is None else round(free * (1 - KEPT_FREE))
            local = stack.enter_context(LocalCluster(
                n_workers=workers, threads_per_worker=1, memory_limit=0, silence_logs=50,
                host=LOOPBACK, dashboard_address=f"{LOOPBACK}:{DASHBOARD_PORT}",
                worker_dashboard_address=f"{LOOPBACK}:0"))
            address = local.scheduler_address
        try:
            client = stack.enter_context(Client(address, timeout=CONNECTING_S))
            if budget is not None:
                client.register_plugin(_own_cores_plugin(workers))
            client.wait_for_workers(1, timeout=CONNECTING_S)
        except (OSError, ValueError, TimeoutError) as error:
            raise EnvironmentProblem(f"no workers can be reached through {address} "
                                     f"({type(error).__name__}); start a scheduler and workers: "
                                     "dask scheduler, dask worker ADDRESS --nthreads 1") from None
        yield Cluster(client, budget)


def _of_workers(environment: dict[str, Any]) -> dict[str, Any]:
    """What Dask puts into the environment of its workers, but for how memory is given back.

    Dask lets the C library return every freed piece at once, so that the next array is mapped and
    zeroed anew: a session of flat samples then takes up to half as much processor again.
    """
    return {name: value for name, value in environment.items()
            if not name.startswith("MALLOC_")}


@contextlib.contextmanager
def _silent_loggers() -> Iterator[None]:
    """Nothing of Dask's own on standard error: what matters is said in a sentence."""
    loggers = [logging.getLogger(name) for name in logging.root.manager.loggerDict
               if name.partition(".")[0] == "distributed"]
    levels = [logger.level for logger in loggers]
    try:
        for logger in loggers:
            logger.setLevel(logging.CRITICAL)
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)


def _own_cores_plugin(workers: int) -> Any:
    """What gives each worker of this machine cores of its own, as processes have."""
    from distributed import WorkerPlugin

    class OwnCores(WorkerPlugin):
        name = "own cores"

        def setup(self, worker: Any) -> None:
            settle(shares_of_cores(workers)[int(worker.name) % workers])

    return OwnCores()
