"""Commands on finished sessions: what to do next, other light, draws for other programs,
rehearsal.
"""
from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from spectrabox.session.commands import requests
from spectrabox.session.terminal import command_line

if TYPE_CHECKING:
    from spectrabox.session.config.session_file import SessionConfig
    from spectrabox.session.kept_stages import FinishedRun


def register(app: typer.Typer) -> None:
    """Add these commands to the command line."""
    for function in (advise, relight, colour, draws, rehearse):
        app.command()(function)


@command_line.Command
def advise(
    measured: requests.MeasuredSignal,
    folder: Annotated[Path | None, typer.Argument(
        metavar="[DIR]", help="A finished session, in place of --sensitivity, --light and "
        "--signal.")] = None,
    sensitivity: requests.OptionalSensitivity = None,
    light: Annotated[str | None, typer.Option(
        metavar="FILE|NAME", help="Of the signal: CSV of the light's spectrum, or a CIE "
        "name.")] = None,
    lamps: requests.Lamps = None,
    filters: requests.Filters = None,
    allow_outside: command_line.Outside = False,
) -> command_line.Answer:
    """Say what to do next, and how much narrower each would make the bands: of a finished
    session, or of one signal.
    """
    from spectrabox.session.signals.advise_answer import advise_answer
    return command_line.Answer(*advise_answer(measured, sensitivity, light, lamps, filters, folder,
                                              allow_outside))


@command_line.Command
def relight(
    folder: command_line.Folder,
    allow_outside: command_line.Outside = False,
    light: Annotated[str | None, typer.Option(
        metavar="FILE|NAME",
        help="A CIE illuminant such as D65 or FL11, or a file; the session's own by "
        "default.")] = None,
    observer: Annotated[str | None, typer.Option(
        metavar="FILE|NAME",
        help="Colour-matching functions by name or file; CIE 1931 2 degrees by default.")] = None,
    out: Annotated[Path | None, typer.Option(
        "--out", "-o", metavar="PNG", help="DIR/relit LIGHT.png by default; the same as EXR is "
        "written beside it.")] = None,
    width: Annotated[int, typer.Option(min=16, max=4096, help="Width in pixels.")] = 480,
    spp: Annotated[int, typer.Option(min=1, max=65536, help="Paths per pixel.")] = 64,
    device: command_line.Device = "auto",
) -> command_line.Answer:
    """Render the scene with the recovered spectra under any light, and say how far its colours are
    known there.
    """
    command_line.check_ending(out, {".png": "a picture; its X, Y, Z go to an EXR beside it"})
    from spectrabox.capture.photo.image_writers import write_exr, write_png
    from spectrabox.measure.scene.box_camera import scene_of
    from spectrabox.measure.shoot.captures import stated_scene
    from spectrabox.session.outputs import run_outputs, session_results
    from spectrabox.session.replayed import OBSERVER
    from spectrabox.session.replayed import relight as render_under
    from spectrabox.session.store.locks import outputs_writer
    config, finished, stale = finished_session(folder, allow_outside)
    scene = scene_of(stated_scene(config, config.inputs))
    size = (width, max(round(width * scene.height / scene.width), 1))
    xyz, picture, colours, notes = render_under(
        finished, light=light, observer=observer or OBSERVER, size=size, spp=spp, device=device,
        pictures=config.folder / session_results.picture_folder(config))
    label = re.sub(r"[^\w.-]", "-", Path(light or "session").stem)
    png = out or folder / f"relit {label}.png"
    with outputs_writer(config.folder):     # two pictures that belong together
        run_outputs.require_results(finished, "spectrabox relight")
        write_png(png, picture)
        write_exr(png.with_suffix(".exr"), xyz, ("X", "Y", "Z"))
    lines = [f"{name:<16} L* {lab[0]:5.1f}  a* {lab[1]:6.1f}  b* {lab[2]:6.1f}"
             + ("   given" if upper is None else
                f"   draws within dE00 {median:.2f} (half), {upper:.2f} (95 %)")
             for name, (lab, median, upper) in colours.items()]
    return command_line.Answer({"png": str(png), "exr": str(png.with_suffix(".exr")),
                   "light": light or "session",
                   "colours": [{"name": name, "lab": lab, "delta_e00_median": median,
                                "delta_e00_95": upper}
                               for name, (lab, median, upper) in colours.items()],
                   "notes": list(notes), "stale": stale},
                  "\n".join([*lines, *notes, f"picture: {png}"]))


@command_line.Command
def colour(
    folder: command_line.Folder,
    allow_outside: command_line.Outside = False,
    out: Annotated[Path | None, typer.Option(
        "--out", "-o", metavar="DIR", help="Folder of the files; DIR/colour by default.")] = None,
    space: Annotated[Literal["prophoto", "p3", "lab"], typer.Option(
        help="Colour space of the photo: ProPhoto RGB, Display P3 or L*a*b*.")] = "prophoto",
    family: Annotated[tuple[str, ...], typer.Option(
        metavar="FAMILY", help="What the surfaces are: paint, textile, leaves, skin, white, earth "
        "or animal; by default what the session states. May be repeated.")] = (),
) -> command_line.Answer:
    """Write a finished session of flat samples for colour management: the photo as 16-bit TIFF, ICC
    and OpenColorIO profiles with their errors, and a page for the archive.
    """
    from spectrabox.session.colour.colour_outputs import write_colour
    from spectrabox.session.outputs.run_outputs import require_results
    from spectrabox.session.store.locks import outputs_writer
    config, finished, stale = finished_session(folder, allow_outside)
    with outputs_writer(config.folder):
        facts, text = write_colour(config, finished, out or folder / "colour",
                                   space, family)
        require_results(finished, "spectrabox colour")
    return command_line.Answer({**facts, "stale": stale}, text)


@command_line.Command
def draws(
    *,
    folder: command_line.Folder,
    allow_outside: command_line.Outside = False,
    out: Annotated[Path, typer.Option(
        "--out", "-o", metavar="FILE", show_default=False, help=".npz: one array a surface; .csv "
        "or .parquet: a row for each surface, draw and wavelength.")],
    step: Annotated[int, typer.Option(min=1, max=100, help="Nanometres between wavelengths.")] = 5,
    count: Annotated[int | None, typer.Option(
        "--samples", min=1, help="Draws of each surface; all by default.")] = None,
) -> command_line.Answer:
    """Write the spectra that were drawn for the surfaces of a finished session into one file."""
    from spectrabox.session.store.surface_files import FORMS, stored_draws, write_draws
    command_line.check_ending(out, FORMS)
    _, finished, stale = finished_session(folder, allow_outside)
    drawn = stored_draws(finished.records.spectra, step, count)
    write_draws(out, drawn)
    numbers = {name: len(values) for name, (_, values) in drawn.items()}
    nm = next(iter(drawn.values()))[0]
    counts = ", ".join(f"{count} of {name}" for name, count in numbers.items())
    return command_line.Answer(
        {"file": out, "draws": numbers, "wavelengths_nm": nm, "stale": stale},
        f"wrote {out}: {counts}, {nm[0]:g}-{nm[-1]:g} nm every {step} "
        "nm")


@command_line.Command
def rehearse(
    folder: command_line.Folder,
    allow_outside: command_line.Outside = False,
    times: Annotated[int, typer.Option(help="Photos of known truth, from 20 up.")] = 200,
    seed: Annotated[int, typer.Option(help="Random seed of truths, photos and draws.")] = 1,
    device: command_line.Device = "auto",
    quiet: command_line.Quiet = False,
) -> command_line.Answer:
    """Test whether this session's bands hold, on simulated photos with known truths."""
    from spectrabox.session.config.session_file import read_session
    from spectrabox.session.replayed import rehearse as replay
    from spectrabox.session.store import locks, rehearsals
    from spectrabox.session.terminal.progress_display import progress_display
    config = read_session(folder, allow_outside)
    with locks.only_writer(config.folder, "spectrabox rehearse"), \
            progress_display(quiet) as progress:
        rehearsed = replay(config, times, seed, device,
                           lambda done, what: progress("rehearse", done, what))
        path = rehearsals.save_rehearsal(config, rehearsed)
    return command_line.Answer(rehearsed.facts | {"file": str(path)}, rehearsed.text)


def finished_session(folder: Path, allow_outside: bool
                     ) -> tuple[SessionConfig, FinishedRun, list[str]]:
    """A session, what is stored of its run, and the stages that are out of date, of which the
    operator is told.

    Parameters
    ----------
    folder : Path
    allow_outside : bool
        Let the session name files outside its folder.
    """
    from spectrabox.session.config.session_file import read_session
    from spectrabox.session.kept_stages import load_finished, warn_of_stale_stages
    config = read_session(folder, allow_outside)
    finished = load_finished(config)
    return config, finished, warn_of_stale_stages(config, finished.capture, command_line.tell)
