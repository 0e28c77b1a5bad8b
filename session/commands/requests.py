"""Requests that other rooms of the session read too: their fields are the options of the commands.

Nothing heavy is imported here, since every command's help reads it.
"""
from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import typer

from spectrabox.session.terminal.command_line import (
    CORNERS,
    CORNERS_HELP,
    ChartLayout,
    CommonOptions,
    Outside,
    Quiet,
    SessionOptions,
)

OBSERVER = "CIE 1931 2 Degree Standard Observer"
METHODS = ("prior", "smooth", "nonnegative", "paper", "file")      # of camera fit
FAMILY_WORDS = "paint|textile|leaves|skin|white|earth|animal"
DELTA_LIGHTS = ("D65", "A", "FL11")     # daylight, incandescent, narrow bands
Sensitivity = Annotated[str, typer.Option(
    metavar="FILE|NAME", help="CSV of sensitivities, or a camera or observer by its name.")]
Light = Annotated[str, typer.Option(
    metavar="FILE|NAME", help="CSV of the light's spectrum, or a CIE name: D65, A, LED-B3.")]
OptionalSensitivity = Annotated[str | None, typer.Option(
    metavar="FILE|NAME", help="CSV of sensitivities, or a camera or observer by its name.")]
OptionalLight = Annotated[str | None, typer.Option(
    metavar="FILE|NAME", help="CSV of the light's spectrum, or a CIE name: D65, A, LED-B3.")]
White = Annotated[str | None, typer.Option(
    metavar="V1,V2,V3", help="What a perfect white reads in each band; 1 by default.")]
Noise = Annotated[str | None, typer.Option(
    metavar="E|E1,E2,E3", help="Standard error of the signal in its unit: one number for all "
    "bands, or one for each.")]
Families = Annotated[tuple[str, ...], typer.Option(
    "--family", metavar=FAMILY_WORDS, help="Kind of surface, if you know it; may be repeated. The "
    "bands then hold for surfaces of this kind.")]
Coefficients = Annotated[int, typer.Option(
    help="Number of B-splines that a spectrum is made of, for exact bounds and for the methods "
    "uniform and paper.")]
Seed = Annotated[int, typer.Option(help="Random seed: the same seed gives the same draws.")]
DeltaLights = Annotated[tuple[str, ...], typer.Option(
    metavar="FILE|NAME", show_default=False,
    help="Light of colour differences; may be repeated. D65, A and FL11 by default.")]
Baseline = Annotated[bool, typer.Option("--baseline", help="Also other authors' single spectra.")]
Lamps = Annotated[str | None, typer.Option(
    "--lamps", metavar="NAME|FILE,...", help="Lamps at hand, for a second photo: D65,A,my.csv; a "
    "few common ones by default.")]
Filters = Annotated[str | None, typer.Option(
    "--filters", metavar="FILE|FOLDER,...", help="Filters at hand, for a second photo under the "
    "same light: files of their transmittance, one or several a file, or folders of such "
    "files.")]
Reference = Annotated[str | None, typer.Option(
    metavar="NAME|FILE", help="Chart reflectances: a published average, or a file you measured.")]
CameraPriorFile = Annotated[Path | None, typer.Option(
    "--prior", metavar="NPZ", help="A prior of your own; the shipped one by default.")]


@dataclass(frozen=True, kw_only=True)
class CameraAndLight(CommonOptions):
    """The camera that saw a signal, and the light it was seen under."""

    sensitivity: Sensitivity
    light: Light


@dataclass(frozen=True, kw_only=True)
class ObserverAndDaylight(CameraAndLight):
    """The same, by default the standard observer under D65."""

    sensitivity: Sensitivity = OBSERVER
    light: Light = "D65"


@dataclass(frozen=True, kw_only=True)
class MeasuredSignal(CommonOptions):
    """One signal, and further measurements of its surface."""

    signal: Annotated[str | None, typer.Option(
        metavar="V1,V2,V3", help="One signal: what the camera reads of a colour in each of its "
        "bands.")] = None
    white: White = None
    noise: Noise = None
    reading: Annotated[tuple[str, ...], typer.Option(
        metavar="NM[/FWHM]:REFLECTANCE[:ERROR]", help="A reading by an instrument at one "
        "wavelength, or over a band of that full width at half maximum.")] = ()
    signal_under: Annotated[tuple[str, ...], typer.Option(
        metavar="LIGHT=V1,V2,V3[:E1,E2,E3]", help="The signal of this colour in a photo by the "
        "same camera under another light, and its standard errors.")] = ()
    same: Annotated[tuple[str, ...], typer.Option(
        metavar="V1,V2,V3[:E1,E2,E3]", help="The signal of another patch of the same "
        "material.")] = ()
    more: Annotated[Path | None, typer.Option(
        metavar="TOML",
        help="File of further measurements: reading, band, spot, photo, same.")] = None


@dataclass(frozen=True, kw_only=True)
class PriorOptions(CommonOptions):
    """The prior on reflectances, and what kind of surface it is."""

    prior: Annotated[Path | None, typer.Option(
        "--prior", metavar="NPZ", help="A prior of your own; the shipped one by default.")] = None
    family: Families = ()


@dataclass(frozen=True, kw_only=True)
class SampleRequest(PriorOptions, MeasuredSignal):
    """Options of ``spectrabox sample``."""

    sensitivity: OptionalSensitivity = None
    light: OptionalLight = None
    srgb: Annotated[str | None, typer.Option(
        "--srgb", metavar="R,G,B|#RRGGBB",
        help="In place of --signal, --sensitivity and --light: a colour of a screen or a web "
        "page. Its spectra are of surfaces that would look so in "
        "daylight.")] = None
    signals: Annotated[Path | None, typer.Option(
        metavar="CSV", help="Many signals: a header that names the bands, a row for each, with its "
        "name first or without.")] = None
    swatches: Annotated[Path | None, typer.Option(
        metavar="CSV",
        help="Measured samples of the material: band names and wavelengths above, below of "
        "each its signals and its reflectances. They correct the spectra.")] = None
    coefficients: Coefficients = 13
    method: Annotated[str, typer.Option(
        metavar="prior|uniform|paper", help="How spectra are drawn: by the learnt prior, uniformly "
        "among all that fit, or as the paper draws them.")] = "prior"
    samples: Annotated[int, typer.Option(
        help="Draws of each signal; 1000 at least for a 95 % band.")] = 2000
    seed: Seed = 0
    out: Annotated[Path | None, typer.Option(
        "--out", "-o", metavar="NPZ|CSV", help="Where to write the draws (.npz), or means and "
        "bands (.csv).")] = None
    plot: Annotated[Path | None, typer.Option(
        "--plot", metavar="PNG", help="Draw means and bands into this picture.")] = None
    level: Annotated[float, typer.Option(
        help="Level of the bands: 0.95 for 95 %.")] = 0.95
    twice: Annotated[str | None, typer.Option(
        metavar="V1,V2,V3:E1,E2,E3", help="Signal of light reflected twice off the "
        "surface.")] = None
    start: Annotated[str, typer.Option(
        metavar="bounded|unbounded",
        help="Spectrum that the method paper starts from.")] = "bounded"
    keep: Annotated[int | None, typer.Option(
        "--best",
        help="Method paper: rank by the further measurements and give the best so many (Eqs. 9, "
        "10).")] = None
    refine: Annotated[int | None, typer.Option(
        help="Coefficients of a finer basis with nested knots; uniform, or paper (Eqs. "
        "11-16).")] = None
    light_error: Annotated[float, typer.Option(
        help="Relative standard error of the light scale.")] = 0.0
    sensitivity_error: Annotated[float, typer.Option(
        help="Relative standard error of each curve.")] = 0.0
    baseline: Baseline = False
    truth: Annotated[Path | None, typer.Option(
        help="File of the measured spectrum, to judge by.")] = None
    column: Annotated[str | None, typer.Option(
        metavar="NAME", help="Column of the truth.")] = None
    delta_light: DeltaLights = DELTA_LIGHTS


@dataclass(frozen=True, kw_only=True)
class UpliftRequest(CameraAndLight):
    """Options of ``spectrabox uplift``."""

    image: Annotated[Path, typer.Argument(
        metavar="IMAGE", help="Linear EXR, TIFF or Zarr array, or a camera raw.")]
    out: Annotated[Path, typer.Option("-o", "--out", metavar="DIR", help="Folder of the results.")]
    white: White = None
    noise: Annotated[float, typer.Option(help="Relative standard error of a pixel.")] = 0.01
    side: Annotated[int, typer.Option(
        help="Points per side of the table; 33 is finer and slower.")] = 25
    step: Annotated[int, typer.Option(
        help="Nanometres between the mean's wavelengths; twice as far between those of the "
        "spread.")] = 10
    full: Annotated[bool, typer.Option(
        "--full", help="All 61 wavelengths of both in single floats: eight times as "
        "large.")] = False
    family: Families = ()
    to: Annotated[Literal["exr", "tiled-exr", "envi", "zarr"], typer.Option(
        "--to", help="exr: spectral EXR, of scan lines or tiled-exr: of tiles; envi: ENVI images "
        "of single floats; zarr: OME-Zarr images, as napari opens them.")] = "exr"
    workers: Annotated[int | None, typer.Option(
        "--workers", min=1, show_default=False, help="Processes that share the picture, and go on "
        "where a command ended that was stopped; one process on all cores by default. Needs --to "
        "zarr.")] = None
    cluster: Annotated[str | None, typer.Option(
        "--cluster", metavar="ADDRESS", show_default=False, help="A Dask scheduler such as "
        "tcp://host:8786, whose workers see the same folders; local starts one on this machine. "
        "Needs --to zarr.")] = None
    quiet: Quiet = False


@dataclass(frozen=True, kw_only=True)
class PlanRequest(MeasuredSignal):
    """Options of ``spectrabox plan``."""

    folder: Annotated[Path | None, typer.Argument(
        metavar="[DIR]", help="A finished session, in place of --sensitivity, --light and "
        "--signal.")] = None
    sensitivity: Annotated[str | None, typer.Option(
        metavar="FILE|NAME",
        help="CSV of sensitivities, or a camera or observer by its name.")] = None
    light: Annotated[str | None, typer.Option(
        metavar="FILE|NAME",
        help="CSV of the light's spectrum, or a CIE name: D65, A, LED-B3.")] = None
    steps: Annotated[int, typer.Option(help="How many readings to plan.")] = 3
    second_light: Annotated[tuple[str, ...], typer.Option(
        metavar="FILE|NAME", help="A light for another photo.")] = ()
    second_camera: Annotated[tuple[str, ...], typer.Option(
        metavar="FILE|NAME", help="Another camera's curves.")] = ()
    lamps: Lamps = None
    filters: Filters = None
    reading_minutes: Annotated[float, typer.Option(help="Minutes of one spot reading.")] = 2.0
    photo_minutes: Annotated[float, typer.Option(help="Minutes of one more photo.")] = 5.0
    spot_minutes: Annotated[float | None, typer.Option(
        help="Minutes of a whole spectrum by a spectrometer.")] = None
    seed: Seed = 0
    allow_outside: Outside = False


@dataclass(frozen=True, kw_only=True)
class CertifyRequest(PriorOptions, ObserverAndDaylight):
    """Options of ``spectrabox certify``."""

    folders: Annotated[tuple[Path, ...], typer.Argument(
        metavar="FOLDER...", help="Measured reflectances, one folder per library.")]
    noise: Annotated[float, typer.Option(help="Relative standard error of the signals.")] = 0.0
    delta_light: DeltaLights = DELTA_LIGHTS
    out: Annotated[Path | None, typer.Option(
        "--out", "-o", metavar="MD", help="Where to write the page.")] = None


@dataclass(frozen=True, kw_only=True)
class TrainRequest(ObserverAndDaylight):
    """Options of ``spectrabox prior train``."""

    folders: Annotated[tuple[str, ...], typer.Argument(
        metavar="[FAMILY=]FOLDER...", help="One folder per library, and the family of surfaces "
        "that it is of, or mixed; paint by default.")]
    out: Annotated[Path, typer.Option(
        "--out", "-o", metavar="NPZ", help="Where to write the prior.")]
    models: Annotated[bool, typer.Option(
        "--models/--libraries-alone", help="Also learn from the models of skin, leaves, dyes ... "
        "that come with the program.")] = True
    seed: Seed = 0


@dataclass(frozen=True, kw_only=True)
class JudgeRequest(PriorOptions, ObserverAndDaylight):
    """Options of ``spectrabox judge``."""

    cube: Annotated[Path, typer.Argument(
        metavar="CUBE", help="ENVI, .npy, .npz, .mat or spectral EXR.")]
    truth: Annotated[Path | None, typer.Option(
        metavar="FILE", help="Measured spectra; without it nothing is judged.")] = None
    column: Annotated[str | None, typer.Option(
        metavar="NAME", help="Column of the truth for all regions.")] = None
    regions: Annotated[Path | None, typer.Option(
        metavar="TOML", help="Regions: [regions.NAME] with rect, point or mask.")] = None
    point: Annotated[tuple[str, ...], typer.Option(
        metavar="[NAME=]X,Y", help="One pixel.")] = ()
    wavelengths: Annotated[str | None, typer.Option(
        metavar="FIRST:LAST:STEP|FILE", help="In nm: 400:700:10, a list, or a text file.")] = None
    variable: Annotated[str | None, typer.Option(
        metavar="NAME", help="Of which array in a .npz or .mat.")] = None
    full_scale: Annotated[float, typer.Option(
        help="What reflectance 1 reads in the picture.")] = 1.0
    white_region: Annotated[str | None, typer.Option(
        metavar="NAME", help="Region of known reflectance to divide by.")] = None
    signals: Annotated[Path | None, typer.Option(
        metavar="CSV", help="What our methods see, one row a region; the truths' own signals "
        "otherwise.")] = None
    white: White = None
    noise: Noise = None
    delta_light: DeltaLights = DELTA_LIGHTS
    coefficients: Coefficients = 13
    samples: Annotated[int, typer.Option(help="Draws of our methods.")] = 2000
    seed: Seed = 0
    baseline: Baseline = False
    out: Annotated[Path | None, typer.Option(
        "--out", "-o", metavar="CSV", help="Where to write the regions' spectra.")] = None


@dataclass(frozen=True, kw_only=True)
class MatchRequest(SessionOptions):
    """Options of ``spectrabox match``."""

    folder: Annotated[Path, typer.Argument(
        metavar="SESSION", help="The folder of a finished session.", show_default=False)]
    library: Annotated[tuple[str, ...], typer.Argument(
        metavar="LIBRARY...", help="Files of reflectances of any format, folders of them, or "
        "published sets: \"CES99\", \"BabelColor Average\" ...", show_default=False)]
    only: Annotated[tuple[str, ...], typer.Option(
        metavar="NAME", help="This surface or region alone.")] = ()
    variation: Annotated[float, typer.Option(
        help="How far samples of one material differ from each other: standard deviation, of "
        "white.")] = 0.01
    ratio: Annotated[float | None, typer.Option(
        help="A spectrum counts as not told apart from the best while its evidence is at most so "
        "many times lower; by default the true one is kept 19 times in 20.")] = None


@dataclass(frozen=True, kw_only=True)
class CameraFitRequest(CommonOptions):
    """Options of ``spectrabox camera fit``."""

    light: Annotated[tuple[str, ...], typer.Option(
        metavar="FILE|NAME", show_default=False, help="CSV of the light's spectrum, a CIE name "
        "(D65, A, LED-B3), unknown, 3200K, or a kind: daylight, halogen, led, fluorescent. Once "
        "for each photo, or once for all.")]
    photos: Annotated[tuple[Path, ...], typer.Argument(
        metavar="[PHOTO...]", show_default=False, help="Photos of a colour chart, as --chart gives "
        "them.")] = ()
    chart: Annotated[tuple[Path, ...], typer.Option(
        metavar="PHOTO", help="Raw, DNG, or linear EXR or TIFF of a colour chart; several of one "
        "camera may be given.")] = ()
    patches: Annotated[tuple[Path, ...], typer.Option(
        metavar="CSV", help="Signals, a row for each patch, in place of a photo; columns named "
        "standard_error... hold their errors.")] = ()
    method: Annotated[str, typer.Option(
        metavar="|".join(METHODS), help="How the curves are fitted.")] = "prior"
    curves: Annotated[Path | None, typer.Option(
        metavar="CSV", help="Measured curves, with method file.")] = None
    out: Annotated[Path | None, typer.Option(
        "--out", "-o", metavar="CSV", help="Write the curves and their band.")] = None
    draws_file: Annotated[Path | None, typer.Option(
        metavar="NPZ", help="Write 1000 draws of the curves.")] = None
    reference: Annotated[tuple[str, ...], typer.Option(
        metavar="NAME|FILE", help="Chart reflectances: a published average, or a file you "
        "measured; by default the layout's own.")] = ()
    layout: ChartLayout = ""
    corners: Annotated[tuple[str, ...], typer.Option(
        metavar=CORNERS, help=f"{CORNERS_HELP} Once for each photo, or once for all; may be "
        "repeated.")] = ()
    leave_out: Annotated[str, typer.Option(
        metavar="N,N...", show_default=False, help="Patches that no fit uses, by number from "
        "1.")] = ""
    prior_file: CameraPriorFile = None
    keep: Annotated[str | None, typer.Option(
        metavar="NAME", help="Keep the curves under this name, for --sensitivity NAME.")] = None


@dataclass(frozen=True, kw_only=True)
class CameraPreflightRequest(CommonOptions):
    """Options of ``spectrabox camera preflight``."""

    light: Annotated[str, typer.Option(
        "--light", metavar="FILE|NAME", show_default=False, help="CSV of the light's spectrum, a "
        "CIE name (D65, A, LED-B3), unknown, 3200K, or a kind: daylight, halogen, led, "
        "fluorescent.")]
    noise: Annotated[float, typer.Option(
        help="Relative error of a patch, everything included.")] = 0.01
    reference: Reference = None
    layout: ChartLayout = ""
    prior_file: CameraPriorFile = None
    curves: Annotated[Path | None, typer.Option(
        metavar="CSV", help="Measured curves of the camera, a column per band; by default it is "
        "one like those of the prior.")] = None
    lamps: Lamps = None
    filters: Filters = None
    surfaces: Annotated[int, typer.Option(
        help="Surfaces of each family that are tried; 0 leaves spectra out.")] = 20


@dataclass(frozen=True, kw_only=True)
class CameraProfileRequest(CommonOptions):
    """Options of ``spectrabox camera profile``."""

    sensitivity: Annotated[str, typer.Argument(
        metavar="FILE|NAME", show_default=False, help="Curves of three bands, or a camera by its "
        "name.")]
    camera: Annotated[str, typer.Option(
        "--camera", metavar="'MAKER MODEL'", show_default=False, help="As the camera's raw files "
        "name it.")]
    out: Annotated[tuple[Path, ...], typer.Option(
        "--out", "-o", metavar="FILE", help=".icc, .clf, .ocio: profile under --light for ICC "
        "programs, as Common LUT Format, for OpenColorIO; .dcp: DNG profile for A and D65; .json: "
        "rawtoaces; .txt: vkdt. May be repeated.")] = ()
    light: Annotated[str, typer.Option(
        metavar="FILE|NAME", help="Spectrum or CIE name of the photos' light, of .icc, .clf and "
        ".ocio.")] = "D50"
    family: Annotated[tuple[str, ...], typer.Option(
        metavar="FAMILY", help="What will be photographed: paint, textile, leaves, skin, white, "
        "earth or animal; any by default. May be repeated.")] = ()
    raw: Annotated[Path | None, typer.Option(
        metavar="PHOTO", help="A raw file of the camera: the errors of its own matrix (that by "
        "which LibRaw knows it, or a DNG's) stand beside the profile's.")] = None
    draws_file: Annotated[Path | None, typer.Option(
        metavar="NPZ",
        help="Draws of the curves, from 'camera fit --draws-file': gives every number "
        "its spread.")] = None
    idt_light: Annotated[str, typer.Option(
        metavar="NAME", help="CIE name, of the ACES matrix.")] = "D55"
