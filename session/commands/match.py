"""The command that compares a finished session with libraries of measured spectra."""
from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from spectrabox.session.command_line import Debug, Json, Outside, answer, command

Session = Annotated[Path, typer.Argument(metavar="SESSION", help="The folder of a finished "
                                         "session.", show_default=False)]
Libraries = Annotated[list[str], typer.Argument(
    metavar="LIBRARY...", help="Files of reflectances of any format, folders of them, or published "
    "sets: \"CES99\", \"BabelColor Average\" ...", show_default=False)]
Surfaces = Annotated[list[str] | None, typer.Option(
    "--surface", help="Of this surface or region alone; may be repeated.")]
Variation = Annotated[float, typer.Option(
    help="How far another sample of one material differs from the library's: standard deviation, "
    "of white.")]
Ratio = Annotated[float | None, typer.Option(
    help="Spectra so many times less evident than the best still count as not told apart; by "
    "default what a true one exceeds 1 time in 20.")]


def register(app: typer.Typer) -> None:
    """Add this command to the command line."""
    app.command()(match)


def match(folder: Session, library: Libraries, surface: Surfaces = None,
          variation: Variation = 0.01, ratio: Ratio = None, allow_outside: Outside = False,
          as_json: Json = False, debug: Debug = False) -> None:
    """Which measured spectra of a library could give each signal, how many cannot be told apart,
    and whether none does.
    """
    with command(as_json, debug):
        from spectrabox.session.signals.match_answer import MatchRequest, match_answer
        answer(as_json, *match_answer(MatchRequest(folder, library, tuple(surface or ()),
                                                   variation, ratio, allow_outside)))
