"""Commands on signals and spectra without a session: sample, uplift, plan, certify, judge, prior
train.

A command's parameters are its options, so some have many.
"""
from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from spectrabox.session.command_line import (
    CommandGroup,
    Debug,
    Json,
    Outside,
    Quiet,
    answer,
    check_ending,
    command,
)

Sensitivity = Annotated[str, typer.Option(
    help="CSV of sensitivities, or a camera or observer by its name.")]
Light = Annotated[str, typer.Option(
    help="CSV of the light's spectrum, or a CIE name: D65, A, LED-B3.")]
White = Annotated[str | None, typer.Option(
    help="What a perfect white reads in each band; 1 by default.")]
Noise = Annotated[str | None, typer.Option(
    help="Standard error of the signal in each band, in its unit.")]
Coefficients = Annotated[int, typer.Option(
    help="N of the B-spline class: bounds, and the methods uniform and paper.")]
PriorFile = Annotated[Path | None, typer.Option(
    "--prior", help="A prior of your own; the shipped one by default.")]
Families = Annotated[list[str] | None, typer.Option(
    "--family", help="What the surface is said to be: paint, textile, leaves, skin, white, earth "
    "or animal; may be repeated. Bands then are conditional on it.")]
LabelledFolders = Annotated[list[str], typer.Argument(
    metavar="[FAMILY=]FOLDER...", help="One folder per library, and the family of surfaces that "
    "it is of, or mixed; paint by default.")]
Seed = Annotated[int, typer.Option(help="The same seed gives the same draws.")]
Level = Annotated[float, typer.Option(help="Of the bands.")]
Column = Annotated[str | None, typer.Option(help="Column of the truth.")]
Baseline = Annotated[bool, typer.Option("--baseline", help="Also other authors' single spectra.")]
OBSERVER = "CIE 1931 2 Degree Standard Observer"
DELTA_LIGHTS = ("D65", "A", "FL11")     # daylight, incandescent, narrow bands
DeltaLight = Annotated[list[str] | None, typer.Option(
    "--delta-light",
    help="Light of colour differences; may be repeated. D65, A and FL11 by default.")]

# further measurements of the same surface
Readings = Annotated[list[str] | None, typer.Option(
    "--reading",
    help="One more reading, NM:REFLECTANCE[:ERROR], NM/FWHM for a band; may be repeated.")]
Photos = Annotated[list[str] | None, typer.Option(
    "--photo", help="A photo by this camera under another light, LIGHT=v1,v2,v3[:e1,e2,e3]; may be "
    "repeated.")]
Same = Annotated[list[str] | None, typer.Option(
    "--same", help="Another patch of the same material, v1,v2,v3[:e1,e2,e3]; may be repeated.")]
More = Annotated[Path | None, typer.Option(
    help="TOML of further measurements: reading, band, spot, photo, same.")]
Twice = Annotated[str | None, typer.Option(
    help="Signal of light reflected twice off the surface, v1,v2,v3:e1,e2,e3.")]

# of sample alone
Signal = Annotated[str | None, typer.Option(help="One signal: v1,v2,v3.")]
Signals = Annotated[Path | None, typer.Option(
    help="CSV: a header of bands, one signal per row.")]
Method = Annotated[str, typer.Option(help="prior, uniform or paper.")]
Samples = Annotated[int, typer.Option(
    help="T, draws per signal; 1000 at least for a 95 % band.")]
Draws = Annotated[Path | None, typer.Option(help=".npz of the draws.")]
Start = Annotated[str, typer.Option(help="bounded or unbounded: c0 of the method paper.")]
Keep = Annotated[int | None, typer.Option(
    help="Method paper: rank by the further measurements and keep so many (Eqs. 9, 10).")]
Refine = Annotated[int | None, typer.Option(
    help="Coefficients of a finer basis with nested knots; uniform, or paper (Eqs. 11-16).")]
LightError = Annotated[float, typer.Option(help="Relative standard error of the light scale.")]
SensitivityError = Annotated[float, typer.Option(help="Relative standard error of each curve.")]
Truth = Annotated[Path | None, typer.Option(help="File of the measured spectrum, to judge by.")]

# of uplift alone
Image = Annotated[Path, typer.Argument(
    metavar="IMAGE", help="Linear EXR, TIFF or Zarr array, or a camera raw.")]
OutFolder = Annotated[Path, typer.Option(
    "-o", "--out", metavar="DIR", help="Folder of the results.")]
PixelNoise = Annotated[float, typer.Option(help="Relative standard error of a pixel.")]
Side = Annotated[int, typer.Option(
    help="Points per side of the table; 33 is finer and slower.")]
Step = Annotated[int, typer.Option(
    help="Nanometres between the mean's wavelengths; twice as far between those of the spread.")]
Full = Annotated[bool, typer.Option(
    "--full", help="All 61 wavelengths of both in single floats: eight times as large.")]
PictureFormat = Annotated[Literal["exr", "tiled-exr", "envi", "zarr"], typer.Option(
    "--to", help="exr: spectral EXR, of scan lines or tiled-exr: of tiles; envi: ENVI images of "
    "single floats; zarr: Zarr arrays.")]
LowRank = Annotated[int | None, typer.Option(
    "--low-rank", metavar="N", help="Of each pixel N coefficients and once their basis, in place "
    "of spectra: half as large with 16, and about 0.001 off (rms).", show_default=False)]
TileWorkers = Annotated[int | None, typer.Option(
    "--workers", min=1, help="Processes that share the picture, and go on where a command ended "
    "that was stopped; one process on all cores by default. Needs --to zarr.", show_default=False)]
TileCluster = Annotated[str | None, typer.Option(
    "--cluster", metavar="ADDRESS", help="A Dask scheduler such as tcp://host:8786, whose workers "
    "see the same folders; local starts one on this machine. Needs --to zarr.",
    show_default=False)]

# of plan alone
PlannedSession = Annotated[Path | None, typer.Argument(
    metavar="[DIR]", help="A finished session, in place of --sensitivity, --light and --signal.")]
PlanSensitivity = Annotated[str | None, typer.Option(
    "--sensitivity", help="CSV of sensitivities, or a camera or observer by its name.")]
PlanLight = Annotated[str | None, typer.Option(
    "--light", help="CSV of the light's spectrum, or a CIE name: D65, A, LED-B3.")]
AtHand = Annotated[str | None, typer.Option(
    "--lamps", metavar="NAME|FILE,...", help="Lamps at hand, for a second photo: D65,A,my.csv; a "
    "few common ones by default.")]
Filters = Annotated[str | None, typer.Option(
    "--filters", metavar="FILE,...", help="Filters at hand, for a second photo under the same "
    "light: files of their transmittance.")]
Steps = Annotated[int, typer.Option(help="Readings to plan.")]
OtherLights = Annotated[list[str] | None, typer.Option(
    "--second-light", help="A light for another photo.")]
OtherCameras = Annotated[list[str] | None, typer.Option(
    "--second-camera", help="Another camera's curves.")]
ReadingMinutes = Annotated[float, typer.Option(help="Of one spot reading.")]
PhotoMinutes = Annotated[float, typer.Option(help="Of one more photo.")]
SpotMinutes = Annotated[float | None, typer.Option(
    help="Of a whole spectrum by a spectrometer.")]

# of certify and prior train
Folders = Annotated[list[Path], typer.Argument(
    metavar="FOLDER...", help="Measured reflectances, one folder per library.")]
SignalNoise = Annotated[float, typer.Option(help="Relative standard error of the signals.")]
Page = Annotated[Path | None, typer.Option(help="Write the page there (.md).")]
Models = Annotated[bool, typer.Option(
    "--models/--libraries-alone", help="Also learn from the models of skin, leaves, dyes ... that "
    "come with the program.")]
Trained = Annotated[Path, typer.Option(help="The prior, .npz.")]

# of judge alone
Cube = Annotated[Path, typer.Argument(
    metavar="CUBE", help="ENVI, .npy, .npz, .mat or spectral EXR.")]
Truths = Annotated[Path | None, typer.Option(
    help="File of measured spectra; without it nothing is judged.")]
TruthColumn = Annotated[str | None, typer.Option(help="Column of the truth for all regions.")]
Regions = Annotated[Path | None, typer.Option(
    help="TOML: [regions.NAME], rectangle, point or mask.")]
Points = Annotated[list[str] | None, typer.Option(
    help="One pixel, x,y or NAME=x,y; may be repeated.")]
Wavelengths = Annotated[str | None, typer.Option(
    help="400:700:10, a list, or a text file, in nm.")]
Variable = Annotated[str | None, typer.Option(help="Name of the array in a .npz or .mat.")]
FullScale = Annotated[float, typer.Option(help="What reflectance 1 reads in the picture.")]
WhiteRegion = Annotated[str | None, typer.Option(
    help="Region of known reflectance to divide by.")]
SeenSignals = Annotated[Path | None, typer.Option(
    help="CSV of what our methods see, one row a region; the truths' own signals otherwise.")]
OwnDraws = Annotated[int, typer.Option(help="Draws of our methods.")]
RegionTable = Annotated[Path | None, typer.Option(help="CSV of the regions' spectra.")]


def register(app: typer.Typer) -> None:
    """Add these commands to the command line."""
    for function in (sample, uplift, plan, certify, judge):
        app.command()(function)
    prior = typer.Typer(cls=CommandGroup, no_args_is_help=True,
                        help="The prior on reflectances: train one of your own.")
    prior.command("train")(prior_train)
    prior.callback()(lambda: None)  # keeps "train" a word of its own while it is the only command
    app.add_typer(prior, name="prior")


def sample(sensitivity: Sensitivity, light: Light, signal: Signal = None, signals: Signals = None,
           white: White = None, noise: Noise = None, coefficients: Coefficients = 13,
           method: Method = "prior", samples: Samples = 2000, seed: Seed = 0, out: Draws = None,
           prior: PriorFile = None, family: Families = None, level: Level = 0.95,
           reading: Readings = None,
           photo: Photos = None, same: Same = None, more: More = None, twice: Twice = None,
           start: Start = "bounded", keep: Keep = None, refine: Refine = None,
           light_error: LightError = 0.0, sensitivity_error: SensitivityError = 0.0,
           baseline: Baseline = False, truth: Truth = None, column: Column = None,
           delta_light: DeltaLight = None, as_json: Json = False, debug: Debug = False) -> None:
    """Every spectrum behind one signal: mean, band, exact bounds and draws."""
    with command(as_json, debug):
        check_ending(out, {".npz": "the draws"})
        from spectrabox.session.signals.answers import SampleRequest, sample_answer, sample_text
        from spectrabox.session.signals.request_draws import DrawOptions
        options = DrawOptions(coefficients, method, samples, seed, start, keep, refine)
        request = SampleRequest(
            sensitivity, light, signal, signals, white, noise, options, prior,
            tuple(family or ()), level,
            readings=tuple(reading or ()), photos=tuple(photo or ()), same=tuple(same or ()),
            more=more, twice=twice, baseline=baseline, truth=truth, column=column,
            lights=tuple(delta_light or DELTA_LIGHTS), light_error=light_error,
            sensitivity_error=sensitivity_error, keep_draws=out is not None)
        facts, arrays = sample_answer(request)
        text = "" if as_json else sample_text(facts, request)
        if out is not None:
            write_arrays(out, arrays)
            facts["file"] = str(out)
        answer(as_json, facts, text)


def uplift(image: Image, out: OutFolder, sensitivity: Sensitivity, light: Light,
           white: White = None, noise: PixelNoise = 0.01, side: Side = 25, step: Step = 10,
           full: Full = False, family: Families = None, to: PictureFormat = "exr",
           low_rank: LowRank = None, workers: TileWorkers = None, cluster: TileCluster = None,
           quiet: Quiet = False, as_json: Json = False, debug: Debug = False) -> None:
    """Mean and spread of the spectrum behind every pixel, as spectral EXR or ENVI images."""
    with command(as_json, debug):
        if out.suffix.lower() in (".exr", ".hdr", ".img"):
            raise typer.BadParameter(f"{out.name} is the name of a file; a folder is needed, into "
                                     "which mean and standard deviation go", param_hint="--out")
        from spectrabox.session.pictures.uplift import UpliftRequest, uplift_answer
        from spectrabox.session.progress_display import progress_display, with_time_left
        request = UpliftRequest(image, out, sensitivity, light, white, noise, side, step, full,
                                tuple(family or ()), to, low_rank)
        with progress_display(quiet) as progress:
            if workers is None and cluster is None:
                facts, text = uplift_answer(request, with_time_left(progress))
            else:
                from spectrabox.session.pictures.shared_uplift import shared_uplift_answer
                facts, text = shared_uplift_answer(request, cluster, workers,
                                                   with_time_left(progress))
        answer(as_json, facts, text)


def plan(folder: PlannedSession = None, sensitivity: PlanSensitivity = None,
         light: PlanLight = None, signal: Signal = None, white: White = None,
         noise: Noise = None, reading: Readings = None, photo: Photos = None, same: Same = None,
         more: More = None, steps: Steps = 3, other: OtherLights = None,
         camera: OtherCameras = None, lamps: AtHand = None, filters: Filters = None,
         reading_minutes: ReadingMinutes = 2.0, photo_minutes: PhotoMinutes = 5.0,
         spot_minutes: SpotMinutes = None, seed: Seed = 0, allow_outside: Outside = False,
         as_json: Json = False, debug: Debug = False) -> None:
    """Which reading or photo to take next: what it would bring in width of the band and in RMSE, of
    one signal or of every surface of a finished session.
    """
    with command(as_json, debug):
        from spectrabox.radiometry.errors import InputError
        from spectrabox.session.signals.lamps_at_hand import lamps_at_hand, session_plan
        hand = lamps_at_hand(lamps, filters)
        stated = (sensitivity, light, signal)
        if folder is not None:
            if any(stated) or more or reading or photo or same:
                raise InputError("a session has its own camera, light and signals: give DIR with "
                                 "--lamps and --filters alone, or no DIR")
            answer(as_json, *session_plan(folder, hand, allow_outside))
            return
        if sensitivity is None or light is None or signal is None:
            raise InputError("nothing to plan for: give the folder of a finished session, or "
                             "--sensitivity, --light and --signal")
        from spectrabox.session.signals.judgement_answers import PlanRequest, plan_answer
        request = PlanRequest(
            sensitivity, light, signal, white, noise, steps, lights=tuple(other or ()),
            cameras=tuple(camera or ()), readings=tuple(reading or ()), photos=tuple(photo or ()),
            same=tuple(same or ()), more=more, reading_minutes=reading_minutes,
            photo_minutes=photo_minutes, spot_minutes=spot_minutes, seed=seed, hand=hand)
        answer(as_json, *plan_answer(request))


def certify(folders: Folders, sensitivity: Sensitivity = OBSERVER, light: Light = "D65",
            noise: SignalNoise = 0.0, prior: PriorFile = None, family: Families = None,
            delta_light: DeltaLight = None, out: Page = None, as_json: Json = False,
            debug: Debug = False) -> None:
    """Do the bands hold the truth on your own spectra? A certificate page."""
    with command(as_json, debug):
        check_ending(out, {".md": "the certificate as a page"})
        from spectrabox.radiometry.files import write_text_whole
        from spectrabox.session.signals.judgement_answers import certify_answer
        facts, page = certify_answer(folders, sensitivity, light, noise, prior,
                                     tuple(delta_light or DELTA_LIGHTS), tuple(family or ()))
        if out is not None:
            write_text_whole(out, page)
            facts["page"] = str(out)
        answer(as_json, facts, page)


def judge(cube: Cube, truth: Truths = None, column: TruthColumn = None, regions: Regions = None,
          point: Points = None, wavelengths: Wavelengths = None, variable: Variable = None,
          full_scale: FullScale = 1.0, white_region: WhiteRegion = None,
          sensitivity: Sensitivity = OBSERVER, light: Light = "D65", signals: SeenSignals = None,
          white: White = None, noise: Noise = None, delta_light: DeltaLight = None,
          coefficients: Coefficients = 13, samples: OwnDraws = 2000, seed: Seed = 0,
          prior: PriorFile = None, family: Families = None, baseline: Baseline = False,
          out: RegionTable = None,
          as_json: Json = False, debug: Debug = False) -> None:
    """Spectra recovered elsewhere, as a hyperspectral picture, judged by the same measures beside
    our methods.
    """
    with command(as_json, debug):
        check_ending(out, {".csv": "the regions' spectra"})
        from spectrabox.capture.photo.image_files import read_plane
        from spectrabox.radiometry.errors import InputError
        from spectrabox.radiometry.files import write_text_whole
        from spectrabox.radiometry.grid import visible_grid
        from spectrabox.radiometry.records import Quantity
        from spectrabox.radiometry.spectra.beside import metadata_beside
        from spectrabox.radiometry.spectra.formats.csvw import metadata_text, plain_text
        from spectrabox.radiometry.spectra.named_spectra import sensitivities
        from spectrabox.radiometry.spectra.spectrum_files import read_table
        from spectrabox.sampling.judge.cube_regions import point_region, read_regions
        from spectrabox.sampling.judge.cubes import parse_wavelengths
        from spectrabox.session.signals.cube_answers import JudgeRequest, judge_answer
        from spectrabox.session.signals.signal_options import read_signals
        nm = None if wavelengths is None else parse_wavelengths(wavelengths)
        picture = open_picture(cube, nm, variable)
        chosen = [point_region(text, picture.width, picture.height) for text in point or ()]
        if regions is not None:
            chosen += read_regions(regions, picture.width, picture.height,
                                   lambda path: read_plane(path)[0])
        if not chosen:
            raise InputError("no region was given; give --regions FILE.toml or --point x,y")
        seen = None
        if signals is not None:
            seen = read_signals(signals, len(sensitivities(sensitivity, visible_grid(1))))
        request = JudgeRequest(column, full_scale, white_region, sensitivity, light,
                               tuple(delta_light or DELTA_LIGHTS), samples, seed, coefficients,
                               baseline, prior, tuple(family or ()), seen, white, noise)
        truths = None if truth is None else read_table(truth)
        facts, text, columns = judge_answer(picture, chosen, truths, request)
        if out is not None:
            write_text_whole(out, plain_text(picture.nm, columns))
            write_text_whole(metadata_beside(out), metadata_text(
                out.name, columns, quantity=Quantity.REFLECTANCE, source=f"regions of {cube.name}"))
            facts["file"] = str(out)
        answer(as_json, facts, text)


def open_picture(path: Path, wavelengths: Any, variable: str | None) -> Any:
    """A hyperspectral picture of any known format, an EXR being one by what it begins with."""
    from spectrabox.capture.photo.image_files import open_channels
    from spectrabox.radiometry.spectra.formats.spectral_exr import MAGIC
    from spectrabox.sampling.judge.cube_files import open_cube
    from spectrabox.sampling.judge.cubes import cube_of_channels
    if path.is_file():
        with path.open("rb") as file:
            if file.read(len(MAGIC)) == MAGIC:
                return cube_of_channels(path.name, *open_channels(path))
    return open_cube(path, wavelengths, variable)


def prior_train(folders: LabelledFolders, out: Trained, sensitivity: Sensitivity = OBSERVER,
                light: Light = "D65", models: Models = True, seed: Seed = 0,
                as_json: Json = False, debug: Debug = False) -> None:
    """Learn a prior from folders of measured reflectances; calibrate it on each left out in
    turn.
    """
    with command(as_json, debug):
        check_ending(out, {".npz": "the prior"})
        from spectrabox.sampling.prior.mixture import save_prior
        from spectrabox.session.signals.judgement_answers import train_answer
        facts, text, prior = train_answer(folders, sensitivity, light, seed, models)
        save_prior(out, prior)
        answer(as_json, {**facts, "prior": str(out)}, f"{text}\nwrote {out}")


def write_arrays(path: Path, arrays: dict[str, Any]) -> None:
    """An .npz under exactly the name that was asked for."""
    import numpy as np

    from spectrabox.radiometry.files import whole_file
    with whole_file(path) as unfinished, unfinished.open("wb") as file:
        np.savez_compressed(file, **arrays)
