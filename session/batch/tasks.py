"""One session of a batch, looked at or run in whatever process it is sent to."""
from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path

from spectrabox.radiometry.errors import EnvironmentProblem, SpectraboxError
from spectrabox.session.batch.manifest import Outcome, files_behind, made_by
from spectrabox.session.batch.needs import PeakMemory, needed_bytes
from spectrabox.session.command_line import describe_error, interrupt_behind
from spectrabox.session.config.session_file import read_session

SHARED = "shared"       # in the batch's folder: calibrations that sessions have in common


@dataclass(frozen=True)
class Order:
    """What is asked of a batch."""

    folders: tuple[Path, ...]
    out: Path                   # the batch's folder
    device: str                 # "auto", "cpu" or "cuda"
    allow_outside: bool
    made_by: str                # of ``manifest.made_by``


@dataclass(frozen=True)
class Task:
    """What is to be done with one session.

    A scene is looked at first: its short stages are run and kept, which tells what the long ones
    will take. Flat samples are run at once.
    """

    folder: Path
    order: Order
    look: bool                  # only look at it
    needed_bytes: int           # of memory, with the program
    tries: int = 0              # how often a worker died of it, or beside it

    def __call__(self) -> Outcome:
        """Do it, on a worker."""
        return do_task(self)


def do_task(task: Task) -> Outcome:
    """Look at a session, or run it whole and write its report.

    Whatever goes wrong with the session is in the outcome, in a sentence. Only an interrupt is
    raised: what is whole then is kept.
    """
    start, memory = time.perf_counter(), PeakMemory()
    try:
        _require_same_program(task)
        done = _looked_at(task) if task.look else _run(task)
    except BaseException as error:      # a batch goes on, whatever one of its sessions meets
        if interrupt_behind(error) is not None or isinstance(error, SystemExit | GeneratorExit):
            raise
        said, code = describe_error(error)
        done = failed(task, said, code)
    return replace(done, seconds=round(time.perf_counter() - start, 3), peak_bytes=memory.peak())


def failed(task: Task, said: str, exit_code: int) -> Outcome:
    """The outcome of a session that has no results."""
    return Outcome(str(task.folder), "failed", task.folder.name, says=said, exit_code=exit_code,
                   needed_bytes=task.needed_bytes)


def _looked_at(task: Task) -> Outcome:
    from spectrabox.session.check import preflight_check
    from spectrabox.session.stages.order import all_stages
    from spectrabox.session.store.locks import only_writer
    order = task.order
    with only_writer(task.folder, all_stages(), "spectrabox batch"):
        found = preflight_check(task.folder, order.allow_outside, order.device, order.out / SHARED)
    if found.problems:
        return failed(task, "\n".join(each.sentence for each in found.problems),
                      min(each.exit_code for each in found.problems))
    return Outcome(str(task.folder), "ready", task.folder.name,
                   needed_bytes=task.needed_bytes + (found.tracing_bytes or 0))


def _run(task: Task) -> Outcome:
    from spectrabox.session.pipeline import run_stages
    from spectrabox.session.run_outputs import outputs_of_run
    from spectrabox.session.stages.order import all_stages
    from spectrabox.session.store.locks import only_writer

    def quiet(stage: str, share: float, message: str) -> None:
        """A batch shows sessions, not stages."""

    order = task.order
    config = read_session(task.folder, order.allow_outside)
    with only_writer(config.folder, all_stages(), "spectrabox batch"):
        finished = run_stages(config, device=order.device, only=None, force=False, progress=quiet,
                              shared=order.out / SHARED)
        # as 'run' has it: the command that makes these results again
        words = ["spectrabox", "run", task.folder.name, "--device", order.device]
        facts = outputs_of_run(config, finished, words, order.device, quiet).facts
        of = files_behind(config)
    return Outcome(str(task.folder), "done", config.session.name, facts["verdict"],
                   facts.get("says", ""), report=facts["report"],
                   stages={name: (finished.states[name], stage.seconds)
                           for name, stage in finished.stored.items()},
                   needed_bytes=task.needed_bytes, of=of)


def tried_task(folder: Path, order: Order) -> Task | Outcome:
    """The first task of a session, or its failure where its files cannot be read."""
    task = Task(folder, order, look=False, needed_bytes=0)
    try:
        config = read_session(folder, order.allow_outside)
        return replace(task, look=not config.flat, needed_bytes=needed_bytes(config))
    except SpectraboxError as error:
        return failed(task, str(error), error.exit_code)


def _require_same_program(task: Task) -> None:
    """Refuse to make results that are not those of the batch's own machine."""
    if made_by() != task.order.made_by:
        raise EnvironmentProblem("this worker's program, packages or kept cameras are not those "
                                 "that the batch began with: install the same, then run the same "
                                 "command again")
