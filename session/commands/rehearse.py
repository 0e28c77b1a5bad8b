"""The command that replays a session with known truths."""
from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import typer

from spectrabox.session.command_line import (
    Answer,
    Device,
    Quiet,
    SessionOptions,
    check_device,
    command,
)


def register(app: typer.Typer) -> None:
    """Add the command to the command line."""
    app.command()(rehearse)


@dataclass(frozen=True, kw_only=True)
class RehearseRequest(SessionOptions):
    """Options of ``spectrabox rehearse``."""

    times: Annotated[int, typer.Option(help="Photos of known truth, from 20 up.")] = 200
    seed: Annotated[int, typer.Option(help="Random seed of truths, photos and draws.")] = 1
    device: Device = "auto"
    quiet: Quiet = False


@command
def rehearse(request: RehearseRequest) -> Answer:
    """Do this session's bands hold? Its photos again with known truths, through the same code."""
    check_device(request.device)
    from spectrabox.session.config.session_file import read_session
    from spectrabox.session.progress_display import progress_display
    from spectrabox.session.rehearsal import facts
    from spectrabox.session.rehearsal import rehearse as replay
    from spectrabox.session.stages.order import all_stages
    from spectrabox.session.store.locks import only_writer
    from spectrabox.session.store.rehearsals import rehearsal_text, save_rehearsal
    config = read_session(request.folder, request.allow_outside)
    with only_writer(config.folder, all_stages(), "spectrabox rehearse"), \
            progress_display(request.quiet) as progress:
        rehearsals = replay(config, request.times, request.seed, request.device,
                            lambda done, what: progress("rehearse", done, what))
        answers = facts(rehearsals, config.sampling.level, request.seed)
        path = save_rehearsal(config, answers)
    return Answer(answers | {"file": str(path)}, rehearsal_text(answers))
