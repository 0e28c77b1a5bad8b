"""Tasks of a worker on some rows of an image: survey them, or write their spectra.

Rows are those of whole shards of the arrays, so that no two workers write to one file. The plan of
the image is stored as arrays, which every worker reads, and a command that resumes finds again.
"""
from __future__ import annotations

import functools
import threading
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from spectrabox.measure.pictures.pixel_spectra import (
    LightTable,
    PixelBlock,
    SpectraPlan,
    Survey,
    merge_surveys,
    row_blocks,
    survey_rows,
)
from spectrabox.measure.pictures.spectra_files import PictureLayout
from spectrabox.measure.pictures.uplift import ImageSource
from spectrabox.radiometry.errors import EnvironmentProblem
from spectrabox.radiometry.files import whole_file, write_text_whole
from spectrabox.radiometry.spectra.formats.zarr_array import (
    CHUNK_PX,
    CHUNKS_A_SHARD,
    open_region,
)
from spectrabox.sampling.prior.local_posteriors import LocalPosteriors
from spectrabox.session.commands.requests import UpliftRequest
from spectrabox.session.pictures.uplift_answer import image_source, uplift_layout
from spectrabox.session.store.program import program_digest

DONE = "done"           # folder of one empty file a task
PLAN = "plan.npz"
PROGRAM_BYTES = 400 * 2**20
OPEN_IMAGES = 16        # threads of one worker that keep their image open


@dataclass(frozen=True)
class Order:
    """An image whose spectra are to be written by several workers."""

    request: UpliftRequest      # with absolute paths
    folder: Path                # of the arrays until all rows are written
    program: str                # its digest, of ``program_digest``


@dataclass(frozen=True)
class RowsTask:
    """Rows ``first`` to ``last``: surveyed, or written."""

    order: Order
    first: int
    last: int
    write: bool
    needed_bytes: int

    def __call__(self) -> Survey | None:
        """Do it, on a worker."""
        if program_digest() != self.order.program:
            raise EnvironmentProblem("this worker's program or packages are not those of the "
                                     "command: install the same, then run it again")
        source = _open_source(self.order, threading.get_ident())
        if not self.write:
            return merge_surveys(survey_rows(source, self.first + start, self.first + end)
                                 for start, end in row_blocks(self.last - self.first,
                                                              source.size[1]))
        write_rows(source, _plan_of(self.order), self.order, self.first, self.last)
        return None


def write_rows(source: ImageSource, plan: SpectraPlan, order: Order, first: int,
               last: int) -> None:
    """Write the spectra of some rows, and then a mark that they are written.

    Parameters
    ----------
    source : ImageSource
    plan : SpectraPlan
    order : Order
    first, last : int
        From a multiple of ``CHUNK_PX`` to the next, or to the end.
    """
    arrays = uplift_layout(order.request).paths(order.folder).values()
    regions = [open_region(path) for path in arrays]
    _, width, bands = source.size
    for row in range(first, last, CHUNK_PX):
        end = min(row + CHUNK_PX, last)
        signals = source.block(row, end).signals.reshape(end - row, width, bands)
        for column in range(0, width, CHUNK_PX * CHUNKS_A_SHARD):
            shard = signals[:, column:column + CHUNK_PX * CHUNKS_A_SHARD]
            blocks = [plan.split(plan.values(source, PixelBlock(
                shard[start:stop].reshape(-1, bands), None, None)))
                for start, stop in row_blocks(*shard.shape[:2])]
            for region, parts in zip(regions, zip(*blocks, strict=True), strict=True):
                region.write(row, column, np.concatenate(parts).reshape(*shard.shape[:2], -1))
    for region in regions:
        region.sync(first, last)
    write_text_whole(done_mark(order.folder, first), "")


def done_mark(folder: Path, first: int) -> Path:
    """The file whose presence says that a task's rows are written."""
    return folder / DONE / str(first)


def store_plan(folder: Path, plan: SpectraPlan, outside: int) -> None:
    """Store a plan of an image, and how many of its pixels are outside 0 to 1.

    Parameters
    ----------
    folder : Path
    plan : SpectraPlan
    outside : int
    """
    arrays = {"outside": np.array(outside)}
    for table in plan.tables:
        arrays |= {name: value for name, value in vars(table).items() if value is not None}
    with whole_file(folder / PLAN) as unfinished, unfinished.open("wb") as file:
        np.savez(file, **arrays)    # type: ignore[arg-type]


def load_plan(folder: Path, layout: PictureLayout) -> tuple[SpectraPlan, int]:
    """The plan and the count that ``store_plan`` stored."""
    with np.load(folder / PLAN, allow_pickle=False) as stored:
        tables = tuple(kind(**{each.name: stored.get(each.name) for each in fields(kind)})
                       for kind in (LightTable, LocalPosteriors) if fields(kind)[0].name in stored)
        return SpectraPlan(layout, tables), int(stored["outside"])


@functools.lru_cache(maxsize=OPEN_IMAGES)
def _open_source(order: Order, thread: int) -> ImageSource:
    """The image, open for one thread alone: its file keeps the position of the last reading."""
    return image_source(order.request)


@functools.lru_cache(maxsize=1)
def _plan_of(order: Order) -> SpectraPlan:
    return load_plan(order.folder, uplift_layout(order.request))[0]
