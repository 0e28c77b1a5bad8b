"""One picture on several workers: the bits of one process, whoever dies on the way."""
import contextlib
import os
import signal
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from inline_workers import inline_workers
from shaded_images import CAMERA, LIGHT, shaded_image, write_image
from typer.testing import CliRunner

from spectrabox.radiometry.errors import EnvironmentProblem, InputError, SpectraboxError
from spectrabox.radiometry.files import UNFINISHED
from spectrabox.session.batch.executors import Capacity, NotRun, Workers
from spectrabox.session.cli import app
from spectrabox.session.commands.requests import UpliftRequest
from spectrabox.session.pictures import shared_uplift as tiles
from spectrabox.session.pictures.row_tasks import RowsTask
from spectrabox.session.pictures.shared_uplift import shared_uplift_answer
from spectrabox.session.pictures.uplift_answer import uplift_answer

pytest.importorskip("zarr", reason="Zarr is not installed: pip install 'spectrabox[zarr]'")
HEIGHT, WIDTH, TASKS = 400, 70, 4
# Dask closes sockets and event loops when they are collected
DASK = pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::DeprecationWarning",
                                  "ignore::pytest.PytestUnraisableExceptionWarning")


@pytest.fixture(scope="module")
def image(tmp_path_factory):
    """A picture in tiles."""
    return write_image(tmp_path_factory.mktemp("picture") / "picture.exr",
                       shaded_image(HEIGHT, WIDTH), (64, 64))


@pytest.fixture(autouse=True)
def _one_shard_a_task(monkeypatch):
    monkeypatch.setattr(tiles, "TASK_PIXELS", 1)


def request(image, out, **more):
    return UpliftRequest(image=image, out=out, sensitivity=CAMERA, light=LIGHT, side=5,
                         **{"to": "zarr"} | more)


def contents(out):
    """Bytes of every file, but for the lock."""
    return {path.relative_to(out).as_posix(): path.read_bytes() for path in sorted(out.rglob("*"))
            if path.is_file() and path.suffix != ".lock"}


def answer(image, out, workers=None, cluster=None):
    return shared_uplift_answer(request(image, out, workers=workers, cluster=cluster),
                                lambda *_: None)[0]


@pytest.fixture
def inline(monkeypatch):
    """A function that makes tasks run here, and gives the list of first rows as they are written;
    ``work`` takes a task and that list.
    """
    def use(work=lambda task, written: task()):
        written = []

        def note(task):
            if task.write:
                written.append(task.first)
            return work(task, written)

        use_workers(monkeypatch, inline_workers(note)[1])
        return written
    return use


def use_workers(monkeypatch, workers):
    monkeypatch.setattr(tiles, "open_workers", lambda *_: contextlib.nullcontext(workers))


# ---- the same bits

def test_two_processes_write_the_bits_of_one(image, tmp_path):
    facts, _ = uplift_answer(request(image, tmp_path / "one"), lambda *_: None)
    shared = answer(image, tmp_path / "two", workers=2)
    assert contents(tmp_path / "two") == contents(tmp_path / "one")
    assert (shared["tasks"], shared["done_before"]) == (TASKS, 0)
    assert shared["outside_0_to_1"] == facts["outside_0_to_1"]


@pytest.fixture(scope="module")
def expected(image, tmp_path_factory):
    """Bytes of what one process writes of spectra."""
    out = tmp_path_factory.mktemp("one")
    uplift_answer(request(image, out), lambda *_: None)
    return contents(out)


@DASK
def test_a_cluster_writes_the_bits_of_one_process(image, expected, tmp_path):
    pytest.importorskip("distributed", reason="no Dask here: pip install 'spectrabox[cluster]'")
    answer(image, tmp_path, workers=1, cluster="local")
    assert contents(tmp_path) == expected


@dataclass(frozen=True)
class DyingOnce(RowsTask):
    """Rows at whose writing a worker is killed, once."""

    def __call__(self):
        killed = self.order.request.out.parent / "killed"
        if self.write and not killed.exists():
            killed.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return super().__call__()


def test_a_worker_that_is_killed_costs_nothing_but_time(image, expected, tmp_path, monkeypatch):
    monkeypatch.setattr(tiles, "RowsTask", DyingOnce)
    answer(image, tmp_path / "out", workers=2)
    assert (tmp_path / "killed").exists() and contents(tmp_path / "out") == expected


def test_threads_of_one_worker_do_not_share_an_open_picture(image, expected, tmp_path, monkeypatch):
    """Dask's workers may have several threads, and a file is read from where it was read last."""
    with ThreadPoolExecutor(4) as threads:
        use_workers(monkeypatch, Workers("", lambda: Capacity(4, None, None), lambda _: threads))
        answer(image, tmp_path)
    assert contents(tmp_path) == expected


# ---- going on

def test_what_is_done_is_not_done_again(image, expected, tmp_path, inline):
    def stopped(task, written):
        if len(written) == 3:
            raise EnvironmentProblem("the cluster is gone")
        return task()

    inline(stopped)
    with pytest.raises(EnvironmentProblem, match="gone"):
        answer(image, tmp_path)
    assert not [path for path in tmp_path.iterdir() if path.suffix == ".zarr"]
    written = inline()
    made = answer(image, tmp_path)
    assert written == [256, 384] and made["done_before"] == 2
    assert contents(tmp_path) == expected


def test_an_end_that_was_cut_short_is_made_up_for(image, expected, tmp_path, inline, monkeypatch):
    inline()
    with monkeypatch.context() as patch:
        patch.setattr(tiles, "sync", lambda folder: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            answer(image, tmp_path)
    written = inline()
    answer(image, tmp_path)
    assert written == [] and contents(tmp_path) == expected


def test_clearing_up_that_was_cut_short_leaves_no_rows_unwritten(image, expected, tmp_path, inline,
                                                                 monkeypatch):
    """Marks of rows that are done outlive the arrays that they speak of."""
    def cut_short(folder, **_):
        if (folder / tiles.DONE).exists():
            raise ZeroDivisionError

    inline()
    with monkeypatch.context() as patch:
        patch.setattr(tiles.shutil, "rmtree", cut_short)
        with pytest.raises(ZeroDivisionError):
            answer(image, tmp_path)
    written = inline()
    answer(image, tmp_path)
    assert len(written) == TASKS and contents(tmp_path) == expected


def test_another_picture_begins_anew(image, tmp_path, inline):
    inline(lambda task, written: task() if len(written) < 2 else 1 / 0)
    with pytest.raises(ZeroDivisionError):
        answer(image, tmp_path)
    (before,) = tmp_path.glob(f"{UNFINISHED}tiles-*")
    pixels = np.full((HEIGHT, WIDTH, 3), 0.25)
    written = inline()
    made = answer(write_image(tmp_path / "other.exr", pixels, (64, 64)), tmp_path)
    assert made["done_before"] == 0 and len(written) == TASKS
    assert not before.exists()


def test_a_second_picture_takes_the_place_of_the_first(image, expected, tmp_path, inline):
    inline()
    grey = write_image(tmp_path / "p.exr", np.full((HEIGHT, WIDTH, 3), 0.25), (64, 64))
    for path in (grey, image):
        answer(path, tmp_path)
    (tmp_path / "p.exr").unlink()
    assert contents(tmp_path) == expected


# ---- what ends it

def test_rows_whose_worker_dies_are_one_sentence(image, tmp_path, inline):
    inline(lambda task, written: NotRun("its worker died"))
    with pytest.raises(EnvironmentProblem, match="rows 0 to 128 have no spectra: its worker died"):
        answer(image, tmp_path)


def test_rows_that_are_wrong_end_the_command_with_their_sentence(tmp_path, inline):
    pixels = np.full((HEIGHT, WIDTH, 3), 0.25)
    pixels[300, 3, 1] = np.nan
    inline()
    with pytest.raises(SpectraboxError, match="values that are NaN") as refused:
        answer(write_image(tmp_path / "nan.exr", pixels, (64, 64)), tmp_path / "out")
    assert refused.value.exit_code == InputError.exit_code


def test_a_worker_with_another_program_is_refused(image, tmp_path, inline, monkeypatch):
    inline()
    monkeypatch.setattr(tiles, "program_digest", lambda: "another")
    with pytest.raises(SpectraboxError, match="this worker's program or packages are not those"):
        answer(image, tmp_path)


def test_one_stream_is_not_shared_out(image, tmp_path):
    with pytest.raises(InputError, match="--to exr is one stream: give --to zarr"):
        shared_uplift_answer(request(image, tmp_path, to="exr", workers=2), lambda *_: None)


@pytest.mark.parametrize("words", [["--workers", "2"], ["--cluster", "local"]])
def test_the_command_shares_out_what_it_is_asked_to(words, image, tmp_path):
    result = CliRunner().invoke(app, ["uplift", str(image), "-o", str(tmp_path), "--sensitivity",
                                      CAMERA, "--light", LIGHT, "--to", "tiled-exr", *words])
    assert result.exit_code == InputError.exit_code
    assert "several workers write into Zarr arrays" in " ".join(result.output.split())


@pytest.mark.parametrize("make, message", [
    (lambda path: path.write_text("x", encoding="utf-8"), "mean.zarr cannot be written: it is a"),
    (lambda path: path.symlink_to(Path("elsewhere")), "mean.zarr is a symbolic link")])
def test_what_is_in_the_way_is_said_before_work_begins(make, message, image, tmp_path, inline):
    written = inline()
    make(tmp_path / "mean.zarr")
    with pytest.raises(EnvironmentProblem, match=message):
        answer(image, tmp_path)
    assert written == []
