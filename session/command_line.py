"""What every command shares: options, one clear message per error, one JSON object per answer."""
from __future__ import annotations

import contextlib
import errno
import json
import os
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer
from typer.core import TyperGroup

from spectrabox.radiometry.errors import EnvironmentProblem, InputError, SpectraboxError
from spectrabox.radiometry.system.words import message, plain

Folder = Annotated[Path, typer.Argument(metavar="DIR", help="The session folder.",
                                        show_default=False)]
Json = Annotated[bool, typer.Option("--json",
                                    help="One machine-readable object on standard output.")]
Debug = Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")]
ChartLayout = Annotated[str, typer.Option("--chart-layout", metavar="NAME|FILE", show_default=False,
                                          help="The chart: \"Digital SG\", \"SpyderCheckr 24\", a "
                                          "layout of your own, ...; a ColorChecker Classic by "
                                          "default.")]
Outside = Annotated[bool, typer.Option("--allow-outside",
                                       help="Let the session name files outside its folder.")]
Device = Annotated[str, typer.Option(help="auto, cpu or cuda: where Mitsuba renders.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="No progress on standard error.")]
SUBJECTS = {"A session": ("flat", "new", "open", "check", "run", "status", "report", "relight",
                          "rehearse", "draws"),
            "Many sessions": ("batch", "compare", "catalogue"),
            "Photos and cameras": ("develop", "chart", "camera", "geometry"),
            "Instruments and spectral files": ("meter", "spectrum"),
            "The spectra behind a signal": ("sample", "uplift", "match", "plan", "prior"),
            "Can they be trusted": ("certify", "judge"),
            "Trying it out": ("demo", "doctor")}
INTERRUPTED = 130
STOPPED = "interrupted: finished stages are kept, run the same command again to go on"

NO_MEMORY = ("memory ran out: close other programs, or give smaller pictures, fewer draws or fewer "
             "regions")
NOT_WRITTEN = "the output cannot be written: free space, then run again"
DISK_TROUBLE = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO)


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
    """Turn errors that an operator can mend into one clear message and the documented exit code."""
    try:
        yield
    except typer.Exit:
        raise
    except SpectraboxError as error:
        if debug:
            raise
        fail(as_json, str(error), error.exit_code)
    except BrokenPipeError:
        raise typer.Exit(1) from None
    except OSError as error:
        if debug or error.filename is None or error.strerror is None:
            raise
        fail(as_json, f"{_text(error.filename)} cannot be read or written ({error.strerror}): "
             "correct its name, or change its permissions",
             EnvironmentProblem.exit_code if error.errno in DISK_TROUBLE else InputError.exit_code)
    except (KeyboardInterrupt, Exception) as error:
        stop = interrupt_behind(error)
        if stop is None:
            raise
        fail(as_json, STOPPED, getattr(stop, "exit_code", INTERRUPTED))


@contextlib.contextmanager
def last_resort(as_json: bool, debug: bool) -> Iterator[None]:
    """Turn any error that nobody foresaw into one sentence and exit code 1, or 7 where memory ran
    out.

    Whatever it is: libraries also raise what is no ``Exception``.
    """
    try:
        yield
    except (SystemExit, GeneratorExit):
        raise
    except BaseException as error:
        if debug:
            raise
        stop = interrupt_behind(error)
        said, code = said_of(error) if stop is None \
            else (STOPPED, getattr(stop, "exit_code", INTERRUPTED))
        with contextlib.suppress(typer.Exit):
            fail(as_json, said, code)
        sys.exit(code)


def said_of(error: BaseException) -> tuple[str, int]:
    """Any error but an interrupt as one sentence, and the exit code that it means."""
    if isinstance(error, SpectraboxError):
        return str(error), error.exit_code
    if isinstance(error, MemoryError):
        return NO_MEMORY, EnvironmentProblem.exit_code
    if isinstance(error, OSError) and error.errno in DISK_TROUBLE:
        return f"{NOT_WRITTEN} ({error.strerror})", EnvironmentProblem.exit_code
    return (f"unexpected {type(error).__name__}: {error}; run again with --debug and report what "
            "it shows"), 1


@contextlib.contextmanager
def flushed_output() -> Iterator[None]:
    """Write out what was printed before leaving; a reader that has gone is no error.

    Raises
    ------
    EnvironmentProblem
        If it cannot be written.
    """
    try:
        yield
    finally:
        try:
            sys.stdout.flush()
        except OSError as error:
            # else Python tries again when it ends, and complains
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            if not isinstance(error, BrokenPipeError):
                raise EnvironmentProblem(f"{NOT_WRITTEN} ({error.strerror})") from None


def interrupt_behind(error: BaseException) -> KeyboardInterrupt | None:
    """The interrupt that an error began as: Dr.Jit wraps a Ctrl-C that falls into the tracing of a
    loop in an error of its own.
    """
    causes: list[BaseException] = []
    cause: BaseException | None = error
    while cause is not None and cause not in causes:
        if isinstance(cause, KeyboardInterrupt):
            return cause
        causes.append(cause)
        cause = cause.__cause__ or cause.__context__
    return None


def fail(as_json: bool, said: str, exit_code: int) -> NoReturn:
    """Print an error where the caller looks for it and leave."""
    said = message(said)
    if as_json:
        print(json.dumps({"error": said, "exit_code": exit_code}))
    tell(f"spectrabox: {said}")
    raise typer.Exit(exit_code)


def answer(as_json: bool, facts: dict[str, Any], text: str) -> None:
    """One JSON object, or text for a person."""
    print(json.dumps(facts, allow_nan=False) if as_json else plain(text))


def tell(text: str) -> None:
    """A line for a person on standard error, beside the answer."""
    print(message(text), file=sys.stderr, flush=True)


def _text(name: Any) -> str:
    return os.fsdecode(name) if isinstance(name, bytes | str) else str(name)


def check_ending(path: Path | None, endings: Mapping[str, str], option: str = "--out") -> None:
    """Refuse, as a usage error, to write a file whose name ends as nothing does that is written.

    Parameters
    ----------
    path : Path or None
        None where none is to be written.
    endings : mapping of ending to what it writes
    option : str
        That gave the path.
    """
    if path is not None and path.suffix.lower() not in endings:
        known = ", ".join(f"{ending} ({what})" for ending, what in endings.items())
        raise typer.BadParameter(f"{path.name} does not end in what is written here: {known}",
                                 param_hint=option)


def check_device(device: str) -> None:
    """Refuse an unknown device as a usage error."""
    if device not in ("auto", "cpu", "cuda"):
        raise typer.BadParameter(f"{device!r} is not one of auto, cpu, cuda", param_hint="--device")
