"""Text files of spectrometers: SVC .sig, Spectral Evolution .sed, Ocean Optics .txt."""
from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.spectra.formats.measurement_table import SpectralTable, number, text_of

SVC_TITLE = "Spectra Vista"
PERCENT = {"quantity": "reflectance", "unit": "percent"}
COUNTS = {"quantity": "raw", "unit": "counts"}
# radiance or irradiance whose unit the file does not state
NO_UNIT = {"quantity": "relative", "unit": "relative"}
SED_COLUMNS = {"reflect. %": ("reflectance", PERCENT), "tgt./ref. %": ("reflectance", PERCENT),
               "reflect. [1.0]": ("reflectance", {"quantity": "reflectance", "unit": "1"}),
               "rad. (target)": ("target radiance", NO_UNIT),
               "rad. (ref.)": ("reference radiance", NO_UNIT),
               "irrad. (target)": ("target irradiance", NO_UNIT),
               "irrad. (ref.)": ("reference irradiance", NO_UNIT),
               "norm. dn (target)": ("target counts", COUNTS),
               "norm. dn (ref.)": ("reference counts", COUNTS)}
# before the spectrum in files of SpectraSuite and OceanView, and after it in some
OCEAN_START, OCEAN_END = re.compile(r"^>+Begin .*Spectral Data<+", re.MULTILINE), ">>>>>End"
NO_UNIT_NOTE = "the file states no unit for its radiance or irradiance: it is taken as relative"


def is_svc(text: str) -> bool:
    """Whether text is an SVC signature file."""
    return SVC_TITLE in text[:200] and re.search(r"^\s*data\s*=", text, re.MULTILINE) is not None


def is_sed(text: str) -> bool:
    """Whether text is a Spectral Evolution file."""
    # the column of wavelengths may follow one of channel numbers
    return all(re.search(pattern, text, re.MULTILINE)
               for pattern in (r"^Data:", r"^(\"?Chan[^\t,]*[\t,])?\"?Wvl"))


def is_ocean(text: str) -> bool:
    """Whether text is a spectrum as SpectraSuite or OceanView of Ocean Optics save it."""
    return OCEAN_START.search(text) is not None


def read_ocean(content: bytes, path: Path) -> SpectralTable:
    """The one spectrum of a text file of SpectraSuite or OceanView, with decimal point or comma.

    Its header states neither quantity nor unit.

    Parameters
    ----------
    content : bytes
    path : Path
        Its name, for errors.

    Raises
    ------
    InputError
        If it is cut, or its axis is another than wavelengths.
    """
    text = text_of(content, path.name)
    start = OCEAN_START.search(text)
    assert start is not None
    header = [line.partition(":") for line in text[:start.start()].splitlines()]
    keys = {key.strip().lower(): value.strip() for key, _, value in header}
    axis = keys.get("xaxis mode", "Wavelengths")
    if axis.lower() != "wavelengths":
        raise InputError(f"{path.name} has {axis!r} for its x axis; save it with wavelengths in nm")
    table, _, _ = text[start.end():].partition(OCEAN_END)
    rows = [[number(cell) for cell in line.replace(",", ".").split()]
            for line in table.splitlines() if line.strip()]
    numbers = _rectangle(rows, 2, path.name)
    facts = {"source": f"{keys.get('spectrometer') or 'Ocean Optics'}, {path.name}"}
    return SpectralTable(numbers[:, 0], ("value",), numbers[:, 1:].T, facts, path.name)


def read_svc(content: bytes, path: Path) -> SpectralTable:
    """Reflectance in percent, with reference and target in the unit that the file names.

    Parameters
    ----------
    content : bytes
    path : Path
        Its name, for errors.

    Raises
    ------
    InputError
    """
    lines = text_of(content, path.name).splitlines()
    start = next(index for index, line in enumerate(lines) if re.match(r"\s*data\s*=", line))
    keys = {key.strip().lower(): value.strip()
            for key, _, value in (line.partition("=") for line in lines[:start])}
    rows = [[number(cell) for cell in line.replace(",", " ").split()] for line in lines[start + 1:]
            if line.strip()]
    numbers = _rectangle(rows, 4, path.name)
    kinds = [kind.strip().lower() for kind in keys.get("units", "").split(",")]
    pairs = zip(("reference", "target"), kinds, strict=False)
    stated = {name: COUNTS if kind == "counts" else NO_UNIT for name, kind in pairs if kind}
    facts = {"source": f"{keys.get('instrument', 'SVC')}, {path.name}"}
    notes = (NO_UNIT_NOTE,) if NO_UNIT in stated.values() else ()
    return SpectralTable(numbers[:, 0], ("reflectance", "reference", "target"),
                         numbers[:, [3, 1, 2]].T, facts, path.name,
                         "reflectance", {"reflectance": PERCENT, **stated}, notes)


def read_sed(content: bytes, path: Path) -> SpectralTable:
    """Every column of a .sed file, reflectance first where it has it.

    Parameters
    ----------
    content : bytes
    path : Path
        Its name, for errors.

    Raises
    ------
    InputError
    """
    lines = text_of(content, path.name).splitlines()
    start = next(index for index, line in enumerate(lines) if line.startswith("Data:"))
    keys = {key.strip().lower(): value.strip()
            for key, _, value in (line.partition(":") for line in lines[:start])}
    table = [line for line in lines[start + 1:] if line.strip()]
    mark = "\t" if table and "\t" in table[0] else ","
    header = [cell.strip().strip('"') for cell in table[0].split(mark)] if table else []
    numbers = _rectangle([[number(cell) for cell in line.split(mark)] for line in table[1:]],
                         len(header), path.name)
    wavelength = next((index for index, cell in enumerate(header)
                       if cell.lower().startswith("wvl")), None)
    if wavelength is None:
        raise InputError(f"{path.name} has no column Wvl, only {', '.join(header[:6])}; export it "
                         "again")
    columns: dict[str, int] = {}
    stated: dict[str, dict[str, str]] = {}
    for index, cell in enumerate(header):
        name, facts = SED_COLUMNS.get(cell.lower(), (cell or f"column {index + 1}", {}))
        if index != wavelength and not cell.lower().startswith("chan") and name not in columns:
            columns[name], stated[name] = index, facts
    if not columns:
        raise InputError(f"{path.name} has no column of values beside its wavelengths; export it "
                         "again")
    main = "reflectance" if "reflectance" in columns else next(iter(columns)) if len(
        columns) == 1 else None
    source = " ".join(filter(None, (keys.get("instrument"), keys.get("file name", path.name))))
    return SpectralTable(numbers[:, wavelength], tuple(columns),
                         numbers[:, list(columns.values())].T,
                         {"source": source}, path.name, main,
                         {name: facts for name, facts in stated.items() if facts}, (NO_UNIT_NOTE,)
                         if NO_UNIT in stated.values() else ())


def _rectangle(rows: list[list[float]], width: int, name: str) -> np.ndarray:
    if len(rows) < 2 or width < 2 or any(len(row) != width for row in rows):
        bad = next((index for index, row in enumerate(rows, 1) if len(row) != width), 0)
        where = f"row {bad} has {len(rows[bad - 1])}" if bad else f"there are {len(rows)} rows"
        raise InputError(f"{name}: its table should have {width} columns in every row, but "
                         f"{where}; the file is cut or was edited")
    return np.array(rows)
