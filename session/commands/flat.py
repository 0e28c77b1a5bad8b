"""The command that goes from photos with a chart in them to spectra of their regions."""
from __future__ import annotations

import contextlib
import shlex
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from spectrabox.radiometry import errors
from spectrabox.session.commands.session import run_session
from spectrabox.session.terminal import command_line

if TYPE_CHECKING:
    from spectrabox.radiometry.findings import Finding
    from spectrabox.session.flat.new_session import Tables


def register(app: typer.Typer) -> None:
    """Add the command to the command line."""
    app.command()(flat)


@command_line.Command
def flat(
    photos: Annotated[
        tuple[Path, ...],
        typer.Argument(
            metavar="PHOTO...", show_default=False,
            help="The samples, with a colour chart among them: "
            "camera raw or linear file. Further photos are of the same samples from the same "
            "tripod, each with the chart and under another unknown light: every one adds its "
            "bands.")],
    also: Annotated[
        tuple[str, ...],
        typer.Option(
            "--also", metavar="PHOTO=WHAT",
            help="A further photo under a light or through a filter of which "
            "something is known: filter:FILE or filter:unknown (before the first photo's light), "
            "light:LIGHT as of --light, same (the first photo's light), or moved (the first "
            "photo's lamp in another place, which measures gloss, plane and shadow). May be "
            "repeated.")] = (),
    region: Annotated[
        tuple[str, ...],
        typer.Option(
            "--region", metavar=f"NAME={command_line.RECTANGLE}",
            help="A region by two opposite corners in pixels "
            "of the first photo; may be repeated. Without one, the command looks for the chart and "
            "writes a picture of the photo with its pixels on the axes.")] = (),
    regions: Annotated[
        Path | None,
        typer.Option(
            metavar="TOML",
            help="File of regions, [regions.NAME] with rect, family, surface, known and "
            "truth as in a session, for photos that are framed alike.")] = None,
    each: Annotated[
        bool,
        typer.Option(
            "--each",
            help="Measure every photo by itself, with the same regions, and make a session "
            "of each: for the photos of a day. All are turned as the first states.")] = False,
    light: Annotated[
        str,
        typer.Option(metavar="FILE|NAME",
                     help="{light.spectrum} Here 3200K is a temperature. Of the first photo."
                     )] = "unknown",
    chart: Annotated[
        Path | None,
        typer.Option("--chart", metavar="PHOTO",
                     help="{photos.chart} In the samples' place, where they do not show it."
                     )] = None,
    corners: Annotated[
        str | None,
        typer.Option(metavar=command_line.CORNERS, help=command_line.CORNERS_HELP)] = None,
    layout: command_line.ChartLayout = "",
    reference: Annotated[
        str | None,
        typer.Option(metavar="NAME|FILE", show_default=False, help="{chart.reference}")] = None,
    white_card: Annotated[
        str | None,
        typer.Option(
            metavar=f"{command_line.RECTANGLE}=FILE|NUMBER",
            help="A region of known reflectance, such as "
            "986,462,1073,537=0.94 (3 % is allowed), =0.94+-0.01 or =card.csv.")] = None,
    flat_field: Annotated[
        Path | None,
        typer.Option(metavar="PHOTO", help="{photos.flat} It fills the samples' place.")] = None,
    family: Annotated[
        tuple[str, ...],
        typer.Option("--family", metavar="NAME=KIND", help="{regions.family} May be repeated.")] = (
        ),
    surface: Annotated[
        tuple[str, ...],
        typer.
        Option("--surface", metavar="[NAME=]matt|satin|glossy", help="{regions.surface} Of all "
               "regions, or of the named one. May be repeated.")] = (),
    truth: Annotated[tuple[str, ...],
                     typer.Option("--truth", metavar="NAME=FILE", help="{regions.truth}")] = (),
    not_linear: Annotated[
        bool,
        typer.Option(
            "--not-linear",
            help="{photos.not_linear} For a first look, since nobody knows the errors "
            "of what the camera has processed; never a PASS.")] = False,
    picture: Annotated[
        bool,
        typer.Option("--picture", help="Also the spectrum of every pixel, with maps, in "
                     "results/picture.")] = False,
    session: Annotated[
        Path | None,
        typer.
        Option(metavar="DIR", help="The session folder; beside the photo and named after it by "
               "default.")] = None,
    verbose: command_line.Verbose = False,
    quiet: command_line.Quiet = False,
) -> command_line.Answer:
    """Measure spectra of flat samples in photos that show a colour chart."""
    if each and (also or session is not None):
        raise errors.InputError(
            "--each makes a session beside every photo: leave --also and --session "
            "out")
    tables: Tables | None = None        # of session.toml, but for those of its photo
    if region or regions is not None:
        from spectrabox.session.flat.new_session import file_or_word, views_of
        outlined, of_all = _regions(region, regions, white_card, family, truth, surface)
        further = [(photo, _light_of(photo, said)) for photo, said in (
            *((photo, "light:unknown") for photo in photos[1:]),
            *((Path(file), said) for file, said in _pairs(also, "--also", "WHAT").items()))]
        tables = {"light": {"spectrum": file_or_word(light)},
                  "chart": _chart(layout, reference, corners) or None,
                  "views": None if each else views_of(photos[0], further) or None,
                  "regions": outlined,
                  "picture": {"surface": of_all} if picture else None}

    def measured(photo: Path, orientation: int | None = None) -> command_line.Answer:
        if tables is None:
            return _show_photo(photo, orientation, chart, layout, reference, corners, not_linear)
        from spectrabox.session.flat.new_session import new_session, tables_of_photo
        start = time.perf_counter()
        of_photo = tables_of_photo(photo, chart=chart, flat=flat_field, orientation=orientation,
                                   not_linear=not_linear or None)
        with new_session(of_photo | tables, session) as folder:
            answer = run_session(folder, device="not needed", verbose=verbose, quiet=quiet,
                                 words=["spectrabox", "flat", photo.stem])
        return command_line.Answer(
            {**answer.facts, "seconds": round(time.perf_counter() - start, 3)}, answer.text,
            failed=answer.failed)
    return _measure_each(photos, measured) if each else measured(photos[0])


def _measure_each(
        photos: Sequence[Path], measured: Callable[[Path, int | None],
                                                   command_line.Answer]) -> command_line.Answer:
    """A session for each photo; one that will not do does not stop the others."""
    answers: list[dict[str, object]] = []
    texts, codes = [], []
    failed: list[Finding] = []
    orientation = _first_orientation(photos)
    for photo in photos:
        try:
            answer = measured(photo, orientation)
            answers.append({"photo": photo, **answer.facts})
            texts.append(f"{photo}\n{answer.text}")
            failed += answer.failed
        except errors.SpectraboxError as error:
            command_line.tell(f"spectrabox: {photo}: {error}")
            answers.append({"photo": photo, "error": str(error), "exit_code": error.exit_code})
            texts.append(f"{photo}\nnot measured: {error}")
            codes.append(error.exit_code)
    return command_line.Answer({"photos": answers}, "\n\n".join(texts), min(codes, default=0),
                               failed)


def _first_orientation(photos: Sequence[Path]) -> int | None:
    """The orientation of the first photo that can be read, in which all are framed alike: a camera
    that looks down states any.
    """
    from spectrabox.capture.photo.preview import photo_orientation
    for photo in photos:
        with contextlib.suppress(errors.SpectraboxError):
            return photo_orientation(photo)
    return None


def _regions(region: Sequence[str], file: Path | None, white_card: str | None,
             family: Sequence[str], truth: Sequence[str], surface: Sequence[str]
             ) -> tuple[Tables, str | None]:
    """[regions] of session.toml, and what is stated of the surface of all that is photographed."""
    from spectrabox.session.flat.new_session import CARD, read_regions
    tables: Tables = {
        name:
        {"rect": command_line.pixel_numbers(rest, 4, f"--region {name}", command_line.RECTANGLE)}
        for name, rest in _pairs(region, "--region", command_line.RECTANGLE).items()
    }
    in_file = {} if file is None else read_regions(file)
    if twice := tables.keys() & in_file.keys():
        raise errors.InputError(f"{min(twice)!r} is a --region and in {file} too; leave one out")
    tables |= in_file
    if white_card is not None:
        rect, _, known = white_card.partition("=")
        tables[CARD] = {
            "rect": command_line.pixel_numbers(rect, 4, "--white-card", command_line.RECTANGLE),
            "known": known
        }
        if not known:
            raise errors.InputError(
                "--white-card needs the card's reflectance: X0,Y0,X1,Y1=FILE, or "
                "a number such as X0,Y0,X1,Y1=0.95")
    surfaces, of_all = _surfaces(surface, [name for name, table in tables.items()
                                           if "known" not in table])
    for key, stated in (
            ("family", {name: word.split(",") for name, word
                        in _pairs(family, "--family", "paint").items()}),
            ("truth", {name: Path(word) for name, word
                       in _pairs(truth, "--truth", "FILE").items()}),
            ("surface", surfaces)):
        for name, value in stated.items():
            if name not in tables:
                raise errors.InputError(
                    f"{name!r} is no region; the regions are {', '.join(tables)}")
            tables[name][key] = value
    return tables, of_all


def _surfaces(words: Sequence[str], regions: Iterable[str]) -> tuple[dict[str, str], str | None]:
    """What is stated of the surface of each region, and of all that is photographed."""
    from spectrabox.radiometry.gloss import SURFACE_WORDS

    of_all = next((word for word in words if "=" not in word), None)
    stated = {} if of_all is None else dict.fromkeys(regions, of_all)
    stated |= _pairs([word for word in words if "=" in word], "--surface", "matt")
    for word in stated.values():
        if word not in SURFACE_WORDS:
            raise errors.InputError(
                f"--surface {word!r}: {', '.join(SURFACE_WORDS)} are what a surface "
                "may be")
    return stated, of_all


def _chart(layout: str, reference: str | None, corners: str | None) -> dict[str, Any]:
    """[chart] of session.toml."""
    from spectrabox.radiometry.charts.layouts import chart_layout, is_layout_file
    from spectrabox.session.flat.new_session import file_or_word
    said: dict[str, Any] = {}
    if layout:
        known = chart_layout(layout)
        said["layout"] = Path(layout) if is_layout_file(layout) else known.name
        if reference is None and known.reference_file is not None:
            reference = str(known.reference_file)
    if reference is not None:
        said["reference"] = file_or_word(reference)
    if corners is not None:
        px = command_line.pixel_numbers(corners, 8, "--corners", command_line.CORNERS)
        said["corners_px"] = [px[at:at + 2] for at in range(0, 8, 2)]
    return said


def _light_of(photo: Path, said: str) -> dict[str, Any]:
    """What [views] says of the light of a further photo."""
    from spectrabox.measure.captured import FIRST_PHOTO
    from spectrabox.session.flat.new_session import file_or_word
    kind, _, what = said.partition(":")
    if said == "same":
        return {"same_light_as": FIRST_PHOTO}
    if said == "moved":
        return {"same_light_as": FIRST_PHOTO, "lamp": "moved"}
    if not what or kind not in ("filter", "light"):
        raise errors.InputError(f"--also {photo}={said}: PHOTO=filter:FILE, PHOTO=filter:unknown, "
                         "PHOTO=light:LIGHT, PHOTO=same or PHOTO=moved is needed")
    if kind == "light":
        return {"light": file_or_word(what)}
    return {"same_light_as": FIRST_PHOTO, "filter": file_or_word(what)}


def _show_photo(photo: Path, orientation: int | None, chart_photo: Path | None, layout: str,
                reference: str | None, corners: str | None,
                not_linear: bool) -> command_line.Answer:
    """Look for the chart, and write a picture to read regions from, with the chart drawn on it."""
    from spectrabox.capture.develop.developed import open_any
    from spectrabox.capture.photo.preview import photo_orientation, turned
    from spectrabox.measure import texts
    from spectrabox.session.camera.camera_files import chart_named
    from spectrabox.session.flat.new_session import write_picture
    picture = photo.with_name(f"{photo.stem}-pixels.png")
    image = turned(open_any(photo, not_linear), orientation or photo_orientation(photo))
    chart = None
    try:
        if chart_photo is None:
            chart = chart_named(image, layout, reference, corners)
    except errors.CheckError as error:
        write_picture(image, picture)
        raise type(error)(f"{error}. {picture} shows the photo with its pixels on the axes, to "
                          "read corners from; a photo of the chart by itself is given with "
                          "--chart") from None
    size = write_picture(image, picture, None if chart is None else chart[0].corners_px)
    next_step = (f"wrote {picture}\nnext: point at the colours in the browser, at an address that "
                 f"this prints: spectrabox open {shlex.quote(str(photo))}\n"
                 f"or: read corners from the axes of the picture, and give --region "
                 f"NAME={command_line.RECTANGLE} for each colour")
    facts = {"picture": picture, "size_px": size, "verdict": None, "reasons": [], "findings": [],
             "corners_px": None}
    if chart is None:
        return command_line.Answer(facts, next_step)
    detection, verdict = chart
    reasons = texts.reasons(verdict.findings)
    return command_line.Answer({**facts, "verdict": verdict.verdict, "reasons": reasons,
                   "findings": [texts.facts(finding) for finding in verdict.findings],
                   "corners_px": detection.corners_px},
                  "\n".join([f"{verdict.verdict.upper()}  {photo.name}: the chart is drawn on the "
                             "picture",
                             *(f"- {reason}" for reason in (texts.says(detection.how_found),
                                                            *reasons)), next_step]))


def _pairs(words: Sequence[str], option: str, form: str) -> dict[str, str]:
    """NAME=REST of every word."""
    pairs: dict[str, str] = {}
    for word in words:
        name, equals, rest = word.partition("=")
        if not (name and equals and rest):
            raise errors.InputError(f"{option} {word!r}: NAME={form} is needed")
        if name in pairs:
            raise errors.InputError(f"{option} names {name!r} twice; give each a name of its own")
        pairs[name] = rest
    return pairs
