"""The command that measures a filter: from two photos of a chart, or from two readings."""
from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from spectrabox.session.terminal.command_help import Commands
from spectrabox.session.terminal.command_line import (
    Answer,
    ChartLayout,
    CommonOptions,
    UsageProblem,
    check_ending,
    command,
)

if TYPE_CHECKING:
    from spectrabox.measure.more_bands.filter_fit import MeasuredFilter

WRITTEN = {".csv": "the transmittance with its standard error"}


def register(app: typer.Typer) -> None:
    """Add these commands to the command line."""
    filters = Commands(name="filter", help="Filters before lens or lamp: their transmittance.")
    filters.command()(fit)
    app.add_typer(filters)


@dataclass(frozen=True, kw_only=True)
class FilterFitRequest(CommonOptions):
    """Options of ``spectrabox filter fit``."""

    files: Annotated[tuple[Path, ...], typer.Argument(
        metavar="WITHOUT WITH", show_default=False, help="Two photos of a colour chart, or with "
        "--readings two spectra of one lamp: first without the filter, then with it.")]
    out: Annotated[Path, typer.Option(
        "--out", "-o", metavar="CSV", show_default=False, help="Where to write the transmittance "
        "and its standard error.")]
    readings: Annotated[bool, typer.Option(
        "--readings", help="The files are readings of a spectroradiometer.")] = False
    light: Annotated[str, typer.Option(
        metavar="FILE|NAME",
        help="Light of the photos: unknown, a CIE name, a kind of lamp, 3200K, or the file of its "
        "spectrum.")] = "unknown"
    reference: Annotated[str | None, typer.Option(
        metavar="NAME|FILE", help="Chart reflectances.")] = None
    layout: ChartLayout = ""


@command
def fit(request: FilterFitRequest) -> Answer:
    """Measure the transmittance of a filter, with standard errors, as a file for --filters."""
    if len(request.files) != 2:
        raise UsageProblem(f"{len(request.files)} files were given; two are needed: first without "
                           "the filter, then with it")
    check_ending(request.out, WRITTEN)
    from spectrabox.radiometry.errors import InputError
    from spectrabox.radiometry.files import write_text_whole
    from spectrabox.radiometry.grid import FINE_GRID
    from spectrabox.radiometry.records import Quantity
    from spectrabox.radiometry.spectra.spectrum_files import table_text

    if request.out in request.files:
        raise InputError(f"{request.out} is one of the given files; name another file")
    known = _of_readings(*request.files) if request.readings else _of_charts(request)
    write_text_whole(request.out, table_text(
        FINE_GRID.nm, {"transmittance": known.transmittance,
                       "standard_error": known.standard_error},
        quantity=Quantity.RELATIVE, source=known.source))
    relative = known.standard_error / known.transmittance.max()
    level = "" if known.level_known else "; its level is not known, and was set to 1 at its best"
    return Answer({"file": request.out, "wavelengths_nm": FINE_GRID.nm.tolist(),
                   "transmittance": known.transmittance.tolist(),
                   "standard_error": known.standard_error.tolist(),
                   "level_known": known.level_known},
                  f"wrote {request.out}: transmittance {known.transmittance.min():.3f} to "
                  f"{known.transmittance.max():.3f}, standard error {relative.mean():.1%} of its "
                  f"largest value on average, {relative.max():.1%} at worst{level}")


def _of_readings(without: Path, through: Path) -> MeasuredFilter:
    from spectrabox.measure.more_bands.filter_fit import filter_from_readings
    from spectrabox.radiometry.records import Quantity
    from spectrabox.radiometry.spectra.spectrum_files import read_spectrum
    return filter_from_readings(*(read_spectrum(path, role=Quantity.RELATIVE)
                                  for path in (without, through)))


def _of_charts(request: FilterFitRequest) -> MeasuredFilter:
    import numpy as np

    from spectrabox.calibrate.chart_calibration import ChartPhoto
    from spectrabox.capture.chart.detection import find_chart, find_chart_again
    from spectrabox.capture.chart.patches import require_unclipped, sample_patches
    from spectrabox.capture.photo.linear import open_photo
    from spectrabox.measure.camera import chart_signals
    from spectrabox.measure.more_bands.filter_fit import filter_from_charts
    from spectrabox.radiometry.charts.references import reference_reflectances
    from spectrabox.radiometry.errors import InputError
    from spectrabox.radiometry.grid import FINE_GRID
    from spectrabox.radiometry.light_scale import exposure_ratio
    from spectrabox.radiometry.spectra.filters import unknown_filter
    from spectrabox.radiometry.spectra.stated_light import stated_light
    from spectrabox.session.camera.inputs import read_layout

    chart, light = read_layout(request.layout), stated_light(request.light, FINE_GRID)
    reflectances = reference_reflectances(request.reference, chart, FINE_GRID)
    photos = [open_photo(path) for path in request.files]
    if photos[0].signal.shape == photos[1].signal.shape and np.array_equal(
            photos[0].signal, photos[1].signal):
        raise InputError(f"{request.files[0]} and {request.files[1]} are one photo; the second is "
                         "to be taken through the filter")
    expected = chart_signals(chart, reflectances, FINE_GRID)
    first = find_chart(photos[0], expected, None, chart)
    samples = [sample_patches(photos[0], first),
               sample_patches(photos[1], find_chart_again(photos[1], expected, first, chart))]
    for photo, patches in zip(photos, samples, strict=True):
        require_unclipped(patches, chart.names, photo.source, chart.neutrals)
    stated = all(photo.exposure_s is not None for photo in photos)
    return filter_from_charts(
        ChartPhoto(samples[0], reflectances, light, chart=chart),
        ChartPhoto(samples[1], reflectances, light, chart=chart, filter=unknown_filter()),
        exposure_ratio(*photos) if stated else None)
