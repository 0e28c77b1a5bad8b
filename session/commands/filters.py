"""The command that measures a filter: from two photos of a chart, or from two readings."""
from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from spectrabox.session.terminal import command_help, command_line

if TYPE_CHECKING:
    from spectrabox.measure.more_bands.filter_fit import MeasuredFilter

WRITTEN = {".csv": "the transmittance with its standard error"}


def register(app: typer.Typer) -> None:
    """Add these commands to the command line."""
    filters = command_help.Commands(name="filter",
                                    help="Filters before lens or lamp: their transmittance.")
    filters.command()(fit)
    app.add_typer(filters)


@command_line.Command
def fit(
    files: Annotated[tuple[Path, ...], typer.Argument(
        metavar="WITHOUT WITH", show_default=False, help="Two photos of a colour chart, or with "
        "--readings two spectra of one lamp: first without the filter, then with it.")],
    out: Annotated[Path, typer.Option(
        "--out", "-o", metavar="CSV", show_default=False, help="Where to write the transmittance "
        "and its standard error.")],
    readings: Annotated[bool, typer.Option(
        "--readings", help="The files are readings of a spectroradiometer.")] = False,
    light: Annotated[str, typer.Option(
        metavar="FILE|NAME",
        help="Light of the photos: unknown, a CIE name, a kind of lamp, 3200K, or the file of its "
        "spectrum.")] = "unknown",
    reference: Annotated[str | None, typer.Option(
        metavar="NAME|FILE", help="Chart reflectances.")] = None,
    layout: command_line.ChartLayout = "",
) -> command_line.Answer:
    """Measure the transmittance of a filter, with standard errors, as a file for --filters."""
    if len(files) != 2:
        raise command_line.UsageProblem(
            f"{len(files)} files were given; two are needed: first without "
            "the filter, then with it")
    command_line.check_ending(out, WRITTEN)
    from spectrabox.radiometry import errors, grid
    from spectrabox.radiometry.files import write_text_whole
    from spectrabox.radiometry.records.spectra import Quantity
    from spectrabox.radiometry.spectra.spectrum_files import table_text

    if out in files:
        raise errors.InputError(f"{out} is one of the given files; name another file")
    known = _of_readings(*files) if readings else _of_charts(*files, light, reference, layout)
    write_text_whole(out, table_text(
        grid.FINE_GRID.nm, {"transmittance": known.transmittance,
                            "standard_error": known.standard_error},
        quantity=Quantity.RELATIVE, source=known.source))
    return command_line.Answer(known.facts() | {"file": out}, f"wrote {out}: {known.text()}")


def _of_readings(without: Path, through: Path) -> MeasuredFilter:
    from spectrabox.measure.more_bands.filter_fit import filter_from_readings
    from spectrabox.radiometry.records.spectra import Quantity
    from spectrabox.radiometry.spectra.spectrum_files import read_spectrum
    return filter_from_readings(*(read_spectrum(path, role=Quantity.RELATIVE)
                                  for path in (without, through)))


def _of_charts(without: Path, through: Path, light: str, reference: str | None,
               layout: str) -> MeasuredFilter:
    from spectrabox.capture.photo.linear import open_photo
    from spectrabox.measure.more_bands.filter_fit import filter_from_photos
    from spectrabox.radiometry.charts.references import reference_reflectances
    from spectrabox.radiometry.grid import FINE_GRID
    from spectrabox.radiometry.spectra.named_spectra import stated_light
    from spectrabox.session.camera.camera_files import read_layout

    chart = read_layout(layout)
    return filter_from_photos(open_photo(without), open_photo(through), chart,
                              reference_reflectances(reference, chart, FINE_GRID),
                              stated_light(light, FINE_GRID))
