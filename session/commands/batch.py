"""The command that runs many sessions."""
from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from spectrabox.session.terminal import command_line


def register(app: typer.Typer) -> None:
    """Add the command to the command line."""
    app.command()(batch)


@command_line.Command
def batch(
    folders: Annotated[tuple[Path, ...], typer.Argument(
        metavar="DIR...", show_default=False, help="Session folders.")] = (),
    listed: Annotated[Path | None, typer.Option(
        "--list", metavar="FILE", show_default=False, help="Session folders, one a line.")] = None,
    workers: Annotated[int | None, typer.Option(
        min=1, help="Sessions at a time; as many as there are cores by default, fewer where memory "
        "would not do.")] = None,
    cluster: Annotated[str | None, typer.Option(
        metavar="ADDRESS", show_default=False, help="A Dask scheduler such as tcp://host:8786, "
        "whose workers see the same folders; local starts one on this machine.")] = None,
    dashboard: Annotated[bool, typer.Option(
        "--dashboard", help="With --cluster local: Dask's page of what its workers do, on port "
        "8787 of this machine; any of its users can read it.")] = False,
    out: Annotated[Path, typer.Option(
        "--out", "-o", metavar="DIR", help="Folder of what is done, shared calibrations and the "
        "page of all verdicts.")] = Path("batch"),
    device: command_line.Device = "auto",
    allow_outside: command_line.Outside = False,
    quiet: command_line.Quiet = False,
) -> command_line.Answer:
    """Run many sessions, several at a time, and write one page of all verdicts."""
    from spectrabox.session.batch import overview, tasks
    from spectrabox.session.batch.workers import open_workers
    from spectrabox.session.store.locks import sole_user
    from spectrabox.session.terminal.progress_display import progress_display
    out, program = out.resolve(), overview.program_of_batch()
    sessions = [tasks.Task(folder, out, device, allow_outside, program)
                for folder in tasks.session_folders(folders, listed)]
    with sole_user(out):
        outcomes = tasks.kept_outcomes(sessions)
        kept, waiting = len(outcomes), [each for each in sessions if each.folder not in outcomes]
        used = 0
        try:
            with progress_display(quiet) as show, \
                    open_workers(cluster, workers, len(waiting), dashboard) as pool:
                if pool.about and not quiet:
                    command_line.tell(pool.about)
                used, _, _ = pool.capacity()
                progress = overview.BatchProgress(show, len(sessions), kept,
                                                  not quiet and not sys.stderr.isatty())
                for outcome in tasks.run_batch(waiting, pool):
                    outcomes[Path(outcome.folder)] = outcome
                    progress.add(outcome)
        finally:    # also of what is done when Ctrl-C ends it
            ended = [outcomes[each.folder] for each in sessions if each.folder in outcomes]
            page = overview.write_page(out, ended, len(sessions))
    failed = [each.exit_code for each in ended if each.state == "failed"]
    return command_line.Answer(overview.batch_facts(ended, kept, page, used),
                               overview.batch_text(ended, kept, page), min(failed, default=0))
