"""The command that takes the draws of a finished session to other programs."""
from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from spectrabox.session.command_line import (
    Debug,
    Folder,
    Json,
    Outside,
    answer,
    check_ending,
    command,
    tell,
)

Out = Annotated[Path, typer.Option("--out", "-o", metavar="FILE", show_default=False,
                                   help=".npz: one array a surface; .csv or .parquet: a row for "
                                   "each surface, draw and wavelength.")]
Step = Annotated[int, typer.Option(min=1, max=100, help="Nanometres between wavelengths.")]
Count = Annotated[int | None, typer.Option("--draws", min=1,
                                           help="Of each surface; all by default.")]


def register(app: typer.Typer) -> None:
    """Add this command to the command line."""
    app.command()(draws)


def draws(folder: Folder, out: Out, step: Step = 5, count: Count = None,
          allow_outside: Outside = False, as_json: Json = False, debug: Debug = False) -> None:
    """Every spectrum that was drawn for the surfaces of a finished session, as one file."""
    with command(as_json, debug):
        from spectrabox.session.store.draws_files import FORMS, stored_draws, write_draws
        check_ending(out, FORMS)
        from spectrabox.session.config.session_file import read_session
        from spectrabox.session.pipeline import load_finished, stale_stages
        config = read_session(folder, allow_outside)
        made = stored_draws(load_finished(config).stored, step, count)
        stale, said = stale_stages(config)
        if said:
            tell(f"warning: {said}")
        write_draws(out, made)
        numbers = {name: len(values) for name, (_, values) in made.items()}
        nm = next(iter(made.values()))[0]
        answer(as_json, {"file": str(out), "draws": numbers, "wavelengths_nm": nm.tolist(),
                         "stale": stale},
               f"wrote {out}: {', '.join(f'{n} of {name}' for name, n in numbers.items())}, "
               f"{nm[0]:g}-{nm[-1]:g} nm every {step} nm")
