"""The command that takes the draws of a finished session to other programs."""
from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from spectrabox.session.command_line import Answer, SessionOptions, check_ending, command, tell


def register(app: typer.Typer) -> None:
    """Add this command to the command line."""
    app.command()(draws)


@dataclass(frozen=True, kw_only=True)
class DrawsRequest(SessionOptions):
    """Options of ``spectrabox draws``."""

    out: Annotated[Path, typer.Option(
        "--out", "-o", metavar="FILE", show_default=False, help=".npz: one array a surface; .csv "
        "or .parquet: a row for each surface, draw and wavelength.")]
    step: Annotated[int, typer.Option(min=1, max=100, help="Nanometres between wavelengths.")] = 5
    count: Annotated[int | None, typer.Option(
        "--draws", min=1, help="Of each surface; all by default.")] = None


@command
def draws(request: DrawsRequest) -> Answer:
    """Every spectrum that was drawn for the surfaces of a finished session, as one file."""
    from spectrabox.session.store.draws_files import FORMS, stored_draws, write_draws
    check_ending(request.out, FORMS)
    from spectrabox.session.config.session_file import read_session
    from spectrabox.session.pipeline import load_finished, stale_stages
    config = read_session(request.folder, request.allow_outside)
    made = stored_draws(load_finished(config).stored, request.step, request.count)
    stale, said = stale_stages(config)
    if said:
        tell(f"warning: {said}")
    write_draws(request.out, made)
    numbers = {name: len(values) for name, (_, values) in made.items()}
    nm = next(iter(made.values()))[0]
    counts = ", ".join(f"{count} of {name}" for name, count in numbers.items())
    return Answer({"file": request.out, "draws": numbers, "wavelengths_nm": nm, "stale": stale},
                  f"wrote {request.out}: {counts}, {nm[0]:g}-{nm[-1]:g} nm every {request.step} "
                  "nm")
