"""One picture shared out among workers: rows, memory, marks, plans, keys, and what is said."""
import contextlib
from collections import deque
from types import SimpleNamespace

import numpy as np
import OpenImageIO as oiio
import pytest
from compact_results import compact, without
from sampling_cameras import surface

from spectrabox.radiometry.errors import EnvironmentProblem, SpectraboxError
from spectrabox.radiometry.files import UNFINISHED
from spectrabox.radiometry.spectra.named_spectra import relative_response
from spectrabox.sampling.prior.low_rank import LowRank
from spectrabox.sampling.prior.mixture import GRID
from spectrabox.session.batch.pool import Finished, Lost
from spectrabox.session.signals.uplift import UpliftRequest, job_of
from spectrabox.session.signals.uplift_plan import Plan
from spectrabox.session.tiles import picture as tiles
from spectrabox.session.tiles import tasks
from spectrabox.session.tiles.picture import in_turn, needed_bytes, rows_of_a_task, tiled_answer
from spectrabox.session.tiles.stored_plan import load_plan, pixels_beyond, store_plan
from spectrabox.session.tiles.tasks import Order, Refused, RowsTask, done_mark

zarr = pytest.importorskip("zarr",
                           reason="Zarr is not installed: pip install 'spectrabox[zarr]'")
CAMERA, LIGHT, HEIGHT, WIDTH = "Nikon 5100 (NPL)", "D65", 290, 21
MIB = 2**20


@pytest.fixture(scope="module")
def image(tmp_path_factory):
    """A picture in tiles; a few pixels are brighter than white."""
    matrix = relative_response(CAMERA, LIGHT, GRID)
    surfaces = np.array([matrix @ surface(GRID.nm, each) for each in range(5)])
    shade = np.linspace(0.4, 1, HEIGHT)[:, None, None]
    pixels = surfaces[np.arange(WIDTH) % 5] * shade
    pixels[3, 4], pixels[200, 7] = [1.2, 0.9, 0.8], [-0.1, 0.2, 0.1]
    return write_tiles(tmp_path_factory.mktemp("picture") / "picture.exr", pixels)


def write_tiles(path, pixels, side=64):
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], 3, "half")
    spec.tile_height = spec.tile_width = side
    file = oiio.ImageOutput.create(str(path))
    assert file.open(str(path), spec)
    assert file.write_image(pixels.astype(np.float32)) and file.close()
    return path


def request(image, out, coefficients=None, **more):
    return UpliftRequest(image, out, CAMERA, LIGHT, None, 0.013, 5, 20, False,
                         **{"form": "zarr", "coefficients": coefficients} | more)


class Inline:
    """A pool of this process alone, which notes what it was given."""

    budget_bytes, largest_bytes, about, workers = None, None, "", 1

    def __init__(self, outcome):
        self.outcome, self.ended, self.log = outcome, [], []

    def start(self, task):
        self.log.append(f"{'write' if task.write else 'look at'} {task.first} to {task.last}"
                        f"{'!' * task.tries}")
        self.ended.append(self.outcome(task))

    def wait(self):
        ended, self.ended = self.ended, []
        return ended


@pytest.fixture
def inline(monkeypatch):
    """A function that makes tasks run here, or end as it is told."""
    def use(outcome=lambda task: Finished(task, task())):
        pool = Inline(outcome)
        monkeypatch.setattr(tiles, "open_workers", lambda *words: contextlib.nullcontext(pool))
        return pool
    monkeypatch.setattr(tiles, "TASK_PIXELS", 1)
    return use


def arrays_in(out):
    """Every array under a folder, and what is stated with it."""
    found = {}
    for path in sorted(out.rglob("zarr.json")):
        node = zarr.open(str(path.parent), mode="r")
        name = path.parent.relative_to(out).as_posix()
        found[f"{name} says"] = compact(dict(node.attrs))
        if isinstance(node, zarr.Array):
            found[name] = np.asarray(node[...], float)
            found[f"{name} type"] = f"{node.dtype} {node.chunks} {node.shards}"
    return found


@pytest.mark.parametrize("options", [{}, {"coefficients": 6, "families": ("paint", "textile")},
                                     {"full": True, "white": "0.9,1.1,1.2"}],
                         ids=["spectra", "low rank", "full"])
def test_the_arrays_and_what_is_said(options, image, tmp_path, inline, recorded):
    pool, progress = inline(), []
    asked = request(image, tmp_path / "out", options.get("coefficients"))
    asked = UpliftRequest(**(vars(asked) | options))
    facts, text = tiled_answer(asked, None, 2, lambda *words: progress.append(list(words)))
    recorded([pool.log, compact(facts, [tmp_path]), progress], rtol=1e-3, case="answer")
    recorded([without(line, [tmp_path]) for line in text.splitlines()], rtol=1e-3, case="text")
    # tables are single floats, arrays are halves
    recorded(arrays_in(tmp_path / "out"), rtol=2e-3, case="arrays")
    assert not list((tmp_path / "out").glob(f"{UNFINISHED}*"))


def test_what_is_left_where_a_command_ended_and_what_follows(image, tmp_path, inline, recorded):
    """After each task at which it is cut short: what is marked, and what is then done."""
    found = []
    for after in (1, 2, 3, 4, 5):
        out, done = tmp_path / str(after), []

        def ending(task, done=done, after=after):
            if len(done) == after:
                raise ZeroDivisionError
            done.append(task)
            return Finished(task, task())
        pool = inline(ending)
        with pytest.raises(ZeroDivisionError):
            tiled_answer(request(image, out), None, 2, lambda *_: None)
        folder = next(out.glob(f"{UNFINISHED}tiles-*"), out / "none")
        marks = sorted(path.name for path in folder.glob("done/*"))
        kept, progress, again = [pool.log, marks, (folder / tiles.PLAN).exists()], [], inline()
        facts, _ = tiled_answer(request(image, out), None, 2,
                                lambda *words, progress=progress: progress.append(list(words)))
        found.append([*kept, again.log, facts["tasks"], facts["done_before"], progress])
    recorded(found)


@pytest.mark.parametrize("height, width, at_once, coefficients, kept", [
    (4000, 6000, 1, None, (31, 16)), (4000, 6000, 300, 8, (61, 61)), (90, 50, 64, None, (31, 16)),
    (100_000, 40, 1000, 16, (31, 16)), (20_000, 100_000, 1, None, (61, 31))])
def test_rows_and_memory_of_a_task(height, width, at_once, coefficients, kept, recorded):
    job = SimpleNamespace(picture=SimpleNamespace(width=width, height=height, bands=3,
                                                  rows_at_once=at_once),
                          coefficients=coefficients,
                          kept=SimpleNamespace(nm=[np.zeros(each) for each in kept]))
    recorded([rows_of_a_task(job), needed_bytes(job) - tasks.PROGRAM_BYTES])


class Slow:
    """A pool whose tasks end in another order than they began."""

    def __init__(self, workers, budget, ends):
        self.workers, self.budget_bytes, self._ends = workers, budget, ends
        self.running, self.log = deque(), []

    def start(self, task):
        self.running.append(task)
        self.log.append(" + ".join(f"{each.first}{'!' * each.tries}" for each in self.running))

    def wait(self):
        return [self._ends(self.running.pop())]


@pytest.mark.parametrize("workers, budget", [(1, None), (3, None), (3, 25 * MIB), (4, 3 * MIB),
                                             (2, 100 * MIB)])
def test_results_come_in_the_order_of_the_rows(workers, budget, recorded):
    def ends(task):
        if task.first == 20 and not task.tries:
            return Lost(task, "by signal 9")
        return Finished(task, f"rows {task.first}")
    pool = Slow(workers, budget, ends)
    made = list(in_turn(pool, 10 * MIB, (RowsTask(None, at, at + 10, True, 10 * MIB)
                                         for at in range(0, 60, 10))))
    assert made == [f"rows {at}" for at in range(0, 60, 10)]
    recorded(pool.log)


@pytest.mark.parametrize("end", [lambda task: Lost(task, "with exit code 3"),
                                 lambda task: Finished(task, Refused("what is wrong", 4))])
def test_what_ends_a_picture(end, recorded):
    with pytest.raises(SpectraboxError) as ended:
        list(in_turn(Slow(2, None, end), 1, iter([RowsTask(None, 128, 256, True, 1)])))
    recorded([str(ended.value), ended.value.exit_code, type(ended.value).__name__])


@pytest.mark.parametrize("error", [ValueError("x"), MemoryError(), EnvironmentProblem("y"),
                                   SpectraboxError("z"), OSError(28, "No space left")])
def test_what_a_worker_says_of_an_error(error, tmp_path, recorded, monkeypatch):
    monkeypatch.setattr(tasks, "made_by", lambda: "this program")

    def refusing(*_):
        raise error
    monkeypatch.setattr(tasks, "_job", refusing)
    order = Order(None, tmp_path, "this program")
    recorded([RowsTask(order, 0, 8, True, 1)(),
              RowsTask(Order(None, tmp_path, "another"), 0, 8, False, 1)()])
    for interrupt in (KeyboardInterrupt, SystemExit):
        def interrupted(*_, interrupt=interrupt):
            raise interrupt
        monkeypatch.setattr(tasks, "_job", interrupted)
        with pytest.raises(interrupt):
            RowsTask(order, 0, 8, True, 1)()


def test_a_plan_comes_back_as_it_was_kept(tmp_path, recorded):
    rng = np.random.default_rng(3)
    plans = [Plan(rng.uniform(size=(2, 5)), rng.uniform(size=(2, 3, 4)), None, None),
             Plan(None, None, LowRank(rng.uniform(size=(4, 61))), {"mean": 0.01, "spread": 0.02})]
    for number, plan in enumerate(plans):
        store_plan(tmp_path, plan, 17 + number)
        back = load_plan(tmp_path)
        for name in ("row", "columns"):
            assert (getattr(back, name) is None) == (getattr(plan, name) is None)
        recorded([back.row, back.columns, None if back.low_rank is None else back.low_rank.basis,
                  back.errors, pixels_beyond(tmp_path)], case=str(number))
    recorded(done_mark(tmp_path, 128).relative_to(tmp_path).as_posix(), case="mark")


def test_every_input_changes_where_a_picture_grows(image, tmp_path, monkeypatch):
    def key(made="this", path=image, **changes):
        asked = UpliftRequest(**(vars(request(path, tmp_path)) | changes))
        return tiles._key(job_of(asked), asked, made)
    other = write_tiles(tmp_path / "other.exr", np.full((40, 30, 3), 0.3))
    keys = [key(), key("another"), key(path=other), key(sensitivity="cie_2_1931"), key(light="A"),
            key(white="1,1,0.9"), key(noise=0.02), key(side=7), key(step_nm=10), key(full=True),
            key(coefficients=5), key(families=("paint",)), key(families=("textile",))]
    monkeypatch.setattr(tiles, "TASK_PIXELS", 1)
    keys.append(key())
    other.write_bytes(other.read_bytes() + b" ")
    keys.append(key(path=other))
    assert len(set(keys)) == len(keys)
    assert key(families=("paint", "textile")) == key(families=("textile", "paint"))
