"""The command that replays a session with known truths."""
from __future__ import annotations

from typing import Annotated

import typer

from spectrabox.session.command_line import (
    Debug,
    Device,
    Folder,
    Json,
    Outside,
    Quiet,
    answer,
    check_device,
    command,
)


def register(app: typer.Typer) -> None:
    """Add the command to the command line."""
    app.command()(rehearse)


def rehearse(folder: Folder,
             times: Annotated[int, typer.Option(help="Photos of known truth, from 20 up.")] = 200,
             seed: Annotated[int, typer.Option(help="Of truths, photos and draws.")] = 1,
             device: Device = "auto", allow_outside: Outside = False, quiet: Quiet = False,
             as_json: Json = False, debug: Debug = False) -> None:
    """Do this session's bands hold? Its photos again with known truths, through the same code."""
    with command(as_json, debug):
        check_device(device)
        from spectrabox.session.config.session_file import read_session
        from spectrabox.session.progress_display import progress_display
        from spectrabox.session.rehearsal import facts
        from spectrabox.session.rehearsal import rehearse as replay
        from spectrabox.session.stages.order import all_stages
        from spectrabox.session.store.rehearsals import rehearsal_text, save_rehearsal
        from spectrabox.session.store.session_lock import only_writer
        config = read_session(folder, allow_outside)
        with only_writer(config.folder, all_stages(), "spectrabox rehearse"), \
                progress_display(quiet) as progress:
            rehearsals = replay(config, times, seed, device,
                                lambda done, what: progress("rehearse", done, what))
            answers = facts(rehearsals, config.sampling.level, seed)
            path = save_rehearsal(config, answers)
        answer(as_json, answers | {"file": str(path)}, rehearsal_text(answers))
