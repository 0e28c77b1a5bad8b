"""What every command shares: options, one clear message per error, one JSON object per answer."""
from __future__ import annotations

import contextlib
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from spectrabox.radiometry.errors import SpectraboxError

Folder = Annotated[Path, typer.Argument(metavar="DIR", help="The session folder.",
                                        show_default=False)]
Json = Annotated[bool, typer.Option("--json",
                                    help="One machine-readable object on standard output.")]
Debug = Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")]
Outside = Annotated[bool, typer.Option("--allow-outside",
                                       help="Let the session name files outside its folder.")]
Device = Annotated[str, typer.Option(help="auto, cpu or cuda: where Mitsuba renders.")]
SUBJECTS = {"A session": ("new", "check", "run", "status", "report", "relight",
                          "rehearse"),
            "Photos and cameras": ("develop", "chart", "camera", "geometry"),
            "Instruments and spectral files": ("meter", "spectrum"),
            "The spectra behind a signal": ("sample", "uplift", "plan", "prior"),
            "Can they be trusted": ("certify", "judge"),
            "Trying it out": ("demo", "doctor")}
INTERRUPTED = 130
STOPPED = "interrupted: finished stages are kept, run the same command again to go on"


class CommandGroup(TyperGroup):
    """Commands whose help lists them by subject, each with its whole first sentence."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the commands under their subjects, those of no subject under \"Commands\"."""
        names = [name for name, each in self.commands.items() if not each.hidden]
        subjects = {heading: [name for name in names if name in of_subject]
                    for heading, of_subject in SUBJECTS.items()} if ctx.parent is None else {}
        listed = [name for of_subject in subjects.values() for name in of_subject]
        subjects["Commands"] = [name for name in names if name not in listed]
        for heading, of_subject in subjects.items():
            if of_subject:
                with formatter.section(heading):
                    formatter.write_dl([(name, _first_paragraph(self.commands[name].help))
                                        for name in of_subject])


def _first_paragraph(text: str | None) -> str:
    return " ".join((text or "").split("\n\n")[0].split())


@contextlib.contextmanager
def command(as_json: bool, debug: bool) -> Iterator[None]:
    """Turn errors into one clear message and the documented exit code."""
    try:
        yield
    except typer.Exit:
        raise
    except KeyboardInterrupt:
        fail(as_json, STOPPED, INTERRUPTED)
    except SpectraboxError as error:
        if debug:
            raise
        fail(as_json, str(error), error.exit_code)
    except BrokenPipeError:
        raise typer.Exit(1) from None
    except Exception as error:
        if not _began_as_interrupt(error):
            raise
        fail(as_json, STOPPED, INTERRUPTED)


def _began_as_interrupt(error: BaseException) -> bool:
    """Dr.Jit wraps a Ctrl-C that falls into the tracing of a loop in an error of its own."""
    causes: list[BaseException] = []
    cause: BaseException | None = error
    while cause is not None and cause not in causes:
        causes.append(cause)
        cause = cause.__cause__ or cause.__context__
    return any(isinstance(cause, KeyboardInterrupt) for cause in causes)


def fail(as_json: bool, message: str, exit_code: int) -> None:
    """Print an error where the caller looks for it and leave."""
    if as_json:
        print(json.dumps({"error": message, "exit_code": exit_code}))
    print(f"spectrabox: {message}", file=sys.stderr)
    raise typer.Exit(exit_code)


def answer(as_json: bool, facts: dict[str, Any], text: str) -> None:
    """One JSON object, or text for a person."""
    print(json.dumps(facts, allow_nan=False) if as_json else text)


def check_device(device: str) -> None:
    """Refuse an unknown device as a usage error."""
    if device not in ("auto", "cpu", "cuda"):
        raise typer.BadParameter(f"{device!r} is not one of auto, cpu, cuda", param_hint="--device")
