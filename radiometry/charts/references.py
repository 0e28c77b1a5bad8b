"""Reflectances of a chart, published, measured or from a file, and how copies of a chart differ.

How copies of a chart differ: what is known beforehand of the one that was photographed.

Editions and measured copies of the ColorChecker Classic differ from their mean by .012 to .017 of
reflectance, relative to their greys: in the level of a patch by 2 to 3 %, of a white by 3 %; in
where edges lie and how deep absorptions are, within some 25 nm; by a yellowing that white and
light greys share; and in the level of the whole chart by 1 %. Logarithms are what varies, each term
an independent unit normal.
``benchmarks/bench_chart_copies.py`` puts copies so drawn beside tables and measured ones.
"""


from __future__ import annotations

import re
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Annotated

import numpy as np

from spectrabox.radiometry import chart as charts
from spectrabox.radiometry import errors, files, shaped
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.published.published_tables import published_colours
from spectrabox.radiometry.records.spectra import Quantity, WavelengthGrid
from spectrabox.radiometry.spectra import spectrum_files
from spectrabox.radiometry.spectra.formats.measurement_table import SpectralTable

# Standard deviations of the logarithm of reflectance, of editions and measured copies about their
# mean: level of a coloured patch, of white, of a grey; shape of a coloured patch and of a neutral
# one, the wavelengths over which it holds, and what dark parts of spectra add in reflectance
LEVEL, WHITE_LEVEL, GREY_LEVEL = 0.025, 0.026, 0.013
SHAPE, SHAPE_NM, NEUTRAL_SHAPE, NEUTRAL_SHAPE_NM = 0.032, 25.0, 0.01, 60.0
DARK, DARK_NEUTRAL = 0.003, 0.001
# in common: a yellowing of neutrals, in proportion to their reflectance, at 400 nm, and the
# wavelengths over which it fades; the level of a whole chart
YELLOWING, YELLOWING_NM, CHART_LEVEL = 0.05, 80.0, 0.01
# The least that a fit takes for the error of a patch's own level, as a share of the above; of
# white, which dirt and yellowing darken first, all. How far levels of this chart scatter beyond
# that, its photo tells, as the error that a fit finds common to the bands of a patch: taken for
# sure, 2.5 % would hide how a near lamp falls off.
LEAST_LEVEL = 0.4
KEPT = 0.995            # of the variance of shapes, by their principal terms
ANOTHER = 1.5           # of a chart of which one copy alone is known: its errors over a Classic's
# share of charts in use that were made before November 2014, where no date says more
SHARE_BEFORE_2014 = 0.05


@dataclass(frozen=True, eq=False)
class ChartCopies(shaped.Record):
    """Charts of one edition as a distribution: log reflectance = that of the mean + own terms of
    each patch + terms that patches have in common.
    """

    name: str
    mean: Annotated[np.ndarray, "I P"]              # reflectance
    own: Annotated[np.ndarray, "I P Q"]             # log reflectance by a patch's own terms
    common: Annotated[np.ndarray, "I P S"]
    least_level: Annotated[np.ndarray, "I"]         # of the first own term, its level, in a fit
    share: float = 1.0                              # of charts in use that are of this edition
    # when charts of it were made, SINCE_2014 or BEFORE_2014; empty where no other edition is known
    made: str = ""

    def drawn(self, rng: np.random.Generator) -> np.ndarray:
        """Reflectances (I, P) of one copy.

        Parameters
        ----------
        rng : numpy.random.Generator
        """
        patches, _, own = self.own.shape
        departure = np.einsum("ipq,iq->ip", self.own, rng.standard_normal((patches, own)))
        return np.asarray(self.mean * np.exp(
            departure + self.common @ rng.standard_normal(self.common.shape[2])))


def copies_of(name: str, mean: np.ndarray, neutrals: tuple[int, ...], grid: WavelengthGrid,
              share: float = 1.0, larger: float = 1.0, made: str = "") -> ChartCopies:
    """Copies of a chart about their mean, with the errors of a ColorChecker Classic.

    Parameters
    ----------
    name : str
    mean : (I, P) array
    neutrals : tuple of int
        Neutral patches, lightest first.
    grid : WavelengthGrid
        Working grid, of P wavelengths.
    share : float
        Of charts in use.
    larger : float
        Factor in all errors; ``ANOTHER`` for a chart of which one copy alone is known.
    made : str
        As of ``ChartCopies``.
    """
    level = np.full(len(mean), LEVEL)
    level[list(neutrals)] = GREY_LEVEL
    level[list(neutrals[:1])] = WHITE_LEVEL
    is_neutral = np.isin(np.arange(len(mean)), neutrals)[:, None]
    shape = np.where(is_neutral, np.hypot(NEUTRAL_SHAPE, DARK_NEUTRAL / mean),
                     np.hypot(SHAPE, DARK / mean))
    smooth, broad = (_principal(grid, width) for width in (SHAPE_NM, NEUTRAL_SHAPE_NM))
    broad = np.pad(broad, ((0, 0), (0, smooth.shape[1] - broad.shape[1])))
    shapes = shape[:, :, None] * np.where(is_neutral[:, :, None], broad, smooth)
    own = np.concatenate([np.broadcast_to(level[:, None, None], (*mean.shape, 1)), shapes], axis=2)
    yellow = YELLOWING * np.exp((grid.nm[0] - grid.nm) / YELLOWING_NM) * mean * is_neutral
    common = np.stack([yellow, np.full(mean.shape, CHART_LEVEL)], axis=2)
    least = np.full(len(mean), LEAST_LEVEL)
    least[list(neutrals[:1])] = 1.0
    return ChartCopies(name, mean, larger * own, larger * common, least, share, made)


def _principal(grid: WavelengthGrid, width_nm: float) -> np.ndarray:
    """Terms (P, Q) of smooth curves of unit variance that hold over a width."""
    kernel = np.exp(-0.5 * ((grid.nm[:, None] - grid.nm) / width_nm) ** 2)
    values, vectors = np.linalg.eigh(kernel)
    values, vectors = values[::-1], vectors[:, ::-1]
    kept = 1 + int(np.searchsorted(np.cumsum(values), KEPT * values.sum()))
    terms = vectors[:, :kept] * np.sqrt(values[:kept])
    return np.asarray(terms / np.linalg.norm(terms, axis=1, keepdims=True))


def editions(chart: charts.Chart, taken_at: str = "") -> tuple[ChartCopies, ...]:
    """The editions that a chart of a layout may be of, the likelier first, on FINE_GRID; none where
    no copies of it are known.

    Parameters
    ----------
    chart : Chart
    taken_at : str
        When it was photographed, as 2014-10-31 with or without more; empty where that is not known.
    """
    if not chart.references:
        return ()
    if charts.COPIES_SINCE_2014 not in chart.references:
        name = chart.references[0]
        return (copies_of(name, charts.chart_reflectances(name, FINE_GRID, chart), chart.neutrals,
                          FINE_GRID, larger=ANOTHER),)
    since, before = _classic_editions()
    if taken_at and taken_at < "2014-11":
        return (before,)
    return since, before


@lru_cache(maxsize=1)
def _classic_editions() -> tuple[ChartCopies, ChartCopies]:
    neutrals = tuple(range(18, 24))
    since, before = (
        copies_of(name, charts.chart_reflectances(name, FINE_GRID), neutrals, FINE_GRID, share,
                  made=made)
        for name, share, made in ((charts.COPIES_SINCE_2014, 1 - SHARE_BEFORE_2014,
                                   charts.SINCE_2014),
                                  (charts.COPIES_BEFORE_2014, SHARE_BEFORE_2014,
                                   charts.BEFORE_2014)))
    return since, before


# ---- reflectances of a chart, published or from a file -------------------------------------------

SURE_CORRELATION = 0.8      # of another order: of ColorCheckers it is 0.97 or more in the right one
CLEAR_GAIN = 0.2            # over the correlation of the order as it stands
DARKEST = 0.005             # of white: a sharpened colour may be negative
# From tristimulus values to about what the bands of a camera see [Bradford, ICC.1:2022 Annex E].
SHARPENED = np.array([(0.8951, 0.2664, -0.1614), (-0.7502, 1.7135, 0.0367),
                      (0.0389, -0.0685, 1.0296)])


def reference_file(reference: str | None, chart: charts.Chart,
                   folder: Path = Path()) -> Path | None:
    """The file that a chart's reflectances come from; None where they are published.

    Parameters
    ----------
    reference : str or None
        What the operator wrote: a published name or a file; None for the layout's own.
    chart : Chart
    folder : Path
        That the file's name is seen from.
    """
    if reference is None:
        return chart.reference_file
    return folder / reference if files.names_a_file(reference) else None


def reference_reflectances(reference: str | None, chart: charts.Chart, grid: WavelengthGrid,
                           folder: Path = Path()) -> np.ndarray:
    """Reflectances (I, P) of a chart, in chart order.

    Parameters
    ----------
    reference, chart, folder
        As of ``reference_file``.
    grid : WavelengthGrid
        Working grid, of P wavelengths.

    Raises
    ------
    InputError, CheckError
        As ``measured_chart`` and ``chart_reflectances``; or if the layout has no reflectances of
        its own and none were given.
    """
    file = reference_file(reference, chart, folder)
    if file is not None:
        return measured_chart(file, grid, chart)
    if reference is None and not chart.references:
        raise errors.InputError(
            f"no reflectances of a {chart.name} are published that may ship with "
            f"spectrabox; measure its {len(chart.names)} patches, or ask its maker "
            "for their spectra, and give that file as reference (CSV or CGATS)")
    return charts.chart_reflectances(reference or chart.references[0], grid, chart)


def published_signals(chart: charts.Chart, grid: WavelengthGrid) -> np.ndarray:
    """Signals (I, 3) that an ordinary camera would read of a chart of published colours.

    Parameters
    ----------
    chart : Chart
        Of which ``has_known_colours`` holds.
    grid : WavelengthGrid
    """
    if chart.colours is None:
        return charts.typical_camera_signals(charts.chart_reflectances(chart.references[0], grid,
                                                                       chart), grid)
    return np.maximum(published_colours(chart.colours) @ SHARPENED.T, DARKEST)


def measured_chart(path: Path, grid: WavelengthGrid, chart: charts.Chart) -> np.ndarray:
    """Reflectances (I, P) of one's own chart, in chart order.

    Samples that have the names of the chart's patches are put in order by them, whatever order the
    file has; others are taken to be in chart order, row by row.

    Parameters
    ----------
    path : Path
        Any spectral file.
    grid : WavelengthGrid
        Working grid, of P wavelengths.
    chart : Chart

    Raises
    ------
    InputError
        If the file does not hold reflectances of every patch that cover the grid.
    CheckError
        If the samples have other names and are in another order than a published reference of the
        same chart, or are those of another chart.
    """
    table = spectrum_files.read_table(path)
    samples = [index for index, name in enumerate(table.names)
               if not name.startswith("standard_error")]
    order = _by_name(table, samples, chart)
    if order is None and len(samples) != len(chart.names):
        raise errors.InputError(f"{path.name} holds {len(samples)} columns; {len(chart.names)} are "
                         f"needed, one per patch, {chart.names[0]} first")
    chosen = samples if order is None else order
    reflectances = np.array([
        spectrum_files.spectrum_on_grid(
            spectrum_files.spectrum_of(table, role=Quantity.REFLECTANCE, column=index + 2), grid)
        for index in chosen
    ])
    if order is None and chart.has_known_colours:
        _require_chart(path.name, reflectances, grid, chart)
    return reflectances


def _by_name(table: SpectralTable, samples: list[int], chart: charts.Chart) -> list[int] | None:
    """Index in the table of every patch, in chart order; None where patches are not named so."""
    labels = [[_plain(table.names[index]) for index in samples],
              [_plain(table.fact("location", index) or "") for index in samples]]
    for names in (chart.names, *chart.other_names):
        wanted = [_plain(name) for name in names]
        for given in labels:
            if all(given.count(name) == 1 for name in wanted):
                return [samples[given.index(name)] for name in wanted]
    return None


def _plain(name: str) -> str:
    """A patch name without case, blanks and leading zeros: "A01" is "a1"."""
    return re.sub(r"(?<=[a-z])0+(?=\d)", "", re.sub(r"[\s_-]+", "", name.lower()))


def _require_chart(file: str, reflectances: np.ndarray, grid: WavelengthGrid,
                   chart: charts.Chart) -> None:
    """Refuse reflectances of another chart, or in another order."""
    correlations = charts.order_correlations(charts.typical_camera_signals(reflectances, grid),
                                             published_signals(chart, grid), chart.rows)
    best = max(correlations, key=lambda words: correlations[words])
    as_listed = correlations[charts.AS_ASKED]
    if correlations[best] > max(SURE_CORRELATION, as_listed + CLEAR_GAIN):
        raise errors.CheckError(
            f"{file} lists the patches of a {chart.name} {best}: in that order they "
            f"correlate with a published chart by {correlations[best]:.2f}, as listed "
            f"by {as_listed:.2f}; list them row by row, {chart.names[0]} first, or "
            "name them after the patches")
    if as_listed < SURE_CORRELATION:
        raise errors.CheckError(
            f"{file} holds the reflectances of another chart than a {chart.name}: its "
            f"{len(chart.names)} patches correlate with a published one by "
            f"{as_listed:.2f}, in any order; give the file of this chart, or the "
            "layout that the file is of")
