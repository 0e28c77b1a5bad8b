"""What every reader of a spectral file gives: columns on one wavelength axis, with stated facts."""
from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records.spectra import Quantity

MIN_NM, MAX_NM = 100.0, 1e5
MAX_FILE_BYTES = 1_000_000_000
MAX_VALUES = 50_000_000     # of one file: more is no spectral file, or a damaged count
GAP_STEPS = 3.0             # a step this many times the usual one is a gap
UNITS = {"reflectance": Quantity.REFLECTANCE.value, "irradiance": Quantity.IRRADIANCE.value,
         "radiance": Quantity.RADIANCE.value, "relative": Quantity.RELATIVE.value}


@dataclass(frozen=True)
class SpectralTable:
    """Columns of one file: wavelengths (P,) in nm and values (C, P), with names and the stated
    facts.

    ``facts`` holds what the file states of all columns (quantity, unit, source, ...);
    ``column_facts`` what it states of one. ``main`` is the column that is meant where none is
    named; ``notes`` are sentences on what to beware of.
    """

    nm: np.ndarray
    names: tuple[str, ...]
    values: np.ndarray
    facts: dict[str, str]
    file: str
    main: str | None = None
    column_facts: dict[str, dict[str, str]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def fact(self, name: str, column: int) -> str | None:
        """What the file states of one column, or of all.

        Parameters
        ----------
        name : str
        column : int
            Index.
        """
        return self.column_facts.get(self.names[column], {}).get(name, self.facts.get(name))


def checked_table(table: SpectralTable) -> SpectralTable:
    """The table with its gaps noted, after the checks that every format needs.

    Parameters
    ----------
    table : SpectralTable

    Raises
    ------
    InputError
        If the wavelengths are not ascending, not in nm, or fewer than two.
    """
    nm = table.nm
    if nm.size < 2 or not table.names:
        raise InputError(f"{table.file} holds {nm.size} wavelengths and {len(table.names)} "
                         "spectra; at least two wavelengths and one spectrum are needed")
    if not np.all(np.isfinite(nm)):
        raise InputError(f"{table.file}: a wavelength is not a number; export the file again")
    if np.any(np.diff(nm) <= 0):
        turn = nm[1:][np.diff(nm) <= 0][0]
        raise InputError(f"{table.file}: wavelengths must ascend; they turn back at {turn:g} nm")
    if nm[0] < MIN_NM or nm[-1] > MAX_NM:
        raise InputError(f"{table.file}: wavelengths from {nm[0]:g} to {nm[-1]:g} cannot be in nm; "
                         "give them in nm")
    values = np.where(np.isfinite(table.values), table.values, np.nan)
    steps = np.diff(nm)
    wide = np.flatnonzero(steps > GAP_STEPS * np.median(steps))
    notes = [f"no wavelengths between {nm[gap]:g} and {nm[gap + 1]:g} nm" for gap in wide[:3]]
    notes += [f"{wide.size - 3} more such gaps"] if wide.size > 3 else []
    for name, row in zip(table.names, ~np.isfinite(values), strict=True):
        if row.any() and len(notes) < 8:
            notes.append(f"column {name!r} has no number at {int(row.sum())} of {nm.size} "
                         f"wavelengths ({nm[row][0]:g}-{nm[row][-1]:g} nm)")
    return SpectralTable(nm, table.names, values, table.facts, table.file, table.main,
                         table.column_facts, (*table.notes, *notes))


def file_content(path: Path) -> bytes:
    """What a file of spectra holds.

    Parameters
    ----------
    path : Path

    Raises
    ------
    InputError
        If it is missing, no file, too large, or cannot be read.
    """
    try:
        if path.exists() and not path.is_file() and not path.is_dir():
            raise InputError(f"{path} is a device or a pipe; a file of spectra is needed")
        if path.is_file() and path.stat().st_size > MAX_FILE_BYTES:
            raise InputError(f"{path.name} is larger than {MAX_FILE_BYTES // 1_000_000} MB; "
                             "give a file of spectra")
        return path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{path} is missing: give the file or correct its name") from None
    except IsADirectoryError:
        raise InputError(f"{path} is a folder; a file of spectra is needed") from None
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}") from None


def text_of(content: bytes, name: str) -> str:
    """A text file's characters; UTF-8 or, where it is not that, Latin-1.

    Parameters
    ----------
    content : bytes
    name : str
        Of the file, for errors.

    Raises
    ------
    InputError
        If the content is binary.
    """
    if b"\x00" in content:
        raise InputError(f"{name} is not a text file of spectra; export it as CSV")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("latin-1")
    if any(ord(letter) < 32 and letter not in "\t\r\n\f\x1a" for letter in text):
        raise InputError(f"{name} is not a text file of spectra; export it as CSV")
    return text


def number(text: str) -> float:
    """A number, or NaN where there is none; "inf" and "nan" are none."""
    try:
        value = float(text)
    except ValueError:
        return float("nan")
    return value if np.isfinite(value) else float("nan")


def distinct(names: list[str]) -> tuple[str, ...]:
    """The names, later ones of a kind numbered, so that each can be asked for."""
    seen: dict[str, int] = {}
    result = []
    for name in names:
        seen[name] = seen.get(name, 0) + 1
        result.append(name if seen[name] == 1 else f"{name} ({seen[name]})")
    return tuple(result)
