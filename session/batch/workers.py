"""The workers of a batch: processes of this machine, or those of a Dask cluster, which see the same
folders.

Workers of a Dask cluster, which see the same folders as this process.

The scheduler keeps nothing that is not stored by then: results lie in the sessions, outcomes in the
batch's folder. A worker that dies costs its task, which the scheduler gives to another.
"""


from __future__ import annotations

import contextlib
import copy
import logging
from collections.abc import Iterator
from typing import Any

from spectrabox.radiometry.errors import EnvironmentProblem, InputError
from spectrabox.session.batch import executors


@contextlib.contextmanager
def open_workers(cluster: str | None, workers: int | None, tasks: int,
                 dashboard: bool = False) -> Iterator[executors.Workers]:
    """Processes of this machine, or the workers of a cluster.

    Parameters
    ----------
    cluster : str or None
        Address of a Dask scheduler, or "local".
    workers : int or None
        How many processes; None for as many as there are cores.
    tasks : int
        That are to be run: no more processes than these.
    dashboard : bool
        Whether a local cluster has a dashboard.

    Raises
    ------
    InputError
        If a number of workers is asked of a cluster that has its own, or a dashboard without a
        local cluster.
    EnvironmentProblem
        If the cluster cannot be reached.
    """
    if cluster not in (None, "local") and workers is not None:
        raise InputError(f"--workers starts processes here, and the cluster {cluster} has its own; "
                         "give one of the two")
    if dashboard and cluster != "local":
        raise InputError("--dashboard is of --cluster local: other schedulers have their own")
    wanted = min(workers or len(executors.available_cores()), tasks)
    if cluster is None or not tasks:
        with executors.open_processes(wanted) as processes:
            yield processes
        return
    with open_cluster(cluster, wanted, dashboard) as workers_of_cluster:
        yield workers_of_cluster


# ---- workers of a Dask cluster, which see the same folders as this process -----------------------

LOCAL = "local"
# Scheduler and workers: whoever reaches them and is let in can run code as this user.
LOOPBACK = "127.0.0.1"
NO_PAGES: dict[str, list[str]] = {"distributed.scheduler.http.routes": [],
                                  "distributed.worker.http.routes": []}
DASHBOARD_PORT = 8787   # Dask takes a free one where this one is taken
CONNECTING_S = 20.0
RETRIES = 1             # of a task whose worker died
ENVIRONMENT = "distributed.nanny.pre-spawn-environ"
# What a scheduler and workers of this machine alone do without. Each interval wakes every one of
# them, on cores that all have a session to work at: the profile, every 10 ms, walks the stack of
# the session that runs.
CALM = {"distributed.worker.profile.enabled": False,
        "distributed.admin.tick.interval": "1s",
        "distributed.admin.system-monitor.interval": "2s"}


@contextlib.contextmanager
def open_cluster(address: str, workers: int,
                 dashboard: bool = False) -> Iterator[executors.Workers]:
    """The workers of a scheduler, or of one that is started on this machine and ends with the
    block.

    Other users of this machine reach its ports too: that scheduler and its workers speak TLS alone,
    with a certificate made for this block that lies in memory, and let nobody in without it.

    Parameters
    ----------
    address : str
        Such as tcp://host:8786, or "local".
    workers : int
        Processes of a local one.
    dashboard : bool
        Whether a local one has a dashboard, which any user of this machine can read.

    Raises
    ------
    EnvironmentProblem
        If Dask is not installed, or the scheduler cannot be reached or has no workers.
    """
    try:
        import dask
        from distributed import Client, KilledWorker, LocalCluster, Security
        from distributed.client import ClosedClientError
        if address == LOCAL:
            import cryptography  # noqa: F401  makes the certificate of a local one
    except ImportError:
        raise EnvironmentProblem("--cluster needs Dask: pip install 'spectrabox[cluster]', or "
                                 "leave it out to use processes of this machine") from None
    with contextlib.ExitStack() as stack:
        stack.enter_context(dask.config.set({"distributed.scheduler.allowed-failures": RETRIES}))
        stack.enter_context(_silent_loggers())
        memory = security = None        # of workers without limits of their own; as configured
        about = ""
        if address == LOCAL:
            stack.enter_context(dask.config.set(CALM | {ENVIRONMENT: _of_workers(
                dask.config.get(ENVIRONMENT))}))
            if not dashboard:
                stack.enter_context(dask.config.set(copy.deepcopy(NO_PAGES)))   # Dask adds to them
            memory, security = executors.memory_for_workers(), Security.temporary()
            local = stack.enter_context(LocalCluster(
                n_workers=workers, threads_per_worker=1, memory_limit=0, silence_logs=50,
                security=security, host=LOOPBACK, scheduler_kwargs={"dashboard": dashboard},
                dashboard_address=f"{LOOPBACK}:{DASHBOARD_PORT if dashboard else 0}",
                worker_dashboard_address=f"{LOOPBACK}:0"))
            address = local.scheduler_address
        elif not address.startswith("tls://"):
            about = (f"{address} lets in whoever reaches it, to run code as its workers' user: "
                     "keep it inside a network that you trust, or use Dask's TLS (tls://)\n")
        try:
            client = stack.enter_context(Client(address, timeout=CONNECTING_S, security=security))
            client.wait_for_workers(1, timeout=CONNECTING_S)
        except (OSError, ValueError, TimeoutError) as error:
            raise EnvironmentProblem(f"no workers can be reached through {address} "
                                     f"({type(error).__name__}); start a scheduler and workers: "
                                     "dask scheduler, dask worker ADDRESS --nthreads 1") from None
        executor = client.get_executor(pure=False)

        @stack.callback
        def end() -> None:
            # what still runs cannot be called off through a scheduler that is gone
            with contextlib.suppress(ClosedClientError):
                executor.shutdown(wait=False)

        if dashboard or security is None:
            about += f"dashboard: {client.dashboard_link}"
        yield executors.Workers(about, lambda: _capacity(client, memory), lambda count: executor,
                      (KilledWorker,))


def _capacity(client: Any, memory: int | None) -> tuple[int, int | None, int | None]:
    """Of the workers that a scheduler has at present; of one to come where it has none."""
    workers = client.scheduler_info(n_workers=-1)["workers"].values()
    limits = [each["memory_limit"] for each in workers]
    known = limits and all(limits)
    return (max(1, sum(each["nthreads"] for each in workers)),
            sum(limits) if known else memory, max(limits) if known else None)


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
