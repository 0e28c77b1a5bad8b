"""Patch signals from a text file: a row for each patch, a column for each band."""
from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from spectrabox.measure.camera import ERROR_PREFIX, ChartSignals
from spectrabox.measure.chart_patches import CLIPPED_PREFIX, COUNTS, POSITIONS, SPREAD_PREFIX
from spectrabox.radiometry.chart import CLASSIC, Chart
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.files import read_text
from spectrabox.radiometry.records.photos import PatchSamples

MAX_SIGNAL = 1e9        # white is near 1, or near 65535
ADVICE = "give a CSV of signals, a row for each patch"
# Relative, where a table states none: charts and photos of them agree to 0.3 to 0.5 %. Signals
# taken as exact are held against the last digit of how somebody integrated over wavelength.
ASSUMED_ERROR = 0.004
DARK = 0.03             # of the brightest patch: the error of darker ones is that of this


def read_patches(path: Path, chart: Chart = CLASSIC) -> ChartSignals:
    """Signals of a chart's patches, in chart order, the names of the bands, and notes.

    The first row may name the columns; a column ``standard_error NAME`` holds the standard errors
    of band NAME, and where such columns name no bands they stand in the bands' order. Of a table
    that ``spectrabox chart --out`` wrote, ``clipped NAME`` says which signals are none, and
    positions and spread are left out. Without names, every column is a band. A first column of
    words (patch names) is left out. Where no errors are stated, those that charts and photos have
    are assumed, and a note says so.

    Parameters
    ----------
    path : Path
        Comma-separated text; lines that begin with # are left out.
    chart : Chart

    Raises
    ------
    InputError
        If the file is missing, does not hold a row for each patch, a cell is not a number up to
        1e9, two bands have one name, or a standard error is negative or of no band.
    """
    rows = _rows(path)
    header = rows.pop(0) if not any(_is_number(cell) for cell in rows[0]) else None
    if rows and not _is_number(rows[0][0]):
        rows = [row[1:] for row in rows]
        header = header[1:] if header is not None else None
    if len(rows) != len(chart.names):
        raise InputError(f"{path.name} holds {len(rows)} rows of signals; {len(chart.names)} are "
                         f"needed, one per patch, {chart.names[0]} first, {chart.names[-1]} last")
    if len({len(row) for row in rows}) != 1 or not all(_is_number(cell) for row in rows
                                                       for cell in row):
        raise InputError(f"{path.name}: some rows are shorter than others or hold words; give a "
                         f"number up to {MAX_SIGNAL:.0e} in every cell")
    values = np.array(rows, dtype=float)
    names = [name.strip() for name in header or (f"band {column + 1}"
                                                 for column in range(values.shape[1]))]
    further = [index for index, name in enumerate(names) if name in (*POSITIONS, *COUNTS)
               or name.startswith((SPREAD_PREFIX, CLIPPED_PREFIX))]
    bands = [index for index, name in enumerate(names)
             if index not in further and not name.startswith(ERROR_PREFIX)]
    errors = [index for index, name in enumerate(names) if name.startswith(ERROR_PREFIX)]
    if errors and len(errors) != len(bands):
        raise InputError(f"{path.name} holds {len(bands)} bands and {len(errors)} standard errors; "
                         "give one for each band, or none")
    band_names = [names[index] for index in bands]
    if len(set(band_names)) < len(bands):
        raise InputError(f"{path.name} holds two bands of one name ({', '.join(band_names)}); name "
                         "each column once")
    signal, notes = values[:, bands], tuple[str, ...]()
    if errors:
        error = _errors(values, names, band_names, errors, path.name)
    else:
        error = ASSUMED_ERROR * np.maximum(np.abs(signal), DARK * np.abs(signal).max(axis=0))
        notes = (f"{path.name} states no errors of its signals: {ASSUMED_ERROR:.1%} is assumed, as "
                 f"charts and photos have it; columns named {ERROR_PREFIX} state others",)
    clipped = np.column_stack([values[:, names.index(column)] if column in names
                               else np.zeros(len(values))
                               for column in (f"{CLIPPED_PREFIX} {band}" for band in band_names)])
    return ChartSignals(path.name, _samples(signal, error, clipped), tuple(band_names), notes)


def _errors(values: np.ndarray, names: list[str], band_names: list[str], columns: list[int],
            file: str) -> np.ndarray:
    """Standard errors (I, K) in the order of the bands."""
    of_band = {names[column].removeprefix(ERROR_PREFIX).strip(" _"): column for column in columns}
    if set(of_band) == set(band_names):
        columns = [of_band[name] for name in band_names]
    elif set(of_band) & set(band_names):
        stray = next(name for name in of_band if name not in band_names)
        raise InputError(f"{file} has the column {ERROR_PREFIX} {stray!r} and no band of that "
                         f"name; the bands are {', '.join(band_names)}")
    if values[:, columns].min() < 0:
        raise InputError(f"{file} holds a negative standard error; they are 0 or greater, in the "
                         "unit of the signals")
    return values[:, columns]


def _samples(signal: np.ndarray, error: np.ndarray, clipped: np.ndarray) -> PatchSamples:
    covariance = np.einsum("ik,kl->ikl", error**2, np.eye(signal.shape[1]))
    return PatchSamples(signal, covariance, np.ones(len(signal)), clipped, np.zeros(signal.shape))


def _rows(path: Path) -> list[list[str]]:
    try:
        text = read_text(path)
    except FileNotFoundError:
        raise InputError(f"{path} is missing; {ADVICE}") from None
    except (UnicodeDecodeError, IsADirectoryError):
        raise InputError(
            f"{path.name} is not a text file; {ADVICE}") from None
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    rows = [row for row in csv.reader(lines) if any(cell.strip() for cell in row)]
    if not rows:
        raise InputError(f"{path.name} is empty; {ADVICE}")
    return rows


def _is_number(cell: str) -> bool:
    try:
        return abs(float(cell)) <= MAX_SIGNAL
    except ValueError:
        return False
