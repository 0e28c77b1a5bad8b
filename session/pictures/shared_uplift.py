"""``spectrabox uplift`` on several workers: the arrays of one process, bit for bit.

Arrays grow in a folder within the output folder, named by a digest of all that they depend on. A
file there for each task says that its rows are written and on disk: the same command resumes where
it ended.
"""
from __future__ import annotations

import math
import os
import shutil
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

from spectrabox.measure.pictures.pixel_spectra import (
    PIXELS_AT_ONCE,
    SpectraPlan,
    merge_surveys,
    plan_spectra,
    require_below_white,
)
from spectrabox.measure.pictures.spectra_files import zarr_facts
from spectrabox.measure.pictures.uplift import ImageSource
from spectrabox.radiometry.errors import EnvironmentProblem, InputError
from spectrabox.radiometry.files import UNFINISHED, require_no_link, sync, writable
from spectrabox.radiometry.spectra.formats.zarr_array import (
    CHUNK_PX,
    CHUNKS_A_SHARD,
    create_picture,
)
from spectrabox.session.batch.executors import (
    NotRun,
    Workers,
    run_tasks,
)
from spectrabox.session.batch.workers import open_workers
from spectrabox.session.commands.requests import UpliftRequest
from spectrabox.session.pictures.row_tasks import (
    DONE,
    PLAN,
    PROGRAM_BYTES,
    Order,
    RowsTask,
    done_mark,
    load_plan,
    store_plan,
)
from spectrabox.session.pictures.uplift_answer import (
    WHITE_REMEDY,
    image_source,
    uplift_layout,
    uplift_summary,
)
from spectrabox.session.store.locks import sole_user
from spectrabox.session.store.program import program_digest
from spectrabox.session.store.store import fingerprint
from spectrabox.session.terminal.progress_display import StageProgress

TASK_PIXELS = 4_000_000     # a few seconds: the cost of a lost worker, and little to hand out


def shared_uplift_answer(request: UpliftRequest,
                         progress: StageProgress) -> tuple[dict[str, Any], str]:
    """JSON object and text of ``spectrabox uplift --workers`` or ``--cluster``.

    Parameters
    ----------
    request : UpliftRequest
        With a number of ``workers``, or the address of a ``cluster``.
    progress : function of (stage, share of it that is done, message)

    Raises
    ------
    InputError
        If the output is not Zarr arrays, or an input is wrong.
    EnvironmentProblem
        If workers die or are out of reach. What is written then stays so.
    """
    if request.to != "zarr":
        raise InputError(f"several workers write into Zarr arrays, and --to {request.to} is one "
                         "stream: give --to zarr, or leave --workers and --cluster out")
    request = replace(request, image=request.image.resolve(), out=request.out.resolve())
    source, layout, code = image_source(request), uplift_layout(request), program_digest()
    height, width, _ = source.size
    rows = rows_of_a_task(source)
    order = Order(request, request.out / f"{UNFINISHED}tiles-{_key(source, request, code, rows)}",
                  code)
    needed = needed_bytes(source, request)
    tasks = [RowsTask(order, first, min(first + rows, height), False, needed)
             for first in range(0, height, rows)]
    paths = layout.paths(request.out)
    with sole_user(request.out, "uplift"):
        for path in paths.values():
            require_no_link(path)
            if path.is_file():
                raise EnvironmentProblem(f"{path} cannot be written: it is a file; move it away, "
                                         "or name another folder")
        # unfinished arrays of other images
        for unfinished in request.out.glob(f"{UNFINISHED}tiles-*"):
            if unfinished != order.folder and not unfinished.is_symlink():
                shutil.rmtree(unfinished, ignore_errors=True)
        with open_workers(request.cluster, request.workers, len(tasks)) as workers:
            if not (order.folder / PLAN).exists():
                surveys = _results(tasks, workers, lambda share: progress("signals", share, ""))
                survey = merge_surveys(surveys[each.first] for each in tasks)
                require_below_white(survey.above, height * width, WHITE_REMEDY)
                with ThreadPoolExecutor(os.cpu_count()) as threads:
                    plan = plan_spectra(source, layout, survey,
                                        lambda share: progress("table", share, ""), threads.map)
                _create_arrays(order, source, plan, survey.outside)
            left = [replace(each, write=True) for each in tasks
                    if not done_mark(order.folder, each.first).exists()]
            _results(left, workers, lambda share: progress(
                "spectra", 1 - (1 - share) * len(left) / len(tasks), ""))
        plan, outside = load_plan(order.folder, layout)
        _move_arrays(order.folder, [*paths.values()])
    facts, text = uplift_summary(request, plan, paths, height * width, outside)
    return facts | {"tasks": len(tasks), "done_before": len(tasks) - len(left)}, text


def rows_of_a_task(source: ImageSource) -> int:
    """Whole shards, and whole tiles of the image where they are high, of a few megapixels."""
    unit = CHUNK_PX * math.ceil(source.image.rows_at_once / CHUNK_PX)
    return unit * max(1, TASK_PIXELS // (unit * source.image.width))


def needed_bytes(source: ImageSource, request: UpliftRequest) -> int:
    """Memory that a worker takes at most: rows of tiles as they are read, and a shard's spectra."""
    image = source.image
    read = 3 * 4 * image.bands * image.width * max(image.rows_at_once, CHUNK_PX)
    numbers = sum(nm.size for nm in uplift_layout(request).nm)
    return PROGRAM_BYTES + read + 3 * 4 * numbers * (CHUNK_PX**2 * CHUNKS_A_SHARD + PIXELS_AT_ONCE)


def _results(tasks: list[RowsTask], workers: Workers,
             progress: Callable[[float], None]) -> dict[int, Any]:
    """Results of tasks, by their first rows; ``progress`` takes the share that has ended.

    Raises
    ------
    SpectraboxError
        Of a task that was refused, or whose worker died.
    """
    results: dict[int, Any] = {}
    waiting = iter(tasks)
    for task, result in run_tasks(workers, lambda: next(waiting, None)):
        if isinstance(result, NotRun):
            raise EnvironmentProblem(f"rows {task.first} to {task.last} have no spectra: "
                                     f"{result.why} to go on")
        results[task.first] = result
        progress(len(results) / len(tasks))
    return results


def _create_arrays(order: Order, source: ImageSource, plan: SpectraPlan, outside: int) -> None:
    """Create arrays of zeros, and last store the plan: its presence says that they are whole."""
    request, (height, width, _) = order.request, source.size
    paths, half = uplift_layout(request).paths(order.folder), not request.full
    with writable(order.folder):
        # marks too: an end that was cut short leaves some, of arrays that were moved already
        for path in (order.folder / DONE, *paths.values()):
            if path.exists():
                shutil.rmtree(path)
        for (name, path), nm in zip(paths.items(), plan.kept.nm, strict=True):
            create_picture(path, height, width, nm, half, *zarr_facts(name, source.responses))
        store_plan(order.folder, plan, outside)


def _move_arrays(folder: Path, paths: list[Path]) -> None:
    """Move the arrays to the output folder. Interrupted at any point, the same again ends it."""
    with writable(folder):
        for path in paths:
            require_no_link(path)
            if (folder / path.name).exists():
                if path.exists():
                    path.replace(folder / f"before-{path.name}")
                (folder / path.name).replace(path)
        sync(folder.parent)
        (folder / PLAN).unlink()        # first: without it nothing can be resumed from the folder
        shutil.rmtree(folder)


def _key(source: ImageSource, request: UpliftRequest, code: str, rows: int) -> str:
    """Digest of all that the arrays depend on: program, image by size and time, and options."""
    files: list[Path] = [request.image] if request.image.is_file() else sorted(
        path for path in request.image.rglob("*") if path.is_file())
    states = {str(path): (path.stat().st_size, path.stat().st_mtime_ns) for path in files}
    return fingerprint({
        "made by": code, "picture": states, "response": source.relative_response.tolist(),
        "white": source.white.tolist(), "families": sorted(request.family),
        "noise": request.noise, "side": request.side, "step": request.step,
        "full": request.full, "rows": rows})[:16]
