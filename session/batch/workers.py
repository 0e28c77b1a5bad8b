"""The workers of a batch or of a picture: processes of this machine, or those of a cluster."""
from __future__ import annotations

import contextlib
from collections.abc import Iterator

from spectrabox.radiometry.errors import InputError
from spectrabox.session.batch.cluster import open_cluster
from spectrabox.session.batch.executors import Workers, available_cores, open_processes


@contextlib.contextmanager
def open_workers(cluster: str | None, workers: int | None, tasks: int,
                 dashboard: bool = False) -> Iterator[Workers]:
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
    wanted = min(workers or len(available_cores()), tasks)
    if cluster is None or not tasks:
        with open_processes(wanted) as processes:
            yield processes
        return
    with open_cluster(cluster, wanted, dashboard) as workers_of_cluster:
        yield workers_of_cluster
