"""CSV and its relatives: one row for each wavelength, whatever the delimiter and the preamble.

The canonical file states what it holds, in comment lines before the header row::

    # quantity: reflectance
    # unit: 1
    # source: ASD FieldSpec 4, sphere, 2026-01-02
    wavelength_nm,value,standard_error

A table for other programs has one header row and numbers, no comment lines: colour-science, pandas
and spreadsheets read it. Quantity, unit and source lie in ``NAME.csv-metadata.json``, after the
W3C's Metadata Vocabulary for Tabular Data (CSV on the Web, 2015), whose prefixes ``dc`` and
``schema`` are. Of others' tables some have a row for each spectrum, and the wavelengths in the
header; text_table.py finds the rest inside their preambles.
"""
from __future__ import annotations

import itertools
import json
import re
from pathlib import Path

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.radiometry.spectra.formats import cgats, measurement_table, text_table, units
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


# ---- CSV and its relatives: a table of numbers inside a text -------------------------------------

MAX_FIRST_NM = 2600.0       # where tables in nm begin below, unless they say that they are in nm
MIN_ACROSS = 5              # wavelengths of a header that is taken for one of them
SVC = "/*** Spectra Vista SIG Data"     # HR-512i, HR-768, HR-1024i manuals: the columns of .sig
SVC_NAMES = ("wavelength", "reference", "target", "reflectance")
SVC_FACTS = {"reference": {"unit": "counts"}, "target": {"unit": "counts"},
             "reflectance": {"unit": units.PERCENT, "quantity": "reflectance"}}
# Jaz manual: wavelength W, dark D, reference R, scope S, processed P, whose unit it does not write
JAZ, JAZ_IRRADIANCE = {"D", "R", "S", "P"}, "Absolute Irradiance File"


def read_delimited(content: bytes, path: Path,
                   axis_unit: str | None = None) -> measurement_table.SpectralTable:
    """All columns of the table inside a text; its axis is brought to nm.

    Parameters
    ----------
    content : bytes
    path : Path
        Its name, for errors.
    axis_unit : str, optional
        Of the axis, where the text states none that is understood.

    Raises
    ------
    InputError
        If there is no table, or its axis states a unit that is not understood.
    """
    text = measurement_table.text_of(content, path.name)
    lines = text.splitlines()
    facts = _comment_facts(lines) or facts_beside(path)
    _check_size(lines, path.name)
    across = _wavelengths_across(lines)
    if across is not None:
        return measurement_table.SpectralTable(
            units.axis_in_nm(across[1], None, axis_unit, path.name), across[0], across[2], facts,
            path.name)
    block, layout, notes = text_table.find_table(lines, path.name)
    stated_names, unit_row = text_table.names_and_units(lines, block, layout)
    numbers = text_table.numbers_of(block, layout, path.name)
    columns = numbers.shape[1]
    header = (stated_names + [""] * columns)[:columns]
    unit_row = (unit_row + [""] * columns)[:columns]
    axis = _axis_column(header, unit_row)
    filled = [index for index in range(columns) if header[index]
              or np.isfinite(numbers[:, index]).any()]
    again = _axis_again(numbers, header, axis, path.name)
    kept = [index for index in range(filled[-1] + 1) if index != axis and index not in again]
    names = [words.from_cell(header[index]) or f"column {index + 1}" for index in kept]
    if again:
        names = list(measurement_table.distinct(names))
    column_facts: dict[str, dict[str, str]] = {}
    if "unit" not in facts:
        percent = text_table.percent_columns(block)
        column_facts = {name: stated for name, index in zip(names, kept, strict=True) if (
            stated := _column_facts(header[index], unit_row[index], percent[index], facts))}
        facts = _line_facts(lines) | facts
    if text.startswith(SVC) and not stated_names and columns == len(SVC_NAMES):
        names, column_facts = list(SVC_NAMES[1:]), SVC_FACTS
    if header[0] == "W" and set(names) <= JAZ:
        column_facts = {name: {"unit": units.COUNTS} for name in names if name != "P"}
        if JAZ_IRRADIANCE in lines[0]:
            column_facts["P"] = {"unit": "uW cm-2 nm-1", "quantity": "irradiance"}
    main = _meant(names, column_facts)
    stated_axis = unit_row[axis], header[axis], text_table.stated(lines, text_table.STATED_X)
    nm = _wavelengths_nm(numbers[:, axis], stated_axis, path.name, [
        facts.get("unit"), *(stated.get("unit") for stated in column_facts.values())], axis_unit)
    return measurement_table.SpectralTable(
        nm, tuple(names), numbers[:, kept].T.reshape(len(kept), nm.size), facts, path.name,
        main, column_facts, notes)


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


def _comment_facts(lines: list[str]) -> dict[str, str]:
    facts: dict[str, str] = {}
    for line in lines:
        if line.lstrip().startswith("#"):
            key, colon, value = line.lstrip("# ").partition(":")
            if colon:
                facts[key.strip().lower()] = value.strip()
    return facts


def _check_size(lines: list[str], name: str) -> None:
    if not any(line.strip() and not line.lstrip().startswith("#") for line in lines):
        raise InputError(f"{name} is empty; a text file of spectra is needed")
    widest = max(line.count(",") + line.count(";") + line.count("\t") for line in lines)
    if widest > text_table.MAX_COLUMNS:
        raise InputError(f"{name} has lines of {widest + 1} columns; {text_table.MAX_COLUMNS} is "
                         "the limit: give one row for each wavelength, and split the file")


def _axis_column(header: list[str], unit_row: list[str]) -> int:
    """The column of the wavelengths: the first, unless another one alone is named so."""
    def named(cell: str) -> bool:
        return units.WAVELENGTH.match(cell.strip()) is not None \
            or (cell != "" and units.stated_axis(cell)[0] is not None)
    if not header or named(header[0]) or (unit_row and units.stated_axis(unit_row[0])[0]):
        return 0
    others = [index for index, cell in enumerate(header) if named(cell)]
    if len(others) > 1:     # beside wavenumbers
        others = [index for index in others if units.IS_WAVELENGTH.match(header[index].strip())]
    return others[0] if len(others) == 1 else 0


def _axis_again(numbers: np.ndarray, header: list[str], axis: int, name: str) -> list[int]:
    """Columns that repeat the wavelengths, as a Cary writes them beside each spectrum.

    Raises
    ------
    InputError
        If one holds other wavelengths than the first.
    """
    again = [index for index, cell in enumerate(header) if index != axis and cell
             and cell == header[axis] and units.WAVELENGTH.match(cell.strip())]
    for index in again:
        other, own = numbers[:, index], numbers[:, axis]
        both = np.isfinite(other) & np.isfinite(own)
        if np.any(np.abs(other - own)[both] > 1e-4 * np.abs(own[both])):
            raise InputError(f"{name}: column {index + 1} holds wavelengths of its own, other than "
                             "the first: export its spectra one by one, or on common wavelengths")
    return again


def _wavelengths_nm(wavelengths: np.ndarray, texts: tuple[str, str, str | None], name: str,
                    value_units: list[str | None], said: str | None) -> np.ndarray:
    """Wavelengths (P,) in nm by the unit that the table states nearest to its numbers: in the cell
    of its unit, its name, or a line of its own.

    Raises
    ------
    InputError
        Naming every unit that is not understood.
    """
    cell, header, line = texts
    stated = [units.stated_axis(f"[{cell.strip('[](){} ')}]"), units.stated_axis(header),
              units.stated_axis(line or "", is_unit=True)]
    unit, unknown = next((each for each in stated if each != (None, None)), (None, None))
    if unknown is not None and said is None:
        faults = [f"its wavelength axis states {unknown!r}, which is not understood"]
        faults += [f"its values state the unit {text!r}, which is not understood"
                   for text in dict.fromkeys(value_units)
                   if text is not None and units.value_factor(text) is None]
        raise InputError(f"{name}: {'; '.join(faults)}; an axis in {', '.join(units.TO_NM)} is "
                         f"read: where it is one of these, say so: {units.remedy('um')}")
    if unit is None and said is None and np.nanmin(wavelengths, initial=np.inf) > MAX_FIRST_NM:
        raise InputError(f"{name} states no unit of its wavelengths, which go from "
                         f"{np.nanmin(wavelengths):g} to {np.nanmax(wavelengths):g}: say which it "
                         f"is, angstrom, 1/cm or nm: {units.remedy('1/cm')}")
    return units.axis_in_nm(wavelengths, unit, said, name)


def _column_facts(header: str, unit_cell: str, percent: bool,
                  facts: dict[str, str]) -> dict[str, str]:
    """Quantity and unit of a column that its header, its unit or its cells state."""
    quantity, unit = units.stated_values(header)
    if unit_cell.strip():
        unit = units.stated_values(f"[{unit_cell.strip('[](){} ')}]", is_unit=True)[1] or unit
    if percent:
        unit = units.PERCENT
    return _known(unit, None if "quantity" in facts else quantity)


def _line_facts(lines: list[str]) -> dict[str, str]:
    """Quantity and unit of all values that a line of its own states."""
    text = text_table.stated(lines, text_table.STATED_Y)
    quantity, unit = (None, None) if text is None else units.stated_values(text, is_unit=True)
    return _known(unit, quantity)


def _known(unit: str | None, quantity: str | None) -> dict[str, str]:
    stated = {"unit": unit, "quantity": quantity}
    return {key: value for key, value in stated.items() if value is not None}


def _meant(names: list[str], column_facts: dict[str, dict[str, str]]) -> str | None:
    """The column that is meant where all others hold a spectrometer's counts."""
    rest = [name for name in names if column_facts.get(name, {}).get("unit") != units.COUNTS]
    return rest[0] if len(rest) == 1 < len(names) and names.count(rest[0]) == 1 else None


def _wavelengths_across(lines: list[str]) -> tuple[tuple[str, ...], np.ndarray, np.ndarray] | None:
    """Names, wavelengths (P,) and values (C, P) of a table with one row for each spectrum.

    None where no line holds ascending or descending wavelengths after its first cell, or the first
    column holds some.
    """
    for index, line in enumerate(lines):
        for delimiter in ("\t", ";", ",", text_table.BLANKS):
            if delimiter != text_table.BLANKS and line.count(delimiter) < MIN_ACROSS:
                continue
            header = text_table.cells_of(line, delimiter)
            labels = [cgats.BAND.fullmatch(cell) for cell in header]
            first = next((at for at, label in enumerate(labels) if label), 0)
            if first == 0 or np.isfinite(text_table.number(header[0])):
                continue
            nm = np.array([float(label[1]) for label in itertools.takewhile(
                lambda label: label is not None, labels[first:]) if label])
            steps = np.diff(nm)
            if nm.size >= MIN_ACROSS and (np.all(steps > 0) or np.all(steps < 0)):
                return _rows_across(lines[index + 1:], first, nm, delimiter)
    return None


def _rows_across(lines: list[str], first: int, nm: np.ndarray,
                 delimiter: str) -> tuple[tuple[str, ...], np.ndarray, np.ndarray] | None:
    """The spectra below a header of wavelengths, up to the first line that is none."""
    body = []
    for line in lines:
        cells = text_table.cells_of(line, delimiter)
        if any(cells) and not line.lstrip().startswith("#"):
            if len(cells) <= first:
                break
            body.append(cells)
    if not body:
        return None
    start = np.array([text_table.axis_number(cells[0]) for cells in body])
    if np.all(start >= measurement_table.MIN_NM) and np.all(np.diff(start) > 0):
        return None
    layouts = [layout for layout in text_table.LAYOUTS if layout[0] == delimiter]
    values = max((np.array([[text_table.number(cells[at], decimal) if at < len(cells) else np.nan
                             for at in range(first, first + nm.size)] for cells in body])
                  for _, decimal in layouts), key=lambda table: int(np.isfinite(table).sum()))
    texts = [at for at in range(first) if any(not np.isfinite(text_table.number(cells[at]))
                                              for cells in body)]
    column = texts[0] if texts else 0
    return measurement_table.distinct([words.from_cell(cells[column])
                                       for cells in body]), nm, values
