"""CGATS text: Argyll's .sp, .ti3 and .ccss, and what i1Profiler and others export.

Band labels are rounded (106 bands over 380-730 nm print ``SPEC_383``): wavelengths come from start,
end and number of bands where the file states them. Values are divided by SPECTRAL_NORM. Argyll's
emission is in mW (spectro/inst.h).
"""
from __future__ import annotations

import re
import shlex
from pathlib import Path

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.radiometry.spectra.formats import measurement_table

BAND = re.compile(r"(?:SPEC_|SPECTRAL_NM_?|SPECTRAL_|NM_?|R_?)?(\d{3,4}(?:\.\d+)?)(?:NM)?",
                  re.IGNORECASE)
NAMES = ("SAMPLE_NAME", "SAMPLE_ID", "SAMPLEID", "SAMPLE_LOC", "SAMPLEID_NAME")
LOCATION = "SAMPLE_LOC"     # where a sample lies on its chart, as "A1"
MEASUREMENTS = {"EMISSION": ("radiance", "mW m-2 sr-1 nm-1"),
                "AMBIENT": ("irradiance", "mW m-2 nm-1"),
                "REFLECTIVE": ("reflectance", "1"), "TRANSMISSIVE": ("transmittance", "1")}
WRITTEN = {Quantity.RADIANCE: ("EMISSION", 1000.0), Quantity.IRRADIANCE: ("AMBIENT", 1000.0),
           Quantity.REFLECTANCE: ("REFLECTIVE", 1.0), Quantity.RELATIVE: (None, 1.0)}


def is_cgats(text: str) -> bool:
    """Whether text is laid out as CGATS."""
    return "BEGIN_DATA_FORMAT" in text and "BEGIN_DATA" in text.replace("BEGIN_DATA_FORMAT", "")


def read_cgats(content: bytes, path: Path) -> measurement_table.SpectralTable:
    """Every sample of the first table that has spectra, one column each.

    Parameters
    ----------
    content : bytes
    path : Path
        Its name, for errors.

    Raises
    ------
    InputError
    """
    keys, fields, rows = _first_table(measurement_table.text_of(content, path.name), path.name)
    bands = [(index, float(match[1])) for index, field in enumerate(fields)
             if (match := BAND.fullmatch(field))]
    if len(bands) < 2:
        raise InputError(f"{path.name} holds no spectra, only {', '.join(fields[:6])}; export it "
                         "with spectral data")
    nm = _wavelengths(keys, [label for _, label in bands], path.name)
    norm = measurement_table.number(keys.get("SPECTRAL_NORM", "1"))
    if not norm > 0:
        raise InputError(f"{path.name}: SPECTRAL_NORM is {keys.get('SPECTRAL_NORM')!r}; a positive "
                         "number is needed")
    values = np.array([[measurement_table.number(row[index]) for index, _ in bands]
                       for row in rows]) / norm
    order = np.argsort(nm, kind="stable")
    facts = {"source": keys.get("DESCRIPTOR", path.name), **_stated(keys)}
    names = measurement_table.distinct(_names(fields, rows))
    column = [field.upper() for field in fields].index(LOCATION) \
        if LOCATION in [field.upper() for field in fields] else None
    stated = {} if column is None else {name: {"location": row[column]}
                                        for name, row in zip(names, rows, strict=True)}
    return measurement_table.SpectralTable(nm[order], names, values[:, order], facts, path.name,
                                           None, stated)


def sp_text(nm: np.ndarray, columns: dict[str, np.ndarray], *, quantity: Quantity,
            source: str) -> str:
    """Argyll's .sp of spectra (P,) on an even grid, nine significant digits.

    Parameters
    ----------
    nm : (P,) array
    columns : dict of (P,) arrays
        By name.
    quantity : Quantity
    source : str
        Stored in the file.

    Raises
    ------
    InputError
        If the grid is uneven: the format states first, last and number only.
    """
    if np.ptp(np.diff(nm)) > 1e-6 * np.diff(nm).mean():
        raise InputError("a .sp file needs evenly spaced wavelengths; resample first, as with "
                         "--grid 400:700:5")
    kind, factor = WRITTEN[quantity]
    labels = " ".join(f"SPEC_{wavelength:.0f}" for wavelength in nm)
    lines = ["SPECT", "", f'DESCRIPTOR "{_quoted(source)}"', 'ORIGINATOR "spectrabox"']
    lines += [f'MEAS_TYPE "{kind}"'] if kind else ['KEYWORD "QUANTITY"', 'QUANTITY "relative"']
    lines += [f'SPECTRAL_BANDS "{nm.size}"', f'SPECTRAL_START_NM "{nm[0]:.9g}"',
              f'SPECTRAL_END_NM "{nm[-1]:.9g}"', 'SPECTRAL_NORM "1.0"', "",
              f"NUMBER_OF_FIELDS {nm.size + 1}", "BEGIN_DATA_FORMAT",
              f"SAMPLE_NAME {labels}",
              "END_DATA_FORMAT", "", f"NUMBER_OF_SETS {len(columns)}", "BEGIN_DATA"]
    lines += [" ".join([f'"{_quoted(name)}"', *(f"{value * factor:.9g}" for value in values)])
              for name, values in columns.items()]
    return "\n".join([*lines, "END_DATA", ""])


def _quoted(text: str) -> str:
    return " ".join(text.replace('"', "'").split())


def _stated(keys: dict[str, str]) -> dict[str, str]:
    measured = keys.get("MEAS_TYPE", "").upper()
    if measured in MEASUREMENTS:
        quantity, unit = MEASUREMENTS[measured]
        return {"quantity": quantity, "unit": unit}
    if keys.get("DEVICE_CLASS", "").upper() in ("OUTPUT", "INPUT"):
        return {"quantity": "reflectance", "unit": "1"}
    return {"quantity": "relative",
            "unit": "relative"} if keys.get("QUANTITY") == "relative" else {}


def _first_table(text: str, name: str) -> tuple[dict[str, str], list[str], list[list[str]]]:
    """Keywords, field names and rows of the first table with bands, else of the first."""
    tables = []
    keys: dict[str, str] = {}
    fields: list[str] = []
    cells: list[str] = []
    mode = ""
    for line in text.splitlines():
        words = _words(line, name)
        if not words or words[0].startswith("#"):
            continue
        if words[0] in ("BEGIN_DATA_FORMAT", "BEGIN_DATA"):
            mode = words[0]
            fields, cells = ([], []) if mode == "BEGIN_DATA_FORMAT" else (fields, [])
        elif words[0] == "END_DATA_FORMAT":
            mode = ""
        elif words[0] == "END_DATA":
            mode = ""
            tables.append((dict(keys), fields, _rows(fields, cells, keys, name)))
        elif mode == "BEGIN_DATA_FORMAT":
            fields = fields + words
        elif mode == "BEGIN_DATA":
            cells.extend(words)
        elif len(words) > 1:
            keys[words[0]] = " ".join(words[1:])
        elif words[0].upper() in MEASUREMENTS:  # some writers put the bare word
            keys["MEAS_TYPE"] = words[0]
    if not tables:
        raise InputError(f"{name} ends before END_DATA: the file is cut; export it again")
    spectral = [table for table in tables if sum(BAND.fullmatch(field) is not None
                                                 for field in table[1]) > 1]
    return (spectral or tables)[0]


def _words(line: str, name: str) -> list[str]:
    if '"' not in line:
        return line.split()
    try:
        reader = shlex.shlex(line, posix=True)
        reader.whitespace_split, reader.quotes = True, '"'
        reader.escape, reader.commenters = "", "#"
        return list(reader)
    except ValueError:
        raise InputError(f"{name}: a quotation mark is not closed in {line[:50]!r}; correct the "
                         "file") from None


def _rows(fields: list[str], cells: list[str], keys: dict[str, str], name: str) -> list[list[str]]:
    if not fields or not cells or len(cells) % len(fields) or len(
            cells) > measurement_table.MAX_VALUES:
        raise InputError(f"{name}: {len(cells)} cells do not fill rows of {len(fields)} fields; "
                         "the file is cut or was edited")
    rows = [cells[start:start + len(fields)] for start in range(0, len(cells), len(fields))]
    stated = keys.get("NUMBER_OF_SETS")
    if stated is not None and stated != str(len(rows)):
        raise InputError(f"{name} states {stated} samples and holds {len(rows)}; the file is cut "
                         "or was edited")
    return rows


def _wavelengths(keys: dict[str, str], labels: list[float], name: str) -> np.ndarray:
    stated = [measurement_table.number(keys.get(key, ""))
              for key in ("SPECTRAL_BANDS", "SPECTRAL_START_NM", "SPECTRAL_END_NM")]
    if not all(np.isfinite(stated)):
        return np.array(labels)
    bands, first, last = stated
    nm = np.linspace(first, last, len(labels))
    if bands != len(labels) or np.max(np.abs(nm - labels)) > 1.0:
        raise InputError(f"{name} states {bands:g} bands from {first:g} to {last:g} nm, but labels "
                         f"{len(labels)} from {labels[0]:g} to {labels[-1]:g} nm; correct one of "
                         "them")
    return nm


def _names(fields: list[str], rows: list[list[str]]) -> list[str]:
    upper = [field.upper() for field in fields]
    for name in NAMES:
        if name in upper:
            return [row[upper.index(name)] for row in rows]
    return [f"sample {number}" for number in range(1, len(rows) + 1)]
