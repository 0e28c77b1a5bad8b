"""The workers that a batch was asked to use."""
from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator

from spectrabox.radiometry.errors import InputError
from spectrabox.session.batch.pool import Pool
from spectrabox.session.batch.processes import open_processes


@contextlib.contextmanager
def open_workers(cluster: str | None, workers: int | None, sessions: int) -> Iterator[Pool]:
    """Processes of this machine, or the workers of a cluster.

    Parameters
    ----------
    cluster : str or None
        Address of a Dask scheduler, or "local".
    workers : int or None
        How many processes; None for as many as there are cores.
    sessions : int
        That are to be run: no more processes than these.

    Raises
    ------
    InputError
        If a number of workers is asked of a cluster that has its own.
    EnvironmentProblem
        If the cluster cannot be reached.
    """
    if cluster not in (None, "local") and workers is not None:
        raise InputError(f"--workers starts processes here, and the cluster {cluster} has its own; "
                         "give one of the two")
    wanted = min(workers or _cores(), sessions)
    if cluster is None or not sessions:
        with open_processes(wanted) as pool:
            yield pool
        return
    from spectrabox.session.batch.cluster import open_cluster
    with open_cluster(cluster, wanted) as pool_of_cluster:
        yield pool_of_cluster


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") \
        else os.cpu_count() or 1
