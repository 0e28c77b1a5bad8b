"""A batch from its sessions to their outcomes: those that are up to date are kept, the others are
given to workers as their memory allows. Of each, how much memory it needs, and running it.
"""
from __future__ import annotations

import os
import time
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from spectrabox.capture.photo import linear, metadata
from spectrabox.measure import captured, extras, texts
from spectrabox.measure.steps.declared_steps import INVERSION
from spectrabox.radiometry import errors, files
from spectrabox.session import kept_stages, pipeline, problems
from spectrabox.session.batch import executors, overview
from spectrabox.session.config.session_file import SessionConfig, read_session
from spectrabox.session.outputs.run_outputs import outputs_of_run
from spectrabox.session.outputs.session_results import calibrated_picture, raw_picture
from spectrabox.session.report.pictures import picture_data_uri
from spectrabox.session.store.locks import only_writer
from spectrabox.session.terminal.command_line import describe_error

SHARED = "shared"       # in the batch's folder: calibrations that sessions have in common
# Measured: 262 MB of flat samples, 290 MB of a box without what its tracing takes.
PROGRAM_BYTES = 400 * 2**20
# Measured while photos are opened: 18 bytes a pixel of a raw file, 36 of an EXR.
BYTES_A_PIXEL = 48
THUMBNAIL_PX = 160      # a side, at most, on the batch's page
PEAK, STATUS = Path("/proc/self/clear_refs"), Path("/proc/self/status")


@dataclass(frozen=True)
class Task:
    """A session to check or to run.

    A scene is checked first: its short stages are run and kept, which tells the memory of the long
    ones. Flat samples are run at once.
    """

    folder: Path
    out: Path                   # the batch's folder
    device: str                 # "auto", "cpu" or "cuda"
    allow_outside: bool
    program: str                # of ``program_of_batch``, where the batch began
    check: bool = False         # only check it
    needed_bytes: int = 0       # of memory, with the program

    def __call__(self) -> overview.Outcome:
        """Check the session, or run it whole and write its report, on a worker.

        An error becomes the outcome, as a sentence. Only an interrupt is raised: what is whole
        then is kept.
        """
        start, memory = time.perf_counter(), PeakMemory()
        try:
            if overview.program_of_batch() != self.program:
                raise errors.EnvironmentProblem(
                    "this worker's program, packages or kept cameras are not "
                    "those that the batch began with: install the same, then "
                    "run the same command again")
            outcome = _check(self) if self.check else _run(self)
        except BaseException as error:      # a batch goes on, whatever happens to one session
            stop = errors.interrupt_behind(error)
            if stop is not None:
                raise stop from None
            if isinstance(error, SystemExit | GeneratorExit):
                raise
            outcome = failed(self, *describe_error(error))
        return replace(outcome, seconds=round(time.perf_counter() - start, 3),
                       peak_bytes=memory.peak())


def first_task(task: Task) -> Task:
    """The first task of a session, with what it needs. Where its files cannot be read, running it
    says so.
    """
    try:
        config = read_session(task.folder, task.allow_outside)
        return replace(task, check=INVERSION.name in kept_stages.stage_names(config),
                       needed_bytes=needed_bytes(config))
    except errors.SpectraboxError:
        return task


def failed(task: Task, sentence: str, exit_code: int) -> overview.Outcome:
    """The outcome of a session that has no results."""
    return overview.Outcome(str(task.folder), "failed", task.folder.name, says=sentence,
                   exit_code=exit_code, needed_bytes=task.needed_bytes)


def _check(task: Task) -> overview.Outcome:
    with only_writer(task.folder, "spectrabox batch"):
        result = problems.check_session(task.folder, task.allow_outside, task.device,
                                        task.out / SHARED)
    if result.problems:
        return failed(task, "\n".join(result.problems), min(result.problems.values()))
    return overview.Outcome(str(task.folder), "ready", task.folder.name,
                   needed_bytes=task.needed_bytes + (result.tracing_bytes or 0))


def _run(task: Task) -> overview.Outcome:
    def quiet(stage: str, share: float, message: str) -> None:
        """A batch shows sessions, not stages."""

    config = read_session(task.folder, task.allow_outside)
    with only_writer(config.folder, "spectrabox batch"):
        finished = pipeline.run_stages(config, device=task.device, only=None, force=False,
                                       progress=quiet, shared=task.out / SHARED)
        # as 'run' has it: the command that makes these results again
        words = ["spectrabox", "run", task.folder.name, "--device", task.device]
        facts, _, _, failed = outputs_of_run(config, finished, words, task.device, quiet)
        files = overview.input_states(config)
        photo = metadata.photo_metadata(config.path(config.all_views[0].photo_files[0]))
        preview = shown_picture(config, finished.capture.views[0])
        thumbnail, fault = extras.attempt("picture of the photo", lambda: picture_data_uri(
            preview, THUMBNAIL_PX), "")
    return overview.Outcome(str(task.folder), "done", config.session.name, facts["verdict"],
                   facts.get("says", ""), report=facts["report"],
                   stages={name: (finished.states[name], stage.seconds)
                           for name, stage in finished.stored.items()},
                   needed_bytes=task.needed_bytes, files=files, camera=photo.camera,
                   taken_at=photo.taken_at, thumbnail=thumbnail,
                   failed_extras=tuple(texts.sentence(one) for one in extras.different(
                       (*failed, *(() if fault is None else (fault,))))))


def shown_picture(config: SessionConfig, view: captured.View) -> Path:
    """PNG of a view's photo for lists of sessions: calibrated, or else as the camera saw it."""
    calibrated = calibrated_picture(config.results_folder, view)
    return calibrated if calibrated.is_file() else raw_picture(config.results_folder, view)


def needed_bytes(config: SessionConfig) -> int:
    """Bytes that a session takes before it traces light, with the program.

    Of the photos the largest counts, with the flat fields that go with it: they are opened one
    after the other.

    Raises
    ------
    InputError
        If a photo is missing or none.
    """
    def pixels(names: list[str]) -> int:
        sizes = [linear.photo_size(config.path(name)) for name in names]
        return sum(width * height for width, height in sizes)

    correcting = pixels([*config.photos.flats.values(), *config.photos.dark_files[:1]])
    photos = [list(files) for view in config.all_views for files in (view.photo_files,
                                                                     view.chart_files)]
    return PROGRAM_BYTES + BYTES_A_PIXEL * (correcting + max(map(pixels, photos)))


class PeakMemory:
    """The most memory that this process has held since this object was made."""

    def __init__(self) -> None:
        self._reset = False
        try:
            handle = os.open(PEAK, os.O_WRONLY)
        except OSError:
            return
        try:
            os.write(handle, b"5")      # forget the peak until now (proc(5))
            self._reset = True
        except OSError:
            pass
        finally:
            os.close(handle)

    def peak(self) -> int | None:
        """Bytes; None where the system knows only the peak of the process's whole life."""
        if not self._reset:
            return None
        lines = dict(line.split(":", 1) for line in STATUS.read_text().splitlines())
        return int(lines["VmHWM"].split()[0]) * 1024


# ---- all of them ---------------------------------------------------------------------------------

def session_folders(named: Iterable[Path], listed: Path | None) -> list[Path]:
    """Folders of sessions, absolute, each once, in the order in which they are named.

    Parameters
    ----------
    named : iterable of Path
        On the command line.
    listed : Path or None
        A file with one folder a line, relative to its own folder; empty lines and those that begin
        with # are passed over.

    Raises
    ------
    InputError
        If none is named, or the list cannot be read.
    """
    folders = [folder.resolve() for folder in named]
    if listed is not None:
        try:
            text = files.read_text(listed)
        except (OSError, ValueError) as error:
            raise errors.InputError(
                f"{listed} cannot be read as a list of sessions ({error}); give a "
                "text file with one folder a line") from None
        lines = [line.strip() for line in text.splitlines()]
        folders += [(listed.parent / line).resolve() for line in lines
                    if line and not line.startswith("#")]
    if not folders:
        raise errors.InputError(
            "no session is named; give session folders, or --list FILE with one a "
            "line")
    return list(dict.fromkeys(folders))


def kept_outcomes(tasks: Sequence[Task]) -> dict[Path, overview.Outcome]:
    """Outcomes of sessions that are up to date already, by folder."""
    kept = {task.folder: overview.stored_outcome(task.out, task.folder, task.program)
            for task in tasks}
    return {folder: outcome for folder, outcome in kept.items() if outcome is not None}


def run_batch(waiting: Sequence[Task],
              workers: executors.Workers) -> Iterator[overview.Outcome]:
    """Run sessions on workers.

    Parameters
    ----------
    waiting : sequence of Task
        Of sessions that are not up to date.
    workers : Workers

    Yields
    ------
    Outcome
        As sessions end, each stored before.

    Raises
    ------
    EnvironmentProblem
        If the workers are out of reach. What is stored then stays so.
    """
    # made one by one: a task is known only once its session has been read
    new = (first_task(task) for task in waiting)
    checked = deque[Task]()
    for task, result in executors.run_tasks(
            workers, lambda: checked.popleft() if checked else next(new, None)):
        outcome = failed(task, str(result), result.exit_code) \
            if isinstance(result, errors.EnvironmentProblem) else result
        if outcome.state == "ready":
            checked.append(replace(task, check=False, needed_bytes=outcome.needed_bytes))
        else:
            overview.store_outcome(task.out, outcome, task.program)
            yield outcome
