"""Commands on a camera without a session: camera fit, profile, prior, preflight, add, names."""
from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from spectrabox.session.camera.inputs import (
    facts_of,
    keep_fit,
    light_words,
    numbers_of_patches,
    read_layout,
    read_measured_curves,
    read_photos,
    require_outputs,
    write_curves,
    write_draws,
)
from spectrabox.session.command_line import (
    ChartLayout,
    CommandGroup,
    Debug,
    Json,
    answer,
    check_ending,
    command,
    fail,
)
from spectrabox.session.commands.sampling import AtHand, Filters

if TYPE_CHECKING:
    from spectrabox.calibrate.chart_calibration import ChartCalibration
    from spectrabox.calibrate.prior.camera_prior import CameraPrior

METHODS = ("prior", "smooth", "nonnegative", "paper", "file")
CURVES = {".csv": "the curves and their standard errors"}
DRAWS = {".npz": "draws of the curves"}
PRIORS = {".npz": "a prior on curves"}
LampToUse = Annotated[str, typer.Option(
    "--light", metavar="FILE|NAME", show_default=False, help="CSV of the light's spectrum, a CIE "
    "name (D65, A, LED-B3), unknown, 3200K, or a kind: daylight, halogen, led, fluorescent.")]
KnownCurves = Annotated[Path | None, typer.Option(
    metavar="CSV", help="Measured curves of the camera, a column per band; by default it is one "
    "like those of the prior.")]
Reference = Annotated[str | None, typer.Option(metavar="NAME|FILE", help="Chart reflectances: a "
                                               "published average, or a file you measured.")]
Lights = Annotated[list[str], typer.Option(metavar="FILE|NAME", show_default=False,
                                           help="CSV of the light's spectrum, a CIE name (D65, A, "
                                           "LED-B3), unknown, 3200K, or a kind: daylight, halogen, "
                                           "led, fluorescent. Once for each photo, or once for "
                                           "all.")]
ChartPhotos = Annotated[list[Path] | None, typer.Argument(
    metavar="[PHOTO...]", help="Photos of a colour chart, as --chart gives them.",
    show_default=False)]
Charts = Annotated[list[Path] | None, typer.Option(metavar="PHOTO", help="Raw, DNG, or linear EXR "
                                                   "or TIFF of a colour chart; several of one "
                                                   "camera may be given.")]
Tables = Annotated[list[Path] | None, typer.Option(metavar="CSV", help="Signals, a row for each "
                                                   "patch, in place of a photo; columns named "
                                                   "standard_error... hold their errors.")]
Corners = Annotated[list[str] | None, typer.Option(metavar="'X,Y X,Y X,Y X,Y'", help="Corners "
                                                   "of the chart where it is not found: of a "
                                                   "ColorChecker the outer corners of the patches "
                                                   "at dark skin, bluish green, black and white."
                                                   )]
References = Annotated[list[str] | None, typer.Option(metavar="NAME|FILE", help="Chart "
                                                      "reflectances: a published average, or a "
                                                      "file you measured; by default the "
                                                      "layout's own.")]
PriorFile = Annotated[Path | None, typer.Option("--prior", metavar="NPZ", help="A prior of your "
                                                "own; the shipped one by default.")]
camera = typer.Typer(cls=CommandGroup, no_args_is_help=True, help="Sensitivities of a camera: fit, "
                     "prior, preflight.")


def register(app: typer.Typer) -> None:
    """Add these commands to the command line."""
    for function in (fit, profile, prior, preflight, add, names):
        camera.command()(function)
    app.add_typer(camera, name="camera")


def fit(light: Lights, photos: ChartPhotos = None, chart: Charts = None,
        patches: Tables = None,
        method: Annotated[str, typer.Option(help=f"One of {', '.join(METHODS)}.")] = "prior",
        curves: Annotated[Path | None, typer.Option(
            metavar="CSV", help="Measured curves, with method file.")] = None,
        out: Annotated[Path | None, typer.Option(
            metavar="CSV", help="Write the curves and their band.")] = None,
        samples: Annotated[Path | None, typer.Option(
            metavar="NPZ", help="Write 1000 draws of the curves.")] = None,
        reference: References = None, layout: ChartLayout = "", corners: Corners = None,
        leave_out: Annotated[str, typer.Option(metavar="N,N...", show_default=False, help="Patches "
                                               "that no fit uses, by number from 1.")] = "",
        prior_file: PriorFile = None,
        keep: Annotated[str | None, typer.Option(metavar="NAME", help="Keep the curves under this "
                                                 "name, for --sensitivity NAME.")] = None,
        as_json: Json = False, debug: Debug = False) -> None:
    """Sensitivities from chart photos and light spectra, with error bars.

    Under a light that is not known, the products of sensitivity and light.

    Of several photos the first --light and --reference belong to the first photo, the second to the
    second; one alone serves all.
    """
    with command(as_json, debug):
        if method not in METHODS:
            fail(as_json, f"--method {method} is not known; known are {', '.join(METHODS)}", 2)
        chart = [*(photos or ()), *(chart or ())]
        if bool(chart) == bool(patches):
            fail(as_json, "give either photos of a chart or --patches CSV", 2)
        if (method == "file") != (curves is not None):
            fail(as_json, "measured curves need both --method file and --curves CSV", 2)
        given = chart or patches or []
        for option, stated in (("--light", light), ("--reference", reference or [""]),
                              ("--corners", corners or [""])):
            if len(stated) not in (1, len(given)):
                fail(as_json, f"{len(stated)} times {option} for {len(given)} photos; give one for "
                     "each or one for all", 2)
        require_outputs([path for path in (out, samples) if path is not None],
                        [*given, *map(Path, light), *map(Path, reference or []),
                         *(path for path in (curves, prior_file)
                           if path is not None)])
        check_ending(out, CURVES)
        check_ending(samples, DRAWS, "--samples")
        if keep is not None:
            from spectrabox.radiometry.spectra.kept_cameras import require_new_name
            require_new_name(keep)
        from spectrabox.radiometry.grid import visible_grid
        grid = visible_grid()
        charts, names = read_photos(list(given), list(light), list(reference or []),
                                  list(corners or []), bool(chart), grid,
                                  numbers_of_patches(leave_out), layout)
        from spectrabox.calibrate.chart_calibration import CalibrationOptions, calibrate_chart
        from spectrabox.calibrate.curve_band import curve_band
        from spectrabox.session.stages.left_out import left_out_patches
        given_curves = None if curves is None else read_measured_curves(curves, len(names), grid)
        options = CalibrationOptions(method, None if prior_file is None else _prior(prior_file),
                                     curves=given_curves)
        result = calibrate_chart(charts, grid, options)
        band = curve_band(result)
        left_out = left_out_patches(result, charts[0].reflectances)
        source = ", ".join(light_words(chart.light) for chart in charts)
        facts = {**facts_of(result, band, grid, charts[0].chart, left_out), "bands": list(names),
                 "light": source}
        if out is not None:
            write_curves(out, result.calibration, names, source)
            facts["file"] = str(out)
        if keep is not None:
            facts["kept"] = str(keep_fit(keep, result.calibration, names, source))
        if samples is not None:
            write_draws(samples, band, grid)
            facts["samples"] = str(samples)
        answer(as_json, facts, _fit_text(facts, result, names, out))


def prior(folder: Annotated[Path, typer.Argument(metavar="FOLDER", show_default=False,
                                                 help="Curves: rawtoaces JSON, camspec TXT, CSV.")],
          out: Annotated[Path, typer.Option(
              metavar="NPZ", help="Where to write the prior.", show_default=False)],
          leave_out: Annotated[list[str] | None, typer.Option(
              metavar="NAME", help="A camera to leave out; may be repeated.")] = None,
          source: Annotated[str | None, typer.Option(
              help="Stored with the prior; the folder by default.")] = None,
          licence: Annotated[str, typer.Option(help="Of the curves.")] = "not stated",
          as_json: Json = False, debug: Debug = False) -> None:
    """A prior on sensitivities from a folder of measured cameras."""
    with command(as_json, debug):
        check_ending(out, PRIORS)
        from spectrabox.calibrate.prior.camera_database import read_camera_database
        from spectrabox.calibrate.prior.camera_prior import save_camera_prior
        from spectrabox.calibrate.prior.learnt_prior import build_prior
        database = read_camera_database(folder, leave_out=tuple(leave_out or ()))
        made = build_prior(database.nm, database.curves, database.names, licence=licence,
                           source=source or f"{len(database.names)} cameras of {folder.name}")
        save_camera_prior(out, made)
        families = [members for members, level in zip(made.members, made.level, strict=True)
                    if level == 0]
        facts = {"file": str(out), "cameras": list(database.names),
                 "skipped": list(database.skipped),
                 "families": families, "bands": made.bands}
        lines = [f"wrote {out}: {len(database.names)} cameras, {len(families)} families of two or "
                 "more", *(f"- skipped: {reason}" for reason in database.skipped)]
        answer(as_json, facts, "\n".join(lines))


def preflight(light: LampToUse,
              noise: Annotated[float, typer.Option(help="Relative error of a patch, everything "
                                                   "included.")] = 0.01,
              reference: Reference = None, layout: ChartLayout = "", prior_file: PriorFile = None,
              curves: KnownCurves = None, lamps: AtHand = None, filters: Filters = None,
              surfaces: Annotated[int, typer.Option(help="Surfaces of each family that are "
                                                    "tried; 0 leaves spectra out.")] = 20,
              as_json: Json = False, debug: Debug = False) -> None:
    """Before shooting: expected error of the curves and of spectra, family by family, for this
    camera, chart and light, and what a second light would bring.
    """
    with command(as_json, debug):
        if not 0 < noise < 1:
            fail(as_json, f"--noise {noise:g} is not between 0 and 1; 0.01 means 1 %", 2)
        if surfaces < 0:
            fail(as_json, f"--surfaces {surfaces} is negative; 0 leaves spectra out", 2)
        if curves is not None and prior_file is not None:
            fail(as_json, "--curves and --prior both say what the camera is; give one", 2)
        from spectrabox.session.camera.preflight_answer import Preparation, preflight_answer
        prepared = Preparation(light, noise, reference, read_layout(layout), prior_file, curves,
                               lamps, filters, surfaces)
        answer(as_json, *preflight_answer(prepared))


def profile(sensitivity: Annotated[str, typer.Argument(
                metavar="FILE|NAME", show_default=False, help="Curves of three bands, or a camera "
                "by its name.")],
            model: Annotated[str, typer.Option("--camera", metavar="'MAKER MODEL'", help="As the "
                             "camera's raw files name it.", show_default=False)],
            out: Annotated[list[Path] | None, typer.Option(
                "--out", "-o", metavar="FILE", help=".dcp: DNG profile for A and D65; .json: "
                "rawtoaces; .txt: vkdt. May be repeated.")] = None,
            samples: Annotated[Path | None, typer.Option(
                metavar="NPZ", help="Draws of the curves, from 'camera fit --samples': gives every "
                "number its spread.")] = None,
            idt_light: Annotated[str, typer.Option(help="CIE name, of the ACES matrix.")] = "D55",
            as_json: Json = False, debug: Debug = False) -> None:
    """Colour matrices (DNG, ACES) and profiles of a camera, with error bars and colour errors."""
    with command(as_json, debug):
        from spectrabox.session.camera.profile import FORMS, ProfileRequest, profile_answer
        for path in out or ():
            check_ending(path, FORMS)
        answer(as_json, *profile_answer(ProfileRequest(sensitivity, model, samples, idt_light,
                                                       tuple(out or ()))))


def add(files: Annotated[list[Path], typer.Argument(
            metavar="FILE|FOLDER...", show_default=False, help="Measured curves: rawtoaces JSON, "
            "camspec TXT, CSV; folders of them.")],
        as_json: Json = False, debug: Debug = False) -> None:
    """Keep measured cameras by their names, for --sensitivity \"Nikon D850\"."""
    with command(as_json, debug):
        from spectrabox.session.camera.kept import add_cameras
        kept, skipped, folder = add_cameras(files)
        answer(as_json, {"folder": str(folder), "cameras": kept, "skipped": skipped},
               "\n".join([f"kept in {folder}: {', '.join(kept) or 'none'}",
                          *(f"- skipped: {reason}" for reason in skipped)]))


def names(as_json: Json = False, debug: Debug = False) -> None:
    """Names of the cameras and observers that --sensitivity takes."""
    with command(as_json, debug):
        from spectrabox.radiometry.published.published_tables import OBSERVERS, published_names
        from spectrabox.radiometry.spectra.kept_cameras import own_cameras
        own, published = own_cameras(), published_names(OBSERVERS)
        answer(as_json, {"own": {name: str(path) for name, path in own.items()},
                         "published": published},
               "\n".join([*(f"{name}  (your own)" for name in own), *published]))


def _prior(path: Path) -> CameraPrior:
    from spectrabox.calibrate.prior.camera_prior import load_camera_prior
    return load_camera_prior(path)


def _fit_text(facts: dict[str, Any], result: ChartCalibration, names: tuple[str, ...],
              out: Path | None) -> str:
    fit = result.calibration.sensitivity
    lines = [f"bands {', '.join(names)}: {fit.method}",
             *(f"- {check}" for check in facts["checks"]), fit.outcome.value]
    return "\n".join([*lines, f"wrote {out}"] if out is not None else lines)
