"""A plain CSV of spectra, and what it states in a file beside it.

The table has one header row and numbers, no comment lines: colour-science, pandas and spreadsheets
read it. Quantity, unit and source lie in ``NAME.csv-metadata.json``, after the W3C's Metadata
Vocabulary for Tabular Data (CSV on the Web, 2015), whose prefixes ``dc`` and ``schema`` are.
"""
from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np

from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.radiometry.system.words import cell, plain

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
    described += [{"titles": _title(name), "dc:title": plain(name), "datatype": "number",
                   QUANTITY: quantity.name.lower(), UNIT: quantity.value} for name in columns]
    return json.dumps({"@context": "http://www.w3.org/ns/csvw", "url": file,
                       SOURCE: plain(" ".join(source.split())),
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
    return cell(MARKS.sub(" ", name))
