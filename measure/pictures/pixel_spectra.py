"""From pixels' signals to spectra: one plan for a whole picture, whatever its signals come from.

A picture is read twice, some rows at a time. The first reading surveys which points of a table of
spectra (sampling/prior/tables.py) its signals need, and the table is computed once; the second
reading interpolates in it. Pictures with few pixels, or with other than three bands, are computed
pixel by pixel. Either way a spectrum depends on its own pixel and on the plan alone, so that it
does not depend on how the picture is cut, nor on who computes it.
"""
from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

import numpy as np

from spectrabox.capture.photo.image_rows import ROWS_PER_BLOCK
from spectrabox.sampling.prior.low_rank import LowRank, stated_errors
from spectrabox.sampling.prior.mixture import PRIOR_GRID, LogitMixture
from spectrabox.sampling.prior.uplift_table import (
    MapParts,
    Progress,
    Uplifted,
    UpliftTable,
    build_tables,
    interpolation,
    outside,
    points_around,
)

PIXELS_AT_ONCE = 65_536
PIXELS_IN_CACHE = 16_384    # looked up at a time
SAMPLED = 65_536            # pixels, evenly over the picture, that tell what a low rank costs
SAMPLED_DIRECTLY = 2048     # where each takes a millisecond
POINT_IN_PIXELS = 1         # a point of one table takes as long as how many pixels one by one
SUM_ERROR = 1e-5            # of an interpolation in single precision, at most
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
        return PRIOR_GRID.nm[self.mean], PRIOR_GRID.nm[self.deviation]

    @property
    def float_type(self) -> Any:
        """Type of the numbers that are stored."""
        return np.float32 if self.full else np.float16


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
    def prior(self) -> LogitMixture:
        """Of the reflectances."""

    @property
    def responses(self) -> np.ndarray:
        """Relative response (J, K, 61) under each of the typical lights; rows sum to 1."""

    @property
    def table_side(self) -> int:
        """Points of a table along each axis, odd."""

    @property
    def error_levels(self) -> int:
        """How many covariances ``table_errors`` gives."""

    def block(self, first: int, last: int) -> PixelBlock:
        """The pixels of rows ``first`` to ``last``."""

    def table_errors(self, light: int, signals: np.ndarray) -> list[np.ndarray]:
        """Covariances (n, K, K) of signals (n, K) under one light: one, or the smallest and the
        largest of the picture.
        """

    def direct(self, block: Any) -> Uplifted:
        """Spectra of a block, each pixel by itself."""


@dataclass(frozen=True)
class Survey:
    """Results of the first reading of some rows."""

    points: np.ndarray      # (J, side, side, side) bool: needed points of the table of each light
    outside: int            # pixels with a band outside 0 to 1
    sample: np.ndarray      # (n, K) signals of some pixels


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
    for light, some in _pieces(block) if bands == 3 else ():
        points[light] |= points_around(block.signals[some], source.table_side)
    # from one pixel of the sample to the next, in reading order: no divisor of a row
    step = max(1, -(-height * width // SAMPLED))
    while math.gcd(step, width) > 1:
        step += 1
    # copied: a view would hold all signals of these rows
    return Survey(points, int(outside(block.signals).sum()),
                  block.signals[-first * width % step::step].copy())


def merge_surveys(surveys: Iterable[Survey]) -> Survey:
    """The survey of all rows, from parts in their order."""
    points, beyond, samples = np.array(False), 0, []
    for survey in surveys:
        points = points | survey.points
        beyond += survey.outside
        samples.append(survey.sample)
    return Survey(points, beyond, np.concatenate(samples))


def _pieces(block: PixelBlock) -> Iterator[tuple[int, Any]]:
    """Indices of a block's pixels under each light, no more at a time than stay in the cache."""
    count = len(block.signals)
    if block.light is None:
        for start in range(0, count, PIXELS_IN_CACHE):
            yield 0, slice(start, start + PIXELS_IN_CACHE)
        return
    for light in np.unique(block.light):
        own = np.flatnonzero(block.light == light)
        for start in range(0, own.size, PIXELS_IN_CACHE):
            yield int(light), own[start:start + PIXELS_IN_CACHE]


@dataclass(frozen=True)
class LightTable:
    """Numbers that a signal becomes under one light, at L points of the lattice of signals."""

    row: np.ndarray             # (side, side, side) of each point of the lattice
    columns: np.ndarray         # (L, C) where errors are smallest
    change: np.ndarray | None   # (L, C) from there to where they are largest


@dataclass(frozen=True)
class SpectraPlan:
    """How signals become spectra, the same for all pixels of a picture."""

    kept: KeptWavelengths
    tables: tuple[LightTable, ...]      # of each light; none where pixels are computed one by one
    low_rank: LowRank | None = None
    errors: dict[str, Any] | None = None    # that the low rank costs

    def values(self, source: PixelSource, block: PixelBlock) -> np.ndarray:
        """Numbers (n, C) of a block's pixels.

        Returns
        -------
        (n, C) array
            Coefficients of the low rank; without one mean (P), standard deviation (Q) and novelty
            (1) side by side.
        """
        if not self.tables:
            spectra = _columns(source.direct(block), self.kept, novelty=self.low_rank is None)
            return spectra if self.low_rank is None else self.low_rank.coefficients(spectra)
        values = np.empty((len(block.signals), self.tables[0].columns.shape[1]), np.float32)
        for light, some in _pieces(block):
            table = self.tables[light]
            weights = interpolation(table.row, len(table.columns), block.signals[some])
            piece = weights @ table.columns
            if table.change is not None and block.error_level is not None:
                piece += block.error_level[some, None] * (weights @ table.change)
            values[some] = piece
        return values

    def split(self, values: np.ndarray) -> tuple[np.ndarray, ...]:
        """Coefficients, or mean (n, P) and standard deviation (n, Q), as they are written."""
        mean, deviation = (nm.size for nm in self.kept.nm)
        return (values,) if self.low_rank is not None else (
            values[:, :mean], values[:, mean:mean + deviation])


def plan_spectra(source: PixelSource, kept: KeptWavelengths, survey: Survey,
                 low_rank: LowRank | None = None,
                 progress: Progress = lambda share: None,
                 map_parts: MapParts = map) -> SpectraPlan:
    """The plan of a picture all of whose rows have been surveyed.

    Parameters
    ----------
    source : PixelSource
    kept : KeptWavelengths
    survey : Survey
        Of all rows.
    low_rank : LowRank, optional
        Of sources with one light and errors of one level.
    progress : function of the share that is done
    map_parts : function of (function, iterable), optional
        As ``map``; of a pool of threads, the tables are computed on several cores.
    """
    height, width, bands = source.size
    points = int(survey.points.sum())
    if bands != 3 or height * width < POINT_IN_PIXELS * source.error_levels * points:
        return SpectraPlan(kept, (), low_rank, None if low_rank is None
                           else _errors_one_by_one(source, kept, survey, low_rank))
    tables: list[LightTable] = []
    done = 0
    for light, wanted in enumerate(survey.points):
        own = int(wanted.sum())
        uplifted = build_tables(
            source.prior, source.responses[light], partial(source.table_errors, light), wanted,
            lambda share, done=done, own=own: progress(     # type: ignore[misc]
                (done + share * own) / points), map_parts)
        smallest, *larger = (_columns(table, kept, novelty=low_rank is None) for table in uplifted)
        tables.append(LightTable(uplifted[0].row, smallest,
                                 larger[0] - smallest if larger else None))
        done += own
    if low_rank is None:
        return SpectraPlan(kept, tuple(tables))
    row, spectra = tables[0].row, tables[0].columns
    coefficients = low_rank.coefficients(spectra)
    # A pixel's error is a mean of those at the table's points around it.
    rounding = float(np.finfo(kept.float_type).eps) / 2
    bound = (np.abs(low_rank.spectra(coefficients) - spectra)
             + low_rank.rounded(coefficients, rounding)).max(axis=0) + SUM_ERROR
    weights = interpolation(row, len(spectra), survey.sample)
    return SpectraPlan(kept, (LightTable(row, coefficients, None),), low_rank, stated_errors(
        low_rank, weights @ spectra, (weights @ coefficients).astype(kept.float_type),
        kept.nm[0].size, bound))


def _columns(uplifted: Uplifted | UpliftTable, kept: KeptWavelengths, *,
             novelty: bool) -> np.ndarray:
    """Mean and standard deviation side by side, and perhaps the novelty."""
    return np.hstack([uplifted.mean[:, kept.mean], uplifted.standard_deviation[:, kept.deviation],
                      uplifted.novelty[:, None][:, :int(novelty)]])


def _errors_one_by_one(source: PixelSource, kept: KeptWavelengths, survey: Survey,
                       low_rank: LowRank) -> dict[str, Any]:
    """Errors that a low rank costs where there is no table, of some pixels of the sample."""
    some = survey.sample[::max(1, -(-len(survey.sample) // SAMPLED_DIRECTLY))]
    spectra = _columns(source.direct(PixelBlock(some, None, None)), kept, novelty=False)
    return stated_errors(low_rank, spectra,
                         low_rank.coefficients(spectra).astype(kept.float_type),
                         kept.nm[0].size, None)
