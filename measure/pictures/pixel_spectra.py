"""From pixels' signals to spectra: one plan for a whole picture, whatever its signals come from.

A picture is read twice, some rows at a time. The first reading surveys which points of a table of
spectra (sampling/prior/uplift_table.py) its signals need, and the table is computed once; the
second reading interpolates in it. With other than three bands posteriors at some of the signals
take the table's place (sampling/prior/local_posteriors.py). Pictures with few pixels are computed
pixel by pixel. A spectrum depends on its own pixel and on the plan alone, so that it does not
depend on how the picture is cut, nor on who computes it.
"""
from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

import numpy as np

from spectrabox.capture.photo.image_rows import ROWS_PER_BLOCK
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
class KeptWavelengths:
    """Which of the prior's 61 wavelengths mean and standard deviation are kept at."""

    step_nm: int            # between wavelengths of the mean, a multiple of 5
    full: bool = False      # all wavelengths of both, in single instead of half floats

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


@dataclass(frozen=True)
class Survey:
    """Results of the first reading of some rows."""

    points: np.ndarray      # (J, side, side, side) bool: needed points of the table of each light
    outside: int            # pixels with a band outside 0 to 1
    above: int              # pixels with a band clearly above white
    sample: PixelBlock      # some pixels


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


def survey_rows(source: PixelSource, first: int, last: int) -> Survey:
    """The first reading of rows ``first`` to ``last``.

    Parameters
    ----------
    source : PixelSource
    first, last : int
    """
    height, width, bands = source.size
    block = source.block(first, last)
    points = np.zeros((len(source.responses), *(source.table_side,) * 3), dtype=bool)
    for light, some in _pieces(block, PIXELS_IN_CACHE) if bands == 3 else ():
        points[light] |= uplift_table.points_around(block.signals[some], source.table_side)
    # from one pixel of the sample to the next, in reading order: no divisor of a row
    step = max(1, -(-height * width // SAMPLED))
    while math.gcd(step, width) > 1:
        step += 1
    some = slice(-first * width % step, None, step)
    # copied: a view would hold all signals of these rows
    sample = PixelBlock(block.signals[some].copy(), _rows([block.light], some),
                        _rows([block.error_level], some))
    return Survey(points, int(uplift_table.outside(block.signals).sum()),
                  int(np.any(block.signals > ABOVE_WHITE, axis=1).sum()), sample)


def merge_surveys(surveys: Iterable[Survey]) -> Survey:
    """The survey of all rows, from parts in their order."""
    points, beyond, above, samples = np.array(False), 0, 0, []
    for survey in surveys:
        points = points | survey.points
        beyond += survey.outside
        above += survey.above
        samples.append(survey.sample)
    return Survey(points, beyond, above, PixelBlock(
        np.concatenate([each.signals for each in samples]), _rows([each.light for each in samples]),
        _rows([each.error_level for each in samples])))


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


@dataclass(frozen=True)
class LightTable:
    """Numbers that a signal becomes under one light, at L points of the lattice of signals."""

    row: np.ndarray             # (side, side, side) of each point of the lattice
    columns: np.ndarray         # (L, C) where errors are smallest
    change: np.ndarray | None   # (L, C) from there to where they are largest

    at_once = PIXELS_IN_CACHE

    def values(self, signals: np.ndarray, level: np.ndarray | None) -> np.ndarray:
        """Numbers (n, C) of signals (n, 3), and of the level (n,) of their errors."""
        weights = uplift_table.interpolation(self.row, len(self.columns), signals)
        values = weights @ self.columns
        if self.change is not None and level is not None:
            values += level[:, None] * (weights @ self.change)
        return np.asarray(values)


@dataclass(frozen=True)
class SpectraPlan:
    """How signals become spectra, the same for all pixels of a picture."""

    kept: KeptWavelengths
    # of each light; none where pixels are computed one by one
    tables: tuple[LightTable | local_posteriors.LocalPosteriors, ...]

    def values(self, source: PixelSource, block: PixelBlock) -> np.ndarray:
        """Numbers (n, C) of a block's pixels.

        Returns
        -------
        (n, C) array
            Mean (P), standard deviation (Q) and novelty (1) side by side.
        """
        if not self.tables:
            return _columns(source.direct(block), self.kept)
        columns = sum(nm.size for nm in self.kept.nm) + 1
        values = np.empty((len(block.signals), columns), np.float32)
        for light, some in _pieces(block, self.tables[0].at_once):
            table = self.tables[light]
            level = None if block.error_level is None else block.error_level[some]
            values[some] = table.values(block.signals[some], level)
        return values

    def split(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean (n, P) and standard deviation (n, Q), as they are written."""
        mean, deviation = (nm.size for nm in self.kept.nm)
        return values[:, :mean], values[:, mean:mean + deviation]


def plan_spectra(source: PixelSource, kept: KeptWavelengths, survey: Survey,
                 progress: uplift_table.Progress = lambda share: None,
                 map_parts: uplift_table.MapParts = map) -> SpectraPlan:
    """The plan of a picture all of whose rows have been surveyed.

    Parameters
    ----------
    source : PixelSource
    kept : KeptWavelengths
    survey : Survey
        Of all rows.
    progress : function of the share that is done
    map_parts : function of (function, iterable), optional
        As ``map``; of a pool of threads, the tables are computed on several cores.
    """
    height, width, bands = source.size
    points = int(survey.points.sum())
    one_by_one = height * width < (POINT_IN_PIXELS * source.error_levels * points if bands == 3
                                   else CENTRE_IN_PIXELS * local_posteriors.MAX_CENTRES)
    if bands != 3 or one_by_one:
        near = () if one_by_one else tuple(_local_tables(source, kept, survey, progress, map_parts))
        return SpectraPlan(kept, near)
    tables: list[LightTable] = []
    done = 0
    for light, wanted in enumerate(survey.points):
        own = int(wanted.sum())
        uplifted, row = uplift_table.build_tables(
            source.prior, source.responses[light], partial(source.table_errors, light), wanted,
            lambda share, done=done, own=own: progress(     # type: ignore[misc]
                (done + share * own) / points), map_parts)
        smallest, *larger = (_columns(table, kept) for table in uplifted)
        tables.append(LightTable(row, smallest, larger[0] - smallest if larger else None))
        done += own
    return SpectraPlan(kept, tuple(tables))


def _columns(uplifted: uplift_table.Uplifted, kept: KeptWavelengths) -> np.ndarray:
    """Mean, standard deviation and novelty side by side."""
    mean, deviation, novelty = uplifted
    return np.hstack([mean[:, kept.mean], deviation[:, kept.deviation], novelty[:, None]])


def _local_tables(source: PixelSource, kept: KeptWavelengths, survey: Survey,
                  progress: uplift_table.Progress,
                  map_parts: uplift_table.MapParts) -> Iterator[local_posteriors.LocalPosteriors]:
    """Posteriors at some signals under each light."""
    lights, sample = len(source.responses), survey.sample
    for light, response in enumerate(source.responses):
        own = slice(None) if sample.light is None else sample.light == light
        if not sample.signals[own].size:    # too few pixels for one of them to be in the sample
            own = slice(None)
        yield local_posteriors.local_posteriors(
            source.prior, response, partial(source.table_errors, light), sample.signals[own],
            None if sample.error_level is None else sample.error_level[own], kept.mean,
            kept.deviation, lambda share, light=light: progress(    # type: ignore[misc]
                (light + share) / lights), map_parts)
