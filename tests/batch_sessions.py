"""Small sessions for batches: one paint beside a chart, which all have in common."""
import contextlib
import json
import os
import shutil
import signal
import threading
import time

from flat_example import HEAD, regions_toml, write_flat

from spectrabox.radiometry.files import sha256_of
from spectrabox.session.batch.overview import program_of_batch
from spectrabox.session.batch.tasks import Task

KEPT = {".npz", ".csv", ".xml", ".png"}
FLAT = ("chart", "photo", "calibrate", "signals", "sample")     # stages, in order


def write_session(folder):
    """A session of flat samples with one region."""
    folder.mkdir(parents=True)
    write_flat(folder)
    text = HEAD + regions_toml(("red_wall",))
    (folder / "session.toml").write_text(text, encoding="utf-8")
    return folder


def copies(session, folder, names):
    """Copies of a session under other names, without results."""
    return [shutil.copytree(session, folder / name, ignore=shutil.ignore_patterns(
        "results", "report.html", "spectra.csv", "materials.csv", "spdx")) for name in names]


def begun(session, folder, names, until):
    """Copies with the results of the stages before one of them."""
    folders = copies(session, folder, names)
    for each in folders:
        for stage in FLAT[:FLAT.index(until)]:
            shutil.copytree(session / "results" / stage, each / "results" / stage)
    return folders


def results_of(folder):
    """Digests of all that a run leaves, but for what says when and how fast it was made."""
    return {path.relative_to(folder).as_posix(): sha256_of(path)
            for path in sorted(folder.rglob("*")) if path.suffix in KEPT
            and not path.is_relative_to(folder / "photos")}


def batch_of(folders, out, made=None):
    """The tasks of a batch."""
    program = program_of_batch() if made is None else made
    return [Task(folder, out, "cpu", False, program) for folder in folders]


def process_at(folder, limit_s=120):
    """Number of the process that works in a session, once one does."""
    end = time.monotonic() + limit_s
    while time.monotonic() < end:
        try:
            return json.loads((folder / "results" / ".run.lock").read_text())["process"]
        except (OSError, ValueError):
            time.sleep(0.01)
    raise AssertionError(f"nobody worked in {folder}")


@contextlib.contextmanager
def kill_worker_at(folder):
    """The first process that works in a session during the block is killed."""
    killing = threading.Thread(target=lambda: os.kill(process_at(folder), signal.SIGKILL))
    killing.start()
    yield
    killing.join()
