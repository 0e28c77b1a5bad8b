"""What a worker does with some rows of a picture: look at them, or write their spectra.

Rows are those of whole shards of the arrays, so that no two workers write to one file.
"""
from __future__ import annotations

import functools
import threading
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from spectrabox.radiometry.errors import EnvironmentProblem
from spectrabox.radiometry.files import write_text_whole
from spectrabox.radiometry.spectra.formats.zarr_array import (
    CHUNK_PX,
    CHUNKS_A_SHARD,
    COEFFICIENTS,
    open_region,
)
from spectrabox.session.command_line import interrupt_behind, said_of
from spectrabox.session.signals.low_rank_files import low_rank_path
from spectrabox.session.signals.spectra_rows import row_blocks
from spectrabox.session.signals.uplift import UpliftRequest, job_of
from spectrabox.session.signals.uplift_plan import Job, Look, Plan, look, together
from spectrabox.session.store.provenance import PACKAGES, versions
from spectrabox.session.store.stage_code import stage_code
from spectrabox.session.store.store import fingerprint
from spectrabox.session.tiles.stored_plan import load_plan

DONE = "done"           # folder of one empty file a task
PROGRAM_BYTES = 400 * 2**20
OPEN = 16               # threads of one worker that keep their picture open


@dataclass(frozen=True)
class Order:
    """A picture that is to be written by several workers."""

    request: UpliftRequest      # with absolute paths
    folder: Path                # where arrays lie until all rows are written
    made_by: str                # of ``made_by``


@dataclass(frozen=True)
class Refused:
    """Why a task has no result."""

    said: str
    exit_code: int


@dataclass(frozen=True)
class RowsTask:
    """Rows ``first`` to ``last``: looked at, or written."""

    order: Order
    first: int
    last: int
    write: bool
    needed_bytes: int
    tries: int = 0              # how often a worker died of it

    def __call__(self) -> Look | Refused | None:
        """Do it, on a worker."""
        try:
            if made_by() != self.order.made_by:
                raise EnvironmentProblem("this worker's program or packages are not those of the "
                                         "command: install the same, then run it again")
            job = _job(self.order, threading.get_ident())
            if not self.write:
                return together(look(job, self.first + start, self.first + end)
                                for start, end in row_blocks(self.last - self.first,
                                                             job.picture.width))
            write_rows(job, _plan(self.order), self.order.folder, self.first, self.last)
        except BaseException as error:
            if interrupt_behind(error) is not None or isinstance(error, SystemExit | GeneratorExit):
                raise
            return Refused(*said_of(error))
        return None


def write_rows(job: Job, plan: Plan, folder: Path, first: int, last: int) -> None:
    """Write the spectra of some rows, and then that they are written.

    Parameters
    ----------
    folder : Path
        Of the order.
    first, last : int
        From a multiple of ``CHUNK_PX`` to the next, or to the end.
    """
    regions = [open_region(path) for path in arrays_of(job, folder)]
    width, bands = job.picture.width, job.picture.bands
    for row in range(first, last, CHUNK_PX):
        end = min(row + CHUNK_PX, last)
        signals = job.signals(row, end).reshape(end - row, width, bands)
        for column in range(0, width, CHUNK_PX * CHUNKS_A_SHARD):
            part = signals[:, column:column + CHUNK_PX * CHUNKS_A_SHARD]
            blocks = [plan.made(job, part[start:stop].reshape(-1, bands))
                      for start, stop in row_blocks(*part.shape[:2])]
            for region, made in zip(regions, zip(*blocks, strict=True), strict=True):
                region.write(row, column, np.concatenate(made).reshape(*part.shape[:2], -1))
    for region in regions:
        region.sync(first, last)
    write_text_whole(done_mark(folder, first), "")


def arrays_of(job: Job, folder: Path) -> list[Path]:
    """The arrays that are written to, in the order of ``Plan.made``."""
    if job.coefficients is not None:
        return [low_rank_path(folder, job.kept) / COEFFICIENTS]
    return [*job.kept.paths(folder).values()]


def done_mark(folder: Path, first: int) -> Path:
    """The file that says that a task's rows are written."""
    return folder / DONE / str(first)


@functools.cache
def made_by() -> str:
    """Digest of the program and of the packages that pixels depend on."""
    return fingerprint({"code": stage_code({"tiles": __name__}), "versions": versions(PACKAGES)})


@functools.lru_cache(maxsize=OPEN)
def _job(order: Order, thread: int) -> Job:
    """The picture, open for one thread alone: its file knows where it was read last."""
    return job_of(order.request)


@functools.lru_cache(maxsize=1)
def _plan(order: Order) -> Plan:
    return load_plan(order.folder)
