"""The command line. Heavy modules are imported inside commands, so that --help answers at once."""
from __future__ import annotations

import copy
import io
import os
import sys
import warnings
from typing import Annotated

import typer
from typer.main import get_command

import spectrabox
from spectrabox.session.commands import (
    batch,
    camera,
    capture,
    finished,
    flat,
    geometry,
    meter,
    sampling,
    session,
    spectrum,
)
from spectrabox.session.terminal import command_help, command_line, progress_display

# rich_markup_mode None: its panels cost --help twice the time.
app = command_help.Commands(name="spectrabox", pretty_exceptions_enable=False,
                            rich_markup_mode=None,
                            context_settings={"help_option_names": ["-h", "--help"]})
for subject in (session, batch, flat, finished, capture, geometry, camera, sampling, meter,
                spectrum):
    subject.register(app)


def say_version(asked: bool) -> None:
    """Print the version and leave."""
    if asked:
        print(f"spectrabox {spectrabox.__version__}")
        raise typer.Exit


@app.callback()
def spectrabox_options(
        version: Annotated[bool, typer.Option("--version", callback=say_version, is_eager=True,
                                              help="Print the version and leave.")] = False
        ) -> None:
    """Ordinary camera captures to calibrated reflectance spectra, with honest uncertainty."""


def with_only(name: str) -> typer.Typer:
    """The command line with no other command than the named one, or whole where it has none such.

    Typer builds the options of every command that it knows, which takes longer than ``status``.
    """
    chosen = copy.copy(app)
    chosen.registered_commands = [each for each in app.registered_commands
                                  if each.callback is not None
                                  and (each.name or each.callback.__name__) == name]
    chosen.registered_groups = [each for each in app.registered_groups if each.typer_instance
                                and name in (each.name, each.typer_instance.info.name)]
    return chosen if chosen.registered_commands or chosen.registered_groups else app


def main() -> None:
    """Entry point of the ``spectrabox`` command."""
    # No process that this one starts (workers, runs of the page) takes a module from the working
    # folder, which may be a stranger's session.
    os.environ["PYTHONSAFEPATH"] = "1"
    # Pydantic looks for plugins in every installed package; none may change what a file says.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    # One thread, as radiometry/system/threads.py says; NumPy and SciPy have a BLAS each, which look
    # here when they are loaded.
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    debug = "--debug" in sys.argv
    if not debug:
        warnings.simplefilter("ignore")     # lines of our code, which tell an operator nothing
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")   # names that no locale can write
    progress_display.stop_on_signals()
    with command_line.reported_errors("--json" in sys.argv, debug), command_line.flushed_output():
        # Not the Typer object itself: it would put its own hook in place of ours.
        get_command(with_only("".join(sys.argv[1:2])))(prog_name="spectrabox")


if __name__ == "__main__":
    main()
