"""Spectra in and out of text files.

The canonical file states what it holds, in comment lines before the header row::

    # quantity: reflectance
    # unit: 1
    # source: ASD FieldSpec 4, sphere, 2026-01-02
    wavelength_nm,value,standard_error

Loose files (instrument exports, spreadsheets) are read too: comma, semicolon or tab; several columns, one of which the
caller names. What such a file holds is then what its role in the session says, never a guess.
"""
from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import PchipInterpolator

from radiometry.errors import InputError
from radiometry.grid import grid_from_nm
from radiometry.records import Quantity, Spectrum, WavelengthGrid

FINE_STEP_NM = 2.5          # up to here linear interpolation is within measurement error; above, shape-preserving cubic
SI_FACTORS = {"uw cm-2 sr-1 nm-1": 0.01, "µw cm-2 sr-1 nm-1": 0.01, "μw cm-2 sr-1 nm-1": 0.01,
              "uw cm-2 nm-1": 0.01, "mw m-2 nm-1": 1e-3, "mw m-2 sr-1 nm-1": 1e-3, "percent": 0.01, "%": 0.01}


@dataclass(frozen=True)
class SpectralTable:
    """Columns of one text file: wavelengths (P,) in nm and values (C, P), with names and the stated facts."""

    nm: np.ndarray
    names: tuple[str, ...]
    values: np.ndarray
    facts: dict[str, str]
    file: str


def read_table(path: Path, wavelength_column: int = 1) -> SpectralTable:
    """All columns of a text file of spectra.

    Parameters
    ----------
    path : Path
        Comma, semicolon or tab separated text with one row per wavelength.
    wavelength_column : int
        Number of the column that holds the wavelengths, from 1.

    Raises
    ------
    InputError
        If the file is missing, is not such a text, or its wavelengths are not ascending.
    """
    facts, rows = _split_rows(path)
    header, numbers = _header_and_numbers(rows, wavelength_column - 1, path)
    nm = np.array([row[wavelength_column - 1] for row in numbers])
    others = [index for index in range(len(header)) if index != wavelength_column - 1]
    values = np.array([[row[index] if index < len(row) else np.nan for row in numbers] for index in others])
    values = values.reshape(len(others), nm.size)
    if np.any(np.diff(nm) <= 0):
        place = nm[1:][np.diff(nm) <= 0][0]
        raise InputError(f"{path.name}: wavelengths must ascend; they turn back at {place:g} nm")
    if nm[0] < 100 or nm[-1] > 10000:
        raise InputError(f"{path.name}: wavelengths from {nm[0]:g} to {nm[-1]:g} cannot be in nm; give them in nm")
    return SpectralTable(nm, tuple(header[index].strip() for index in others), values, facts, path.name)


def read_spectrum(path: Path, *, role: Quantity, column: str | int | None = None,
                  wavelength_column: int = 1) -> Spectrum:
    """One spectrum of a text file, in SI units.

    Parameters
    ----------
    path : Path
    role : Quantity
        What the caller needs. A file that states another quantity is refused; RELATIVE accepts any light.
    column : str or int, optional
        Name or number (from 1) of the column; needed where the file holds several.
    wavelength_column : int
        Number of the column of wavelengths, from 1.

    Raises
    ------
    InputError
        If the file, the column, the stated quantity or a value cannot be right.
    """
    table = read_table(path, wavelength_column)
    index = _column_index(table, column, wavelength_column)
    values = table.values[index]
    valid = np.isfinite(values)
    if valid.sum() < 2:
        raise InputError(f"{path.name}: column {table.names[index]!r} holds no numbers")
    quantity = _quantity(table, role)
    factor = _unit_factor(table)
    if quantity is Quantity.REFLECTANCE:
        _check_reflectance(values[valid] * factor, table.nm[valid], path.name)
    error = next((table.values[i] for i, name in enumerate(table.names) if name == "standard_error"), None)
    return Spectrum(grid_from_nm(table.nm[valid]), values[valid] * factor, quantity,
                    table.facts.get("source", f"{path.name}, column {table.names[index]}"),
                    None if error is None else error[valid] * factor)


def read_curves(path: Path, columns: Sequence[str | int] | None = None,
                wavelength_column: int = 1) -> tuple[np.ndarray, tuple[str, ...], np.ndarray]:
    """Several curves of one file, such as camera sensitivities: nm (P,), names, values (K, P)."""
    table = read_table(path, wavelength_column)
    if columns is None:
        chosen = [i for i, name in enumerate(table.names) if not name.startswith("standard_error")]
    else:
        chosen = [_column_index(table, column, wavelength_column) for column in columns]
    values = table.values[chosen]
    if not np.all(np.isfinite(values)):
        raise InputError(f"{path.name}: some cells of the curves are empty or not numbers")
    return table.nm, tuple(table.names[i] for i in chosen), values


def on_grid(nm: np.ndarray, values: np.ndarray, grid: WavelengthGrid, name: str) -> np.ndarray:
    """Values (..., P) at the grid's wavelengths: linear where sampled at 2.5 nm or finer, else monotone cubic.

    Raises
    ------
    InputError
        If the samples do not cover the grid. Nothing is extrapolated.
    """
    if nm[0] > grid.nm[0] + 1e-6 or nm[-1] < grid.nm[-1] - 1e-6:
        raise InputError(f"{name} covers {nm[0]:g}-{nm[-1]:g} nm; {grid.nm[0]:g}-{grid.nm[-1]:g} nm is needed: "
                         "measure or export the missing part")
    inside = np.clip(grid.nm, nm[0], nm[-1])
    if np.max(np.diff(nm)) <= FINE_STEP_NM:
        rows = [np.interp(inside, nm, row) for row in np.atleast_2d(values)]
        return np.array(rows).reshape(*np.shape(values)[:-1], grid.nm.size)
    return PchipInterpolator(nm, values, axis=-1)(inside)


def spectrum_on_grid(spectrum: Spectrum, grid: WavelengthGrid) -> np.ndarray:
    """The spectrum's values (P,) at the grid's wavelengths; see ``on_grid``."""
    return on_grid(spectrum.grid.nm, spectrum.values, grid, spectrum.source)


def table_text(nm: np.ndarray, columns: dict[str, np.ndarray], *, quantity: Quantity, source: str) -> str:
    """Canonical text of several columns (P,) on one grid; values keep nine significant digits."""
    lines = [f"# quantity: {quantity.name.lower()}", f"# unit: {quantity.value}", f"# source: {source}",
             ",".join(["wavelength_nm", *columns])]
    lines += [",".join([f"{wavelength:g}", *(f"{values[i]:.9g}" for values in columns.values())])
              for i, wavelength in enumerate(nm)]
    return "\n".join(lines) + "\n"


def _split_rows(path: Path) -> tuple[dict[str, str], list[list[str]]]:
    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise InputError(f"{path} is missing: give the file or correct its name in session.toml") from None
    except IsADirectoryError:
        raise InputError(f"{path} is a folder; a text file of spectra is needed") from None
    except UnicodeDecodeError:
        raise InputError(f"{path.name} is not a text file of spectra; export it as CSV") from None
    facts: dict[str, str] = {}
    body = []
    for line in text.splitlines():
        if line.lstrip().startswith("#"):
            key, colon, value = line.lstrip("# ").partition(":")
            if colon:
                facts[key.strip().lower()] = value.strip()
        elif line.strip():
            body.append(line)
    if not body:
        raise InputError(f"{path.name} is empty; a text file of spectra is needed")
    delimiter = max(";\t,", key=lambda mark: sum(mark in line for line in body) * (2 if mark != "," else 1))
    if delimiter == ";":
        body = [line.replace(",", ".") for line in body]
    return facts, list(csv.reader(body, delimiter=delimiter))


def _header_and_numbers(rows: list[list[str]], wavelength: int, path: Path) -> tuple[list[str], list[list[float]]]:
    numbers: list[list[float]] = []
    header: list[str] | None = None
    for row in rows:
        cells = [_number(cell) for cell in row]
        if wavelength < len(cells) and np.isfinite(cells[wavelength]):
            numbers.append(cells)
        elif not numbers:
            header = row
        elif any(cell.strip() for cell in row):
            raise InputError(f"{path.name}: {row[wavelength] if wavelength < len(row) else ''!r} stands where a "
                             "wavelength is needed")
    if len(numbers) < 2:
        raise InputError(f"{path.name} holds no table of wavelengths and values; a CSV with a column of nm is needed")
    width = max(len(row) for row in numbers)
    names = (header or []) + [f"column {index + 1}" for index in range(len(header or []), width)]
    return names[:width], numbers


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return float("nan")


def _column_index(table: SpectralTable, column: str | int | None, wavelength_column: int) -> int:
    candidates = [i for i, name in enumerate(table.names) if name and not name.startswith("standard_error")]
    names = ", ".join(repr(table.names[i]) for i in candidates)
    if column is None:
        if len(candidates) == 1:
            return candidates[0]
        raise InputError(f"{table.file} holds {len(candidates)} columns ({names}); say which with column = \"...\"")
    if isinstance(column, int):
        index = column - 1 - (column > wavelength_column)
        if column == wavelength_column or not 0 <= index < len(table.names):
            raise InputError(f"{table.file} has no column {column} of values; it holds {names}")
        return index
    matches = [i for i, name in enumerate(table.names) if name == column]
    if len(matches) != 1:
        what = "no column" if not matches else f"{len(matches)} columns"
        raise InputError(f"{table.file} has {what} named {column!r}; it holds {names}: "
                         "name one of them, or give its number")
    return matches[0]


def _quantity(table: SpectralTable, role: Quantity) -> Quantity:
    stated = table.facts.get("quantity")
    if stated is None:
        return role
    try:
        quantity = Quantity[stated.upper()]
    except KeyError:
        known = ", ".join(member.name.lower() for member in Quantity)
        raise InputError(f"{table.file} states the quantity {stated!r}; known are {known}") from None
    lights = {Quantity.IRRADIANCE, Quantity.RADIANCE, Quantity.RELATIVE}
    if quantity is not role and not {quantity, role} <= lights:
        raise InputError(f"{table.file} holds {quantity.name.lower()}; {role.name.lower()} is needed here")
    return quantity


def _unit_factor(table: SpectralTable) -> float:
    unit = table.facts.get("unit")
    if unit is None or unit in {member.value for member in Quantity}:
        return 1.0
    factor = SI_FACTORS.get(re.sub(r"\s+", " ", unit.lower()))
    if factor is None:
        raise InputError(f"{table.file} states the unit {unit!r}, which is not known; "
                         f"known are {', '.join([*(m.value for m in Quantity), *SI_FACTORS])}")
    return factor


def _check_reflectance(values: np.ndarray, nm: np.ndarray, name: str) -> None:
    visible = values[(nm >= 400) & (nm <= 700)]
    if visible.size and visible.max() > 2:
        raise InputError(f"{name}: a reflectance of {visible.max():.3g} looks like percent; "
                         "give fractions of 1, or state '# unit: percent'")
    if visible.size and visible.min() < -0.02:
        raise InputError(f"{name}: reflectance falls to {visible.min():.3g}; it cannot be negative")
