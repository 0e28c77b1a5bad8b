"""CSV and its relatives: comma, semicolon or tab, one row per wavelength, with what a file beside
it states.

A plain CSV of spectra, and what it states in a file beside it.

The table has one header row and numbers, no comment lines: colour-science, pandas and spreadsheets
read it. Quantity, unit and source lie in ``NAME.csv-metadata.json``, after the W3C's Metadata
Vocabulary for Tabular Data (CSV on the Web, 2015), whose prefixes ``dc`` and ``schema`` are.

CSV and its relatives: comma, semicolon or tab, one row per wavelength.

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
import json
import re
from pathlib import Path

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.radiometry.spectra.formats import measurement_table
from spectrabox.radiometry.spectra.formats.cgats import BAND
from spectrabox.radiometry.system import words

METADATA = "-metadata.json"     # of a plain CSV (formats/csvw.py)

MAX_BYTES = 10_000_000
QUANTITY, UNIT, SOURCE = "schema:variableMeasured", "schema:unitText", "dc:source"
MARKS = re.compile('[,;"#]')    # that some reader of CSV takes for more than a letter


def metadata_path(path: Path) -> Path:
    """Where the metadata of a CSV lie, if there are some."""
    return path.with_name(path.name + METADATA)


def envi_header_of(path: Path) -> Path | None:
    """The header that belongs to a binary library, if it is beside it."""
    return next((candidate for candidate in (path.with_suffix(".hdr"),
                                             path.with_name(path.name + ".hdr"))
                 if candidate != path and candidate.is_file()), None)


def envi_values_of(header: Path) -> Path | None:
    """The binary library that belongs to a header, if it is beside it."""
    return next((values for suffix in (".sli", ".slb", ".lib", "")
                 if (values := header.with_suffix(suffix)) != header and values.is_file()), None)


def envi_partner(path: Path) -> Path | None:
    """The other file that is read with a header or a binary library, if it is beside it."""
    return envi_values_of(path) if path.suffix.lower() == ".hdr" else envi_header_of(path)


def plain_text(nm: np.ndarray, columns: dict[str, np.ndarray]) -> str:
    """Columns (P,) on one grid as CSV; wavelengths and values keep nine significant digits.

    Parameters
    ----------
    nm : (P,) array
    columns : dict of (P,) arrays
        By name; in the header, marks that could end a cell become blanks.
    """
    rows = [",".join(["wavelength_nm", *(_title(name) for name in columns)])]
    rows += [",".join([f"{wavelength:.9g}", *(f"{values[i]:.9g}" for values in columns.values())])
             for i, wavelength in enumerate(nm)]
    return "\n".join(rows) + "\n"


def metadata_text(file: str, columns: dict[str, np.ndarray], *, quantity: Quantity,
                  source: str) -> str:
    """What is stated beside a plain CSV.

    Parameters
    ----------
    file : str
        Name of the CSV.
    columns : dict
        By the names they have, marks and all.
    quantity : Quantity
    source : str
    """
    described = [{"titles": "wavelength_nm", "datatype": "number", QUANTITY: "wavelength",
                  UNIT: "nm"}]
    described += [{"titles": _title(name), "dc:title": words.plain(name), "datatype": "number",
                   QUANTITY: quantity.name.lower(), UNIT: quantity.value} for name in columns]
    return json.dumps({"@context": "http://www.w3.org/ns/csvw", "url": file,
                       SOURCE: words.plain(" ".join(source.split())),
                       "dialect": {"delimiter": ",", "header": True, "encoding": "utf-8"},
                       "tableSchema": {"columns": described, "primaryKey": "wavelength_nm"}},
                      indent=1, ensure_ascii=False) + "\n"


def facts_beside(path: Path) -> dict[str, str]:
    """Quantity, unit and source that the file beside a CSV states; empty where there is none."""
    metadata = metadata_path(path)
    if not metadata.is_file() or metadata.stat().st_size > MAX_BYTES:
        return {}
    try:
        stated = json.loads(metadata.read_text(encoding="utf-8"))
        column = stated["tableSchema"]["columns"][1]
        facts = {"quantity": column.get(QUANTITY), "unit": column.get(UNIT),
                 "source": stated.get(SOURCE)}
    except (OSError, ValueError, KeyError, IndexError, TypeError, AttributeError, RecursionError):
        return {}       # the table holds without it, and then states no quantity
    return {key: value for key, value in facts.items() if isinstance(value, str)}


def _title(name: str) -> str:
    return words.cell(MARKS.sub(" ", name))


# ---- cSV and its relatives: comma, semicolon or tab, one row per wavelength ----------------------

MAX_COLUMNS = 20_000        # spectra in one file
MIN_ACROSS = 5              # wavelengths of a header that is taken for one of them


def read_delimited(content: bytes, path: Path) -> measurement_table.SpectralTable:
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
    facts, rows = _split_rows(measurement_table.text_of(content, path.name), path.name)
    facts = facts or facts_beside(path)
    across = _wavelengths_across(rows)
    if across is not None:
        names, nm, values = across
        return measurement_table.SpectralTable(nm, names, values, facts, path.name)
    header, numbers = _header_and_numbers(rows, path.name)
    nm = np.array([row[0] for row in numbers])
    others = range(1, len(header))
    values = np.array([[row[index] if index < len(row) else np.nan for row in numbers]
                       for index in others])
    return measurement_table.SpectralTable(
        nm, tuple(words.from_cell(header[index].strip()) for index in others),
        values.reshape(len(others), nm.size), facts, path.name)


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
              '"' + name.replace('"', '""') + '"' for name in map(words.cell, columns)]
    lines = [f"# quantity: {quantity.name.lower()}", f"# unit: {quantity.value}",
             f"# source: {words.plain(' '.join(source.split()))}",
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
        named = not np.isfinite(
            measurement_table.number(body[0].split(delimiter)[0].replace(",", ".")))
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
    start = np.array([measurement_table.number(row[0]) for row in body])
    if np.all(start >= measurement_table.MIN_NM) and np.all(np.diff(start) > 0):
        return None
    texts = [index for index in range(first) if any(
        index < len(row) and not np.isfinite(measurement_table.number(row[index])) for row in body)]
    column = texts[0] if texts else 0
    values = np.array([[measurement_table.number(row[index]) if index < len(row) else np.nan
                        for index in range(first, len(header))] for row in body])
    return measurement_table.distinct([words.from_cell(row[column].strip())
                                       for row in body]), nm, values


def _header_and_numbers(rows: list[list[str]], name: str) -> tuple[list[str], list[list[float]]]:
    numbers: list[list[float]] = []
    header: list[str] | None = None
    for row in rows:
        cells = [measurement_table.number(cell) for cell in row]
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
