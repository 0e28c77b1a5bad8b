"""CSV and its relatives: comma, semicolon or tab, one row per wavelength.

The canonical file states what it holds, in comment lines before the header row::

    # quantity: reflectance
    # unit: 1
    # source: ASD FieldSpec 4, sphere, 2026-01-02
    wavelength_nm,value,standard_error

or, of a table for other programs, in a file beside it (csvw.py). Of others' tables some have a row
for each spectrum, and the wavelengths in the header.
"""
from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.radiometry.spectra.formats.cgats import BAND
from spectrabox.radiometry.spectra.formats.csvw import facts_beside
from spectrabox.radiometry.spectra.formats.measurement_table import (
    MIN_NM,
    SpectralTable,
    distinct,
    number,
    text_of,
)
from spectrabox.radiometry.system.words import cell, from_cell, plain

MAX_COLUMNS = 20_000        # spectra in one file
MIN_ACROSS = 5              # wavelengths of a header that is taken for one of them


def read_delimited(content: bytes, path: Path) -> SpectralTable:
    """All columns of a delimited text.

    Parameters
    ----------
    content : bytes
    path : Path
        Its name, for errors.

    Raises
    ------
    InputError
    """
    facts, rows = _split_rows(text_of(content, path.name), path.name)
    facts = facts or facts_beside(path)
    across = _wavelengths_across(rows)
    if across is not None:
        names, nm, values = across
        return SpectralTable(nm, names, values, facts, path.name)
    header, numbers = _header_and_numbers(rows, path.name)
    nm = np.array([row[0] for row in numbers])
    others = range(1, len(header))
    values = np.array([[row[index] if index < len(row) else np.nan for row in numbers]
                       for index in others])
    return SpectralTable(nm, tuple(from_cell(header[index].strip()) for index in others),
                         values.reshape(len(others), nm.size), facts,
                         path.name)


def table_text(nm: np.ndarray, columns: dict[str, np.ndarray], *, quantity: Quantity,
               source: str) -> str:
    """Canonical text of several columns (P,) on one grid; wavelengths and values keep nine
    significant digits.

    Parameters
    ----------
    nm : (P,) array
    columns : dict of (P,) arrays
        By name.
    quantity : Quantity
    source : str
        Stored in the file.
    """
    header = [name if not any(mark in name for mark in ',;"#') else
              '"' + name.replace('"', '""') + '"' for name in map(cell, columns)]
    lines = [f"# quantity: {quantity.name.lower()}", f"# unit: {quantity.value}",
             f"# source: {plain(' '.join(source.split()))}",
             ",".join(["wavelength_nm", *header])]
    lines += [",".join([f"{wavelength:.9g}", *(f"{values[i]:.9g}" for values in columns.values())])
              for i, wavelength in enumerate(nm)]
    return "\n".join(lines) + "\n"


def _split_rows(text: str, name: str) -> tuple[dict[str, str], list[list[str]]]:
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
        raise InputError(f"{name} is empty; a text file of spectra is needed")
    if (widest := max(line.count(",") + line.count(";") + line.count("\t")
                      for line in body)) > MAX_COLUMNS:
        raise InputError(f"{name} has lines of {widest + 1} columns; {MAX_COLUMNS} is the limit: "
                         "give one row for each wavelength, and split the file")
    delimiter = max(";\t,", key=lambda mark: sum(mark in line for line in body)
                    * (2 if mark != "," else 1))
    if not any(delimiter in line for line in body):
        return facts, [line.split() for line in body]
    if delimiter != "," and not any("," in line and "." in line for line in body[1:]):
        named = not np.isfinite(number(body[0].split(delimiter)[0].replace(",", ".")))
        body = [*body[:named], *(line.replace(",", ".") for line in body[named:])]
    try:
        return facts, list(csv.reader(body, delimiter=delimiter))
    except csv.Error as error:
        raise InputError(
            f"{name} cannot be split into columns ({error}); export it as CSV") from None


def _wavelengths_across(rows: list[list[str]]
                        ) -> tuple[tuple[str, ...], np.ndarray, np.ndarray] | None:
    """Names, wavelengths (P,) and values (C, P) of a table with one row for each spectrum.

    None where the header does not end in ascending wavelengths, or the first column holds some.
    """
    header = [cell.strip() for cell in rows[0]]
    labels = [BAND.fullmatch(cell) for cell in header]
    first = next((index for index, label in enumerate(labels) if label), 0)
    nm = np.array([float(label[1]) if label else np.nan for label in labels[first:]])
    body = [row for row in rows[1:] if any(cell.strip() for cell in row)]
    if first == 0 or not body or nm.size < MIN_ACROSS or not np.all(np.diff(nm) > 0):
        return None     # also where a label is none: a step to what is no number is not above 0
    start = np.array([number(row[0]) for row in body])
    if np.all(start >= MIN_NM) and np.all(np.diff(start) > 0):
        return None
    texts = [index for index in range(first) if any(
        index < len(row) and not np.isfinite(number(row[index])) for row in body)]
    column = texts[0] if texts else 0
    values = np.array([[number(row[index]) if index < len(row) else np.nan
                        for index in range(first, len(header))] for row in body])
    return distinct([from_cell(row[column].strip()) for row in body]), nm, values


def _header_and_numbers(rows: list[list[str]], name: str) -> tuple[list[str], list[list[float]]]:
    numbers: list[list[float]] = []
    header: list[str] | None = None
    for row in rows:
        cells = [number(cell) for cell in row]
        if cells and np.isfinite(cells[0]):
            numbers.append(cells)
        elif not numbers:
            header = row
        elif any(cell.strip() for cell in row):
            raise InputError(f"{name}: {row[0]!r} stands where a wavelength is needed")
    if len(numbers) < 2:
        raise InputError(f"{name} holds no table of wavelengths and values; a CSV with a column of "
                         "nm is needed")
    width = max(len(row) for row in numbers)
    names = (header or []) + [f"column {index + 1}" for index in range(len(header or []), width)]
    return names[:width], numbers
