"""The command that says what to do next."""
from __future__ import annotations

import typer

from spectrabox.session.commands.requests import AdviseRequest
from spectrabox.session.terminal.command_line import Answer, Command


def register(app: typer.Typer) -> None:
    """Add the command to the command line."""
    app.command()(advise)


@Command
def advise(request: AdviseRequest) -> Answer:
    """Say what to do next, and how much narrower each would make the bands: of a finished
    session, or of one signal.
    """
    from spectrabox.session.signals.advise_answer import advise_answer
    return Answer(*advise_answer(request))
