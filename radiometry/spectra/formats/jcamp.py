"""JCAMP-DX spectra: XYDATA in AFFN and in the squeezed forms, XYPOINTS, factors and units.

R. S. McDonald and P. A. Wilks, "JCAMP-DX: A Standard Form for Exchange of Infrared Spectra in
Computer Readable Form", Appl. Spectrosc. 42 (1988) 151. Ordinates of XYDATA lie evenly between
FIRSTX and LASTX; the abscissa at the start of each line, and after differences the repeated
ordinate, are checks. The package jcamp 1.3.2 was tried: it prints what fails its checks instead of
refusing it, and does not read squeezed values that are repeated.
"""
from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.spectra.formats import measurement_table, units

MAX_POINTS = 5_000_000
SQUEEZED = {letter: value for value, letter in enumerate("@ABCDEFGHI")} \
    | {letter: -value for value, letter in enumerate("abcdefghi", 1)}
DIFFERENCES = {letter: value for value, letter in enumerate("%JKLMNOPQR")} \
    | {letter: -value for value, letter in enumerate("jklmnopqr", 1)}
REPEATS = {letter: value for value, letter in enumerate("STUVWXYZs", 1)}
# Letters that stand in no AFFN number, whose exponent has an E.
SQUEEZED_FORM = re.compile(r"[@%A-DF-IJ-Za-df-ij-s]")
PLAIN = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?|\?")
TOKEN = re.compile(r"([@A-Ia-i%J-Rj-rS-Zs])(\d*\.?\d*)"
                   r"|([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]\d{1,3})?|\?)")
TABLES = ("XYDATA", "XYPOINTS")
EVEN, PAIRS = "(X++(Y..Y)", "(XY..XY)"
OTHER_DATA = {"PEAKTABLE": "a table of peaks", "PEAKASSIGNMENTS": "a list of peaks",
              "NTUPLES": "NTUPLES", "RADATA": "an interferogram", "XYDATA": "XYDATA"}


def is_jcamp(text: str) -> bool:
    """Whether text begins as JCAMP-DX does."""
    start = text[:4000].lstrip("\ufeff \t\r\n").upper()
    return start.startswith("##") and ("##JCAMP" in start.replace("-", "").replace("_", "")
                                       or start.startswith("##TITLE"))


def read_jcamp(content: bytes, path: Path) -> measurement_table.SpectralTable:
    """The spectra of a file that share their wavelengths, one column for each block.

    Parameters
    ----------
    content : bytes
    path : Path
        Its name, for errors.

    Raises
    ------
    InputError
        If it holds no spectrum, an axis in another unit, or fails a check of its own.
    """
    blocks = _blocks(measurement_table.text_of(content, path.name))
    spectra = [(labels, lines) for labels, lines in blocks if _form(labels) is not None]
    if not spectra:
        other = next((what for labels, _ in blocks for key, what in OTHER_DATA.items()
                      if key in labels), "no XYDATA and no XYPOINTS")
        raise InputError(f"{path.name} is JCAMP-DX that holds {other}; a spectrum as XYDATA or "
                         "XYPOINTS is needed")
    columns = [_curve(labels, lines, path.name) for labels, lines in spectra]
    titles = measurement_table.distinct([labels.get("TITLE", "") or "spectrum"
                                         for labels, _ in spectra])
    processed = [index for index, title in enumerate(titles) if "PROCESSED" in title.upper()]
    first = processed[0] if len(processed) == 1 else 0
    nm = columns[first][0]
    kept = [index for index, (own, _) in enumerate(columns) if np.array_equal(own, nm)]
    notes = () if len(kept) == len(columns) else (
        f"{len(columns) - len(kept)} of its {len(columns)} spectra have other wavelengths and were "
        "left out",)
    column_facts = {titles[index]: _stated(spectra[index][0]) for index in kept}
    source = " ".join((spectra[first][0].get("ORIGIN") or path.name).split())
    return measurement_table.SpectralTable(
        nm, tuple(titles[index] for index in kept), np.array([columns[index][1] for index in kept]),
        {"source": source}, path.name,
        titles[first] if len(kept) > 1 and len(processed) == 1 else None, column_facts, notes)


def _form(labels: Mapping[str, str]) -> str | None:
    """``EVEN`` or ``PAIRS``; None of a block without a spectrum."""
    stated = [re.sub(r"\s", "", labels[key]).upper() for key in TABLES if key in labels]
    return next((form for form in (EVEN, PAIRS) for each in stated if each.startswith(form)), None)


def _blocks(text: str) -> list[tuple[dict[str, str], list[str]]]:
    """Of each block of a file: its labelled data, and the lines of its table."""
    blocks: list[tuple[dict[str, str], list[str]]] = [({}, [])]
    label = ""
    for raw in text.splitlines():
        labels, lines = blocks[-1]
        line = raw.partition("$$")[0].rstrip()
        match = re.match(r"\s*##([^=]*)=(.*)", line)
        if match is None:
            if label in TABLES:
                lines.append(line)
            elif label and line.strip():
                labels[label] += f" {line.strip()}"
            continue
        label = re.sub(r"[\s\-/_]", "", match[1]).upper()
        if label == "TITLE" and labels:
            labels = {}
            blocks.append((labels, []))
        if label == "END":
            label = ""
            blocks.append(({}, []))
            continue
        labels[label] = match[2].strip()
    return blocks


def _curve(labels: Mapping[str, str], lines: list[str],
           name: str) -> tuple[np.ndarray, np.ndarray]:
    """Wavelengths (P,) in nm, ascending as the file has them, and values (P,)."""
    if "NMR" in (kind := labels.get("DATATYPE", "")).upper():
        raise InputError(f"{name} holds an {kind}; a spectrum of light is needed")
    unit, unknown = units.stated_axis(labels.get("XUNITS", ""), is_unit=True)
    if unit is None:
        raise InputError(f"{name} states its axis in {unknown or 'no unit (XUNITS)'!r}; an axis in "
                         f"{', '.join(units.TO_NM)} is read")
    commas = any(re.search(r"\d,\d", labels.get(key, "")) for key in (
        "FIRSTX", "LASTX", "FIRSTY", "MAXX", "MINX", "MAXY", "MINY"))
    lines = [re.sub(r"(\d),(\d)", r"\1.\2", line) if commas else line for line in lines]
    form = _form(labels)
    axis, values = _pairs(labels, lines, name) if form == PAIRS \
        else _even(labels, lines, name, commas)
    order = np.argsort(axis, kind="stable") if form == PAIRS and axis.size > 1 \
        and not np.all(np.diff(axis) < 0) else np.arange(axis.size)
    nm = units.to_nm(axis[order], unit)
    return nm, values[order] * _factor(labels, "YFACTOR", name, commas)


def _pairs(labels: Mapping[str, str], lines: list[str],
           name: str) -> tuple[np.ndarray, np.ndarray]:
    numbers = [float(token) if token != "?" else np.nan
               for line in lines for token in PLAIN.findall(line)]
    if len(numbers) < 4 or len(numbers) % 2:
        raise InputError(f"{name}: its XYPOINTS hold {len(numbers)} numbers, which are no pairs; "
                         "the file is cut")
    pairs = np.array(numbers).reshape(-1, 2)
    return pairs[:, 0] * _factor(labels, "XFACTOR", name), pairs[:, 1]


def _even(labels: Mapping[str, str], lines: list[str], name: str,
          commas: bool) -> tuple[np.ndarray, np.ndarray]:
    """Evenly spaced points of XYDATA, each line of which begins with its first abscissa."""
    first, last, count = (_label(labels, key, name, commas) for key in ("FIRSTX", "LASTX",
                                                                      "NPOINTS"))
    if not 2 <= count <= MAX_POINTS or count != int(count) or first == last:
        raise InputError(f"{name} states {count:g} points from {first:g} to {last:g}; at least two "
                         "are needed")
    axis = np.linspace(first, last, int(count))
    factor = _factor(labels, "XFACTOR", name, commas)
    step = abs(last - first) / (count - 1)
    squeezed = any(SQUEEZED_FORM.search(line) for line in lines)
    values: list[float] = []
    check = False
    for line in (line for line in lines if line.strip()):
        start, own, differences = _ordinates(line, squeezed, int(count), name)
        if check and own:
            if own[0] != values[-1] and (len(values) < count or len(own) > 1):
                raise InputError(f"{name}: the line at {start:g} begins with {own[0]:g}, but the "
                                 f"one before ends with {values[-1]:g}; the file is damaged")
            at, own = len(values) - 1, own[1:]
        else:
            at = len(values)
        # a step at most by the standard, and abscissas are rounded
        if at < axis.size and abs(start * factor - axis[at]) > 1.5 * step:
            raise InputError(f"{name}: a line of its table stands at {start * factor:g}, where "
                             f"{axis[at]:g} is due by FIRSTX, LASTX and NPOINTS; the file is "
                             "damaged")
        values += own
        check = differences
        if len(values) > count:
            break
    if len(values) != count:
        raise InputError(f"{name} states {count:g} points and holds "
                         f"{'more' if len(values) > count else len(values)}; the file is cut or "
                         "damaged")
    return axis, np.array(values)


def _ordinates(line: str, squeezed: bool, most: int, name: str) -> tuple[float, list[float], bool]:
    """Abscissa and ordinates of a line, and whether it ends in a difference."""
    tokens = [(match[1], match[2], match[3]) for match in TOKEN.finditer(line)] if squeezed else \
        [("", "", token) for token in PLAIN.findall(line)]
    if not tokens or tokens[0][2] in ("", "?"):
        raise InputError(f"{name}: a line of its table begins with no number: "
                         f"{line.strip()[:40]!r}; the file is damaged")
    values: list[float] = []
    difference: float | None = None
    for letter, digits, plain in tokens[1:]:
        if plain:
            values.append(float(plain) if plain != "?" else np.nan)
            difference = None
            continue
        if letter in REPEATS:
            times = int(float(f"{REPEATS[letter]}{digits}")) - 1
            if not values or not 0 <= times <= most:
                raise InputError(f"{name}: {letter}{digits} repeats what is not there; the file "
                                 "is damaged")
            for _ in range(times):
                values.append(values[-1] + (difference or 0.0))
            continue
        table = SQUEEZED if letter in SQUEEZED else DIFFERENCES
        size = float(f"{abs(table[letter])}{digits}")
        size = -size if letter.islower() else size
        if table is DIFFERENCES:
            if not values:
                raise InputError(f"{name}: a line begins with the difference {letter}{digits}; "
                                 "the file is damaged")
            difference = size
            values.append(values[-1] + size)
        else:
            difference = None
            values.append(size)
    return float(tokens[0][2]), values, difference is not None


def _label(labels: Mapping[str, str], key: str, name: str, commas: bool) -> float:
    text = labels.get(key, "")
    value = measurement_table.number(text.replace(",", ".") if commas else text)
    if not np.isfinite(value):
        raise InputError(f"{name}: XYDATA need {key}, which is {text!r}; export the file again")
    return value


def _factor(labels: Mapping[str, str], key: str, name: str, commas: bool = True) -> float:
    if key not in labels:
        return 1.0
    value = _label(labels, key, name, commas)
    if value == 0:
        raise InputError(f"{name}: {key} is 0; export the file again")
    return value


def _stated(labels: Mapping[str, str]) -> dict[str, str]:
    quantity, unit = units.stated_values(labels.get("YUNITS", ""), is_unit=True)
    return {key: value for key, value in (("quantity", quantity), ("unit", unit))
            if value is not None}
