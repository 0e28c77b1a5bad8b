"""A batch from its sessions to their outcomes: those that are up to date are kept, the others are
given to workers as their memory allows.
"""
from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

from spectrabox.radiometry import errors, files
from spectrabox.session.batch import executors, overview, tasks


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


def kept_outcomes(order: tasks.Order) -> dict[Path, overview.Outcome]:
    """Outcomes of sessions that are up to date already, by folder."""
    kept = {
        folder: overview.stored_outcome(order.out, folder, order.program)
        for folder in order.folders
    }
    return {folder: outcome for folder, outcome in kept.items() if outcome is not None}


def run_batch(order: tasks.Order, waiting: list[Path],
              workers: executors.Workers) -> Iterator[overview.Outcome]:
    """Run sessions on workers.

    Parameters
    ----------
    order : Order
    waiting : list of Path
        Sessions that are not up to date.
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
    new = (tasks.first_task(folder, order) for folder in waiting)
    checked = deque[tasks.Task]()
    for task, result in executors.run_tasks(
            workers, lambda: checked.popleft() if checked else next(new, None)):
        outcome = tasks.failed(task, str(result), result.exit_code) \
            if isinstance(result, errors.EnvironmentProblem) else result
        if outcome.state == "ready":
            checked.append(replace(task, check=False, needed_bytes=outcome.needed_bytes))
        else:
            overview.store_outcome(order.out, outcome, order.program)
            yield outcome
