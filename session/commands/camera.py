"""Commands on a camera without a session: camera fit, profile, prior, preflight, add, list."""
from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from spectrabox.session.commands.requests import (
    METHODS,
    CameraFitRequest,
    CameraPreflightRequest,
    CameraProfileRequest,
)
from spectrabox.session.terminal.command_help import Commands
from spectrabox.session.terminal.command_line import (
    Answer,
    CommonOptions,
    UsageProblem,
    check_ending,
    command,
)

PRIORS = {".npz": "a prior on curves"}
CURVES = {".csv": "the curves and their standard errors"}
DRAWS = {".npz": "draws of the curves"}
camera = Commands(help="Sensitivities of a camera: measured on a chart, known by its name, or "
                       "forecast before the shoot.")


def register(app: typer.Typer) -> None:
    """Add these commands to the command line."""
    for function in (fit, profile, prior, preflight, add):
        camera.command()(function)
    camera.command("list")(list_cameras)
    app.add_typer(camera, name="camera")


@command
def fit(request: CameraFitRequest) -> Answer:
    """Measure a camera's sensitivities on photos of a colour chart, with error bars.

    Under an unknown light the answer is the product of sensitivity and light.

    Of several photos the first --light and --reference belong to the first photo, the second to the
    second; one alone serves all.
    """
    if request.method not in METHODS:
        raise UsageProblem(f"--method {request.method} is not known; known are "
                           f"{', '.join(METHODS)}")
    chart = [*request.photos, *request.chart]
    if bool(chart) == bool(request.patches):
        raise UsageProblem("give either photos of a chart or --patches CSV")
    if (request.method == "file") != (request.curves is not None):
        raise UsageProblem("measured curves need both --method file and --curves CSV")
    given = chart or request.patches
    for option, stated in (("--light", request.light), ("--reference", request.reference),
                           ("--corners", request.corners)):
        if stated and len(stated) not in (1, len(given)):
            raise UsageProblem(f"{len(stated)} times {option} for {len(given)} photos; give one "
                               "for each or one for all")
    outputs = [path for path in (request.out, request.draws_file) if path is not None]
    from spectrabox.calibrate.chart_calibration import CalibrationOptions
    from spectrabox.calibrate.prior.camera_prior import load_camera_prior
    from spectrabox.measure.camera import measure_camera
    from spectrabox.radiometry.grid import FINE_GRID
    from spectrabox.radiometry.spectra.kept_cameras import keep_camera, require_new_name
    from spectrabox.session.camera.fit_files import require_outputs, write_curves, write_draws
    from spectrabox.session.camera.inputs import camera_capture, read_measured_curves
    inputs = [*given, *map(Path, (*request.light, *request.reference)),
              *(path for path in (request.curves, request.prior_file) if path is not None)]
    require_outputs(outputs, inputs)
    check_ending(request.out, CURVES)
    check_ending(request.draws_file, DRAWS, "--draws-file")
    if request.keep is not None:
        require_new_name(request.keep)
    capture = camera_capture(request)
    curves = None if request.curves is None else read_measured_curves(
        request.curves, len(capture.shown[0].bands), FINE_GRID)
    prior = None if request.prior_file is None else load_camera_prior(request.prior_file)
    fitted = measure_camera(capture, CalibrationOptions(request.method, prior, curves=curves))
    facts, text = fitted.facts(), fitted.text()
    if request.out is not None:
        write_curves(request.out, fitted)
        facts["file"] = request.out
        text += f"\nwrote {request.out}"
    if request.keep is not None:
        facts["kept"] = keep_camera(request.keep, fitted.sensitivity.grid.nm, fitted.columns(),
                                    fitted.source)
    if request.draws_file is not None:
        write_draws(request.draws_file, fitted)
        facts["samples"] = request.draws_file
    return Answer(facts, text)


@dataclass(frozen=True, kw_only=True)
class CameraPriorRequest(CommonOptions):
    """Options of ``spectrabox camera prior``."""

    folder: Annotated[Path, typer.Argument(
        metavar="FOLDER", show_default=False, help="Curves: rawtoaces JSON, CSV.")]
    out: Annotated[Path, typer.Option(
        "--out", "-o", metavar="NPZ", show_default=False, help="Where to write the prior.")]
    leave_out: Annotated[tuple[str, ...], typer.Option(
        metavar="NAME", help="A camera to leave out; may be repeated.")] = ()
    source: Annotated[str | None, typer.Option(
        metavar="TEXT", help="Stored with the prior; the folder by default.")] = None
    licence: Annotated[str, typer.Option(help="Licence of the curves.")] = "not stated"


@command
def prior(request: CameraPriorRequest) -> Answer:
    """Build a prior on sensitivities from a folder of measured cameras."""
    check_ending(request.out, PRIORS)
    from spectrabox.calibrate.prior.camera_database import read_camera_database
    from spectrabox.calibrate.prior.camera_prior import save_camera_prior
    from spectrabox.calibrate.prior.learnt_prior import build_prior
    database = read_camera_database(request.folder, leave_out=request.leave_out)
    count = len(database.names)
    learnt = build_prior(database.nm, database.curves, database.names, licence=request.licence,
                         source=request.source or f"{count} cameras of {request.folder.name}")
    save_camera_prior(request.out, learnt)
    families = [members for members, level in zip(learnt.members, learnt.level, strict=True)
                if level == 0]
    return Answer({"file": request.out, "cameras": database.names, "skipped": database.skipped,
                   "families": families, "bands": learnt.bands},
                  "\n".join([f"wrote {request.out}: {count} cameras, {len(families)} families of "
                             "two or more",
                             *(f"- skipped: {reason}" for reason in database.skipped)]))


@command
def preflight(request: CameraPreflightRequest) -> Answer:
    """Forecast, before shooting, the errors of curves and of spectra, family by family, for this
    camera, chart and light, and what a second light would bring.
    """
    if not 0 < request.noise < 1:
        raise UsageProblem(f"--noise {request.noise:g} is not between 0 and 1; 0.01 means 1 %")
    if request.surfaces < 0:
        raise UsageProblem(f"--surfaces {request.surfaces} is negative; 0 leaves spectra out")
    if request.curves is not None and request.prior_file is not None:
        raise UsageProblem("--curves and --prior both say what the camera is; give one")
    from spectrabox.session.camera.preflight_answer import preflight_answer
    return Answer(*preflight_answer(request))


@command
def profile(request: CameraProfileRequest) -> Answer:
    """Write colour matrices and profiles of a camera, with error bars and colour errors."""
    from spectrabox.session.camera.profile import FORMS, write_profiles
    for path in request.out:
        check_ending(path, FORMS)
    known = write_profiles(request)
    return Answer(known.facts() | {"files": request.out}, "\n".join([
        known.text(), *(f"wrote {path}" for path in request.out)]))


@dataclass(frozen=True, kw_only=True)
class CameraAddRequest(CommonOptions):
    """Options of ``spectrabox camera add``."""

    files: Annotated[tuple[Path, ...], typer.Argument(
        metavar="FILE|FOLDER...", show_default=False, help="Measured curves: rawtoaces JSON, "
        "CSV; folders of them.")]


@command
def add(request: CameraAddRequest) -> Answer:
    """Keep further measured cameras by their names, for --sensitivity \"My camera\"."""
    from spectrabox.session.camera.kept import add_cameras
    kept, skipped, folder = add_cameras(request.files)
    return Answer({"folder": str(folder), "cameras": kept, "skipped": skipped},
                  "\n".join([f"kept in {folder}: {', '.join(kept) or 'none'}",
                             *(f"- skipped: {reason}" for reason in skipped)]))


@command
def list_cameras(request: CommonOptions) -> Answer:
    """Names of the cameras and observers that --sensitivity takes, such as \"Nikon D810\"."""
    from spectrabox.radiometry.published.published_tables import (
        CAMERAS,
        OBSERVERS,
        published_names,
    )
    from spectrabox.radiometry.spectra.kept_cameras import own_cameras
    own, measured = own_cameras(), published_names(CAMERAS)
    published = published_names(OBSERVERS)
    return Answer({"own": {name: str(path) for name, path in own.items()},
                   "measured": measured, "published": published},
                  "\n".join([*(f"{name}  (your own)" for name in own),
                             *(f"{name}  (rawtoaces-data)" for name in measured), *published]))
