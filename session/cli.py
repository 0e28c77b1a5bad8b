"""The command line. Heavy modules are imported inside commands, so that --help answers at once."""
from __future__ import annotations

import sys
from types import TracebackType

import typer

from spectrabox.session.command_line import INTERRUPTED
from spectrabox.session.commands import (
    camera,
    capture,
    geometry,
    meter,
    sampling,
    session,
    spectrum,
)

app = typer.Typer(name="spectrabox", no_args_is_help=True, add_completion=False,
                  pretty_exceptions_enable=False, rich_markup_mode=None,
                  context_settings={"help_option_names": ["-h", "--help"]},
                  help="Ordinary camera captures to calibrated reflectance spectra, with honest "
                  "uncertainty.")
for subject in (session, capture, geometry, camera, sampling, meter, spectrum):
    subject.register(app)


def say_unexpected(kind: type[BaseException], error: BaseException,
                   traceback: TracebackType | None) -> None:
    """One line for an error that nobody foresaw; Python then leaves with exit code 1."""
    print(f"spectrabox: unexpected {kind.__name__}: {error}; run again with --debug and report "
          "what it shows", file=sys.stderr)


def main() -> None:
    """Entry point of the ``spectrabox`` command."""
    if "--debug" not in sys.argv:
        sys.excepthook = say_unexpected
    try:
        app(prog_name="spectrabox")
    except KeyboardInterrupt:
        print("spectrabox: interrupted", file=sys.stderr)
        sys.exit(INTERRUPTED)


if __name__ == "__main__":
    main()
