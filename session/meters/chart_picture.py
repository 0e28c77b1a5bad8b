"""A chart as characters of a terminal: what is measured, what comes next."""
from __future__ import annotations

import functools
from collections.abc import Collection, Mapping

import numpy as np

from spectrabox.radiometry.appearance import reflectance_to_lab, reflectance_to_srgb
from spectrabox.radiometry.chart import Chart
from spectrabox.radiometry.charts.references import reference_reflectances
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.records.spectra import Spectrum

CELL, NARROW = 8, 5         # characters; of a chart that is too wide for a terminal
MANY_COLUMNS, MANY_ROWS = 8, 6
NEARER = 10.0               # by which another patch must be nearer in L*a*b* before it is named
UNMEASURED = 0.35           # of its colour, over the terminal's background
UNKNOWN = 0.5               # grey of a patch of which nothing is published


def chart_picture(chart: Chart, measured: Mapping[int, Spectrum | None], following: int, *,
                  colours: bool) -> str:
    """The patches row by row, each in the colour that was measured or else is usual.

    Parameters
    ----------
    chart : Chart
    measured : mapping
        From the index of a patch to its reflectance, or to None of one measured as a light.
    following : int
        Index of the patch that comes next.
    colours : bool
        The terminal shows colours; else names alone say what is done.
    """
    width = CELL if chart.columns <= MANY_COLUMNS else NARROW
    named = max(map(len, chart.names)) <= NARROW - 2        # as printed beside the patches
    rows = []
    for row in range(chart.rows):
        cells = range(row * chart.columns, (row + 1) * chart.columns)
        texts = [_mark(chart.names[index] if named else f"{index + 1}", index, measured, following,
                       width) for index in cells]
        for words in (texts, [""] * chart.columns) if colours and chart.rows <= MANY_ROWS \
                else (texts,):
            rows.append(" ".join(
                _cell(chart, index, f"{text:^{width}}", measured, following) if colours
                else f"{text:^{width}}" for index, text in zip(cells, words, strict=True)))
    return "\n".join(rows)


def nearer_patch(chart: Chart, index: int, reflectance: Spectrum) -> int | None:
    """Index of another patch, if a reading looks far more like it than like the one asked for; None
    also of a chart of which no reflectances are known.

    Parameters
    ----------
    chart : Chart
    index : int
    reflectance : Spectrum
    """
    known = _usual(chart)
    if known is None:
        return None
    usual = reflectance_to_lab(FINE_GRID.nm, known)
    lab = reflectance_to_lab(reflectance.grid.nm, reflectance.values)
    distances = np.linalg.norm(usual - lab, axis=1)
    nearest = int(np.argmin(distances))
    return nearest if distances[index] > distances[nearest] + NEARER else None


@functools.cache
def _usual(chart: Chart) -> np.ndarray | None:
    known = chart.references or chart.reference_file is not None
    return reference_reflectances(None, chart, FINE_GRID) if known else None


def _mark(name: str, index: int, measured: Collection[int], following: int, width: int) -> str:
    if index == following:
        return f"> {name} <" if width == CELL else f">{name}<"
    done = " ok" if width == CELL else "+"
    return f"{name}{done}" if index in measured else name


def _cell(chart: Chart, index: int, padded: str, measured: Mapping[int, Spectrum | None],
          following: int) -> str:
    own, usual = measured.get(index), _usual(chart)
    if own is not None:
        srgb = reflectance_to_srgb(own.grid.nm, own.values)
    elif usual is not None:
        srgb = reflectance_to_srgb(FINE_GRID.nm, usual[index])
    else:
        srgb = np.full(3, UNKNOWN)
    if index not in measured and index != following:
        srgb = srgb * UNMEASURED
    red, green, blue = (round(255 * float(value)) for value in srgb)
    ink = "30" if srgb @ [0.2, 0.7, 0.1] > 0.5 else "97"
    return f"\x1b[48;2;{red};{green};{blue}m\x1b[{ink}m{padded}\x1b[0m"
