"""Options that several commands have, and those that are handed on together, as records.

Nothing heavy is imported here, since every command's help reads it.
"""
from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, get_args

import typer

from spectrabox.measure.signals.options import PIXEL_NOISE
from spectrabox.session.terminal import command_line

OBSERVER = "CIE 1931 2 Degree Standard Observer"
METHODS = ("prior", "smooth", "nonnegative", "paper", "file")      # of camera fit
FAMILY_WORDS = "paint|textile|leaves|skin|white|earth|animal"
Sensitivity = Annotated[str, typer.Option(
    metavar="FILE|NAME", help="CSV of sensitivities, or a camera or observer by its name.")]
Light = Annotated[str, typer.Option(
    metavar="FILE|NAME", help="CSV of the light's spectrum, or a CIE name: D65, A, LED-B3.")]
OptionalSensitivity = Annotated[str | None, get_args(Sensitivity)[1]]
OptionalLight = Annotated[str | None, get_args(Light)[1]]
PriorFile = Annotated[Path | None, typer.Option(
    "--prior", metavar="NPZ", help="A prior of your own; the shipped one by default.")]
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
Seed = Annotated[int, typer.Option(min=0, help="Random seed: the same seed gives the same draws.")]
Baseline = Annotated[bool, typer.Option("--baseline", help="Also other authors' single spectra.")]
Lamps = Annotated[str | None, typer.Option(
    "--lamps", metavar="NAME|FILE,...", help="Lamps at hand, for a second photo: D65,A,my.csv; "
    "where neither these nor filters are given, common ones.")]
Filters = Annotated[str | None, typer.Option(
    "--filters", metavar="FILE|FOLDER,...", help="Filters at hand, for a second photo under the "
    "same light: files of their transmittance, one or several a file, or folders of such "
    "files.")]
Reference = Annotated[str | None, typer.Option(
    metavar="NAME|FILE", help="Chart reflectances: a published average, or a file you measured.")]


@dataclass(frozen=True, kw_only=True)
class MeasuredSignal:
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
class UpliftRequest:
    """Options of ``spectrabox uplift``."""

    image: Annotated[Path, typer.Argument(
        metavar="IMAGE", help="Linear EXR, TIFF or Zarr array, or a camera raw; or, with "
        "--encoded, a PNG or JPEG.")]
    out: Annotated[Path, typer.Option("-o", "--out", metavar="DIR", help="Folder of the results.")]
    sensitivity: OptionalSensitivity = None
    light: OptionalLight = None
    encoded: Annotated[bool, typer.Option(
        "--encoded", help="In place of --sensitivity and --light: the picture is in sRGB, as PNG "
        "and JPEG are. Its spectra are of surfaces that would look so in daylight.")] = False
    white: Annotated[str | None, typer.Option(
        metavar="V1,V2,V3", help="What a perfect white reads in each band; by default what the "
        "ColorChecker in the photo says, and 1 of a picture that is no camera raw.")] = None
    noise: Annotated[float, typer.Option(help="Relative standard error of a pixel.")] = PIXEL_NOISE
    side: Annotated[int, typer.Option(
        help="Points per side of the table; 33 is finer and slower.")] = 21
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
    quiet: command_line.Quiet = False
