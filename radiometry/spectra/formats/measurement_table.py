"""What every reader of a spectral file gives: columns on one wavelength axis, with stated facts."""
from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.radiometry.spectra.formats import units

MIN_NM, MAX_NM = 100.0, 1e5
MAX_FILE_BYTES = 1_000_000_000
MAX_VALUES = 50_000_000     # of one file: more is no spectral file, or a damaged count
DELETED = -1e30             # USGS writes -1.23e34 where a channel was deleted
MAX_JOINTS, MIN_OF_DETECTOR = 4, 4      # of a spectrometer of several detectors; wavelengths of one
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
    """The table with ascending wavelengths and its gaps noted, after the checks that every format
    needs.

    A descending axis is turned, channels that are marked as deleted are missing, rows that stand
    twice are taken once, and where two detectors overlap each is kept up to the middle.

    Parameters
    ----------
    table : SpectralTable

    Raises
    ------
    InputError
        Naming every fault: wavelengths that are no numbers, turn back, stand twice with different
        values or are not in nm; fewer than two.
    """
    nm = table.nm
    if nm.size < 2 or not table.names:
        raise InputError(f"{table.file} holds {nm.size} wavelengths and {len(table.names)} "
                         "spectra; at least two wavelengths and one spectrum are needed")
    if not np.all(np.isfinite(nm)):
        raise InputError(f"{table.file}: a wavelength is not a number; export the file again")
    values = np.where(np.isfinite(table.values), table.values, np.nan)
    deleted = values < DELETED
    values = np.where(deleted, np.nan, values)
    notes = [f"{int(deleted.sum())} values below {DELETED:g} mark deleted channels and were taken "
             "as missing"] if deleted.any() else []
    if np.sum(np.diff(nm) < 0) > np.sum(np.diff(nm) > 0):
        nm, values = nm[::-1], values[:, ::-1]
    nm, values, more = _each_wavelength_once(nm, values)
    notes += more
    nm, values, more = _joined_detectors(nm, values, table.names.index(
        table.main) if table.main in table.names else None)
    notes += more
    faults = []
    if np.any(np.diff(nm) <= 0):
        at = int(np.flatnonzero(np.diff(nm) <= 0)[0])
        faults.append(f"wavelengths must ascend; they turn back at {nm[at + 1]:g} nm"
                      if nm[at + 1] < nm[at] else
                      f"{nm[at]:g} nm stands twice, with different values")
    if nm.min() < MIN_NM or nm.max() > MAX_NM:
        unit = "um" if nm.min() >= 0.1 and nm.max() < 20 else "1/cm"
        faults.append(f"wavelengths from {nm.min():g} to {nm.max():g} cannot be in nm; give them "
                      f"in nm, state the unit in the header, as 'wavelength ({unit})', or say it, "
                      f"um, 1/cm, eV or another: {units.remedy(unit)}")
    if faults:
        raise InputError(f"{table.file}: {'; '.join(faults)}")
    steps = np.diff(nm)
    wide = np.flatnonzero(steps > GAP_STEPS * np.median(steps))
    notes += [f"no wavelengths between {nm[gap]:g} and {nm[gap + 1]:g} nm" for gap in wide[:3]]
    notes += [f"{wide.size - 3} more such gaps"] if wide.size > 3 else []
    for name, row in zip(table.names, ~np.isfinite(values), strict=True):
        if row.any() and len(notes) < 8:
            notes.append(f"column {name!r} has no number at {int(row.sum())} of {nm.size} "
                         f"wavelengths ({nm[row][0]:g}-{nm[row][-1]:g} nm)")
    return replace(table, nm=nm, values=values, notes=(*table.notes, *notes))


def _each_wavelength_once(nm: np.ndarray,
                          values: np.ndarray) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Wavelengths and values without rows that repeat the one before them exactly."""
    again = (np.diff(nm) == 0) & np.all(
        (np.diff(values) == 0) | (np.isnan(values[:, 1:]) & np.isnan(values[:, :-1])), axis=0)
    if not again.any():
        return nm, values, []
    keep = np.r_[True, ~again]
    return nm[keep], values[:, keep], [f"{int(again.sum())} rows that stand twice were taken once"]


def _joined_detectors(nm: np.ndarray, values: np.ndarray,
                      main: int | None) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Wavelengths and values of detectors that overlap, each kept up to the middle of the overlap.

    What turns back otherwise is left as it is. The note compares the main column, else all.
    """
    joints = np.flatnonzero(np.diff(nm) < 0) + 1
    if not 0 < joints.size <= MAX_JOINTS:
        return nm, values, []
    parts = [slice(first, last) for first, last in zip([0, *joints], [*joints, nm.size],
                                                       strict=True)]
    if any(nm[part].size < MIN_OF_DETECTOR for part in parts):
        return nm, values, []
    first, last = (np.array([nm[part][at] for part in parts]) for at in (0, -1))
    overlap = last[:-1] - first[1:]
    shortest = np.minimum((last - first)[:-1], (last - first)[1:])
    if np.any(overlap >= shortest / 2):
        return nm, values, []
    middle = (last[:-1] + first[1:]) / 2
    keep = np.ones(nm.size, bool)
    notes = []
    for joint, before, after in zip(range(joints.size), parts[:-1], parts[1:], strict=True):
        keep[before] &= nm[before] <= middle[joint]
        keep[after] &= nm[after] > middle[joint]
        both = nm[after][nm[after] <= last[joint]]
        compared = values if main is None else values[main:main + 1]
        apart = max((float(np.nanmax(np.abs(np.interp(both, nm[before], row[before])
                                            - row[after][:both.size])))
                     for row in compared if np.isfinite(row[before]).all()
                     and np.isfinite(row[after][:both.size]).all()), default=float("nan"))
        notes.append(f"two detectors overlap between {first[joint + 1]:g} and {last[joint]:g} nm; "
                     f"the first was taken up to {middle[joint]:g} nm, the second from there on. "
                     f"Their values differ there by up to {apart:.3g}")
    return nm[keep], values[:, keep], notes


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
    """A text file's characters without zeros; UTF-8, UTF-16 where its mark says so, else Latin-1.

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
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        try:
            return content.decode("utf-16")
        except UnicodeDecodeError:
            raise InputError(f"{name} is not a text file of spectra; export it as CSV") from None
    padded = b"\x00" in content         # AvaSoft fills names up with zeros
    content = content.replace(b"\x00", b"")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        text, padded = content.decode("latin-1"), True
    if padded and any(ord(letter) < 32 and letter not in "\t\r\n\f\x1a" for letter in text):
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
