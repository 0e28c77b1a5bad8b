"""The command that goes from photos with a chart in them to spectra of their regions."""
from __future__ import annotations

import contextlib
import dataclasses
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from spectrabox.radiometry.errors import CheckError, InputError, SpectraboxError
from spectrabox.session.commands.session import RunRequest, run_session
from spectrabox.session.terminal.command_line import (
    CORNERS,
    CORNERS_HELP,
    RECTANGLE,
    Answer,
    ChartLayout,
    CommonOptions,
    Quiet,
    command,
    pixel_numbers,
)

if TYPE_CHECKING:
    from spectrabox.session.flat.new_session import FurtherPhoto


def register(app: typer.Typer) -> None:
    """Add the command to the command line."""
    app.command()(flat)


@dataclass(frozen=True, kw_only=True)
class FlatRequest(CommonOptions):
    """Options of ``spectrabox flat``."""

    photos: Annotated[tuple[Path, ...], typer.Argument(
        metavar="PHOTO...", show_default=False, help="The samples, with a colour chart among them: "
        "camera raw or linear file. Further photos are of the same samples from the same tripod, "
        "each with the chart and under another unknown light: every one adds its bands.")]
    also: Annotated[tuple[str, ...], typer.Option(
        "--also", metavar="PHOTO=WHAT",
        help="A further photo under a light or through a filter of which "
        "something is known: filter:FILE or filter:unknown (before the first photo's light), "
        "light:LIGHT as of --light, or same (the first photo's light). May be repeated.")] = ()
    region: Annotated[tuple[str, ...], typer.Option(
        "--region", metavar=f"NAME={RECTANGLE}", help="A region by two opposite corners in pixels "
        "of the first photo; may be repeated. Without one, the command looks for the chart and "
        "writes a picture of the photo with its pixels on the axes.")] = ()
    regions: Annotated[Path | None, typer.Option(
        metavar="TOML",
        help="File of regions, [regions.NAME] with rect, family, surface, known and "
        "truth as in a session, for photos that are framed alike.")] = None
    each: Annotated[bool, typer.Option(
        "--each", help="Measure every photo by itself, with the same regions, and make a session "
        "of each: for the photos of a day. All are turned as the first states.")] = False
    light: Annotated[str, typer.Option(
        metavar="FILE|NAME",
        help="Of the first photo: unknown, a CIE name, a kind of lamp, 3200K, or the file of its "
        "spectrum.")] = "unknown"
    chart: Annotated[Path | None, typer.Option(
        "--chart", metavar="PHOTO",
        help="Photo of the chart in the samples' place, where they do not show "
        "it.")] = None
    corners: Annotated[str | None, typer.Option(
        metavar=CORNERS, help=CORNERS_HELP)] = None
    layout: ChartLayout = ""
    reference: Annotated[str | None, typer.Option(
        metavar="NAME|FILE", show_default=False, help="Chart reflectances: a published average, or "
        "a file you measured; by default the layout's own.")] = None
    white_card: Annotated[str | None, typer.Option(
        metavar=f"{RECTANGLE}=FILE|NUMBER", help="A region of known reflectance, such as "
        "986,462,1073,537=0.94 or =card.csv.")] = None
    swatches: Annotated[Path | None, typer.Option(
        help="Measured spectra of swatches of the samples' material, eight or more, each named as "
        "its --region; they correct the other regions.")] = None
    flat_field: Annotated[Path | None, typer.Option(
        metavar="PHOTO", help="Photo of a white card that fills the samples' place.")] = None
    family: Annotated[tuple[str, ...], typer.Option(
        "--family", metavar="NAME=KIND", help="What a region's surface is: paint, textile, leaves, "
        "skin, white, earth or animal. May be repeated.")] = ()
    surface: Annotated[tuple[str, ...], typer.Option(
        "--surface", metavar="[NAME=]matt|satin|glossy", help="How much the surfaces mirror: of "
        "all regions, or of the named one. May be repeated.")] = ()
    truth: Annotated[tuple[str, ...], typer.Option(
        "--truth", metavar="NAME=FILE", help="Measured reflectance of a region, to compare "
        "with.")] = ()
    not_linear: Annotated[bool, typer.Option(
        "--not-linear", help="Take JPEG and PNG, decoded as sRGB: for a first look, since nobody "
        "knows the errors of what the camera has processed; never a PASS.")] = False
    picture: Annotated[bool, typer.Option(
        "--picture", help="Also the spectrum of every pixel, with maps, in "
        "results/picture.")] = False
    picture_light: Annotated[str | None, typer.Option(
        metavar="NAME",
        help="CIE name of a second light, besides D65, under which the picture's colours are "
        "shown.")] = None
    session: Annotated[Path | None, typer.Option(
        metavar="DIR", help="The session folder; beside the photo and named after it by "
        "default.")] = None
    quiet: Quiet = False


@command
def flat(request: FlatRequest) -> Answer:
    """Measure spectra of flat samples in photos that show a colour chart."""
    return _measure_each(request) if request.each else _measure(request)


def _measure_each(request: FlatRequest) -> Answer:
    """A session for each photo; one that will not do does not stop the others."""
    from spectrabox.session.terminal.command_line import tell
    if request.also or request.session is not None:
        raise InputError("--each makes a session beside every photo: leave --also and --session "
                         "out")
    answers: list[dict[str, object]] = []
    texts, codes = [], []
    orientation = _first_orientation(request.photos)
    for photo in request.photos:
        try:
            answer = _measure(dataclasses.replace(request, photos=(photo,)), orientation)
            answers.append({"photo": photo, **answer.facts})
            texts.append(f"{photo}\n{answer.text}")
        except SpectraboxError as error:
            tell(f"spectrabox: {photo}: {error}")
            answers.append({"photo": photo, "error": str(error), "exit_code": error.exit_code})
            texts.append(f"{photo}\nnot measured: {error}")
            codes.append(error.exit_code)
    return Answer({"photos": answers}, "\n\n".join(texts), min(codes, default=0))


def _first_orientation(photos: Sequence[Path]) -> int | None:
    """The orientation of the first photo that can be read, in which all are framed alike: a camera
    that looks down states any.
    """
    from spectrabox.capture.photo.orientation import photo_orientation
    for photo in photos:
        with contextlib.suppress(SpectraboxError):
            return photo_orientation(photo)
    return None


def _measure(request: FlatRequest, orientation: int | None = None) -> Answer:
    """The session of one sample, run; without regions a look at its photo."""
    start = time.perf_counter()
    photo, *others = request.photos
    if not request.region and request.regions is None:
        return _show_photo(photo, request, orientation)
    from spectrabox.session.flat.new_session import CARD, FlatOrder, session_of
    from spectrabox.session.flat.regions_file import StatedRegions, read_regions
    in_file = StatedRegions() if request.regions is None else read_regions(request.regions)
    regions = {name: pixel_numbers(rest, 4, f"--region {name}", RECTANGLE)
               for name, rest in _pairs(request.region, "--region", RECTANGLE).items()}
    if twice := regions.keys() & in_file.rects.keys():
        raise InputError(f"{min(twice)!r} is a --region and in {request.regions} too; leave one "
                         "out")
    regions |= {name: list(rect) for name, rect in in_file.rects.items()}
    known = dict(in_file.known)
    if request.white_card is not None:
        rect, _, known[CARD] = request.white_card.partition("=")
        regions[CARD] = pixel_numbers(rect, 4, "--white-card", RECTANGLE)
        if not known[CARD]:
            raise InputError("--white-card needs the card's reflectance: X0,Y0,X1,Y1=FILE, or "
                             "a number such as X0,Y0,X1,Y1=0.95")
    families = {**in_file.families} | {name: word.split(",") for name, word
                in _pairs(request.family, "--family", "paint").items()}
    truths = {**in_file.truths} | _pairs(request.truth, "--truth", "FILE")
    surfaces, of_all = _surfaces(request.surface, [name for name in regions if name not in known])
    surfaces = {**in_file.surfaces} | surfaces
    if unknown := [name for name in (*families, *truths, *surfaces) if name not in regions]:
        raise InputError(f"{unknown[0]!r} is no region; the regions are {', '.join(regions)}")
    px = None if request.corners is None else pixel_numbers(request.corners, 8, "--corners",
                                                            CORNERS)
    further = [*map(_further, others), *(
        _further(Path(file), said)
        for file, said in _pairs(request.also, "--also", "WHAT").items())]
    order = FlatOrder(photo, regions, request.light, request.chart, request.flat_field,
                      None if px is None else [px[at:at + 2] for at in range(0, 8, 2)],
                      families, surfaces, of_all, known, truths, request.layout,
                      request.reference, request.picture, request.picture_light,
                      further, request.swatches, request.not_linear, orientation)
    if request.picture_light is not None and not request.picture:
        raise InputError("--picture-light says how a picture is shown: give --picture too")
    with session_of(order, request.session) as folder:
        run = RunRequest(folder=folder, device="not needed", quiet=request.quiet)
        answer = run_session(run, ["spectrabox", "flat", photo.stem])
    seconds = round(time.perf_counter() - start, 3)
    return Answer({**answer.facts, "seconds": seconds}, answer.text)


def _further(photo: Path, said: str = "light:unknown") -> FurtherPhoto:
    """A further photo and what is said of its light."""
    from spectrabox.session.flat.new_session import FurtherPhoto

    kind, _, what = said.partition(":")
    if said == "same":
        return FurtherPhoto(photo, None)
    if not what or kind not in ("filter", "light"):
        raise InputError(f"--also {photo}={said}: PHOTO=filter:FILE, PHOTO=filter:unknown, "
                         "PHOTO=light:LIGHT or PHOTO=same is needed")
    return FurtherPhoto(photo, None, what) if kind == "filter" else FurtherPhoto(photo, what)


def _surfaces(words: Sequence[str], regions: Iterable[str]) -> tuple[dict[str, str], str | None]:
    """What is stated of the surface of each region, and of all that is photographed."""
    from spectrabox.radiometry.error_model import SURFACE_WORDS

    of_all = next((word for word in words if "=" not in word), None)
    stated = {} if of_all is None else dict.fromkeys(regions, of_all)
    stated |= _pairs([word for word in words if "=" in word], "--surface", "matt")
    for word in stated.values():
        if word not in SURFACE_WORDS:
            raise InputError(f"--surface {word!r}: {', '.join(SURFACE_WORDS)} are what a surface "
                             "may be")
    return stated, of_all


def _show_photo(photo: Path, request: FlatRequest, orientation: int | None) -> Answer:
    """Look for the chart, and write a picture to read regions from, with the chart drawn on it."""
    from spectrabox.capture.develop.developed import open_any
    from spectrabox.capture.photo.orientation import photo_orientation, turned
    from spectrabox.session.camera.inputs import chart_named
    from spectrabox.session.flat.look import write_picture
    picture = photo.with_name(f"{photo.stem}-pixels.png")
    image = turned(open_any(photo, request.not_linear), orientation or photo_orientation(photo))
    chart = None
    try:
        if request.chart is None:
            chart = chart_named(image, request.layout, request.reference, request.corners)
    except CheckError as error:
        write_picture(image, picture)
        raise type(error)(f"{error}. {picture} shows the photo with its pixels on the axes, to "
                          "read corners from; a photo of the chart by itself is given with "
                          "--chart") from None
    size = write_picture(image, picture, None if chart is None else chart[0].corners_px)
    next_step = (f"wrote {picture}: read the corners of your regions from its axes, then give "
                 f"--region NAME={RECTANGLE} for each, or point at them with 'spectrabox open "
                 f"{photo}'")
    facts = {"picture": picture, "size_px": size, "verdict": None, "reasons": [],
             "corners_px": None}
    if chart is None:
        return Answer(facts, next_step)
    detection, verdict = chart
    return Answer({**facts, "verdict": verdict.verdict, "reasons": verdict.reasons,
                   "corners_px": detection.corners_px},
                  "\n".join([f"{verdict.verdict.upper()}  {photo.name}: chart "
                             f"{detection.how_found}, drawn on the picture",
                             *(f"- {reason}" for reason in verdict.reasons), next_step]))


def _pairs(words: Sequence[str], option: str, form: str) -> dict[str, str]:
    """NAME=REST of every word."""
    pairs: dict[str, str] = {}
    for word in words:
        name, equals, rest = word.partition("=")
        if not (name and equals and rest):
            raise InputError(f"{option} {word!r}: NAME={form} is needed")
        if name in pairs:
            raise InputError(f"{option} names {name!r} twice; give each a name of its own")
        pairs[name] = rest
    return pairs
