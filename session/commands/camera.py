"""Commands on a camera without a session: camera fit, profile, prior, add, list."""
from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from spectrabox.session.commands import requests
from spectrabox.session.terminal import command_help, command_line

PRIORS = {".npz": "a prior on curves"}
CURVES = {".csv": "the curves and their standard errors"}
DRAWS = {".npz": "draws of the curves"}
camera = command_help.Commands(
    help="Sensitivities of a camera: measured on a chart, or known by its name.")


def register(app: typer.Typer) -> None:
    """Add these commands to the command line."""
    for function in (fit, profile, prior, add):
        camera.command()(function)
    camera.command("list")(list_cameras)
    app.add_typer(camera, name="camera")


@command_line.Command
def fit(
    light: Annotated[
        tuple[str, ...],
        typer.Option(
            metavar="FILE|NAME", show_default=False, help="{light.spectrum} Here 3200K is a "
            "temperature. Once for each photo, or once for all.")],
    photos: Annotated[tuple[Path, ...],
                      typer.Argument(metavar="[PHOTO...]", show_default=False,
                                     help="Photos of a colour chart, as --chart gives "
                                     "them.")] = (),
    chart: Annotated[tuple[Path, ...],
                     typer.Option(
                         metavar="PHOTO",
                         help="Raw, DNG, or linear EXR or TIFF of a colour chart; several of one "
                         "camera may be given.")] = (),
    patches: Annotated[
        tuple[Path, ...],
        typer.Option(
            metavar="CSV", help="Signals, a row for each patch, in place of a photo; columns named "
            "standard_error... hold their errors.")] = (),
    method: Annotated[
        str | None,
        typer.Option(metavar="|".join(requests.METHODS), help="{sensitivity.method}")] = None,
    curves: Annotated[
        Path | None,
        typer.Option(metavar="CSV", help="Measured curves, with method file.")] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="CSV", help="Write the curves and their band.")] = None,
    draws_file: Annotated[
        Path | None,
        typer.Option(metavar="NPZ", help="Write 1000 draws of the curves.")] = None,
    reference: Annotated[tuple[str, ...],
                         typer.Option(metavar="NAME|FILE", help="{chart.reference}")] = (),
    layout: command_line.ChartLayout = "",
    corners: Annotated[tuple[str, ...],
                       typer.Option(
                           metavar=command_line.CORNERS, help=command_line.CORNERS_HELP
                           + " Once for each photo, or once for all; may be "
                           "repeated.")] = (),
    leave_out: Annotated[
        str, typer.Option(metavar="N,N...", show_default=False, help="{chart.leave_out}")] = "",
    prior_file: requests.PriorFile = None,
    keep: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Keep the curves under this name, for --sensitivity NAME."
                     )] = None,
) -> command_line.Answer:
    """Measure a camera's sensitivities on photos of a colour chart, with error bars.

    Under an unknown light the answer is the product of sensitivity and light.

    Of several photos the first --light and --reference belong to the first photo, the second to the
    second; one alone serves all.
    """
    if method is not None and method not in requests.METHODS:
        raise command_line.UsageProblem(
            f"--method {method} is not known; known are {', '.join(requests.METHODS)}")
    photos = (*photos, *chart)
    if bool(photos) == bool(patches):
        raise command_line.UsageProblem("give either photos of a chart or --patches CSV")
    if (method == "file") != (curves is not None):
        raise command_line.UsageProblem("measured curves need both --method file and --curves CSV")
    given = photos or patches
    for option, stated in (("--light", light), ("--reference", reference), ("--corners", corners)):
        if stated and len(stated) not in (1, len(given)):
            raise command_line.UsageProblem(
                f"{len(stated)} times {option} for {len(given)} photos; give one "
                "for each or one for all")
    outputs = [path for path in (out, draws_file) if path is not None]
    from spectrabox.measure.camera import CameraFit
    from spectrabox.radiometry.spectra.cameras import keep_camera, require_new_name
    from spectrabox.session.camera import camera_files
    inputs = [*given, *map(Path, (*light, *reference)),
              *(path for path in (curves, prior_file) if path is not None)]
    camera_files.require_outputs(outputs, inputs)
    command_line.check_ending(out, CURVES)
    command_line.check_ending(draws_file, DRAWS, "--draws-file")
    if keep is not None:
        require_new_name(keep)
    captures = camera_files.stated_of_charts(
        given, light, reference, corners, layout, leave_out, None if method == "file" else method,
        prior_file, curves)
    fitted = CameraFit.of_charts(camera_files.charts_shown(photos, patches, captures), captures)
    facts, text = fitted.facts(), fitted.text()
    if out is not None:
        camera_files.write_curves(out, fitted)
        facts["file"] = out
        text += f"\nwrote {out}"
    if keep is not None:
        facts["kept"] = keep_camera(keep, fitted.sensitivity.grid.nm, fitted.columns(),
                                    fitted.source)
    if draws_file is not None:
        camera_files.write_draws(draws_file, fitted)
        facts["samples"] = draws_file
    return command_line.Answer(facts, text)


@command_line.Command
def prior(
    folder: Annotated[Path, typer.Argument(
        metavar="FOLDER", show_default=False, help="Curves: rawtoaces JSON, CSV.")],
    out: Annotated[Path, typer.Option(
        "--out", "-o", metavar="NPZ", show_default=False, help="Where to write the prior.")],
    source: Annotated[str | None, typer.Option(
        metavar="TEXT", help="Stored with the prior; the folder by default.")] = None,
    licence: Annotated[str, typer.Option(help="Licence of the curves.")] = "not stated",
) -> command_line.Answer:
    """Build a prior on sensitivities from a folder of measured cameras."""
    command_line.check_ending(out, PRIORS)
    from spectrabox.calibrate.prior import camera_prior, learnt_prior
    database = learnt_prior.read_camera_database(folder)
    count = len(database.names)
    learnt = learnt_prior.build_prior(database.nm, database.curves, database.names, licence=licence,
                                      source=source or f"{count} cameras of {folder.name}")
    camera_prior.save_camera_prior(out, learnt)
    families = [members for members, level in zip(learnt.members, learnt.level, strict=True)
                if level == 0]
    return command_line.Answer({"file": out, "cameras": database.names, "skipped": database.skipped,
                   "families": families, "bands": learnt.bands},
                  "\n".join([f"wrote {out}: {count} cameras, {len(families)} families of "
                             "two or more",
                             *(f"- skipped: {reason}" for reason in database.skipped)]))


@command_line.Command
def profile(
    sensitivity: Annotated[str, typer.Argument(
        metavar="FILE|NAME", show_default=False, help="Curves of three bands, or a camera by its "
        "name.")],
    camera: Annotated[str, typer.Option(
        "--camera", metavar="'MAKER MODEL'", show_default=False, help="As the camera's raw files "
        "name it.")],
    out: Annotated[tuple[Path, ...], typer.Option(
        "--out", "-o", metavar="FILE", help=".icc, .clf, .ocio: profile under --light for ICC "
        "programs, as Common LUT Format, for OpenColorIO; .dcp: DNG profile for A and D65; .json: "
        "rawtoaces; .txt: vkdt. May be repeated.")] = (),
    light: Annotated[str, typer.Option(
        metavar="FILE|NAME", help="Spectrum or CIE name of the photos' light, of .icc, .clf and "
        ".ocio.")] = "D50",
    family: Annotated[tuple[str, ...], typer.Option(
        metavar="FAMILY", help="What will be photographed: paint, textile, leaves, skin, white, "
        "earth or animal; any by default. May be repeated.")] = (),
    raw: Annotated[Path | None, typer.Option(
        metavar="PHOTO", help="A raw file of the camera: the errors of its own matrix (that by "
        "which LibRaw knows it, or a DNG's) stand beside the profile's.")] = None,
    draws_file: Annotated[Path | None, typer.Option(
        metavar="NPZ",
        help="Draws of the curves, from 'camera fit --draws-file': gives every number "
        "its spread.")] = None,
    idt_light: Annotated[str, typer.Option(
        metavar="FILE|NAME", help="Spectrum or CIE name of the light of the ACES matrix.")] = "D55",
) -> command_line.Answer:
    """Write colour matrices and profiles of a camera, with error bars and colour errors."""
    from spectrabox.session.camera.profiles import FORMS, write_profiles
    for path in out:
        command_line.check_ending(path, FORMS)
    known = write_profiles(sensitivity, camera, out, light, family, raw, draws_file, idt_light)
    return command_line.Answer(known.facts() | {"files": out}, "\n".join([
        known.text(), *(f"wrote {path}" for path in out)]))


@command_line.Command
def add(
    files: Annotated[tuple[Path, ...], typer.Argument(
        metavar="FILE|FOLDER...", show_default=False, help="Measured curves: rawtoaces JSON, "
        "CSV; folders of them.")],
) -> command_line.Answer:
    """Keep further measured cameras by their names, for --sensitivity \"My camera\"."""
    from spectrabox.session.camera.camera_files import add_cameras
    kept, skipped, folder = add_cameras(files)
    return command_line.Answer({"folder": str(folder), "cameras": kept, "skipped": skipped},
                  "\n".join([f"kept in {folder}: {', '.join(kept) or 'none'}",
                             *(f"- skipped: {reason}" for reason in skipped)]))


@command_line.Command
def list_cameras() -> command_line.Answer:
    """Names of the cameras and observers that --sensitivity takes, such as \"Nikon D810\"."""
    from spectrabox.radiometry.published import published_tables
    from spectrabox.radiometry.spectra.cameras import own_cameras
    own, measured = own_cameras(), published_tables.published_names(published_tables.CAMERAS)
    published = published_tables.published_names(published_tables.OBSERVERS)
    return command_line.Answer({"own": {name: str(path) for name, path in own.items()},
                   "measured": measured, "published": published},
                  "\n".join([*(f"{name}  (your own)" for name in own),
                             *(f"{name}  (rawtoaces-data)" for name in measured), *published]))
