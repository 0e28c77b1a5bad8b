"""Records, arrays, enumerations and paths as what JSON can hold."""


from __future__ import annotations

import contextlib
import errno
import inspect
import json
import math
import os
import sys
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from enum import Enum
from functools import cached_property, update_wrapper
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer

from spectrabox.radiometry import errors
from spectrabox.radiometry.system.words import message, plain
from spectrabox.session.terminal.command_help import is_repeated, parameter_of

if TYPE_CHECKING:
    from spectrabox.radiometry.findings import Finding


PLAIN = {float, int, str, bool, type(None)}     # what JSON holds as it is, most of a long answer


def to_json(value: Any) -> Any:
    """What JSON can hold of a value, the keys of a record being the names of its fields.

    Parameters
    ----------
    value : Any
        Records (dataclasses), arrays, mappings, sequences, enumerations (by their values), paths,
        numbers, text, None; nested as one likes.

    Returns
    -------
    dict, list, str, int, float, bool or None
    """
    if type(value) in PLAIN:
        return value
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: to_json(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, Mapping):
        return {key: to_json(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [each if type(each) in PLAIN else to_json(each) for each in value]
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, Path):
        return str(value)
    # arrays and numbers of NumPy, which need not be imported to know them
    return value.tolist() if hasattr(value, "tolist") else value


# ---- what every command shares -------------------------------------------------------------------

Folder = Annotated[Path, typer.Argument(metavar="DIR", help="The session folder.",
                                        show_default=False)]
Json = Annotated[bool, typer.Option("--json",
                                    help="One machine-readable object on standard output.")]
Debug = Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")]
ChartLayout = Annotated[str, typer.Option("--chart-layout", metavar="NAME|FILE", show_default=False,
                                          help="{chart.layout} \"Digital SG\", NGT or "
                                          "APT, say; a ColorChecker Classic by default.")]
CORNERS = "X,Y,X,Y,X,Y,X,Y"     # pixels of the photo
CORNERS_HELP = "{chart.corners_px} Needed where it is not found."
RECTANGLE = "X0,Y0,X1,Y1"       # two opposite corners in pixels
Outside = Annotated[bool, typer.Option("--allow-outside",
                                       help="Let the session name files outside its folder.")]


def _known_device(device: str) -> str:
    if device not in DEVICES:
        raise typer.BadParameter(f"{device!r} is not one of {', '.join(DEVICES)}",
                                 param_hint="--device")
    return device


DEVICES = ("auto", "cpu", "cuda")
Device = Annotated[str, typer.Option(
    metavar="|".join(DEVICES), callback=_known_device,
    help="Where Mitsuba renders: auto is the CPU; a GPU (cuda) is untested.")]
Force = Annotated[bool, typer.Option("--force", help="Replace the output where it exists.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="No progress on standard error.")]
Verbose = Annotated[bool, typer.Option(
    "--verbose", "-v", help="Tables of all that was found, not verdict and colours alone.")]
AS_JSON, DEBUG = (inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=False,
                                    annotation=kind)
                  for name, kind in (("as_json", Json), ("debug", Debug)))
LAST = ("device", "allow_outside", "verbose", "quiet", "as_json", "debug")
STOPPED = "interrupted: finished stages are kept, run the same command again to go on", 130

NO_MEMORY = ("memory ran out: close other programs, or give smaller pictures, fewer draws or fewer "
             "regions")
NOT_WRITTEN = "the output cannot be written: free space, then run again"
DISK_TROUBLE = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO, errno.EFBIG)


@dataclass(frozen=True)
class Answer:
    """What a command says: facts for a script, text for a person."""

    facts: Mapping[str, Any]
    text: str
    exit_code: int = 0
    failed: Sequence[Finding] = ()      # extras; facts and text name them


class Command:
    """A function as a command: its parameters are the options, its errors become one clear
    message, its answer is printed.

    A parameter that is a record stands for the options that its fields are. ``--debug`` is added,
    and ``--json`` where the function answers something. Typer asks for the signature of the one
    command that is called.

    Parameters
    ----------
    body : function
        Its parameters, or the fields of their records, are ``name: Annotated[type,
        typer.Option(...)] = default``; those that may be repeated are tuples, () where none is
        given.
    """

    def __init__(self, body: Callable[..., Answer | None]) -> None:
        update_wrapper(self, body)
        self.body = body
        self.__annotations__ = {}       # Typer reads those of the signature

    @cached_property
    def written(self) -> inspect.Signature:
        """The signature of the function."""
        return inspect.signature(self.body, eval_str=True)

    @cached_property
    def options(self) -> dict[str, inspect.Parameter]:
        """Every option by its name; what many commands have comes last, in one order."""
        options = [option for each in self.written.parameters.values()
                   for option in _options_of(each)]
        if self.written.return_annotation is not None:
            options.append(AS_JSON)
        by_name = {option.name: option for option in (*options, DEBUG)}
        return dict(sorted(by_name.items(),
                           key=lambda item: LAST.index(item[0]) if item[0] in LAST else -1))

    @property
    def __signature__(self) -> inspect.Signature:
        return inspect.Signature([parameter_of(option) for option in self.options.values()])

    def __call__(self, **given: Any) -> None:
        values = {name: given.get(name, option.default) for name, option in self.options.items()}
        for name, option in self.options.items():
            if is_repeated(option.annotation):
                values[name] = tuple(values[name] or ())
        as_json = values.get("as_json", False)
        with reported_errors(as_json, values["debug"]):
            answer = self.body(**{name: _value_of(each, values)
                                  for name, each in self.written.parameters.items()})
            if answer is not None:
                for one in answer.failed if as_json or values["debug"] else ():
                    tell(one.values["traceback"] if values["debug"] else _note(one))
                print_answer(as_json, answer)


def _note(failed: Finding) -> str:
    from spectrabox.measure import texts
    return f"note: {texts.says(failed)}"


def _options_of(parameter: inspect.Parameter) -> Collection[inspect.Parameter]:
    """A parameter, or the fields of the record that it is."""
    if not _is_record(parameter):
        return (parameter,)
    return inspect.signature(parameter.annotation, eval_str=True).parameters.values()


def _value_of(parameter: inspect.Parameter, given: Mapping[str, Any]) -> Any:
    """What was given for a parameter, or for the fields of the record that it is."""
    if not _is_record(parameter):
        return given[parameter.name]
    return parameter.annotation(**{each.name: given[each.name] for each in _options_of(parameter)})


def _is_record(parameter: inspect.Parameter) -> bool:
    return is_dataclass(parameter.annotation)


class UsageProblem(errors.SpectraboxError):
    """Options that do not go together, or a value that an option cannot have."""

    exit_code = 2


@contextlib.contextmanager
def reported_errors(as_json: bool, debug: bool) -> Iterator[None]:
    """Turn any error into one sentence and its exit code; ``debug`` lets it through."""
    try:
        yield
    except SystemExit as leaving:
        # an option or argument that there is not, which Click told the person and left
        usage = getattr(leaving.__context__, "format_message", None)
        if as_json and usage is not None:
            print(json.dumps({"error": message(usage()), "exit_code": leaving.code}))
        raise
    except BaseException as error:      # libraries also raise errors that are no Exception
        if isinstance(error, typer.Exit | BrokenPipeError) or hasattr(error, "format_message"):
            raise                       # Click leaves, quietly where no one reads on
        stopped = errors.interrupt_behind(error) is not None
        if debug and not stopped:
            raise
        fail(as_json, *(STOPPED if stopped else describe_error(error)))


def describe_error(error: BaseException) -> tuple[str, int]:
    """One sentence on any error but an interrupt, and the exit code that it means."""
    if isinstance(error, errors.SpectraboxError):
        return str(error), error.exit_code
    if isinstance(error, MemoryError):
        return NO_MEMORY, errors.EnvironmentProblem.exit_code
    if isinstance(error, OSError) and error.strerror is not None:
        full = error.errno in DISK_TROUBLE
        if error.filename is not None:
            return (f"{_text(error.filename)} cannot be read or written ({error.strerror}): "
                    "correct its name, or change its permissions",
                    errors.EnvironmentProblem.exit_code if full else errors.InputError.exit_code)
        if full:
            return f"{NOT_WRITTEN} ({error.strerror})", errors.EnvironmentProblem.exit_code
    return (f"unexpected {type(error).__name__}: {error}; run again with --debug and report what "
            "it shows"), 1


@contextlib.contextmanager
def flushed_output() -> Iterator[None]:
    """Write out what was printed before leaving; what nobody reads any more is dropped.

    Raises
    ------
    EnvironmentProblem
        If it cannot be written.
    """
    try:
        yield
    finally:
        try:
            print(end="", flush=True)
        except OSError as error:        # Python would try again at its end
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            if not isinstance(error, BrokenPipeError):
                raise errors.EnvironmentProblem(f"{NOT_WRITTEN} ({error.strerror})") from None


def fail(as_json: bool, sentence: str, exit_code: int) -> NoReturn:
    """Print an error where the caller looks for it and leave."""
    sentence = message(sentence)
    tell(f"spectrabox: {sentence}")
    if as_json:
        print(json.dumps({"error": sentence, "exit_code": exit_code}))
    sys.exit(exit_code)


def print_answer(as_json: bool, answer: Answer) -> None:
    """Print one JSON object, or text for a person, and leave where the exit code is not 0.

    Raises
    ------
    typer.Exit
    """
    print(json.dumps(answer.facts, default=to_json, allow_nan=False) if as_json
          else plain(answer.text))
    if answer.exit_code:
        raise typer.Exit(answer.exit_code)


def tell(text: str) -> None:
    """Print a line for a person on standard error."""
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
        raise typer.BadParameter(f"{message(path.name)} does not end in what is written here: "
                                 f"{known}", param_hint=option)


def require_new(out: Path, force: bool, *inputs: Path | None) -> None:
    """Refuse to write over an input, or over another file unless ``force`` is given.

    Raises
    ------
    InputError
    """
    if out.resolve() in {given.resolve() for given in inputs if given is not None}:
        raise errors.InputError(
            f"{out} is an input of this command; give another name for the output")
    if out.exists() and not force:
        raise errors.InputError(
            f"{out} exists already; give another name, or replace it with --force")


def pixel_numbers(text: str, count: int, option: str, form: str) -> list[float]:
    """Pixels of the photo in an option, separated by commas or spaces.

    Parameters
    ----------
    text : str
    count : int
        How many numbers are needed.
    option, form : str
        As the operator writes it, for the error.

    Raises
    ------
    InputError
    """
    try:
        numbers = [float(part) for part in text.replace(",", " ").split()]
    except ValueError:
        numbers = []
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        raise errors.InputError(
            f"{option} {text!r}: {count} numbers in pixels of the photo are needed, "
            f"{form}")
    return numbers
