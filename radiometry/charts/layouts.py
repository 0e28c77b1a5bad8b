"""Layouts of charts that are sold, by name; and any other from a file (see layout_file.py).

Proportions are those by which ArgyllCMS reads scans of these charts; only proportions count in a
photo, whatever the unit. Charts other than the Classic are taken to end at the outermost patches.
"""
from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from spectrabox.radiometry.chart import CLASSIC, Chart, grid_chart, outlined_chart
from spectrabox.radiometry.charts.layout_file import read_layout
from spectrabox.radiometry.charts.layout_names import is_layout_file, layout_name

# The twelve steps from white to black in the middle of the Digital SG, and the last row of a
# Classic's greys in the fifth column of both SpyderCheckrs.
SG_NEUTRALS = ("E5", "J6", "F5", "I6", "K6", "G5", "H6", "H5", "G6", "I5", "F6", "J5")
SPYDER_NEUTRALS = ("E1", "E2", "E3", "E4", "E5", "E6")


def _named(columns: str, rows: int) -> tuple[str, ...]:
    """Names of patches, a letter for the column and a number for the row, row by row."""
    return tuple(f"{column}{row}" for row in range(1, rows + 1) for column in columns)


def _small_classic(name: str, patch: float, pitch: tuple[float, float]) -> Chart:
    """The patches of a Classic at another size."""
    laid = grid_chart(name, CLASSIC.rows, CLASSIC.columns, CLASSIC.names, (patch, patch), pitch,
                      neutrals=CLASSIC.names[18:])
    return dataclasses.replace(laid, fiducial_names=CLASSIC.fiducial_names,
                               other_names=CLASSIC.other_names, references=CLASSIC.references,
                               generations=CLASSIC.generations, detectable=True, black_frame=True)


PASSPORT = _small_classic("ColorChecker Passport", 12.4, (15.0, 15.0))
# No drawing of it is published: the proportions of the Passport, a third as large.
NANO = _small_classic("ColorChecker Nano", 4.1, (5.0, 5.0))
DIGITAL_SG = dataclasses.replace(
    grid_chart("ColorChecker Digital SG", 10, 14, _named("ABCDEFGHIJKLMN", 10), (12.675, 12.75),
               (15.175, 15.25), neutrals=SG_NEUTRALS), detectable=True,
    colours="ColorCheckerSG - After November 2014")
SPYDERCHECKR_24 = dataclasses.replace(
    grid_chart("SpyderCheckr 24", 6, 4, _named("EFGH", 6), (88.5, 88.5), (102.0, 102.0),
               neutrals=SPYDER_NEUTRALS), other_names=(_named("ABCD", 6),))
SPYDERCHECKR_48 = outlined_chart(
    "SpyderCheckr 48", 6, 8, _named("ABCDEFGH", 6),
    np.stack(np.meshgrid([-205.0, -156.0, -107.0, -58.0, 58.0, 107.0, 156.0, 205.0],
                         50.0 * (np.arange(6) - 2.5)), axis=-1).reshape(48, 2),
    np.full((48, 2), 42.0), SPYDER_NEUTRALS)

LAYOUTS = {chart.name: chart for chart in (CLASSIC, PASSPORT, NANO, DIGITAL_SG, SPYDERCHECKR_24,
                                           SPYDERCHECKR_48)}


def chart_layout(layout: str) -> Chart:
    """The layout of a chart by its name, or from a file.

    Parameters
    ----------
    layout : str
        One of ``LAYOUTS``, in any case, with or without the first word; or a file ``NAME.toml``.

    Raises
    ------
    InputError
        If the name is not known, or the file is no layout.
    """
    return read_layout(Path(layout)) if is_layout_file(layout) \
        else LAYOUTS[layout_name(layout)]
