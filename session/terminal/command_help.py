"""What help says: where to begin, all commands by subject, and two examples of every command."""


from __future__ import annotations

import copy
import inspect
import re
from collections.abc import Callable, Iterable
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import typer
from typer.core import TyperCommand, TyperGroup
from typer.models import OptionInfo

DEMOS = {"mybox": "spectrabox demo mybox", "painting": "spectrabox demo painting --flat"}
CAMERA = '"Nikon 5100 (NPL)"'

EXAMPLES: dict[str, tuple[str, ...]] = {
    "demo": ("spectrabox demo painting --flat", "spectrabox demo mybox"),
    "new": ("spectrabox new wall-painting --template flat", "spectrabox new tapebox --template "
    "box"),
    "check": ("spectrabox check mybox", "spectrabox check mybox --json"),
    "run": ("spectrabox run mybox", "spectrabox run mybox --until calibrate"),
    "status": ("spectrabox status mybox", "spectrabox status mybox --json"),
    "report": ("spectrabox report mybox", "spectrabox report mybox --json"),
    "doctor": ("spectrabox doctor", "spectrabox doctor --device cpu --json"),
    "open": ("spectrabox open painting/photos/painting.dng",
             "spectrabox open mybox --watch tethered"),
    "batch": ("spectrabox batch mybox", "spectrabox batch mybox --workers 1 --out today"),
    "flat": ("spectrabox flat painting/photos/painting.dng",
             "spectrabox flat painting/photos/painting.dng --session measured \\\n"
             "    --region wall=986,462,1073,537 --family wall=paint \\\n"
             "    --white-card 1006,751,1165,806=0.94"),
    "relight": ("spectrabox relight mybox --light FL11 --width 64",
                "spectrabox relight mybox --light A --width 64 --out evening.png"),
    "colour": ("spectrabox colour painting", "spectrabox colour painting --space p3 --out p3"),
    "draws": ("spectrabox draws mybox --out draws.npz",
              "spectrabox draws mybox --samples 100 --step 10 --out draws.csv"),
    "rehearse": ("spectrabox rehearse mybox", "spectrabox rehearse mybox --times 20 --seed 2"),
    "develop": ("spectrabox develop mybox/photos/box.dng --out box.exr",
                "spectrabox develop mybox/photos/box.dng \\\n"
                "    --flat-field mybox/photos/flat.dng --out even.exr"),
    "chart": ("spectrabox chart painting/photos/painting.dng",
              "spectrabox chart painting/photos/painting.dng \\\n"
              "    --overlay chart.png --out patches.csv"),
    "camera fit": ("spectrabox camera fit painting/photos/painting.dng --light unknown",
                   "spectrabox camera fit mybox/photos/chart.dng \\\n"
                   "    --light mybox/spectra/light.csv --out curves.csv"),
    "camera profile": (
        f"spectrabox camera profile {CAMERA} --camera \"Nikon D5100\"",
        f"spectrabox camera profile {CAMERA} --camera \"Nikon D5100\" \\\n"
        "    --out d5100.dcp --out d5100.json"),
    "camera prior": ("spectrabox camera prior measured-cameras --out mine.npz",
                     "spectrabox camera prior measured-cameras --out mine.npz \\\n"
                     "    --source \"my laboratory, 2026\" --licence \"CC BY 4.0\""),
    "camera add": ("spectrabox camera add measured-cameras",
                   "spectrabox camera add measured-cameras --json"),
    "camera list": ("spectrabox camera list", "spectrabox camera list --json"),
    "filter fit": ("spectrabox filter fit chart.dng chart-gel.dng --out gel.csv",
                   "spectrabox filter fit lamp.csv lamp-gel.csv --readings --out gel.csv"),
    "geometry board": ("spectrabox geometry board --board board.toml --out board.png",
                       "spectrabox geometry board --board board.toml --square-px 300 \\\n"
                       "    --out large.png"),
    "geometry lens": ("spectrabox geometry lens board1.dng board2.dng board3.dng \\\n"
                      "    --board board.toml --out lens.json",
                      "spectrabox geometry lens board1.dng board2.dng board3.dng \\\n"
                      "    --board board.toml --out lens.json --force --overlay seen"),
    "geometry pose": ("spectrabox geometry pose box.dng --scene scene.xml \\\n"
                      "    --points points.toml --out posed.xml",
                      "spectrabox geometry pose box.dng --scene scene.xml \\\n"
                      "    --board board.toml --lens lens.json --out by-board.xml"),
    "geometry box": ("spectrabox geometry box tapebox", "spectrabox geometry box tapebox --json"),
    "geometry undistort": (
        "spectrabox geometry undistort box.dng --lens lens.json --out box.exr",
        "spectrabox geometry undistort box.dng --lens lens.json --out box.exr --force"),
    "geometry light": ("spectrabox geometry light box.dng --scene posed.xml --light lamp.csv \\\n"
                       "    --sensitivity curves.csv --reflectances paints.csv --out lit.xml",
                       "spectrabox geometry light box.dng --scene posed.xml --light LED-B3 \\\n"
                       f"    --sensitivity {CAMERA} --reflectances paints.csv \\\n"
                       "    --out lit.xml --force --spp 512"),
    "geometry beam": ("spectrabox geometry beam wall.dng --wall wall.toml --out beam.csv",
                      "spectrabox geometry beam wall.dng --wall wall.toml --out beam.csv \\\n"
                      "    --flat-field white-card.dng --force"),
    "sample": (f"spectrabox sample --sensitivity {CAMERA} --light D65 \\\n"
               "    --signal 0.47,0.27,0.12 --noise 0.005 --reading 700:0.6:0.01",
               "spectrabox sample --srgb 200,100,50 --out colour.csv --plot colour.png"),
    "uplift": (f"spectrabox uplift painting/photos/painting.dng --sensitivity {CAMERA} \\\n"
               "    --light D65 --side 9 --out uplifted",
               f"spectrabox uplift painting/photos/painting.dng --sensitivity {CAMERA} \\\n"
               "    --light D65 --side 9 --to zarr --out arrays"),
    "advise": ("spectrabox advise painting",
               "spectrabox advise painting --lamps A,LED-B3"),
    "match": ("spectrabox match mybox CES99",
              "spectrabox match mybox \"BabelColor Average\" --only cube"),
    "meter list": ("spectrabox meter list", "spectrabox meter list --json"),
    "meter identify": ("spectrabox meter identify --port /dev/ttyACM0 --instrument pr655",
                       "spectrabox meter identify --port COM3 --instrument cr250"),
    "meter measure": ("spectrabox meter measure mybox --port /dev/ttyACM0 --instrument pr655 \\\n"
                      "    --as light --repeat 5",
                      "spectrabox meter measure mybox --with spotread --as paint --name red"),
    "meter replay": ("spectrabox meter replay fixtures/transcripts/cr250.transcript",
                     "spectrabox meter replay fixtures/transcripts/cr250.transcript --draw"),
    "spectrum show": ("spectrabox spectrum show mybox/spectra/light.csv --draw",
                      "spectrabox spectrum show mybox/spectra/light.csv --json"),
    "spectrum convert": (
        "spectrabox spectrum convert mybox/spectra/light.csv --out light.spdx --grid 400:700:5",
        "spectrabox spectrum convert mybox/spectra/truth_green.csv \\\n"
        "    mybox/spectra/truth_red.csv --out converted --to .sp"),
}


# what examples name that no demonstration writes
BROUGHT_ALONG = {
    "measured-cameras": "files of your cameras' measured curves",
    "measured-paints": "files of reflectances that you have measured",
    "chart-gel.dng": "the chart, photographed without and with the filter",
    "lamp-gel.csv": "spectra of a lamp, measured without and with the filter",
    "board.toml": "the columns, rows, square and marker of your printed board",
    "points.toml": "known points: [points.NAME] scene = [x, y, z], px = [x, y]",
    "lens.json": "'spectrabox geometry lens' writes it",
    "paints.csv": "reflectances of the scene's surfaces, a column for each",
    "wall.toml": "where the wall's rectangle and the lamp are",
    "fixtures/transcripts": "in the source of spectrabox"}


def origin_of_files(examples: Iterable[str]) -> list[str]:
    """What writes the files that examples name, or what they are, a line for each."""
    text = " ".join(examples)
    demos = [f"('{demo}' writes {folder})" for folder, demo in DEMOS.items()
             if f" {folder}" in text and demo not in text]
    return demos + [f"({name}: {what})" for name, what in BROUGHT_ALONG.items()
                    if name in text and f"--out {name}" not in text]


# ---- what help says ------------------------------------------------------------------------------

FIRST_STEPS = """Reflectance spectra from photos that show a colour chart.

  spectrabox open PHOTO        point at the colours of a photo, in the browser
  spectrabox flat PHOTO        the same by typing; it says what to type next
  spectrabox new DIR           a session in a folder; then: spectrabox run DIR
  spectrabox sample --help     the spectra behind a signal given as numbers
  spectrabox demo --flat       a photo with known spectra, to try it on
  spectrabox help              ten commands; all: help all; one: help flat"""
USUAL = ("open", "flat", "new", "check", "run", "advise", "batch", "chart", "sample", "demo")
SUBJECTS = {"A session": ("flat", "new", "open", "check", "run", "status", "report", "relight",
                          "colour", "rehearse", "draws", "advise"),
            "Many sessions": ("batch",),
            "Photos and cameras": ("develop", "chart", "camera", "filter", "geometry"),
            "Instruments and spectral files": ("meter", "spectrum"),
            "The spectra behind a signal": ("sample", "uplift", "match"),
            "Trying it out": ("demo", "doctor")}
ALL = "spectrabox.help_all"     # in the context: every command is listed
KEY = re.compile(r"\{([a-z_]+\.[a-z_]+)\}")      # of a shoot, in what is said of an option
TYPE_WORDS = {str: "TEXT", Path: "FILE", int: "NUMBER", float: "NUMBER"}    # of a value


def parameter_of(option: inspect.Parameter) -> inspect.Parameter:
    """A parameter as Typer reads it, which knows lists in place of tuples of any length.

    Parameters
    ----------
    option : Parameter
        Annotated, with ``typer.Option`` or ``typer.Argument``.
    """
    kind, *about = get_args(option.annotation)
    repeated, default = is_repeated(option.annotation), option.default
    about = [copy.copy(each) if isinstance(each, OptionInfo) else each for each in about]
    for each in about:
        if isinstance(each, OptionInfo):
            _describe_option(each, kind, repeated)
    if repeated:
        kind = list.__class_getitem__(get_args(kind)[0])
        kind = kind if default is inspect.Parameter.empty else kind | None
        default = None if default == () else default
    return inspect.Parameter(option.name, inspect.Parameter.KEYWORD_ONLY, default=default,
                             annotation=Annotated[kind, *about])


def _describe_option(option: OptionInfo, kind: Any, repeated: bool) -> None:
    """Say in words what value an option takes, and whether it may be repeated."""
    if get_origin(kind) in (Union, UnionType):
        kind = next(each for each in get_args(kind) if each is not type(None))
    if repeated:
        kind = get_args(kind)[0]
        if option.help and "repeated" not in option.help:
            option.help += " May be repeated."
    if option.metavar is None:
        option.metavar = "|".join(get_args(kind)) if get_origin(kind) is Literal \
            else TYPE_WORDS.get(kind)


def is_repeated(hint: Any) -> bool:
    """Whether a parameter may be given any number of times."""
    kind = get_args(hint)[0]
    return get_origin(kind) is tuple and get_args(kind)[-1] is Ellipsis


class Commands(typer.Typer):
    """A group of commands whose help says what types are in words and ends in examples."""

    def __init__(self, name: str | None = None, **options: Any) -> None:
        super().__init__(name=name, cls=CommandGroup, no_args_is_help=True, **options)

    def command(self, name: str | None = None, **options: Any) -> Callable[..., Any]:
        """Add a command under its own or another name."""
        return super().command(name, **{"cls": ExplainedCommand, **options})


class ExplainedCommand(TyperCommand):
    """A command whose help ends in its examples."""

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Options, then the arguments, [in brackets] where they may be left out."""
        pieces = [self.options_metavar or ""]
        for each in self.params:
            if each.param_type_name == "argument":
                words = each.metavar or str(each.name).upper()
                name, dots, _ = words.strip("[]").partition("...")
                pieces.append((name if each.required else f"[{name}]") + dots)
        return pieces

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write arguments, without the names of Python's types, and options."""
        records = [(each.param_type_name, record) for each in self.get_params(ctx)
                   if (record := each.get_help_record(ctx)) is not None]
        for heading in ("argument", "option"):
            rows = [(name.split(" <")[0], _with_meanings(said)) for kind, (name, said) in records
                    if kind == heading]
            if rows:
                with formatter.section(f"{heading.capitalize()}s"):
                    formatter.write_dl(rows)

    def format_epilog(self, ctx: Any, formatter: Any) -> None:
        """Write the examples as they can be typed."""
        examples = EXAMPLES.get(ctx.command_path.partition(" ")[2], ())
        if examples:
            with formatter.section("Examples"):
                for line in [*"\n".join(examples).splitlines(), *origin_of_files(examples)]:
                    formatter.write(f"{'':{formatter.current_indent}}{line}\n")


class CommandGroup(TyperGroup):
    """Commands whose help lists them, each with its whole first sentence: of the outermost group
    the usual ones, or with ``help all`` every one by its subject.
    """

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read ``help``, ``help all`` and ``help COMMAND``; without arguments say how to begin."""
        if ctx.parent is None and not args and not ctx.resilient_parsing:
            typer.echo(FIRST_STEPS)
            ctx.exit(2)
        if ctx.parent is None and args[:1] == ["help"]:
            ctx.meta[ALL] = args[1:] == ["all"]
            args = ["--help"] if ctx.meta[ALL] else [*args[1:], "--help"]
        return super().parse_args(ctx, args)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the commands under their subjects, those of no subject under \"Commands\"."""
        names = [name for name, each in self.commands.items() if not each.hidden]
        if ctx.parent is not None:
            subjects = {"Commands": names}
        elif ctx.meta.get(ALL):
            subjects = {heading: [name for name in names if name in of_subject]
                        for heading, of_subject in SUBJECTS.items()}
        else:
            subjects = {"Commands": [name for name in USUAL if name in names]}
        for heading, of_subject in subjects.items():
            if of_subject:
                with formatter.section(heading):
                    formatter.write_dl([(name, _first_paragraph(self.commands[name].help))
                                        for name in of_subject])
        if ctx.parent is None and not ctx.meta.get(ALL):
            more = len(names) - len(USUAL)
            formatter.write(f"\nAll by subject ({more} more): spectrabox help all. Of one: "
                            "spectrabox help flat\n")


def _with_meanings(said: str) -> str:
    """What is said of an option, in which {TABLE.KEY} stands for the meaning of a key of a shoot.
    """
    if not KEY.search(said):
        return said
    from spectrabox.measure.shoot.shoot import meaning
    return KEY.sub(lambda found: meaning(found[1]), said)


def _first_paragraph(text: str | None) -> str:
    return " ".join((text or "").split("\n\n")[0].split())
