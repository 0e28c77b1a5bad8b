"""Layouts of charts: their names, those of charts that are sold, and any other from a TOML file.

Proportions are those by which ArgyllCMS reads scans of these charts; only proportions count in a
photo, whatever the unit. Charts other than the Classic are taken to end at the outermost patches.
"""
from __future__ import annotations

import dataclasses
from itertools import product
from pathlib import Path
from string import ascii_uppercase

import numpy as np
from pydantic import Field

from spectrabox.radiometry import checked_tables, errors
from spectrabox.radiometry.chart import CLASSIC, GLOSSY_PATCHES, Chart, grid_chart, outlined_chart
from spectrabox.radiometry.system.words import nearest_words

LAYOUT_SUFFIX = ".toml"
LAYOUT_NAMES = ("ColorChecker Classic", "ColorChecker Passport", "ColorChecker Nano",
                "ColorChecker Digital SG", "SpyderCheckr 24", "SpyderCheckr 48",
                "Next Generation Target", "Artist Paint Target")
SHORT_NAMES = {"NGT": "Next Generation Target", "APT": "Artist Paint Target"}

# The twelve steps from white to black in the middle of the Digital SG, and the last row of a
# Classic's greys in the fifth column of both SpyderCheckrs.
SG_NEUTRALS = ("E5", "J6", "F5", "I6", "K6", "G5", "H6", "H5", "G6", "I5", "F6", "J5")
SPYDER_NEUTRALS = ("E1", "E2", "E3", "E4", "E5", "E6")
# by their measured spectra
NGT_NEUTRALS = ("D7", "E7", "F7", "G7", "H7", "I7")
APT_NEUTRALS = ("A1", "F1", "B1", "E1", "D1", "C1")


def is_layout_file(layout: str) -> bool:
    """Whether an operator named a file and no chart that is sold."""
    return layout.lower().endswith(LAYOUT_SUFFIX)


def layout_name(written: str) -> str:
    """The one of ``LAYOUT_NAMES`` that is meant.

    Parameters
    ----------
    written : str
        In any case, with or without the first word of a ColorChecker; or one of ``SHORT_NAMES``.

    Raises
    ------
    InputError
        If there is none.
    """
    known = {_plain(name): name for name in LAYOUT_NAMES}
    short = {_plain(name.partition(" ")[2]): name for name in LAYOUT_NAMES
             if name.startswith("ColorChecker")}
    short |= {_plain(word): name for word, name in SHORT_NAMES.items()}
    name = (short | known).get(_plain(written))
    if name is None:
        raise errors.InputError(f"chart layout {written!r} is not known"
                         f"{nearest_words(written, [*LAYOUT_NAMES, *SHORT_NAMES])}; known are "
                         f"{', '.join(LAYOUT_NAMES)}, or a layout of your own in a file "
                         f"NAME{LAYOUT_SUFFIX}")
    return name


def _plain(name: str) -> str:
    return "".join(name.lower().replace("-", "").split())


def _named(columns: str, rows: int) -> tuple[str, ...]:
    """Names of patches, a letter for the column and a number for the row, row by row."""
    return tuple(f"{column}{row}" for row in range(1, rows + 1) for column in columns)


def _small_classic(name: str, patch: float, pitch: tuple[float, float]) -> Chart:
    """The patches of a Classic at another size."""
    laid = grid_chart(name, CLASSIC.rows, CLASSIC.columns, CLASSIC.names, (patch, patch), pitch,
                      neutrals=CLASSIC.names[18:])
    return dataclasses.replace(laid, fiducial_names=CLASSIC.fiducial_names,
                               other_names=CLASSIC.other_names, references=CLASSIC.references,
                               detectable=True, black_frame=True)


PASSPORT = _small_classic("ColorChecker Passport", 12.4, (15.0, 15.0))
# No drawing of it is published: the proportions of the Passport, a third as large.
NANO = _small_classic("ColorChecker Nano", 4.1, (5.0, 5.0))
DIGITAL_SG = dataclasses.replace(
    grid_chart("ColorChecker Digital SG", 10, 14, _named("ABCDEFGHIJKLMN", 10), (12.675, 12.75),
               (15.175, 15.25), neutrals=SG_NEUTRALS), detectable=True,
    colours="ColorCheckerSG - After November 2014", references=("BeyondRGB Digital SG",),
    gloss=GLOSSY_PATCHES)
SPYDERCHECKR_24 = dataclasses.replace(
    grid_chart("SpyderCheckr 24", 6, 4, _named("EFGH", 6), (88.5, 88.5), (102.0, 102.0),
               neutrals=SPYDER_NEUTRALS), other_names=(_named("ABCD", 6),))
SPYDERCHECKR_48 = outlined_chart(
    "SpyderCheckr 48", 6, 8, _named("ABCDEFGH", 6),
    np.stack(np.meshgrid([-205.0, -156.0, -107.0, -58.0, 58.0, 107.0, 156.0, 205.0],
                         50.0 * (np.arange(6) - 2.5)), axis=-1).reshape(48, 2),
    np.full((48, 2), 42.0), SPYDER_NEUTRALS)
# Of these no drawing is published: rows, columns and the order of patches are those of BeyondRGB's
# reference data, gaps are taken to be a seventh of the pitch.
NEXT_GENERATION = dataclasses.replace(
    grid_chart("Next Generation Target", 10, 13, _named("ABCDEFGHIJKLM", 10), (6.0, 6.0),
               (7.0, 7.0), neutrals=NGT_NEUTRALS), references=("BeyondRGB NGT",))
ARTIST_PAINT = dataclasses.replace(
    grid_chart("Artist Paint Target", 4, 6, _named("ABCDEF", 4), (6.0, 6.0), (7.0, 7.0),
               neutrals=APT_NEUTRALS), references=("BeyondRGB APT",))

LAYOUTS = {chart.name: chart for chart in (CLASSIC, PASSPORT, NANO, DIGITAL_SG, SPYDERCHECKR_24,
                                           SPYDERCHECKR_48, NEXT_GENERATION, ARTIST_PAINT)}


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


# ---- a layout of one's own -----------------------------------------------------------------------

ADVICE = "give the layout of a chart (docs/reference/charts.md)"
MAX_SIDE = 100              # rows or columns


class LayoutFile(checked_tables.Table):
    """What a layout file may say; lengths in one unit of one's own, x to the right, y down."""

    name: str = Field(min_length=1, description="of the chart, for messages and the report")
    rows: int = Field(ge=1, le=MAX_SIDE, description="of patches")
    columns: int = Field(ge=2, le=MAX_SIDE, description="of patches")
    patch: checked_tables.ListOf[float] = Field(description="width and height of a patch")
    pitch: checked_tables.ListOf[float] | None = Field(
        None, description="distance of patches along a row and "
        "along a column, from centre to centre")
    centres: checked_tables.ListOf[checked_tables.ListOf[float]] | None = Field(
        None, description="centre of every patch, row by row and from any point, in place of pitch")
    border: checked_tables.ListOf[float] = Field((0.0, 0.0),
                                                 description="of the card beside and above the "
                                                 "patches")
    names: checked_tables.ListOf[str] | None = Field(
        None, description="of the patches, row by row; A1, B1, ... "
        "where left out")
    neutrals: checked_tables.ListOf[str] = Field(
        (), description="names of the neutral patches, lightest first")
    fiducials: checked_tables.ListOf[checked_tables.ListOf[float]] | None = Field(
        None, description="four points that are easily seen, from the same point as centres, or "
        "from the outer corner of the first patch; by default the outer corners of the patches")
    fiducial_names: checked_tables.ListOf[str] | None = Field(None,
                                                              description="names of these points")
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
    written = checked_tables.checked(LayoutFile, checked_tables.read_toml(path, ADVICE), path.name)
    names = _names(written, path.name)
    patch = _pair(written.patch, "patch", path.name)
    if min(patch) <= 0:
        raise errors.InputError(
            f"{path.name}: patch is {list(patch)}; give width and height above 0")
    border = _pair(written.border, "border", path.name)
    if (written.pitch is None) == (written.centres is None):
        raise errors.InputError(
            f"{path.name}: give either pitch or centres, to say where patches lie")
    pitch = patch if written.pitch is None else _pair(written.pitch, "pitch", path.name)
    if any(step < side for step, side in zip(pitch, patch, strict=True)):
        raise errors.InputError(
            f"{path.name}: patches of {list(patch)} at a pitch of {list(pitch)} "
            "overlap; give the distance from centre to centre")
    for neutral in written.neutrals:
        if neutral not in names:
            raise errors.InputError(
                f"{path.name}: neutrals names {neutral!r}, which is no patch; did you "
                f"mean {checked_tables.nearest(neutral, names)!r}?")
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
        raise errors.InputError(f"{file}: names lists {len(set(written.names))} different names; "
                         f"{written.rows} rows of {written.columns} patches need {patches}")
    return written.names


def _pair(values: tuple[float, ...], key: str, file: str) -> tuple[float, float]:
    if len(values) != 2:
        raise errors.InputError(
            f"{file}: {key} has {len(values)} numbers; two are needed, across and "
            "down")
    return values[0], values[1]


def _points(values: tuple[tuple[float, ...], ...], count: int, key: str, file: str) -> np.ndarray:
    if len(values) != count or any(len(point) != 2 for point in values):
        raise errors.InputError(f"{file}: {key} needs {count} points [x, y]; it has {len(values)}")
    return np.array(values)


def _with_centres(chart: Chart, centres: tuple[tuple[float, ...], ...], file: str) -> Chart:
    """The chart with its patches elsewhere, measured from any point."""
    given = _points(centres, len(chart.names), "centres", file)
    grid = given.reshape(chart.rows, chart.columns, 2)
    if np.any(np.diff(grid[..., 0], axis=1) <= 0) or np.any(np.diff(grid[..., 1], axis=0) <= 0):
        raise errors.InputError(
            f"{file}: centres must run to the right along every row and down every "
            "column; list them row by row")
    middle = ((given + chart.sizes / 2).max(axis=0) + (given - chart.sizes / 2).min(axis=0)) / 2
    return outlined_chart(chart.name, chart.rows, chart.columns, chart.names, given - middle,
                          chart.sizes, tuple(chart.names[patch] for patch in chart.neutrals))


def _with_fiducials(chart: Chart, written: LayoutFile, file: str) -> Chart:
    if written.fiducials is None or written.fiducial_names is None \
            or len(written.fiducial_names) != 4:
        raise errors.InputError(
            f"{file}: fiducials and fiducial_names go together, four of each: the "
            "points, and the words by which an operator knows them")
    first, second, third, fourth = written.fiducial_names
    points = _points(written.fiducials, 4, "fiducials", file)
    # from where the file measures: the outer corner of the first patch, or as its centres
    start = chart.centres[0] - (chart.sizes[0] / 2 if written.centres is None
                                else np.array(written.centres[0]))
    return dataclasses.replace(chart, fiducial_names=(first, second, third, fourth),
                               fiducials=points + start)
