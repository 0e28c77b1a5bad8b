"""Published observers, cameras, lights and chart reflectances, without waiting for colour-science.

Importing colour-science takes longer than most commands. ``make_tables`` copied the tables that
operators name from there, value by value; a test compares them with the installed colour-science.
Measured cameras and charts lie in files of their own, described in the texts beside them.
"""
from __future__ import annotations

import functools
from pathlib import Path

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.system.words import known_name, nearest_words

FILE = Path(__file__).parent / "published_spectra.npz"
OBSERVERS, LIGHTS, CHARTS = "observers and cameras", "lights", "charts"
COLOURS, CAMERAS, COPIES = "chart colours", "measured cameras", "measured charts"
TRADE = "charts of the trade"    # one measured copy each, of which no average is published
CAMERAS_FILE = FILE.with_name("measured_cameras.npz")
COPIES_FILE = FILE.with_name("measured_charts.npz")
TRADE_FILE = FILE.with_name("trade_charts.npz")
# of the kinds that are not in FILE
FILES = {CAMERAS: CAMERAS_FILE, COPIES: COPIES_FILE, TRADE: TRADE_FILE}


def published_names(kind: str) -> list[str]:
    """Names of the tables of one kind, as their sources have them.

    Parameters
    ----------
    kind : {"observers and cameras", "measured cameras", "lights", "charts", "chart colours"}
    """
    return list(_names(kind))


@functools.cache
def _names(kind: str) -> tuple[str, ...]:
    with np.load(FILES.get(kind, FILE)) as tables:
        return tuple(name.removeprefix(f"{kind}/") for name in tables.files
                     if name.startswith(f"{kind}/"))


def published_curves(kind: str, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Wavelengths (P,) in nm and curves (K, P) of one table.

    Parameters
    ----------
    kind : {"observers and cameras", "measured cameras", "lights", "charts", "charts of the trade"}
    name : str
        One of ``published_names(kind)``, whatever its capitals.

    Raises
    ------
    InputError
        If there is no such table, with the nearest names.
    """
    names = published_names(kind)
    known = known_name(name, names)
    if known is None:
        raise InputError(f"{name!r} is not among the published {kind}{nearest_words(name, names)}")
    nm, *curves = _table(kind, known)
    return nm.copy(), np.array(curves)


@functools.cache        # a file is opened by every chart and every camera of a measurement
def _table(kind: str, name: str) -> np.ndarray:
    with np.load(FILES.get(kind, FILE)) as tables:
        return np.asarray(tables[f"{kind}/{name}"])


def all_published(kind: str) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Every table of one kind by name, as ``published_curves`` gives each; the file is opened once.

    Parameters
    ----------
    kind : {"observers and cameras", "measured cameras", "lights", "charts", "chart colours"}
    """
    with np.load(FILES.get(kind, FILE)) as tables:
        curves = {name.removeprefix(f"{kind}/"): tables[name] for name in tables.files
                  if name.startswith(f"{kind}/")}
    return {name: (table[0], table[1:]) for name, table in curves.items()}


def published_colours(name: str) -> np.ndarray:
    """Tristimulus values (I, 3) of a chart's patches under D50, row by row, white about 1.

    Parameters
    ----------
    name : str
        One of ``published_names(COLOURS)``.

    Raises
    ------
    InputError
        If there is no such table.
    """
    x, yz = published_curves(COLOURS, name)
    return np.column_stack([x, *yz])
