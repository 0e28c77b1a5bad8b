"""The layout of a chart that an operator made or owns, from a TOML file."""
from __future__ import annotations

import dataclasses
from itertools import product
from pathlib import Path
from string import ascii_uppercase

import numpy as np
from pydantic import Field

from spectrabox.radiometry.chart import Chart, grid_chart, outlined_chart
from spectrabox.radiometry.checked_tables import ListOf, Table, checked, nearest, read_toml
from spectrabox.radiometry.errors import InputError

ADVICE = "give the layout of a chart (docs/reference/charts.md)"
MAX_SIDE = 100              # rows or columns


class LayoutFile(Table):
    """What a layout file may say; lengths in one unit of one's own, x to the right, y down."""

    name: str = Field(min_length=1, description="of the chart, for messages and the report")
    rows: int = Field(ge=1, le=MAX_SIDE, description="of patches")
    columns: int = Field(ge=2, le=MAX_SIDE, description="of patches")
    patch: ListOf[float] = Field(description="width and height of a patch")
    pitch: ListOf[float] | None = Field(None, description="distance of patches along a row and "
                                        "along a column, from centre to centre")
    centres: ListOf[ListOf[float]] | None = Field(
        None, description="centre of every patch, row by row and from any point, in place of pitch")
    border: ListOf[float] = Field((0.0, 0.0), description="of the card beside and above the "
                                  "patches")
    names: ListOf[str] | None = Field(None, description="of the patches, row by row; A1, B1, ... "
                                      "where left out")
    neutrals: ListOf[str] = Field((), description="names of the neutral patches, lightest first")
    fiducials: ListOf[ListOf[float]] | None = Field(
        None, description="four points that are easily seen, from the same point as centres, or "
        "from the outer corner of the first patch; by default the outer corners of the patches")
    fiducial_names: ListOf[str] | None = Field(None, description="names of these points")
    reference: str | None = Field(None, description="file of reflectances, beside this one")


def read_layout(path: Path) -> Chart:
    """The chart that a layout file describes.

    Parameters
    ----------
    path : Path

    Raises
    ------
    InputError
        If the file is missing, is not TOML, or does not describe a chart; every fault of a key at
        once.
    """
    written = checked(LayoutFile, read_toml(path, ADVICE), path.name)
    names = _names(written, path.name)
    patch = _pair(written.patch, "patch", path.name)
    if min(patch) <= 0:
        raise InputError(f"{path.name}: patch is {list(patch)}; give width and height above 0")
    border = _pair(written.border, "border", path.name)
    if (written.pitch is None) == (written.centres is None):
        raise InputError(f"{path.name}: give either pitch or centres, to say where patches lie")
    pitch = patch if written.pitch is None else _pair(written.pitch, "pitch", path.name)
    if any(step < side for step, side in zip(pitch, patch, strict=True)):
        raise InputError(f"{path.name}: patches of {list(patch)} at a pitch of {list(pitch)} "
                         "overlap; give the distance from centre to centre")
    for neutral in written.neutrals:
        if neutral not in names:
            raise InputError(f"{path.name}: neutrals names {neutral!r}, which is no patch; did you "
                             f"mean {nearest(neutral, names)!r}?")
    chart = grid_chart(written.name, written.rows, written.columns, names, patch, pitch,
                       written.neutrals)
    if written.centres is not None:
        chart = _with_centres(chart, written.centres, path.name)
    chart = dataclasses.replace(chart, card=chart.card + 2 * np.array(border))
    if written.fiducials is not None or written.fiducial_names is not None:
        chart = _with_fiducials(chart, written, path.name)
    reference = None if written.reference is None else path.parent / written.reference
    return dataclasses.replace(chart, reference_file=reference)


def _names(written: LayoutFile, file: str) -> tuple[str, ...]:
    patches = written.rows * written.columns
    if written.names is None:
        # A to Z, then AA, AB and so on
        letters = ["".join(pair) for pair in product(("", *ascii_uppercase), ascii_uppercase)]
        return tuple(f"{column}{row}" for row in range(1, written.rows + 1)
                     for column in letters[:written.columns])
    if len(written.names) != patches or len(set(written.names)) != patches:
        raise InputError(f"{file}: names lists {len(set(written.names))} different names; "
                         f"{written.rows} rows of {written.columns} patches need {patches}")
    return written.names


def _pair(values: tuple[float, ...], key: str, file: str) -> tuple[float, float]:
    if len(values) != 2:
        raise InputError(f"{file}: {key} has {len(values)} numbers; two are needed, across and "
                         "down")
    return values[0], values[1]


def _points(values: tuple[tuple[float, ...], ...], count: int, key: str, file: str) -> np.ndarray:
    if len(values) != count or any(len(point) != 2 for point in values):
        raise InputError(f"{file}: {key} needs {count} points [x, y]; it has {len(values)}")
    return np.array(values)


def _with_centres(chart: Chart, centres: tuple[tuple[float, ...], ...], file: str) -> Chart:
    """The chart with its patches elsewhere, measured from any point."""
    given = _points(centres, len(chart.names), "centres", file)
    grid = given.reshape(chart.rows, chart.columns, 2)
    if np.any(np.diff(grid[..., 0], axis=1) <= 0) or np.any(np.diff(grid[..., 1], axis=0) <= 0):
        raise InputError(f"{file}: centres must run to the right along every row and down every "
                         "column; list them row by row")
    middle = ((given + chart.sizes / 2).max(axis=0) + (given - chart.sizes / 2).min(axis=0)) / 2
    return outlined_chart(chart.name, chart.rows, chart.columns, chart.names, given - middle,
                          chart.sizes, tuple(chart.names[patch] for patch in chart.neutrals))


def _with_fiducials(chart: Chart, written: LayoutFile, file: str) -> Chart:
    if written.fiducials is None or written.fiducial_names is None \
            or len(written.fiducial_names) != 4:
        raise InputError(f"{file}: fiducials and fiducial_names go together, four of each: the "
                         "points, and the words by which an operator knows them")
    first, second, third, fourth = written.fiducial_names
    points = _points(written.fiducials, 4, "fiducials", file)
    # from where the file measures: the outer corner of the first patch, or as its centres
    start = chart.centres[0] - (chart.sizes[0] / 2 if written.centres is None
                                else np.array(written.centres[0]))
    return dataclasses.replace(chart, fiducial_names=(first, second, third, fourth),
                               fiducials=points + start)
