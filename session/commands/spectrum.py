"""Commands for spectral files: what is in one, the same in another format; a filter measured."""
from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.system.words import is_whole_number
from spectrabox.session.terminal import command_help, command_line

if TYPE_CHECKING:
    import numpy as np

    from spectrabox.radiometry.records.spectra import Quantity, Spectrum
    from spectrabox.radiometry.spectra.formats.measurement_table import SpectralTable

WRITTEN = {".csv": "CSV", ".sp": "Argyll's CGATS", ".spdx": "IES TM-27", ".sli": "ENVI library",
           ".exr": "spectral EXR"}
MAX_LISTED = 12
OUT_HELP = f"A file ({', '.join(WRITTEN)}), or a folder for several files."
QUANTITIES = "reflectance|radiance|irradiance|relative"


def register(app: typer.Typer) -> None:
    """Add these commands to the command line."""
    spectrum = command_help.Commands(name="spectrum", help="Spectral files.")
    for function in (show, convert):
        spectrum.command()(function)
    app.add_typer(spectrum)
    filters = command_help.Commands(name="filter",
                                    help="Filters before lens or lamp: their transmittance.")
    filters.command(name="fit")(fit_filter)
    app.add_typer(filters)


@command_line.Command
def show(
    files: Annotated[tuple[Path, ...], typer.Argument(
        metavar="FILE...", show_default=False, help="Files of spectra, of any format.")],
    column: Annotated[str | None, typer.Option(
        metavar="COLUMN", help="Name or number of one column.")] = None,
    draw: Annotated[bool, typer.Option(
        "--draw", help="Draw the spectrum in the terminal.")] = False,
) -> command_line.Answer:
    """Show what a spectral file holds: format, range, quantity, unit, and what to beware of."""
    from spectrabox.radiometry.spectra.spectrum_files import read_table
    tables = [read_table(path) for path in files]
    facts = [_facts(table, column) for table in tables]
    text = "\n\n".join(_text(table, each, column, draw)
                       for table, each in zip(tables, facts, strict=True))
    return command_line.Answer(facts[0] if len(facts) == 1 else {"files": facts}, text)


@command_line.Command
def convert(
    files: Annotated[tuple[Path, ...], typer.Argument(
        metavar="FILE...", show_default=False, help="Files of spectra, of any format.")],
    out: Annotated[Path, typer.Option(
        "--out", "-o", metavar="FILE|FOLDER", help=OUT_HELP, show_default=False)],
    column: Annotated[str | None, typer.Option(
        metavar="COLUMN", help="Name or number of one column.")] = None,
    quantity: Annotated[str | None, typer.Option(
        metavar=QUANTITIES, help="What the spectra are, where the file does not state it.")] = None,
    unit: Annotated[tuple[str, ...], typer.Option(
        metavar="UNIT", help="Where the file does not state it, of the values (percent, fraction "
        "...) or of the wavelengths (nm, um, angstrom, 1/cm, THz, eV); may be given for "
        "both.")] = (),
    grid: Annotated[str | None, typer.Option(
        metavar="FIRST:LAST:STEP", help="In nm, such as 400:700:5; the file's own by "
        "default.")] = None,
    to: Annotated[str, typer.Option(
        metavar="|".join(WRITTEN), help="Format of the files in a folder.")] = ".csv",
) -> command_line.Answer:
    """Write spectra in another format, on another grid where one is given. Nothing is
    extrapolated.
    """
    suffix = to if len(files) > 1 else out.suffix.lower()
    command_line.check_ending(Path(f"spectra{suffix}") if len(files) > 1 else out, WRITTEN,
                 "--to" if len(files) > 1 else "--out")
    facts, lines = [], []
    for path in files:
        target = out / f"{path.stem}{suffix}" if len(files) > 1 else out
        notes = _convert(path, target, column, quantity, unit, grid)
        facts.append({"file": target, "notes": notes})
        lines += [f"wrote {target}", *(f"- {note}" for note in notes)]
    return command_line.Answer({"written": facts}, "\n".join(lines))


def _facts(table: SpectralTable, column: str | None) -> dict[str, Any]:
    """What a file holds, for JSON: ``quantity`` and ``unit`` are of the column that is named or
    meant; where there is one, its name is ``column`` and ``values`` are its values. ``facts`` is
    whatever else the file states.
    """
    from spectrabox.radiometry.records.spectra import Quantity
    indices = _indices(table, column)
    main = indices[0] if len(indices) == 1 or table.main is None else table.names.index(table.main)
    units = {member.name.lower(): member.value for member in Quantity}
    stated = table.fact("quantity", main)
    facts: dict[str, Any] = {
        "file": table.file, "format": table.facts.get("format"), "wavelengths_nm": table.nm,
        "quantity": stated,
        "unit": table.fact("unit", main) or (units.get(stated) if stated else None),
        "source": table.facts.get("source", table.file), "notes": table.notes,
        "facts": {key: value for key, value in table.facts.items()
                  if key not in ("quantity", "unit", "source", "format")},
        "spectra": [{"name": table.names[index], "values": _plain(table.values[index]),
                     "quantity": table.fact("quantity", index), "unit": table.fact("unit", index)}
                    for index in indices]}
    if len(indices) == 1 or table.main is not None:
        facts |= {"values": _plain(table.values[main]), "column": table.names[main]}
    return facts


def _plain(values: np.ndarray) -> list[float | None]:
    return [float(value) if value == value and abs(value) != float("inf") else None
            for value in values]


def _indices(table: SpectralTable, column: str | None) -> list[int]:
    if column is None:
        return list(range(len(table.names)))
    from spectrabox.radiometry.spectra.spectrum_files import column_index
    return [column_index(table, _name_or_number(table, column))]


def _name_or_number(table: SpectralTable, column: str) -> str | int:
    """A column's name, or the number of one that no column has for a name."""
    return int(column) if is_whole_number(column) and column not in table.names else column


def _text(table: SpectralTable, facts: dict[str, Any], column: str | None, plot: bool) -> str:
    quantity, unit = facts["quantity"] or "quantity not stated", facts["unit"] or "unit not stated"
    lines = [f"{table.file}: {facts['format']}, {table.nm[0]:g}-{table.nm[-1]:g} nm, "
             f"{table.nm.size} wavelengths, {len(table.names)} "
             f"{'column' if len(table.names) == 1 else 'columns'}",
             f"source: {facts['source']}", f"quantity: {quantity}, {unit}"]
    for each in facts["spectra"][:MAX_LISTED]:
        numbers = [value for value in each["values"] if value is not None]
        span = f"{min(numbers):.4g} to {max(numbers):.4g}" if numbers else "no numbers"
        stated = each["quantity"] or "quantity not stated"
        lines.append(f"  {each['name'] or '(no name)':<28} {span:<24} {stated}")
    if len(facts["spectra"]) > MAX_LISTED:
        lines.append(f"  and {len(facts['spectra']) - MAX_LISTED} more")
    lines += [f"- {note}" for note in table.notes]
    if plot:
        from spectrabox.capture.meter.measurement_files import text_plot
        from spectrabox.radiometry.records.spectra import Quantity
        stated = (facts["quantity"] or "relative").upper()
        role = Quantity[stated] if stated in Quantity.__members__ else Quantity.RELATIVE
        lines.append(text_plot(_one(table, column, role)))
    return "\n".join(lines)


def _one(table: SpectralTable, column: str | None, role: Quantity) -> Spectrum:
    from spectrabox.radiometry.grid import grid_from_nm
    from spectrabox.radiometry.records.spectra import Spectrum
    from spectrabox.radiometry.spectra.spectrum_files import column_index
    index = column_index(table, None if column is None else _name_or_number(table, column))
    keep = table.values[index] == table.values[index]
    return Spectrum(grid_from_nm(table.nm[keep]), table.values[index][keep], role, table.file)


def _convert(path: Path, target: Path, column: str | None, quantity: str | None,
             unit: tuple[str, ...], grid: str | None) -> list[str]:
    import numpy as np

    from spectrabox.radiometry.files import whole_file, write_text_whole
    from spectrabox.radiometry.grid import resampled
    from spectrabox.radiometry.spectra.formats.envi import envi_files
    from spectrabox.radiometry.spectra.spectrum_files import read_table, spectrum_of, table_text

    table = read_table(path, unit)
    role = _stated_quantity(table, column, quantity)
    names = [table.main] if column is None and table.main is not None else \
        [table.names[index] for index in _indices(table, column)]
    names = [name for name in names if not name.startswith("standard_error")]
    spectra = [spectrum_of(table, role=role, column=name) for name in names]
    if any(not np.array_equal(spectrum.grid.nm, spectra[0].grid.nm) for spectrum in spectra):
        raise InputError(f"{path.name}: its columns have numbers at different wavelengths; convert "
                         "them one by one with --column")
    nm, notes = spectra[0].grid.nm, list(table.notes)
    columns = {name if len(names) > 1 else "value": spectrum.values
               for name, spectrum in zip(names, spectra, strict=True)}
    error = spectra[0].standard_error if len(names) == 1 else None
    if error is not None and grid is None and target.suffix.lower() == ".csv":
        columns["standard_error"] = error
    elif error is not None:
        notes.append("standard errors were left out: only a CSV on the same grid can hold them")
    if grid is not None:
        target_nm = _grid(grid)
        results = {name: resampled(nm, values, target_nm, path.name) for name,
                   values in columns.items()}
        nm, columns = target_nm, {name: values for name, (values, _) in results.items()}
        notes.append(f"resampled with {next(iter(results.values()))[1]}")
    stated = spectra[0].quantity
    if target.suffix.lower() == ".sli":
        header, binary = envi_files(nm, columns, quantity=stated, source=spectra[0].source)
        write_text_whole(target.with_suffix(".hdr"), header)
        with whole_file(target) as unfinished:
            unfinished.write_bytes(binary)
    elif target.suffix.lower() == ".exr":
        _write_layers(target, nm, columns, stated)
        if len(columns) > 1:
            notes.append(f"one pixel a spectrum, from left to right: {', '.join(columns)}")
    else:
        write_text_whole(target,
                    _text_writer(target.suffix.lower(), table_text)(nm, columns, quantity=stated,
                                                                    source=spectra[0].source))
    return notes


def _write_layers(path: Path, nm: np.ndarray, columns: dict[str, np.ndarray],
                  quantity: Quantity) -> None:
    """A spectral EXR of one row, a pixel for each spectrum."""
    import numpy as np

    from spectrabox.capture.photo.image_writers import write_exr
    from spectrabox.radiometry.records.spectra import Quantity
    from spectrabox.radiometry.spectra import spectral_layers
    kind = spectral_layers.REFLECTANCE if quantity is Quantity.REFLECTANCE \
        else spectral_layers.LIGHT
    write_exr(path, np.array(list(columns.values()))[None], spectral_layers.layer_names(nm, kind),
              attributes=spectral_layers.layout_attributes(quantity))


def _text_writer(suffix: str, csv_writer: Any) -> Any:
    from spectrabox.radiometry.spectra.formats import cgats, tm27
    return {".csv": csv_writer, ".sp": cgats.sp_text, ".spdx": tm27.spdx_text}[suffix]


def _stated_quantity(table: SpectralTable, column: str | None, quantity: str | None) -> Quantity:
    from spectrabox.radiometry.records.spectra import Quantity
    from spectrabox.radiometry.spectra.spectrum_files import column_index
    known = ", ".join(member.name.lower() for member in Quantity)
    if quantity is not None and quantity.upper() not in Quantity.__members__:
        raise typer.BadParameter(f"{quantity!r} is not one of {known}", param_hint="--quantity")
    first = 0 if column is None and table.main is None else \
        column_index(table, None if column is None else _name_or_number(table, column))
    stated = table.fact("quantity", first)
    if stated is None and quantity is None:
        raise InputError(f"{table.file} does not state what it is a spectrum of; say it with "
                         f"--quantity ({known})")
    name = (stated or quantity or "").upper()
    if name not in Quantity.__members__:
        raise InputError(f"{table.file}, column {table.names[first]!r}, holds {stated}; known are "
                         f"{known}: name another column with --column")
    if stated is not None and quantity is not None and stated != quantity:
        raise InputError(f"{table.file} states {stated}; it cannot be written as {quantity}")
    return Quantity[name]


def _grid(text: str) -> np.ndarray:
    import numpy as np
    match = re.fullmatch(r"(\d+\.?\d*):(\d+\.?\d*):(\d+\.?\d*)", text)
    if match is None or not 0 < float(match[3]) <= float(match[2]) - float(match[1]):
        raise typer.BadParameter(f"{text!r} is not FIRST:LAST:STEP such as 400:700:5",
                                 param_hint="--grid")
    first, last, step = (float(part) for part in match.groups())
    count = round((last - first) / step)
    if count > 100_000 or abs(first + count * step - last) > 1e-6 * step:
        raise typer.BadParameter(f"the step {step:g} nm does not divide {first:g}-{last:g} nm",
                                 param_hint="--grid")
    return np.linspace(first, last, count + 1)


# ---- filters -------------------------------------------------------------------------------------

@command_line.Command
def fit_filter(
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
    command_line.check_ending(out, {".csv": "the transmittance with its standard error"})
    from spectrabox.radiometry import errors, grid
    from spectrabox.radiometry.files import write_text_whole
    from spectrabox.radiometry.records.spectra import Quantity
    from spectrabox.radiometry.spectra.spectrum_files import table_text

    if out in files:
        raise errors.InputError(f"{out} is one of the given files; name another file")
    known, level_known = (_of_readings(*files), True) if readings \
        else _of_charts(*files, light, reference, layout)
    transmittance, error = known.values, known.standard_error
    assert error is not None
    write_text_whole(out, table_text(
        grid.FINE_GRID.nm, {"transmittance": transmittance, "standard_error": error},
        quantity=Quantity.RELATIVE, source=known.source))
    relative = error / transmittance.max()
    level = "" if level_known else "; its level is not known, and was set to 1 at its best"
    return command_line.Answer(
        {"wavelengths_nm": grid.FINE_GRID.nm, "transmittance": transmittance,
         "standard_error": error, "level_known": level_known, "file": out},
        f"wrote {out}: transmittance {transmittance.min():.3f} to {transmittance.max():.3f}, "
        f"standard error {relative.mean():.1%} of its largest value on average, "
        f"{relative.max():.1%} at worst{level}")


def _of_readings(without: Path, through: Path) -> Spectrum:
    from spectrabox.measure.more_bands.filter_fit import filter_from_readings
    from spectrabox.radiometry.records.spectra import Quantity
    from spectrabox.radiometry.spectra.spectrum_files import read_spectrum
    return filter_from_readings(*(read_spectrum(path, role=Quantity.RELATIVE)
                                  for path in (without, through)))


def _of_charts(without: Path, through: Path, light: str, reference: str | None,
               layout: str) -> tuple[Spectrum, bool]:
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
