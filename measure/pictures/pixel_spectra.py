"""From pixels' signals to spectra: the same tables for a whole picture, whatever its signals are.

A picture is read twice, some rows at a time. The first reading surveys which points of a table of
spectra (sampling/prior/uplift_table.py) its signals need, and the table is computed once; the
second reading interpolates in it. With other than three bands posteriors at some of the signals
take the table's place (sampling/prior/local_posteriors.py). Pictures with few pixels are computed
pixel by pixel. A spectrum depends on its own pixel and on the tables alone, so that it does not
depend on how the picture is cut, nor on who computes it.
"""
from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

import numpy as np

from spectrabox.capture.photo.image_rows import ROWS_PER_BLOCK
from spectrabox.measure.shoot.options import PictureFormat
from spectrabox.radiometry import error_model, errors
from spectrabox.sampling.prior import local_posteriors, mixture, uplift_table

ABOVE_WHITE = 1.1       # of white: more than white's own error and the photo's noise
MAX_ABOVE = 0.05        # of the pixels: lamps and highlights; where more are, white is another
PIXELS_AT_ONCE = 65_536
PIXELS_IN_CACHE = 16_384    # looked up at a time
SAMPLED = 65_536            # pixels, evenly over the picture, whose signals stand for all
POINT_IN_PIXELS = 1         # a point of one table takes as long as how many pixels one by one
CENTRE_IN_PIXELS = 2        # likewise one of the posteriors among many bands, at most
GRID_STEP_NM = 5
DEVIATION_STEPS = 2     # the standard deviation changes slowly: every second wavelength is kept


@dataclass(frozen=True)
class PictureLayout:
    """Which of the prior's 61 wavelengths mean and standard deviation are kept at, and the format
    of their files; ENVI's are single floats.
    """

    step_nm: int            # between wavelengths of the mean, a multiple of 5
    full: bool = False      # all wavelengths of both, in single instead of half floats
    form: PictureFormat = "exr"

    @property
    def mean(self) -> slice:
        """Wavelengths of the mean, of the 61."""
        return slice(None, None, 1 if self.full else self.step_nm // GRID_STEP_NM)

    @property
    def deviation(self) -> slice:
        """Wavelengths of the standard deviation, of the 61."""
        return slice(None, None,
                     1 if self.full else DEVIATION_STEPS * self.step_nm // GRID_STEP_NM)

    @property
    def nm(self) -> tuple[np.ndarray, np.ndarray]:
        """Wavelengths (P,) of the mean and (Q,) of the standard deviation."""
        return mixture.PRIOR_GRID.nm[self.mean], mixture.PRIOR_GRID.nm[self.deviation]

    @property
    def pixel_type(self) -> str:
        """Type of the numbers in the files."""
        return "float" if self.full or self.form == "envi" else "half"


@dataclass(frozen=True)
class PixelBlock:
    """The n pixels of some rows."""

    signals: np.ndarray             # (n, K) relative to white, as a table is read at them
    light: np.ndarray | None        # (n,) index of the typical light; None where there is one
    error_level: np.ndarray | None  # (n,) 0 where errors are smallest, 1 where largest; None
    # where they depend on the signal alone


class PixelSource(Protocol):
    """A picture of signals, read in blocks as often as needed."""

    @property
    def size(self) -> tuple[int, int, int]:
        """Height, width and number of bands K."""

    @property
    def prior(self) -> mixture.LogitMixture:
        """Of the reflectances."""

    @property
    def responses(self) -> np.ndarray:
        """Relative response (J, K, 61) under each of the typical lights; rows sum to 1."""

    @property
    def table_side(self) -> int:
        """Points of a table along each axis, odd."""

    @property
    def error_levels(self) -> int:
        """How many errors ``table_errors`` gives."""

    def block(self, first: int, last: int) -> PixelBlock:
        """The pixels of rows ``first`` to ``last``."""

    def table_errors(self, light: int, signals: np.ndarray) -> list[error_model.Errors]:
        """Errors of signals (n, K) under one light: one, or the smallest and the largest of the
        picture.
        """

    def direct(self, block: Any) -> uplift_table.Uplifted:
        """Spectra of a block, each pixel by itself."""


def require_below_white(above: int, pixels: int, remedy: str) -> None:
    """Refuse an image of which too much is brighter than a perfect white.

    Parameters
    ----------
    above : int
        Pixels with a band above ABOVE_WHITE.
    pixels : int
        Of the image.
    remedy : str
        How white is stated, for the error.

    Raises
    ------
    InputError
    """
    if above > MAX_ABOVE * pixels:
        raise errors.InputError(
            f"{above / pixels:.0%} of the pixels are brighter than a perfect white: "
            f"what white reads is not what was taken. {remedy}")


def row_blocks(height: int, width: int) -> list[tuple[int, int]]:
    """First and last row of the parts in which a picture is read."""
    rows = max(1, PIXELS_AT_ONCE // (width * ROWS_PER_BLOCK)) * ROWS_PER_BLOCK
    return [(first, min(first + rows, height)) for first in range(0, height, rows)]


def survey(source: PixelSource, progress: uplift_table.Progress = lambda share: None
           ) -> tuple[np.ndarray, PixelBlock, int, int]:
    """The first reading of a picture.

    Parameters
    ----------
    source : PixelSource
    progress : function of the share that is done

    Returns
    -------
    points : (J, side, side, side) bool array
        Needed points of the table of each light.
    sample : PixelBlock
        Some pixels.
    outside, above : int
        Pixels with a band outside 0 to 1, and clearly above white.
    """
    height, width, bands = source.size
    points = np.zeros((len(source.responses), *(source.table_side,) * 3), dtype=bool)
    # from one pixel of the sample to the next, in reading order: no divisor of a row
    step = max(1, -(-height * width // SAMPLED))
    while math.gcd(step, width) > 1:
        step += 1
    outside, above = 0, 0
    samples: list[PixelBlock] = []
    for first, last in row_blocks(height, width):
        block = source.block(first, last)
        for light, some in _pieces(block, PIXELS_IN_CACHE) if bands == 3 else ():
            points[light] |= uplift_table.points_around(block.signals[some], source.table_side)
        outside += int(uplift_table.outside(block.signals).sum())
        above += int(np.any(block.signals > ABOVE_WHITE, axis=1).sum())
        some = slice(-first * width % step, None, step)
        # copied: a view would hold all signals of these rows
        samples.append(PixelBlock(block.signals[some].copy(), _rows([block.light], some),
                                  _rows([block.error_level], some)))
        progress(last / height)
    return points, PixelBlock(
        np.concatenate([each.signals for each in samples]), _rows([each.light for each in samples]),
        _rows([each.error_level for each in samples])), outside, above


def _rows(parts: Sequence[np.ndarray | None], some: slice = slice(None)) -> np.ndarray | None:
    """Some rows of each part, one after the other, copied; None where there are none."""
    known = [each[some] for each in parts if each is not None]
    return np.concatenate(known) if known else None


def _pieces(block: PixelBlock, most: int) -> Iterator[tuple[int, Any]]:
    """Indices of a block's pixels under each light, no more than ``most`` at a time."""
    count = len(block.signals)
    if block.light is None:
        for start in range(0, count, most):
            yield 0, slice(start, start + most)
        return
    for light in np.unique(block.light):
        own = np.flatnonzero(block.light == light)
        for start in range(0, own.size, most):
            yield int(light), own[start:start + most]


# of each light a function from signals (n, K) and the level (n,) of their errors to mean, standard
# deviation and novelty side by side (n, C); none where pixels are computed one by one
SpectraTable = Callable[[np.ndarray, np.ndarray | None], np.ndarray]
SpectraTables = tuple[SpectraTable, ...]


def _looked_up(row: np.ndarray, columns: np.ndarray, change: np.ndarray | None,
               signals: np.ndarray, level: np.ndarray | None) -> np.ndarray:
    """What signals (n, 3) become by a table of one light at L points of the lattice of signals.

    Parameters
    ----------
    row : (side, side, side) array
        Of each point of the lattice, in the table.
    columns : (L, C) array
        Where errors are smallest.
    change : (L, C) array or None
        From there to where they are largest.
    signals, level
        As of ``SpectraTables``.
    """
    weights = uplift_table.interpolation(row, len(columns), signals)
    values = weights @ columns
    if change is not None and level is not None:
        values += level[:, None] * (weights @ change)
    return np.asarray(values)


def block_spectra(source: PixelSource, layout: PictureLayout, tables: SpectraTables,
                  block: PixelBlock) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean (n, P), standard deviation (n, Q) and novelty (n,) of a block's pixels.

    Parameters
    ----------
    source : PixelSource
    layout : PictureLayout
    tables : tuple of functions
        Of the whole picture, as of `spectra_tables`.
    block : PixelBlock
    """
    mean, deviation = (nm.size for nm in layout.nm)
    if tables:
        values = np.empty((len(block.signals), mean + deviation + 1), np.float32)
        most = PIXELS_IN_CACHE if source.size[2] == 3 else local_posteriors.LocalPosteriors.at_once
        for light, some in _pieces(block, most):
            level = None if block.error_level is None else block.error_level[some]
            values[some] = tables[light](block.signals[some], level)
    else:
        values = _columns(source.direct(block), layout)
    return values[:, :mean], values[:, mean:-1], values[:, -1]


def spectra_tables(source: PixelSource, layout: PictureLayout, points: np.ndarray,
                   sample: PixelBlock, progress: uplift_table.Progress = lambda share: None,
                   map_parts: uplift_table.MapParts = map) -> SpectraTables:
    """How signals become spectra, the same for all pixels of a picture that has been surveyed.

    Parameters
    ----------
    source : PixelSource
    layout : PictureLayout
    points, sample
        As of `survey`.
    progress : function of the share that is done
    map_parts : function of (function, iterable), optional
        As ``map``; of a pool of threads, the tables are computed on several cores.
    """
    height, width, bands = source.size
    count = int(points.sum())
    one_by_one = height * width < (POINT_IN_PIXELS * source.error_levels * count if bands == 3
                                   else CENTRE_IN_PIXELS * local_posteriors.MAX_CENTRES)
    if one_by_one:
        return ()
    if bands != 3:
        return tuple(_local_tables(source, layout, sample, progress, map_parts))
    tables: list[SpectraTable] = []
    done = 0
    for light, wanted in enumerate(points):
        own = int(wanted.sum())
        uplifted, row = uplift_table.build_tables(
            source.prior, source.responses[light], partial(source.table_errors, light), wanted,
            lambda share, done=done, own=own: progress(     # type: ignore[misc]
                (done + share * own) / count), map_parts)
        smallest, *larger = (_columns(table, layout) for table in uplifted)
        tables.append(partial(_looked_up, row, smallest,
                              larger[0] - smallest if larger else None))
        done += own
    return tuple(tables)


def _columns(uplifted: uplift_table.Uplifted, layout: PictureLayout) -> np.ndarray:
    """Mean, standard deviation and novelty side by side."""
    mean, deviation, novelty = uplifted
    return np.hstack([mean[:, layout.mean], deviation[:, layout.deviation], novelty[:, None]])


def _local_tables(source: PixelSource, layout: PictureLayout, sample: PixelBlock,
                  progress: uplift_table.Progress,
                  map_parts: uplift_table.MapParts) -> Iterator[SpectraTable]:
    """By posteriors at some signals under each light."""
    lights = len(source.responses)
    for light, response in enumerate(source.responses):
        own = slice(None) if sample.light is None else sample.light == light
        if not sample.signals[own].size:    # too few pixels for one of them to be in the sample
            own = slice(None)
        yield local_posteriors.local_posteriors(
            source.prior, response, partial(source.table_errors, light), sample.signals[own],
            None if sample.error_level is None else sample.error_level[own], layout.mean,
            layout.deviation, lambda share, light=light: progress(    # type: ignore[misc]
                (light + share) / lights), map_parts).values
