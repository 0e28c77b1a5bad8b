"""Spectra in and out of files of any format in formats/, told apart by content and not by name.

A file that states its quantity and unit is held to them. One that does not is what its role in the
session says; nothing is guessed from the values.
"""
from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import grid_from_nm, pchip
from spectrabox.radiometry.records import spectra
from spectrabox.radiometry.spectra.formats import (
    cxf,
    delimited,
    jcamp,
    light_meters,
    measurement_table,
    units,
)
from spectrabox.radiometry.spectra.formats.asd import is_asd, read_asd
from spectrabox.radiometry.spectra.formats.cgats import is_cgats, read_cgats
from spectrabox.radiometry.spectra.formats.delimited import table_text
from spectrabox.radiometry.spectra.formats.envi import is_envi_header, read_envi
from spectrabox.radiometry.spectra.formats.measurement_table import SpectralTable
from spectrabox.radiometry.spectra.formats.rawtoaces import is_rawtoaces, read_rawtoaces
from spectrabox.radiometry.spectra.formats.spectral_exr import MAGIC, read_spectral_exr
from spectrabox.radiometry.spectra.formats.tm27 import is_tm27, read_tm27

__all__ = ["SpectralTable", "check_reflectance", "column_index", "format_of", "on_grid",
           "read_curves", "read_reflectances", "read_spectrum", "read_table", "require_fraction",
           "spectrum_of", "spectrum_on_grid", "table_text"]

VISIBLE_NM = (400, 700)
MAX_REFLECTANCE = 1.4       # of fluorescent paper; above it is per cent
FINE_STEP_NM = 2.5          # up to here linear interpolation is within measurement error
# A step wider than both, among narrower ones, is a hole and no coarse grid.
HOLE_STEPS, MAX_STEP_NM = 3.0, 20.0
MAX_NAMED = 24              # columns in one error sentence: as many as a chart has patches
MAX_PERCENT = 100 * MAX_REFLECTANCE     # above it values are counts
KNOWN_UNITS = ("percent", "uW cm-2 nm-1", "uW cm-2 sr-1 nm-1", "mW m-2 nm-1", "mW m-2 sr-1 nm-1")
# formats whose axis may lack a unit
ANY_AXIS: dict[str, Callable[[bytes, Path, str | None], SpectralTable]] = {
    "CSV": delimited.read_delimited, "ENVI": read_envi}
READERS: dict[str, Callable[[bytes, Path], SpectralTable]] = {
    "ASD": read_asd, "CGATS": read_cgats, "TM-27": read_tm27, "Sekonic":
    light_meters.read_sekonic, "UPRTek": light_meters.read_uprtek, "rawtoaces": read_rawtoaces,
    "spectral EXR": read_spectral_exr, "JCAMP-DX": jcamp.read_jcamp, "CxF": cxf.read_cxf
}
SUFFIXES = {".asd": "ASD", ".sp": "CGATS", ".ti3": "CGATS", ".ccss": "CGATS",
            ".spdx": "TM-27", ".sli": "ENVI", ".hdr": "ENVI", ".exr": "spectral EXR",
            ".csv": "CSV", ".jdx": "JCAMP-DX", ".dx": "JCAMP-DX", ".jcamp": "JCAMP-DX",
            ".jcm": "JCAMP-DX", ".cxf": "CxF"}
FOREIGN = {
    b"PK\x03\x04": "a spreadsheet or zip archive: export the sheet as CSV",
    b"\xd0\xcf\x11\xe0": "an Excel workbook: export the sheet as CSV",
    b"%PDF": "a PDF: ask for the numbers as CSV",
    b"\x89PNG": "a picture", b"\xff\xd8\xff": "a picture", b"II*\x00": "a TIFF picture",
    b"MM\x00*": "a TIFF picture", b"\x89HDF": "an HDF5 or MATLAB file: export the spectrum as CSV",
    b"MATLAB": "a MATLAB file: export the spectrum as CSV",
    b"\x1f\x8b": "a gzip archive: unpack it first"}


def read_table(path: Path, said: Sequence[str] = ()) -> SpectralTable:
    """All columns of a file of spectra, whatever its format.

    Parameters
    ----------
    path : Path
    said : sequence of str
        Units of the axis and of the values where the file states none, or none that is understood:
        "um", "1/cm", "percent", "fraction".

    Raises
    ------
    InputError
        If the file is missing, is of no known format, is damaged, or its wavelengths are not
        ascending in nm, or if it states another unit than is said.
    """
    axis, unit = units.said_units(said)
    content = measurement_table.file_content(path)
    kind = format_of(content, path)
    # what overflows is noted as a gap
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        if kind not in ANY_AXIS and axis not in (None, "nm"):
            raise InputError(f"{path.name} is a {kind} file, which says where its wavelengths lie; "
                             f"they cannot be read in {axis}: leave --unit {axis} out")
        table = ANY_AXIS[kind](content, path, axis) if kind in ANY_AXIS else READERS[kind](content,
                                                                                           path)
    if unit is not None:
        table = _with_unit(table, unit)
    expected = SUFFIXES.get(path.suffix.lower())
    notes = table.notes
    if expected not in (None, kind):
        notes = (f"{path.name} is a {kind} file in spite of its name, and was read as one", *notes)
    return measurement_table.checked_table(
        replace(table, facts={"format": kind, **table.facts}, notes=notes))


def _with_unit(table: SpectralTable, said: str) -> SpectralTable:
    """The table with a unit for columns that state none, or none that is understood.

    Raises
    ------
    InputError
        If every column states one, and not this one.
    """
    stated = [table.fact("unit", index) for index in range(len(table.names))]
    without = [unit is None or (unit != units.COUNTS and units.value_factor(unit) is None)
               for unit in stated]
    if not any(without) and not any(unit is not None and units.value_factor(unit)
                                    == units.value_factor(said) for unit in stated):
        raise InputError(f"{table.file} states its values in {stated[0]}; they cannot be read in "
                         "another unit: leave that --unit out")
    facts = {name: {**table.facts, **table.column_facts.get(name, {})} | ({"unit": said} if lacks
                                                                          else {})
             for name, lacks in zip(table.names, without, strict=True)}
    return replace(table, column_facts={
        name: {key: value for key, value in each.items() if key in ("unit", "quantity")}
        for name, each in facts.items()})


def format_of(content: bytes, path: Path) -> str:
    """Name of the format, from what the file begins with.

    Parameters
    ----------
    content : bytes
    path : Path
        Its name counts only for a binary that says nothing itself.

    Raises
    ------
    InputError
        If it is a format that holds no spectra.
    """
    if is_asd(content):
        return "ASD"
    if content.startswith(MAGIC):
        return "spectral EXR"
    foreign = next((what for start, what in FOREIGN.items() if content.startswith(start)), None)
    if foreign:
        raise InputError(f"{path.name} is {foreign}; a file of spectra is needed")
    if is_envi_header(content):
        return "ENVI"
    if path.suffix.lower() in (".sli", ".slb") or (b"\x00" in content
                                                   and delimited.envi_header_of(path) is not None):
        return "ENVI"
    text = measurement_table.text_of(content, path.name)
    tests = (("Sekonic", light_meters.is_sekonic), ("UPRTek", light_meters.is_uprtek),
             ("JCAMP-DX", jcamp.is_jcamp), ("CxF", cxf.is_cxf), ("CGATS", is_cgats),
             ("TM-27", is_tm27),
             ("rawtoaces", is_rawtoaces))
    return next((kind for kind, test in tests if test(text)), "CSV")


def read_spectrum(path: Path, *, role: spectra.Quantity,
                  column: str | int | None = None) -> spectra.Spectrum:
    """One spectrum of a file of any known format, in SI units.

    Parameters
    ----------
    path : Path
    role : Quantity
        What the caller needs. A file that states another quantity is refused; RELATIVE accepts any
        light.
    column : str or int, optional
        Name or number (from 1) of the column; needed where the file holds several and means none of
        them.

    Raises
    ------
    InputError
        If the file, the column, the stated quantity or a value cannot be right.
    """
    return spectrum_of(read_table(path), role=role, column=column)


def spectrum_of(table: SpectralTable, *, role: spectra.Quantity,
                column: str | int | None = None) -> spectra.Spectrum:
    """One column of a table as a spectrum in SI units.

    Parameters
    ----------
    table : SpectralTable
    role, column
        As in ``read_spectrum``.

    Raises
    ------
    InputError
        As ``read_spectrum``.
    """
    index = column_index(table, column)
    values = table.values[index]
    valid = np.isfinite(values)
    if valid.sum() < 2:
        raise InputError(f"{table.file}: column {table.names[index]!r} holds no numbers")
    quantity, factor = _quantity_and_factor(table, index, role)
    if quantity is spectra.Quantity.REFLECTANCE:
        if table.fact("unit", index) is None:
            _refuse_percent(table)
        check_reflectance(values[valid] * factor, table.nm[valid], table.file)
    error = next((table.values[i] for i, name in enumerate(table.names)
                  if name == "standard_error"), None)
    return spectra.Spectrum(grid_from_nm(table.nm[valid]), values[valid] * factor, quantity,
                    table.facts.get("source", f"{table.file}, column {table.names[index]}"),
                    None if error is None else error[valid] * factor)


def read_curves(path: Path, columns: Sequence[str | int] | None = None
                ) -> tuple[np.ndarray, tuple[str, ...], np.ndarray]:
    """Several curves of a file, such as camera sensitivities: nm (P,), names, values (K, P), of
    stated per cent as fractions.

    Parameters
    ----------
    path : Path
    columns : sequence of str or int, or None
        Names or numbers (from 1); None takes all but standard errors.

    Raises
    ------
    InputError
        As ``read_table``, or if a cell is empty, or they are products with a light.
    """
    table = read_table(path)
    refuse_products(table.facts.get("source", ""), path.name)
    if columns is None:
        chosen = [i for i, name in enumerate(table.names) if not name.startswith("standard_error")]
    else:
        chosen = [column_index(table, column) for column in columns]
    percent = np.array([units.value_factor(table.fact("unit", index) or units.FRACTION) == 0.01
                        for index in chosen])
    values = table.values[chosen] * np.where(percent, 0.01, 1.0)[:, None]
    if not np.all(np.isfinite(values)):
        raise InputError(f"{path.name}: some cells of the curves are empty or not numbers")
    return table.nm, tuple(table.names[i] for i in chosen), values


def refuse_products(source: str, name: str) -> None:
    """Refuse curves that are no sensitivities.

    Parameters
    ----------
    source : str
        Of the curves, as their file states it.
    name : str
        Of the file or record, for the message.

    Raises
    ------
    InputError
        For products of sensitivity and an unknown light.
    """
    if spectra.PRODUCTS in source:
        raise InputError(
            f"{name} holds {spectra.PRODUCTS}, as a chart photo under an unknown light gives "
            "them: under another light they mean nothing. Fit the camera again with "
            "the light of its photo stated (camera fit --light FILE, a CIE name or "
            "3200K), or measure photos under the same light by their chart "
            "(spectrabox flat)")


def read_reflectances(path: Path, grid: spectra.WavelengthGrid) -> dict[str, np.ndarray]:
    """Every reflectance (P,) of a file by name, as a fraction of 1 whatever unit the file states.

    Parameters
    ----------
    path : Path
    grid : WavelengthGrid
        Working grid, of P wavelengths.

    Raises
    ------
    InputError
        As ``read_spectrum``, or if one does not cover the grid.
    """
    table = read_table(path)
    return {
        name:
        spectrum_on_grid(spectrum_of(table, role=spectra.Quantity.REFLECTANCE, column=index + 2),
                         grid)
        for index, name in enumerate(measurement_table.distinct(list(table.names)))
        if not name.startswith("standard_error")
    }


def on_grid(nm: np.ndarray, values: np.ndarray, grid: spectra.WavelengthGrid,
            name: str) -> np.ndarray:
    """Values (..., P) at the grid's wavelengths.

    Linear where they are sampled at 2.5 nm or finer, else monotone cubic.

    Parameters
    ----------
    nm : (Q,) array
        Ascending.
    values : (..., Q) array
    grid : WavelengthGrid
    name : str
        Of the spectrum, for errors.

    Raises
    ------
    InputError
        If the samples do not cover the grid. Nothing is extrapolated.
    """
    if nm[0] > grid.nm[0] + 1e-6 or nm[-1] < grid.nm[-1] - 1e-6:
        raise InputError(f"{name} covers {nm[0]:g}-{nm[-1]:g} nm; {grid.nm[0]:g}-{grid.nm[-1]:g} "
                         "nm is needed: measure or export the missing part")
    inside = np.clip(grid.nm, nm[0], nm[-1])
    if np.max(np.diff(nm)) <= FINE_STEP_NM:
        rows = [np.interp(inside, nm, row) for row in np.atleast_2d(values)]
        return np.array(rows).reshape(*np.shape(values)[:-1], grid.nm.size)
    return pchip(nm, values, inside)


def spectrum_on_grid(spectrum: spectra.Spectrum, grid: spectra.WavelengthGrid) -> np.ndarray:
    """The spectrum's values (P,) at the grid's wavelengths; see ``on_grid``.

    Parameters
    ----------
    spectrum : Spectrum
    grid : WavelengthGrid

    Raises
    ------
    InputError
        As ``on_grid``, or if the spectrum has a hole: steps far wider than its others, of cells
        that hold no number.
    """
    steps = np.diff(spectrum.grid.nm)
    wide = (steps > max(HOLE_STEPS * float(np.median(steps)), MAX_STEP_NM)) \
        & (spectrum.grid.nm[1:] > grid.nm[0]) & (spectrum.grid.nm[:-1] < grid.nm[-1])
    if wide.any():
        hole = int(np.argmax(np.where(wide, steps, 0)))
        raise InputError(f"{spectrum.source} has no values between {spectrum.grid.nm[hole]:g} and "
                         f"{spectrum.grid.nm[hole + 1]:g} nm: measure or export the missing part")
    return on_grid(spectrum.grid.nm, spectrum.values, grid, spectrum.source)


def column_index(table: SpectralTable, column: str | int | None) -> int:
    """Index of a column given by name or number, else of the main column.

    Parameters
    ----------
    table : SpectralTable
    column : str, int or None
        Number from 1; None for the only one, or the one that the format means.

    Raises
    ------
    InputError
        Naming the columns that there are.
    """
    candidates = [i for i, name in enumerate(table.names) if name
                  and not name.startswith("standard_error")]
    names = ", ".join(repr(table.names[i]) for i in candidates[:MAX_NAMED])
    names += f" and {len(candidates) - MAX_NAMED} more" if len(candidates) > MAX_NAMED else ""
    if column is None and table.main is not None:
        return table.names.index(table.main)
    if column is None:
        if len(candidates) == 1:
            return candidates[0]
        raise InputError(f"{table.file} holds {len(candidates)} columns ({names}); say which with "
                         "column = \"...\"")
    if isinstance(column, int):
        index = column - 2          # the first holds the wavelengths
        if not 0 <= index < len(table.names):
            raise InputError(f"{table.file} has no column {column} of values; it holds {names}")
        return index
    matches = [i for i, name in enumerate(table.names) if name == column]
    if len(matches) != 1:
        what = "no column" if not matches else f"{len(matches)} columns"
        raise InputError(f"{table.file} has {what} named {column!r}; it holds {names}: "
                         "name one of them, or give its number")
    return matches[0]


def _quantity_and_factor(table: SpectralTable, index: int,
                         role: spectra.Quantity) -> tuple[spectra.Quantity, float]:
    """The quantity of a column, and the factor of its values to SI or fractions of 1.

    Raises
    ------
    InputError
        Naming every fault of what the file states.
    """
    known = ", ".join(member.name.lower() for member in spectra.Quantity)
    lights = {spectra.Quantity.IRRADIANCE, spectra.Quantity.RADIANCE, spectra.Quantity.RELATIVE}
    stated, unit = table.fact("quantity", index), table.fact("unit", index)
    quantity, faults = role, []
    if stated is not None and stated.upper() not in spectra.Quantity.__members__:
        faults.append(f"{table.file} states the quantity {stated!r}; known are {known}. If it is "
                      f"one of them, state it in a first line '# quantity: {role.name.lower()}'")
    elif stated is not None:
        quantity = spectra.Quantity[stated.upper()]
        if quantity is not role and not {quantity, role} <= lights:
            faults.append(f"{table.file} holds {quantity.name.lower()}; {role.name.lower()} is "
                          "needed here")
    factor = None if unit is None else units.value_factor(unit)
    if unit is not None and factor is None:
        faults.append(f"{table.file} states the unit {unit!r}, which is not known; known are "
                      f"{', '.join([*(m.value for m in spectra.Quantity), *KNOWN_UNITS])}. Where "
                      f"it is one of these, say so: {units.remedy('percent')}")
    elif unit is not None and not faults and role is spectra.Quantity.REFLECTANCE and (
            units.light_unit(unit) is not None):
        faults.append(f"{table.file} states the unit {unit!r}, which is of light; "
                      "a reflectance is needed here")
    if faults:
        raise InputError("; ".join(faults))
    return quantity, 1.0 if factor is None else factor


def _refuse_percent(table: SpectralTable) -> None:
    """Refuse a table without a unit of which any column is in per cent: all of them then are.

    Raises
    ------
    InputError
    """
    visible = (table.nm >= VISIBLE_NM[0]) & (table.nm <= VISIBLE_NM[1])
    for index, (name, row) in enumerate(zip(table.names, table.values, strict=True)):
        largest = np.max(row[visible & np.isfinite(row)], initial=0)
        if MAX_REFLECTANCE < largest <= MAX_PERCENT and table.fact("unit", index) is None:
            of = f" of column {name!r}" if len(table.names) > 1 else ""
            raise InputError(f"{table.file}: a reflectance of {largest:.3g}{of} looks like "
                             "percent; give fractions of 1, state '# unit: percent', or say it: "
                             f"{units.remedy('percent')}" + (
                                 " (or --unit fraction, where that column alone is of another kind)"
                                 if of else ""))


def require_fraction(value: float, name: str) -> None:
    """Refuse a stated reflectance that is no fraction of 1.

    Parameters
    ----------
    value : float
        At all wavelengths.
    name : str
        Of the surface, for the message.

    Raises
    ------
    InputError
    """
    if not 0 < value <= 1:
        meant = f" ({value / 100:g}?)" if 1 < value <= 100 else ""
        raise InputError(f"the reflectance {value:g} of {name!r} lies outside 0 to 1{meant}; give "
                         "a fraction of 1")


def check_reflectance(values: np.ndarray, nm: np.ndarray, name: str) -> None:
    """Refuse a measured spectrum that is no reflectance: per cent, or negative.

    Parameters
    ----------
    values, nm : (P,) arrays
    name : str
        Of the file or surface, for the message.

    Raises
    ------
    InputError
    """
    visible = values[(nm >= VISIBLE_NM[0]) & (nm <= VISIBLE_NM[1])]
    if not visible.size:        # coarser samples than the visible range is wide
        visible = np.interp(VISIBLE_NM, nm, values)
    if not np.all(np.isfinite(visible)):
        raise InputError(f"{name}: a reflectance between 400 and 700 nm is not a finite number; "
                         "measure or export the missing part")
    if visible.max() > MAX_PERCENT:
        raise InputError(f"{name}: a reflectance of {visible.max():.4g} is neither a fraction of 1 "
                         "nor percent; divide it by what a perfect white reads")
    if visible.max() > MAX_REFLECTANCE:
        raise InputError(f"{name}: a reflectance of {visible.max():.3g} looks like percent; "
                         "give fractions of 1, or state '# unit: percent'")
    if visible.min() < -0.02:
        raise InputError(f"{name}: reflectance falls to {visible.min():.3g}; it cannot be negative")
