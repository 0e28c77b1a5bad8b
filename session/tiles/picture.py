"""``spectrabox uplift`` on several workers: the arrays of one process, bit for bit.

Arrays grow in a folder beside their place, named by all that they depend on. A file there for each
task says that its rows are written and on disk: the same command goes on where another ended.
"""
from __future__ import annotations

import math
import shutil
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from spectrabox.radiometry.errors import EnvironmentProblem, InputError, SpectraboxError
from spectrabox.radiometry.files import UNFINISHED, require_no_link, sync_folder, writable
from spectrabox.radiometry.spectra.formats.zarr_array import (
    CHUNK_PX,
    CHUNKS_A_SHARD,
    WAVELENGTHS,
    create_low_rank,
    create_picture,
)
from spectrabox.radiometry.spectra.spectral_layers import QUANTITY
from spectrabox.session.batch.pool import Finished, Pool
from spectrabox.session.batch.workers import open_workers
from spectrabox.session.progress_display import StageProgress
from spectrabox.session.signals.low_rank_files import low_rank_path, stated
from spectrabox.session.signals.spectra_rows import PIXELS_AT_ONCE, QUANTITIES
from spectrabox.session.signals.uplift import UpliftRequest, job_of, told
from spectrabox.session.signals.uplift_plan import Job, Look, Plan, planned, together
from spectrabox.session.store.session_lock import sole_uplift
from spectrabox.session.store.store import fingerprint
from spectrabox.session.tiles.stored_plan import PLAN, load_plan, pixels_beyond, store_plan
from spectrabox.session.tiles.tasks import (
    DONE,
    PROGRAM_BYTES,
    Order,
    Refused,
    RowsTask,
    done_mark,
    made_by,
)

TASK_PIXELS = 4_000_000     # a few seconds: what a lost worker costs, and little to hand out
TRIES = 2                   # of a task whose worker dies


def tiled_answer(request: UpliftRequest, cluster: str | None, workers: int | None,
                 progress: StageProgress) -> tuple[dict[str, Any], str]:
    """JSON object and text of ``spectrabox uplift --workers`` or ``--cluster``.

    Parameters
    ----------
    request : UpliftRequest
    cluster : str or None
        Address of a Dask scheduler, or "local"; None for processes.
    workers : int or None
    progress : function of (stage, share of it that is done, message)

    Raises
    ------
    InputError
        If the picture is not to become Zarr arrays, or is wrong.
    EnvironmentProblem
        If workers die or are out of reach. What is written then stays so.
    """
    if request.form != "zarr":
        raise InputError(f"several workers write into Zarr arrays, and --to {request.form} is one "
                         "stream: give --to zarr, or leave --workers and --cluster out")
    request = replace(request, image=request.image.resolve(), out=request.out.resolve())
    job, made = job_of(request), made_by()
    order = Order(request, request.out / f"{UNFINISHED}tiles-{_key(job, request, made)}", made)
    rows = rows_of_a_task(job)
    starts = range(0, job.picture.height, rows)
    needed = needed_bytes(job)
    paths = _paths(job, request.out)
    with sole_uplift(request.out):
        _sweep(order, paths)
        with open_workers(cluster, workers, len(starts)) as pool:
            def done(write: bool, left: Iterable[int]) -> Iterator[Look | None]:
                tasks = (RowsTask(order, first, min(first + rows, job.picture.height), write,
                                  needed) for first in left)
                return in_turn(pool, needed, tasks)

            if not (order.folder / PLAN).exists():
                found = together(_counted(done(False, starts), len(starts), 0,
                                          lambda share: progress("signals", share, "")))
                plan = planned(job, found, lambda share: progress("table", share, ""))
                _begin(job, plan, order.folder, found.outside)
            left = [first for first in starts if not done_mark(order.folder, first).exists()]
            for _ in _counted(done(True, left), len(starts), len(starts) - len(left),
                              lambda share: progress("spectra", share, "")):
                pass
        plan, beyond = load_plan(order.folder), pixels_beyond(order.folder)
        _finish(order.folder, [*paths.values()])
    facts, text = told(job, plan, paths, beyond)
    return facts | {"tasks": len(starts), "done_before": len(starts) - len(left)}, text


def rows_of_a_task(job: Job) -> int:
    """Whole shards, and whole tiles of the picture where they are high, of a few megapixels."""
    unit = CHUNK_PX * math.ceil(job.picture.rows_at_once / CHUNK_PX)
    return unit * max(1, TASK_PIXELS // (unit * job.picture.width))


def needed_bytes(job: Job) -> int:
    """Memory that a worker takes at most: rows of tiles as they are read, and a shard's spectra."""
    picture = job.picture
    read = 3 * 4 * picture.bands * picture.width * max(picture.rows_at_once, CHUNK_PX)
    numbers = job.coefficients or sum(each.size for each in job.kept.nm)
    return PROGRAM_BYTES + read + 3 * 4 * numbers * (CHUNK_PX**2 * CHUNKS_A_SHARD + PIXELS_AT_ONCE)


def in_turn(pool: Pool, needed: int, tasks: Iterator[RowsTask]) -> Iterator[Look | None]:
    """Results of tasks in their own order, as many at a time as workers and memory allow."""
    at_once = pool.workers if pool.budget_bytes is None \
        else max(1, min(pool.workers, pool.budget_bytes // needed))
    again, running = deque[RowsTask](), 0
    results: dict[int, Look | None] = {}
    waiting = deque[int]()
    while True:
        while running < at_once:
            task = again.popleft() if again else next(tasks, None)
            if task is None:
                break
            if not task.tries:
                waiting.append(task.first)
            pool.start(task)
            running += 1
        if not running:
            return
        for ended in pool.wait():
            running -= 1
            if not isinstance(ended, Finished):
                again.append(_tried_again(ended.task, ended.why))
            elif isinstance(ended.outcome, Refused):
                raise _error(ended.outcome)
            else:
                results[ended.task.first] = ended.outcome
        while waiting and waiting[0] in results:
            yield results.pop(waiting.popleft())


def _tried_again(task: RowsTask, why: str) -> RowsTask:
    if task.tries + 1 < TRIES:
        return replace(task, tries=task.tries + 1)
    raise EnvironmentProblem(f"the worker of rows {task.first} to {task.last} died twice, the "
                             f"second time {why}; give the workers more memory, then run the same "
                             "command again to go on")


def _error(refused: Refused) -> SpectraboxError:
    error = SpectraboxError(refused.said)
    error.exit_code = refused.exit_code
    return error


def _counted(results: Iterator[Look | None], total: int, done: int,
             progress: Any) -> Iterator[Any]:
    for result in results:
        done += 1
        progress(done / total)
        yield result


def _paths(job: Job, out: Path) -> dict[str, Path]:
    if job.coefficients is not None:
        return {"low_rank": low_rank_path(out, job.kept)}
    return job.kept.paths(out)


def _begin(job: Job, plan: Plan, folder: Path, beyond: int) -> None:
    """Arrays of zeros, and last the plan: where it is, they are whole."""
    picture, half = job.picture, not job.kept.full
    paths = _paths(job, folder)
    with writable(folder):
        # marks too: an end that was cut short leaves some, of rows that are brought to their place
        for path in (folder / DONE, *paths.values()):
            if path.exists():
                shutil.rmtree(path)
        if plan.low_rank is not None:
            tables, about = stated(job.kept, plan.low_rank, plan.errors or {})
            shape = picture.height, picture.width, len(plan.low_rank.basis) - 1
            create_low_rank(paths["low_rank"], shape, half, tables, about)
        else:
            for (name, path), nm in zip(paths.items(), job.kept.nm, strict=True):
                create_picture(path, (picture.height, picture.width, nm.size), half,
                               {WAVELENGTHS: nm.tolist(), QUANTITY: QUANTITIES[name]})
        store_plan(folder, plan, beyond)


def _finish(folder: Path, paths: list[Path]) -> None:
    """Bring the arrays to their place. Cut short at any point, the same again ends it."""
    with writable(folder):
        for path in paths:
            require_no_link(path)
            if (folder / path.name).exists():
                if path.exists():
                    path.replace(folder / f"before-{path.name}")
                (folder / path.name).replace(path)
        sync_folder(folder.parent)
        (folder / PLAN).unlink()        # first: without it the folder is nothing to go on from
        shutil.rmtree(folder)


def _sweep(order: Order, paths: dict[str, Path]) -> None:
    """Remove what is unfinished of other pictures, and refuse a file or link in the way."""
    for path in paths.values():
        require_no_link(path)
        if path.is_file():
            raise EnvironmentProblem(f"{path} cannot be written: it is a file; move it away, or "
                                     "name another folder")
    for left in order.folder.parent.glob(f"{UNFINISHED}tiles-*"):
        if left != order.folder and not left.is_symlink():
            shutil.rmtree(left, ignore_errors=True)


def _key(job: Job, request: UpliftRequest, made: str) -> str:
    """Digest of all that the arrays depend on: program, picture by size and time, and options."""
    files = [request.image] if request.image.is_file() else sorted(
        path for path in request.image.rglob("*") if path.is_file())
    states = {str(path): (path.stat().st_size, path.stat().st_mtime_ns) for path in files}
    return fingerprint({
        "made by": made, "picture": states, "response": job.relative_response.tolist(),
        "white": job.white.tolist(), "families": sorted(request.families), "noise": request.noise,
        "side": request.side, "step": request.step_nm, "full": request.full,
        "coefficients": request.coefficients, "rows": rows_of_a_task(job)})[:16]
