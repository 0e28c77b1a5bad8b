"""Folders of measured reflectances as curves on the prior's grid, and how many were left out.

Formats, known by their names: ENVI spectral libraries (.sli with .hdr), rawtoaces patches (.json),
the USGS library (.mat), data frames of R (.rda), zipped CSV (.zip), and CSV with wavelengths across
the header or down the first column. Nothing in a file is executed: no pickle, no evaluation.
"""
from __future__ import annotations

import csv
import io
import json
import re
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.system import archives
from spectrabox.sampling.prior.mixture import PRIOR_GRID

# a curve may end this far inside 400-700 nm; it is then continued by its end value
END_GAP_NM = 6.0
# of most curves, over a tenth of their wavelengths: no reflectance, whatever the file says
FAR_ABOVE_ONE = 1.2
DISTINCT = 0.004        # root mean square difference of curves that both count
# Data sets that hold absorbance log10(1 / reflectance) although they are called reflectance. Ikeogu
# et al. (2017): the values reach 1.95 in the water band at 1930 nm, and those at 450 nm grow with
# the carotenoids (correlation 0.88).
ABSORBANCES = ("ikeogu.2017.rda",)
Curves = tuple[np.ndarray, np.ndarray]  # wavelengths (Q,) in nm, reflectances (n, Q)


def read_library(folder: Path) -> np.ndarray:
    """All usable reflectances (n, 61) of a folder, at 400, 405 ... 700 nm.

    Left out are curves with gaps, that leave [0, 1] anywhere in 400-700 nm (fluorescent, or wrongly
    scaled), or that do not cover it to within 6 nm, and whole files whose values elsewhere show
    that they are no reflectances.

    Parameters
    ----------
    folder : Path

    Raises
    ------
    InputError
        If the folder is missing or holds no usable reflectance.
    """
    if not folder.is_dir():
        raise InputError(f"{folder} is not a folder; give folders that hold measured reflectances")
    usable_curves: list[np.ndarray] = []
    left_out: dict[str, int] = {}
    for path in sorted(folder.iterdir()):
        reader = READERS.get(path.suffix.lower())
        for nm, curves in reader(path) if reader else []:
            kept, why = usable(nm, curves)
            usable_curves.append(kept)
            left_out.update({reason: left_out.get(reason, 0) + count
                             for reason, count in why.items() if count})
    reflectances = np.concatenate([np.empty((0, PRIOR_GRID.nm.size)), *usable_curves])
    if not len(reflectances):
        raise InputError(f"{folder.resolve().name} holds no usable reflectance "
                         f"({left_out_words(left_out) or 'no file of a known format'}); known are "
                         f"{', '.join(READERS)}, with values between 0 and 1 from 400 to 700 nm")
    return reflectances


def usable(nm: np.ndarray, curves: np.ndarray) -> tuple[np.ndarray, dict[str, int]]:
    """Reflectances (n, 61) of the curves (m, Q) that can be trained on, and counts of the others.

    Parameters
    ----------
    nm : (Q,) array
        In any order.
    curves : (m, Q) array
        Reflectances; a value that is not finite is a gap.

    Returns
    -------
    reflectances : (n, 61) array
    left_out : dict
        Number of curves by the reason that they cannot be used.
    """
    order = np.argsort(nm)
    nm, curves = nm[order], curves[:, order]
    if nm.size < 2 or nm[0] > PRIOR_GRID.nm[0] + END_GAP_NM \
            or nm[-1] < PRIOR_GRID.nm[-1] - END_GAP_NM:
        return np.empty((0, PRIOR_GRID.nm.size)), {"400-700 nm not covered": len(curves)}
    finite = np.where(np.isfinite(curves), curves, np.nan)
    high = np.nanpercentile(finite[np.isfinite(curves).any(axis=1)], 90, axis=1)
    if high.size and np.median(high) > FAR_ABOVE_ONE:
        return (np.empty((0, PRIOR_GRID.nm.size)),
                {"far above 1: absorbance, or per cent": len(curves)})
    seen = (nm > PRIOR_GRID.nm[0] - 20) & (nm < PRIOR_GRID.nm[-1] + 20)
    nm, curves = nm[seen], curves[:, seen]
    whole = np.all(np.isfinite(curves), axis=1)
    at_grid = np.reshape([np.interp(PRIOR_GRID.nm, nm, curve) for curve in curves[whole]],
                         (-1, PRIOR_GRID.nm.size))
    inside = np.all((at_grid >= 0) & (at_grid <= 1), axis=1)
    return at_grid[inside], {"gaps": int(np.sum(~whole)), "outside 0 to 1": int(np.sum(~inside))}


def left_out_words(reasons: dict[str, int]) -> str:
    """Why curves could not be used, and how many."""
    return ", ".join(f"{count} {reason}" for reason, count in reasons.items() if count)


def without_near_duplicates(reflectances: np.ndarray) -> np.ndarray:
    """Rows (n, P) that differ by 0.004 (root mean square) or more from every row kept before.

    Parameters
    ----------
    reflectances : (n, 61) array
    """
    kept = np.empty_like(reflectances)
    count = 0
    for row in reflectances:
        if not count or np.min(np.mean((kept[:count] - row)**2, axis=1)) >= DISTINCT**2:
            kept[count] = row
            count += 1
    return kept[:count].copy()


def _read_envi(path: Path) -> list[Curves]:
    header_path = path.with_suffix(".hdr")
    if not header_path.exists():
        raise InputError(f"{path.name} needs its header {header_path.name} beside it")
    header = header_path.read_text(encoding="utf-8", errors="replace")
    fields = dict(re.findall(r"^([a-z ]+?)\s*=\s*(\{[^}]*\}|\S+)", header, flags=re.MULTILINE))
    try:
        nm = np.array([float(value) for value in fields["wavelength"].strip("{} \n").split(",")])
        lines, samples = int(fields["lines"]), int(fields["samples"])
        kind = {"4": "f4", "5": "f8"}[fields["data type"]]
    except (KeyError, ValueError) as error:
        raise InputError(
            f"{header_path.name} is no header of a spectral library ({error})") from None
    values = np.fromfile(path, dtype=("<" if fields.get("byte order", "0") == "0" else ">") + kind)
    if values.size != lines * samples or nm.size != samples:
        raise InputError(f"{path.name} holds {values.size} numbers; its header promises {lines} x "
                         f"{samples}")
    return [(nm, values.reshape(lines, samples).astype(float))]


def _read_patches(path: Path) -> list[Curves]:
    try:
        table = json.loads(path.read_text(encoding="utf-8"))["spectral_data"]["data"]["main"]
        nm = np.array([float(key) for key in table])
        return [(nm, np.array(list(table.values()), dtype=float).T)]
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError, RecursionError):
        return []


def _read_usgs(path: Path) -> list[Curves]:
    from scipy.io import loadmat, whosmat
    from scipy.io.matlab import MatReadError

    try:
        stated = {name: (shape, kind) for name, shape, kind in whosmat(path)}
        shape, kind = stated["datalib"]
        if kind != "double" or len(shape) != 2 or shape[1] < 4 or np.prod(
                shape, dtype=object) * 8 > archives.MAX_UNPACKED:
            return []
        library = np.asarray(loadmat(path, variable_names=["datalib"])["datalib"], dtype=float)
    except (*archives.DAMAGE, MatReadError):
        return []
    # Columns 0 to 2 are wavelength in micrometres, resolution and channel; -1.23e34 stands for no
    # measurement.
    values = np.where(np.abs(library[:, 3:]) < 100, library[:, 3:], np.nan)
    return [(library[:, 0] * 1000, values.T)]


def _read_r(path: Path) -> list[Curves]:
    columns = read_r_columns(path)
    named = {name: float(name.lstrip("Xx")) for name in columns
             if re.fullmatch(r"[Xx]?\d{3,4}(\.\d+)?", name)}
    if not named:
        return []
    values = np.array([columns[name] for name in named]).T
    if path.name in ABSORBANCES:
        values = 10**-values
    return [(np.array(list(named.values())), values)]


def _read_zip(path: Path) -> list[Curves]:
    try:
        with archives.opened_zip(path) as archive:
            names = sorted(name for name in archive.namelist() if name.lower().endswith(".csv"))
            return [curves for name in names for curves
                    in _parse_csv(archive.read(name).decode("utf-8-sig", errors="replace"))]
    except archives.DamagedArchiveError as error:
        raise InputError(f"{path.name} is no zip archive that can be unpacked ({error}); leave it "
                         "out, or unpack it") from None


def _read_csv(path: Path) -> list[Curves]:
    return _parse_csv(path.read_text(encoding="utf-8-sig", errors="replace"))


def _parse_csv(text: str) -> list[Curves]:
    rows = [row for row in csv.reader(io.StringIO(text)) if row and not row[0].startswith("#")]
    across = [_number(cell) for cell in rows[0]] if rows else []
    numbers = [value for value in across if 200 < value < 3000]
    if len(numbers) > 20 and len(numbers) == np.count_nonzero(np.isfinite(across)):
        start = len(across) - len(numbers)
        return [(np.array(numbers), _table([row[start:len(across)] for row in rows[1:]],
                                           len(numbers)))]
    width = len(rows[0]) if rows else 0
    table = _table(rows[1:], width)
    down = table[:, 0] if table.size else np.empty(0)
    if width > 1 and down.size > 20 and np.all(np.diff(down) > 0) and 200 < down[0] < 3000:
        return [(down, table[:, 1:].T)]
    return []


def _table(rows: list[list[str]], width: int) -> np.ndarray:
    whole = [[_number(cell) for cell in row] for row in rows if len(row) == width]
    return np.array(whole).reshape(-1, max(width, 1))


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return float("nan")


READERS: dict[str, Callable[[Path], list[Curves]]] = {
    ".sli": _read_envi, ".json": _read_patches, ".mat": _read_usgs, ".rda": _read_r,
    ".zip": _read_zip, ".csv": _read_csv}


# ---- R -------------------------------------------------------------------------------------------
# Numeric columns of a data frame saved by R (.rda), read and never executed.
#
# The XDR serialisation, versions 2 and 3. Layout: "R Internals", section 1.8. Every item starts
# with a 32-bit word: its type in the low byte, bit 9 for attributes, bit 10 for a tag.

PAIRLIST, SYMBOL, CHARACTERS, LOGICAL, INTEGER, REAL, STRINGS, LIST = 2, 1, 9, 10, 13, 14, 16, 19
REFERENCE, NIL = 255, 254
HAS_ATTRIBUTES, HAS_TAG = 1 << 9, 1 << 10


def read_r_columns(path: Path) -> dict[str, np.ndarray]:
    """Real and integer columns of every data frame of the file, by name.

    Parameters
    ----------
    path : Path

    Raises
    ------
    InputError
        If the file is no such file, is cut short, or holds more than plain vectors.
    """
    try:
        reader = _Reader(_unpacked(path.read_bytes()))
        top = reader.item()
    except (struct.error, IndexError, ValueError, OSError, RecursionError,
            archives.DamagedArchiveError) as error:
        raise InputError(f"{path.name} is no R data file that can be read ({error}); export the "
                         "table as CSV") from None
    columns: dict[str, np.ndarray] = {}
    for frame in (top or {}).values() if isinstance(top, dict) else []:
        if isinstance(frame, tuple) and isinstance(frame[0], list):
            names = frame[1].get("names", [])
            columns |= {name: column for name, column in zip(names, frame[0], strict=False)
                        if isinstance(column, np.ndarray)}
    return columns


def _unpacked(raw: bytes) -> bytes:
    raw = archives.unpacked(raw)
    if raw[:5] not in (b"RDX2\n", b"RDX3\n") or raw[5:7] != b"X\n":
        raise ValueError("it does not begin with RDX2 or RDX3")
    version = int.from_bytes(raw[7:11], "big")
    head = 19 if version == 2 else 23 + int.from_bytes(raw[19:23], "big")
    return raw[head:]


class _Reader:
    """A position in the bytes, and the symbols so far, to which later items refer by number."""

    def __init__(self, content: bytes) -> None:
        self.content, self.position = content, 0
        self.symbols: list[Any] = []

    def integer(self) -> int:
        self.position += 4
        return int(struct.unpack(">i", self.content[self.position - 4:self.position])[0])

    def array(self, dtype: str) -> np.ndarray:
        length, width = self.integer(), np.dtype(dtype).itemsize
        if length < 0 or self.position + length * width > len(self.content):
            raise ValueError("it is cut short")
        self.position += length * width
        start = self.position - length * width
        return np.frombuffer(self.content, dtype, length, start).astype(float)

    def item(self) -> Any:
        flags = self.integer()
        kind = flags & 255
        if kind == NIL:
            return None
        if kind == REFERENCE:
            return self.symbols[(flags >> 8) - 1]
        if kind == PAIRLIST:
            return self.pairs(flags)
        value = self.plain(kind)
        if flags & HAS_ATTRIBUTES and kind != CHARACTERS:
            return value, self.item() or {}
        return (value, {}) if kind == LIST else value

    def plain(self, kind: int) -> Any:
        if kind == SYMBOL:
            self.symbols.append(self.item())
            return self.symbols[-1]
        if kind == CHARACTERS:
            length = self.integer()
            self.position += max(length, 0)
            text = self.content[self.position - max(length, 0):self.position]
            return text.decode("utf-8", errors="replace")
        if kind in (LOGICAL, INTEGER):
            return self.array(">i4")
        if kind == REAL:
            return self.array(">f8")
        if kind in (STRINGS, LIST):
            return [self.item() for _ in range(self.integer())]
        raise ValueError(f"it holds an item of type {kind}")

    def pairs(self, flags: int) -> dict[str, Any]:
        tagged: dict[str, Any] = {}
        while flags & 255 == PAIRLIST:
            if flags & HAS_ATTRIBUTES:
                self.item()
            name = self.item() if flags & HAS_TAG else str(len(tagged))
            tagged[name] = self.item()
            flags = self.integer()
        return tagged
