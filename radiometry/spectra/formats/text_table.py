"""A table of wavelengths and values found inside a text, whatever stands before and after it.

Delimiter, decimal mark, column names, units and the end of the table are judged on the block of
numbers: the longest run of lines that begin with a number and hold another. A preamble may hold
commas, semicolons and numbers of its own.
"""
from __future__ import annotations

import csv
import re
from collections.abc import Sequence

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.spectra.formats import units

MAX_COLUMNS = 20_000        # spectra in one file
BLANKS = " "
# In order of preference where two layouts read a block equally well.
LAYOUTS = (("\t", "."), (";", "."), (",", "."), ("\t", ","), (";", ","), (BLANKS, "."),
           (BLANKS, ","), (",", ","))
NUMBER = re.compile(r"[+\-−]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][+\-]?\d+)?")
GROUPED = re.compile(r"[+\-−]?\d{1,3}(?:,\d{3})+\.\d*")        # 1,000.5
THOUSAND = re.compile(r"\d{1,3}(?:[,.' \u00a0\u202f]\d{3})+")   # or a number with a decimal mark
FIRST_NUMBER = re.compile(r"\s*[\"']?[+\-−]?[\d.,]")
MISSING = {"", "-", "--", "na", "n/a", "nan", "null", "none", "inf", "-inf", "+inf", "#n/a"}
COMMENT = re.compile(r"\s*(?:#|%|//|!|\*)+\s*")
MIN_SHARE = 0.6             # of the words of a line that are numbers
HEADER_ROWS = 4             # looked at above the numbers
CONTINUES = 5               # steps at most from one part of a broken table to the next
# Lines of numbers at an end of a table that are not of it: at most so many, of so many rows, and
# this many times the next step off it.
MAX_EDGE, MIN_TRIMMED, FAR_OFF = 3, 8, 30
MIN_SECOND_TABLE = 5        # rows of another block of numbers that is mentioned

STATED_X = re.compile(
    r"\W*(?:x[ _-]*(?:axis[ _-]*)?(?:units?|label|mode)|abscissa(?:[ _-]*units?)?"
    r"|(?:wave(?:length)?s?|axis)[ _-]*units?)\s*[:=,;\t]\s*(.*)", re.IGNORECASE)
STATED_Y = re.compile(
    r"\W*(?:y[ _-]*(?:axis[ _-]*)?(?:units?|label)|ordinate(?:[ _-]*units?)?"
    r"|(?:data|value|reflectance|irradiance|radiance)s?[ _-]*units?)\s*[:=,;\t]\s*(.*)",
    re.IGNORECASE)


Layout = tuple[str, str]        # delimiter, decimal mark
Block = dict[int, list[str]]    # cells of each row, by the index of its line in the text


def cells_of(line: str, delimiter: str) -> list[str]:
    """The cells of one line, stripped."""
    if delimiter == BLANKS:
        return [cell.rstrip(",;") for cell in line.split()]
    if '"' not in line:
        return [cell.strip() for cell in line.split(delimiter)]
    try:
        rows = list(csv.reader([line], delimiter=delimiter, skipinitialspace=True))
    except csv.Error:
        return [cell.strip() for cell in line.split(delimiter)]
    return [cell.strip() for cell in rows[0]] if rows else []


def number(cell: str, decimal: str = ".") -> float:
    """A number with that decimal mark, or NaN; a sign of per cent after it is passed over."""
    text = cell.strip().removesuffix("%").rstrip()
    if decimal == "." and GROUPED.fullmatch(text):
        text = text.replace(",", "")
    if decimal == "," and "," in text:
        if "." in text:
            return float("nan")
        text = text.replace(",", ".", 1)
    if NUMBER.fullmatch(text) is None:
        return float("nan")
    value = float(text.replace("−", "-").replace("d", "e").replace("D", "e"))
    return value if np.isfinite(value) else float("nan")


def axis_number(cell: str, decimal: str = ".") -> float:
    """The number of a wavelength's cell, which may have its nm after it, as "400 nm"."""
    return number(re.sub(r"\s*nm$", "", cell, flags=re.IGNORECASE), decimal)


def find_table(lines: Sequence[str], name: str) -> tuple[Block, Layout, tuple[str, ...]]:
    """The rows of the table of a text, its layout, and notes on other tables.

    Parameters
    ----------
    lines : sequence of str
    name : str
        Of the file, for errors.

    Raises
    ------
    InputError
        If there is none, or a line within it is none of its rows.
    """
    layout, block = _longest_block(lines, name)
    return block, layout, _after_and_before(lines, block, layout, name)


def numbers_of(block: Block, layout: Layout, name: str) -> np.ndarray:
    """Numbers (P, C) of a table, NaN where a cell holds none.

    Parameters
    ----------
    block, layout
        From ``find_table``.
    name : str
        Of the file, for errors.

    Raises
    ------
    InputError
        If it holds none beside its first column, or its decimal commas were taken for delimiters.
    """
    decimal = layout[1]
    numbers = np.full((len(block), max(len(row) for row in block.values())), np.nan)
    for row, cells in enumerate(block.values()):
        numbers[row, 0] = axis_number(cells[0], decimal)
        numbers[row, 1:len(cells)] = [number(cell, decimal) for cell in cells[1:]]
    if not np.isfinite(numbers[:, 1:]).any():
        raise InputError(f"{name} holds no table of wavelengths and values; beside the "
                         f"first cells of its {len(numbers)} rows it holds no numbers")
    if layout == (",", "."):
        _refuse_split_decimals(block, name)
    return numbers


def _longest_block(lines: Sequence[str], name: str) -> tuple[Layout, Block]:
    candidates = [index for index, line in enumerate(lines) if FIRST_NUMBER.match(line)]
    best: tuple[Layout, Block] | None = None
    best_score = 0.0
    for delimiter, decimal in LAYOUTS:
        if delimiter != BLANKS and not any(delimiter in lines[index] for index in candidates):
            continue
        for block, score in _blocks(lines, candidates, (delimiter, decimal)):
            if best is None or score > best_score + 1e-9:
                best, best_score = ((delimiter, decimal), _without_edges(block, decimal)), score
    if best is None or len(best[1]) < 2:
        single = sum(number(lines[index]) == number(lines[index]) for index in candidates)
        raise InputError(f"{name} holds no table of wavelengths and values; " + (
            f"its {single} lines of one number lack the wavelengths: put them in a first column"
            if single >= MIN_SECOND_TABLE else "a CSV with a column of nm is needed"))
    return best


def _blocks(lines: Sequence[str], candidates: Sequence[int],
            layout: Layout) -> list[tuple[Block, float]]:
    """Runs of rows in one layout, each with the sum of its numeric shares; empty lines and comment
    lines do not end one.
    """
    blocks: list[tuple[Block, float]] = []
    rows: Block = {}
    score = 0.0
    for index in candidates:
        cells = cells_of(lines[index], layout[0])
        share = _numeric_share(cells, layout[1])
        if layout[0] == BLANKS and share < MIN_SHARE:       # prose that begins with a number
            share = 0.0
        if rows and (share == 0 or any(_ends_a_table(lines[between]) for between in
                                       range(next(reversed(rows)) + 1, index))):
            blocks.append((rows, score))
            rows, score = {}, 0.0
        if share > 0:
            rows[index] = cells
            score += share
    return [*blocks, (rows, score)] if rows else blocks


def _without_edges(block: Block, decimal: str) -> Block:
    """A block without lines of numbers of the preamble right above it, or of a trailer below.

    They have another number of cells, or lie against the order of the axis or far off it.
    """
    widths = [len(row) for row in block.values()]
    width = max(set(widths), key=widths.count)
    axis = np.array([axis_number(row[0], decimal) for row in block.values()])
    first, last = 0, len(axis)
    if len(axis) >= MIN_TRIMMED:
        steps = np.diff(axis)
        against = steps * float(np.median(steps)) <= 0
        size = np.abs(steps)
        far = np.r_[size[:-1] > FAR_OFF * size[1:], False]
        off_edge = [at for at in range(MAX_EDGE) if against[at] or far[at] or widths[at] != width]
        first = 1 + max(off_edge, default=-1)
        last -= max((at for at in range(1, MAX_EDGE) if against[-at]
                     or size[-at] > FAR_OFF * size[-at - 1]), default=0)
    return dict(list(block.items())[first:last])


def _ends_a_table(line: str) -> bool:
    return bool(line.strip()) and not line.lstrip().startswith("#")


def _numeric_share(cells: Sequence[str], decimal: str) -> float:
    """Share of the cells of a row that are numbers or empty; 0 of what is no row of a table."""
    if len(cells) < 2 or not np.isfinite(axis_number(cells[0], decimal)):
        return 0.0
    values = [cell.lower() in MISSING or np.isfinite(number(cell, decimal)) for cell in cells[1:]]
    return (1 + sum(values)) / len(cells) if any(values) else 0.01


def _after_and_before(lines: Sequence[str], block: Block, layout: Layout,
                      name: str) -> tuple[str, ...]:
    """Notes on other tables of the text.

    Raises
    ------
    InputError
        Where one goes on with this one: a line between them is damaged.
    """
    delimiter, decimal = layout
    first, last = min(block), max(block)
    axis = np.array([axis_number(row[0], decimal) for row in block.values()])
    step = float(np.median(np.diff(axis)))
    following = cells_of(lines[last + 1], delimiter) if last + 1 < len(lines) else []
    if len(following) == len(block[last]) and THOUSAND.fullmatch(following[0]):
        raise InputError(f"{name}: {following[0]!r} stands where a wavelength is needed (line "
                         f"{last + 2}); write it without a mark between thousands")
    notes = []
    candidates = [index for index, line in enumerate(lines) if FIRST_NUMBER.match(line)
                  and not first <= index <= last]
    for other, _ in _blocks(lines, candidates, layout):
        begins, ends = min(other), max(other)
        after = begins > last
        gap = axis_number(other[begins][0], decimal) - axis[-1] if after else \
            axis[0] - axis_number(other[ends][0], decimal)
        if len(other[begins]) == len(block[first]) and step and 0 < gap / step <= CONTINUES:
            between = range(last + 1, begins) if after else range(ends + 1, first)
            broken = next((index for index in between if _ends_a_table(lines[index])), None)
            if broken is not None:
                text = cells_of(lines[broken], delimiter)
                raise InputError(
                    f"{name}: {(text[0] if text else '')[:60]!r} stands where a wavelength is "
                    f"needed (line {broken + 1}); correct it, or take the line out")
        if len(other) >= MIN_SECOND_TABLE:
            notes.append(f"another table of {len(other)} rows, from line {begins + 1} on, was left "
                         "out")
    return tuple(notes[:3])


def names_and_units(lines: Sequence[str], block: Block,
                    layout: Layout) -> tuple[list[str], list[str]]:
    """Names of the columns and the row of their units, of the lines above the numbers; empty where
    there are none.

    Parameters
    ----------
    lines : sequence of str
    block, layout
        From ``find_table``.
    """
    rows: list[list[str]] = []
    index, width = min(block) - 1, max(len(row) for row in block.values())
    while index >= 0 and len(rows) < HEADER_ROWS:
        line = lines[index]
        index -= 1
        if not line.strip():
            continue
        comment = line.lstrip().startswith("#") and re.match(r"\s*#\s*[\w ]+:", line) is not None
        cells = [] if comment else _header_cells(line, layout, width, nearest=not rows)
        if not cells:
            if line.lstrip().startswith("#"):
                continue
            break
        rows.append(cells)
    unit_at = next((at for at, row in enumerate(rows) if _is_unit_row(row)), None)
    if unit_at is not None and unit_at + 1 < len(rows):
        return rows[unit_at + 1], rows[unit_at]
    return (rows[0] if rows else []), []


def _header_cells(line: str, layout: Layout, width: int, nearest: bool) -> list[str]:
    """The cells of a line that names columns; none of a line that does not.

    The line next to the numbers may name fewer or more columns than there are.
    """
    text = COMMENT.sub("", line, count=1) if COMMENT.match(line) else line
    delimiter, decimal = layout
    own = cells_of(text, delimiter) if delimiter != BLANKS else []
    if len(own) == width and not _is_row(own, decimal):
        return own
    # Names may be parted otherwise than the numbers; prose of as many words begins otherwise.
    for cells in (re.split(r"\s{2,}|\t", text.strip()),
                  re.findall(r"[^\s(\[]+(?:\s*[(\[][^)\]]*[)\]])?|[(\[][^)\]]*[)\]]", text),
                  text.split(), *(cells_of(text, mark) for mark in ",;\t")):
        if len(cells) == width and (units.WAVELENGTH.match(cells[0]) or cells[0].lower() in (
                "x", "w") or _is_unit_row(cells)):
            return cells
    if len(own) < 2 or not nearest or ":" in own[0] or "=" in own[0] \
            or any(np.isfinite(number(cell)) for cell in own):
        return []
    return own


def _is_row(cells: Sequence[str], decimal: str) -> bool:
    return bool(np.isfinite(axis_number(cells[0], decimal)))


def _is_unit_row(cells: Sequence[str]) -> bool:
    """Whether every cell is a unit or empty, and the axis has one of its own."""
    first = cells[0].strip()
    bare = first.strip("[](){} ")
    if not bare or (units.axis_unit(bare) is None and first == bare):
        return False
    return all(not cell.strip() or (cell.strip()[0] in "[({" and cell.strip()[-1] in "])}")
               or units.stated_values(f"[{cell.strip()}]")[1] is not None for cell in cells[1:])


def _refuse_split_decimals(block: Block, name: str) -> None:
    """Refuse decimal commas between commas: 400,0,05012 reads as 5012."""
    split = next((cell for row in block.values() for cell in row[1:]
                  if re.fullmatch(r"0\d+", cell)), None)
    if split is not None and not any("." in cell for row in block.values() for cell in row):
        raise InputError(f"{name} has cells such as {split!r}: a decimal comma cannot be told from "
                         "the commas between columns; export with semicolons or decimal points")


def percent_columns(block: Block) -> list[bool]:
    """Of which columns of a table every cell ends in a sign of per cent."""
    width = max(len(row) for row in block.values())
    columns = [[row[column] for row in block.values() if column < len(row)
                and row[column].lower() not in MISSING] for column in range(width)]
    return [bool(cells) and all(cell.endswith("%") for cell in cells) for cells in columns]


def stated(lines: Sequence[str], pattern: re.Pattern[str]) -> str | None:
    """What the first line such as "X Units: ..." states, by ``STATED_X`` or ``STATED_Y``."""
    return next((match[1].strip() for line in lines if (match := pattern.match(line))
                 and match[1].strip()), None)
