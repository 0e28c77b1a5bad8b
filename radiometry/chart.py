"""A chart: where its patches lie, what they are called and which reflectances are known of it.

``CLASSIC`` is the ColorChecker Classic; radiometry/charts holds the other layouts.
"""
from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np

from spectrabox.radiometry import appearance, errors, shaped
from spectrabox.radiometry.grid import grid_from_nm
from spectrabox.radiometry.published import published_tables
from spectrabox.radiometry.records.spectra import WavelengthGrid
from spectrabox.radiometry.spectra.spectrum_files import on_grid
from spectrabox.radiometry.system.words import nearest_words

PATCH_NAMES = (
    "dark skin", "light skin", "blue sky", "foliage", "blue flower", "bluish green",
    "orange", "purplish blue", "moderate red", "purple", "yellow green", "orange yellow",
    "blue", "green", "red", "yellow", "magenta", "cyan",
    "white 9.5", "neutral 8", "neutral 6.5", "neutral 5", "neutral 3.5", "black 2",
)

# Chart names of colour-science that cover 400-700 nm, by what an operator may write.
REFERENCES = ("BabelColor Average", "ISO 17321-1", "ColorChecker N Ohta")

# The Classic as it is made since, of which its maker publishes colours alone.
AFTER_2014 = "ColorChecker after November 2014"

# What a copy of either edition is like. Its colours: geometric means of published tables and
# measured copies, each with its weight, beside their greys. The copy of which no edition is stated
# is in both.
COPIES_SINCE_2014 = "ColorChecker copies since November 2014"
COPIES_BEFORE_2014 = "ColorChecker copies before November 2014"
SINCE_2014, BEFORE_2014 = "since November 2014", "before November 2014"     # when a chart was made
MEANS_OF_COPIES = {
    COPIES_SINCE_2014: {AFTER_2014: 2, "copy of August 2016": 1, "used copy": 1,
                        "ColorChecker N Ohta": 1},
    COPIES_BEFORE_2014: {"BabelColor Average": 2, "used copy": 1, "ColorChecker N Ohta": 1}}
GREYS = slice(19, 23)       # neutral 8 to 3.5: copies are compared at their level, from 430 nm on
GREYS_FROM_NM = 430.0
# The level of its greys: the mean of all tables but the one whose instrument read a fifth too much
# of everything. How light white, each grey, black and the coloured patches together are beside the
# greys: the mean of these tables, of copies made since of all, among which it goes with no edition.
LEVELLED = ("BabelColor Average", "ColorChecker N Ohta", AFTER_2014, "used copy")
GREY_SCALE_OF = {COPIES_SINCE_2014: (*LEVELLED, "copy of August 2016"),
                 COPIES_BEFORE_2014: ("BabelColor Average", "ColorChecker N Ohta", "used copy")}

# Peak and standard deviation (nm) of the bands of an ordinary colour camera, to know a chart when
# one is seen.
TYPICAL_BANDS_NM = ((600.0, 38.0), (535.0, 40.0), (460.0, 30.0))

MATT_PATCHES, GLOSSY_PATCHES = 0.0012, 0.016    # as shares of white; of a glossy SG up to .04
SQUARE = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])    # corners, going round


@dataclass(frozen=True, eq=False)
class Chart(shaped.Record):
    """Layout of a chart of I patches in rows and columns, listed row by row.

    Lengths are in one unit, any; points are seen from the middle of the patches, x to the right and
    y down where the first patch is at the top left.
    """

    name: str
    rows: int
    columns: int
    names: tuple[str, ...]                          # I, of the patches
    centres: Annotated[np.ndarray, "I 2"]
    sizes: Annotated[np.ndarray, "I 2"]
    card: Annotated[np.ndarray, "2"]                # width and height, the patches in its middle
    neutrals: tuple[int, ...]                       # indices, lightest first; may be empty
    # Four points in the order in which an operator gives them in a photo, and their names.
    fiducials: Annotated[np.ndarray, "4 2"]
    fiducial_names: tuple[str, str, str, str]
    # Names that other software gives the patches, each tuple in the order of ``names``.
    other_names: tuple[tuple[str, ...], ...] = ()
    references: tuple[str, ...] = ()                # published reflectances, the usual one first
    colours: str | None = None                      # published colours that tell the patches' order
    reference_file: Path | None = None              # measured, of a layout that an operator wrote
    detectable: bool = False                        # OpenCV finds it in a photo
    black_frame: bool = False                       # patches stand apart on black, as the Classic's
    # Light that its patches mirror, as a share of white: of a Classic, a sphere instrument reads so
    # much more with the specular part than without
    gloss: float = MATT_PATCHES

    @property
    def centres_uv(self) -> np.ndarray:
        """Centres (I, 2) of the patches as fractions of the card, from the first patch's corner."""
        return 0.5 + self.centres / self.card

    @property
    def sizes_uv(self) -> np.ndarray:
        """Width and height (I, 2) of the patches in the same fractions."""
        return self.sizes / self.card

    @property
    def has_known_colours(self) -> bool:
        """Whether it is known without an operator's file which patch is which."""
        return bool(self.references) or self.colours is not None

    @property
    def corner_words(self) -> str:
        """What ``corners_px`` are, in words and in order."""
        *first, last = self.fiducial_names
        return f"{', '.join(first)} and {last}"


def grid_chart(name: str, rows: int, columns: int, names: tuple[str, ...],
               patch: tuple[float, float], pitch: tuple[float, float],
               neutrals: tuple[str, ...] = ()) -> Chart:
    """A chart of equal patches in even rows, which ends at their outer corners, its fiducials.

    Parameters
    ----------
    names : tuple of I = rows x columns str
        Of the patches, row by row.
    patch, pitch : (float, float)
        Width and height of a patch, and distance of patches along a row and a column.
    neutrals : tuple of str
        Names of the neutral patches, lightest first.
    """
    row, column = np.divmod(np.arange(rows * columns), columns)
    centres = np.array(pitch) * np.column_stack([column - (columns - 1) / 2, row - (rows - 1) / 2])
    return outlined_chart(name, rows, columns, names, centres, np.tile(patch, (len(names), 1)),
                          neutrals)


def outlined_chart(name: str, rows: int, columns: int, names: tuple[str, ...],
                   centres: np.ndarray, sizes: np.ndarray, neutrals: tuple[str, ...]) -> Chart:
    """A chart of patches anywhere, which ends at their outer corners, its fiducials.

    Parameters
    ----------
    names, neutrals
        As of ``grid_chart``.
    centres, sizes : (I, 2) arrays
        Of the patches, row by row.
    """
    corners = corner_patches(rows, columns)
    fiducials = centres[list(corners)] + SQUARE * sizes[list(corners)] / 2
    first, second, third, fourth = (names[corner] for corner in corners)
    card = (centres + sizes / 2).max(axis=0) - (centres - sizes / 2).min(axis=0)
    return Chart(name, rows, columns, names, centres, sizes, card,
                 tuple(names.index(neutral) for neutral in neutrals), fiducials,
                 (first, second, third, fourth))


def corner_patches(rows: int, columns: int) -> tuple[int, int, int, int]:
    """Indices of the corner patches, going round from the first."""
    return 0, columns - 1, rows * columns - 1, (rows - 1) * columns


# in cm, as printed
CLASSIC = dataclasses.replace(
    grid_chart("ColorChecker Classic", 4, 6, PATCH_NAMES, (4.0, 4.0), (4.35, 4.35),
               neutrals=PATCH_NAMES[18:]),
    card=np.array([29.0, 20.3]), fiducial_names=("dark skin", "bluish green", "black", "white"),
    other_names=(tuple(f"{row}{column}" for row in "ABCD" for column in range(1, 7)),
                 tuple(f"{column}{row}" for row in range(1, 5) for column in "ABCDEF")),
    references=(COPIES_SINCE_2014, COPIES_BEFORE_2014, *REFERENCES, AFTER_2014), detectable=True,
    black_frame=True)


def chart_reflectances(reference: str, grid: WavelengthGrid, chart: Chart = CLASSIC) -> np.ndarray:
    """Reflectances (I, P) of a named published chart, first patch first.

    ``BabelColor Average`` is the average of 30 charts that the paper uses [Pascale 2023], shipped
    by colour-science. ``ColorChecker after November 2014`` is that average, changed smoothly as the
    maker's colours have changed. ``MEANS_OF_COPIES`` says what the means of copies are. Of other
    charts there is one measured copy.

    Parameters
    ----------
    reference : str
        One of ``chart.references``.
    grid : WavelengthGrid
        Working grid, of P wavelengths.
    chart : Chart

    Raises
    ------
    InputError
        If the reference is not known, or none is published of this chart.
    """
    if not chart.references:
        raise errors.InputError(f"chart reference {reference!r} is of another chart than the "
                         f"{chart.name}; give a file of its {len(chart.names)} measured patches "
                         "(CSV or CGATS)")
    if reference not in chart.references:
        raise errors.InputError(f"chart reference {reference!r} is not known"
                         f"{nearest_words(reference, chart.references)}; known are "
                         f"{', '.join(chart.references)}, or a CSV file with one column per patch")
    if reference in MEANS_OF_COPIES:
        return _mean_of_copies(reference, tuple(grid.nm)).copy()
    if reference in published_tables.published_names(published_tables.TRADE):
        return on_grid(*published_tables.published_curves(published_tables.TRADE, reference), grid,
                       reference)
    return table_of_classic(reference, grid)


@functools.lru_cache(maxsize=16)
def _mean_of_copies(reference: str, nm: tuple[float, ...]) -> np.ndarray:
    """Reflectances (24, P) of the mean of copies, at wavelengths from 430 nm or less."""
    grid = grid_from_nm(np.array(nm))
    names, weights = zip(*MEANS_OF_COPIES[reference].items(), strict=True)
    logs = np.log([table_of_classic(name, grid) for name in names])
    levels, greys = levels_of_classic(logs, grid)
    _, all_greys = levels_of_classic(np.log([table_of_classic(name, grid) for name in LEVELLED]),
                                     grid)
    scale, _ = levels_of_classic(np.log([table_of_classic(name, grid)
                                         for name in GREY_SCALE_OF[reference]]), grid)
    lighter = scale.mean(axis=0) - np.average(levels, axis=0, weights=weights)
    lighter[:GREYS.start - 1] = lighter[:GREYS.start - 1].mean()    # coloured patches together
    mean = np.average(logs - greys[:, None, None], axis=0, weights=weights)
    return np.asarray(np.exp(mean + lighter[:, None] + all_greys.mean()))


def levels_of_classic(logs: np.ndarray, grid: WavelengthGrid) -> tuple[np.ndarray, np.ndarray]:
    """Levels (N, 24) of the patches of N copies beside their greys, and of the greys (N,): means of
    logarithms from 430 nm on.

    Parameters
    ----------
    logs : (N, 24, P) array
        Of reflectance.
    grid : WavelengthGrid
    """
    levels = logs[:, :, grid.nm >= GREYS_FROM_NM].mean(axis=2)
    greys = levels[:, GREYS].mean(axis=1)
    return levels - greys[:, None], greys


def table_of_classic(name: str, grid: WavelengthGrid) -> np.ndarray:
    """Reflectances (24, P) of one edition or one measured copy of the ColorChecker Classic.

    Parameters
    ----------
    name : str
        One of ``REFERENCES``, ``AFTER_2014``, or a measured copy of ``MEANS_OF_COPIES``.
    grid : WavelengthGrid
        Working grid, of P wavelengths.
    """
    if name == AFTER_2014:
        return _after_2014(tuple(grid.nm)).copy()
    nm, patches = published_tables.published_curves(
        published_tables.CHARTS if name in REFERENCES else published_tables.COPIES, name)
    return on_grid(nm, patches, grid, name)


@functools.lru_cache(maxsize=16)
def _after_2014(nm: tuple[float, ...]) -> np.ndarray:
    grid = grid_from_nm(np.array(nm))
    return later_generation(table_of_classic(REFERENCES[0], grid), grid)


def plane_centres(chart: Chart = CLASSIC) -> np.ndarray:
    """Centres (I, 2) of the patches in widths of the card, from its corner at the first patch."""
    return chart.centres_uv * np.array([1.0, chart.card[1] / chart.card[0]])


def plane_from_picture(centres_px: np.ndarray, chart: Chart = CLASSIC) -> np.ndarray:
    """Matrix (3, 3) from pixels to the plane of the chart, in widths of the card.

    Parameters
    ----------
    centres_px : (I, 2) array
        Of the patches in a photo, in chart order.
    chart : Chart
    """
    (x, y), (u, v) = centres_px.T, plane_centres(chart).T
    unit = np.abs(centres_px).max()         # pixels in the thousands would spoil the last digits
    x, y = x / unit, y / unit
    zero, one = np.zeros(x.size), np.ones(x.size)
    equations = np.vstack([np.column_stack([x, y, one, zero, zero, zero, -u * x, -u * y]),
                           np.column_stack([zero, zero, zero, x, y, one, -v * x, -v * y])])
    solution = np.linalg.lstsq(equations, np.r_[u, v], rcond=None)[0]
    return np.append(solution, 1.0).reshape(3, 3) @ np.diag([1 / unit, 1 / unit, 1.0])


def projected(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points (N, 2) through a matrix (3, 3) of the plane.

    Parameters
    ----------
    matrix : (3, 3) array
    points : (N, 2) array
    """
    mapped = points @ matrix[:, :2].T + matrix[:, 2]
    return np.asarray(mapped[:, :2] / mapped[:, 2:])


def typical_camera_signals(reflectances: np.ndarray, grid: WavelengthGrid,
                           light: np.ndarray | None = None) -> np.ndarray:
    """Signals (I, 3) that an ordinary camera would read, a perfect reflector about 1 in each band.

    Only to recognise a chart and its orientation; nothing is measured with it.

    Parameters
    ----------
    reflectances : (I, P) array
    grid : WavelengthGrid
        Working grid, of P wavelengths.
    light : (P,) array or None
        Its spectrum, any unit; None for equal energy.
    """
    power = grid.weights_nm if light is None else light * grid.weights_nm
    bands = np.array([np.exp(-0.5 * ((grid.nm - peak) / width) ** 2) * power
                      for peak, width in TYPICAL_BANDS_NM])
    return reflectances @ (bands / bands.sum(axis=1, keepdims=True)).T


def excluded_patches(numbers: Sequence[int], chart: Chart, setting: str) -> np.ndarray:
    """Whether each patch (I,) is excluded from every fit by the operator.

    Parameters
    ----------
    numbers : sequence of int
        From 1, in chart order.
    chart : Chart
    setting : str
        Where the operator wrote them, for the message.

    Raises
    ------
    InputError
        If the chart has no patch of such a number.
    """
    patches = len(chart.names)
    for number in numbers:
        if not 1 <= number <= patches:
            raise errors.InputError(
                f"{setting} {number} is no patch; those of the {chart.name} are "
                f"numbered 1 to {patches}, {chart.names[0]} first")
    return np.isin(np.arange(1, patches + 1), list(numbers))


# ---- order of a table ----------------------------------------------------------------------------
# In which order a table lists the patches of a chart: one of eight that mirrors and turns give.

AS_ASKED = "row by row"     # the order that every table should have
FLOOR = 1e-3                # of the brightest signal, below which darkness is not told apart


def table_orders(rows: int, columns: int) -> dict[str, np.ndarray]:
    """Of each way to read a table, in words, the index (I,) in it of every patch in chart order.

    Parameters
    ----------
    rows, columns : int
        Of the chart.
    """
    by_rows = np.arange(rows * columns).reshape(rows, columns)
    by_columns = np.arange(rows * columns).reshape(columns, rows).T
    orders: dict[str, np.ndarray] = {}
    for words, both, table in ((AS_ASKED, "", by_rows),
                               ("column by column", "column by column, ", by_columns)):
        orders |= {words: table,
                   f"{both}from the last patch to the first": table[::-1, ::-1],
                   f"{both}mirrored left to right": table[:, ::-1],
                   f"{both}mirrored top to bottom": table[::-1]}
    return {words: table.ravel() for words, table in orders.items()}


def order_correlations(signals: np.ndarray, chart_signals: np.ndarray,
                       rows: int) -> dict[str, float]:
    """Correlation of a table's signals with those of a chart, read in each of the eight orders.

    Of logarithms, each band less its mean, so that gains and the light do not count.

    Parameters
    ----------
    signals, chart_signals : (I, K) arrays
        Positive, in any unit.
    rows : int
        Of the chart.

    Returns
    -------
    dict of float
        From the order in words; the first, ``AS_ASKED``, is the one that is asked for.
    """
    one, other = (_centred(values) for values in (signals, chart_signals))
    norm = np.linalg.norm(one) * np.linalg.norm(other)
    return {words: float((one[order] * other).sum() / norm)
            for words, order in table_orders(rows, len(signals) // rows).items()}


def _centred(signals: np.ndarray) -> np.ndarray:
    logarithms = np.log(np.maximum(signals, FLOOR * signals.max()))
    return np.asarray(logarithms - logarithms.mean(axis=0))


# ---- charts made since November 2014 -------------------------------------------------------------
# The ColorChecker Classic as it has been made since November 2014, from the colours of both.
#
# Its maker publishes colours of both generations (L*, a*, b* under D50) and spectra of neither.
# The measured average is of charts made before: each of its spectra is multiplied by the smoothest
# factor that changes its tristimulus values by as much as the published ones have changed.

BEFORE, AFTER = (f"ColorChecker24 - {when} November 2014" for when in ("Before", "After"))
SMOOTH_NM = 80.0             # over which the change of a paint changes
LEVEL_SD = 2.0               # of its level, in units of the change within the spectrum
STEPS = 6                    # of Newton's method: round-off after four
RIDGE = 1e-9


def later_generation(earlier: np.ndarray, grid: WavelengthGrid) -> np.ndarray:
    """Reflectances (24, P) of charts made since November 2014, from those made before.

    Parameters
    ----------
    earlier : (24, P) array
    grid : WavelengthGrid
        Working grid, of P wavelengths.
    """
    weights = appearance.tristimulus_weights(grid.nm, "D50")
    wanted = earlier @ weights.T * published_tables.published_colours(
        AFTER) / published_tables.published_colours(BEFORE)
    apart = (grid.nm[:, None] - grid.nm) / SMOOTH_NM
    smooth = LEVEL_SD**2 + np.exp(-0.5 * apart**2)
    later = []
    for reflectance, target in zip(earlier, wanted, strict=True):
        change = np.zeros(grid.nm.size)                 # of the logarithm
        for _ in range(STEPS):
            seen = weights * reflectance * np.exp(change)
            colour = seen.sum(axis=1)
            slope = seen / colour[:, None]
            off = np.log(target / colour) + slope @ change
            change = smooth @ slope.T @ np.linalg.solve(slope @ smooth @ slope.T
                                                        + RIDGE * np.eye(3), off)
        later.append(reflectance * np.exp(change))
    return np.array(later)
