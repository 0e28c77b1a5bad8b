"""A chart as characters of a terminal: what is measured, what comes next."""
from __future__ import annotations

import functools
from collections.abc import Collection, Mapping

import numpy as np

from spectrabox.radiometry.appearance import reflectance_to_lab, reflectance_to_srgb
from spectrabox.radiometry.chart import CLASSIC
from spectrabox.radiometry.charts.references import reference_reflectances
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.records.spectra import Spectrum

CELL = 8                    # characters
NEARER = 10.0               # by which another patch must be nearer in L*a*b* before it is named
UNMEASURED = 0.35           # of its colour, over the terminal's background


def chart_picture(measured: Mapping[int, Spectrum | None], following: int, *,
                  colours: bool) -> str:
    """The Classic's 24 patches row by row, each in the colour that was measured or else is usual.

    Parameters
    ----------
    measured : mapping
        From the index of a patch to its reflectance, or to None of one measured as a light.
    following : int
        Index of the patch that comes next.
    colours : bool
        The terminal shows colours; else numbers alone say what is done.
    """
    rows = []
    for row in range(CLASSIC.rows):
        cells = range(row * CLASSIC.columns, (row + 1) * CLASSIC.columns)
        for text in (_mark, _blank) if colours else (_mark,):
            rows.append(" ".join(_cell(index, text(index, measured, following), measured, following,
                                       colours) for index in cells))
    return "\n".join(rows)


def nearer_patch(index: int, reflectance: Spectrum) -> int | None:
    """Index of another patch, if a reading looks far more like it than like the one asked for.

    Parameters
    ----------
    index : int
    reflectance : Spectrum
    """
    usual = reflectance_to_lab(FINE_GRID.nm, _usual())
    lab = reflectance_to_lab(reflectance.grid.nm, reflectance.values)
    distances = np.linalg.norm(usual - lab, axis=1)
    nearest = int(np.argmin(distances))
    return nearest if distances[index] > distances[nearest] + NEARER else None


@functools.cache
def _usual() -> np.ndarray:
    return reference_reflectances(None, CLASSIC, FINE_GRID)


def _mark(index: int, measured: Collection[int], following: int) -> str:
    text = f"{index + 1}"
    return f"> {text} <" if index == following else f"{text} ok" if index in measured else text


def _blank(index: int, measured: Collection[int], following: int) -> str:
    return ""


def _cell(index: int, text: str, measured: Mapping[int, Spectrum | None], following: int,
          colours: bool) -> str:
    padded = f"{text:^{CELL}}"
    if not colours:
        return padded
    own = measured.get(index)
    srgb = reflectance_to_srgb(FINE_GRID.nm, _usual()[index]) if own is None \
        else reflectance_to_srgb(own.grid.nm, own.values)
    if index not in measured and index != following:
        srgb = srgb * UNMEASURED
    red, green, blue = (round(255 * float(value)) for value in srgb)
    ink = "30" if srgb @ [0.2, 0.7, 0.1] > 0.5 else "97"
    return f"\x1b[48;2;{red};{green};{blue}m\x1b[{ink}m{padded}\x1b[0m"
