"""Reflectances of a chart, published or from a file: CSV, CGATS or any other spectral format.
"""
from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from spectrabox.radiometry.chart import (
    AS_ASKED,
    Chart,
    chart_reflectances,
    order_correlations,
    typical_camera_signals,
)
from spectrabox.radiometry.errors import CheckError, InputError
from spectrabox.radiometry.files import names_a_file
from spectrabox.radiometry.published.published_tables import published_colours
from spectrabox.radiometry.records.spectra import Quantity, WavelengthGrid
from spectrabox.radiometry.spectra.formats.measurement_table import SpectralTable
from spectrabox.radiometry.spectra.spectrum_files import (
    read_table,
    spectrum_of,
    spectrum_on_grid,
)

SURE_CORRELATION = 0.8      # of another order: of ColorCheckers it is 0.97 or more in the right one
CLEAR_GAIN = 0.2            # over the correlation of the order as it stands
DARKEST = 0.005             # of white: a sharpened colour may be negative
# From tristimulus values to about what the bands of a camera see [Bradford, ICC.1:2022 Annex E].
SHARPENED = np.array([(0.8951, 0.2664, -0.1614), (-0.7502, 1.7135, 0.0367),
                      (0.0389, -0.0685, 1.0296)])


def reference_file(reference: str | None, chart: Chart, folder: Path = Path()) -> Path | None:
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
    return folder / reference if names_a_file(reference) else None


def reference_reflectances(reference: str | None, chart: Chart, grid: WavelengthGrid,
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
        raise InputError(f"no reflectances of a {chart.name} are published that may ship with "
                         f"spectrabox; measure its {len(chart.names)} patches, or ask its maker "
                         "for their spectra, and give that file as reference (CSV or CGATS)")
    return chart_reflectances(reference or chart.references[0], grid, chart)


def published_signals(chart: Chart, grid: WavelengthGrid) -> np.ndarray:
    """Signals (I, 3) that an ordinary camera would read of a chart of published colours.

    Parameters
    ----------
    chart : Chart
        Of which ``has_known_colours`` holds.
    grid : WavelengthGrid
    """
    if chart.colours is None:
        return typical_camera_signals(chart_reflectances(chart.references[0], grid, chart), grid)
    return np.maximum(published_colours(chart.colours) @ SHARPENED.T, DARKEST)


def measured_chart(path: Path, grid: WavelengthGrid, chart: Chart) -> np.ndarray:
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
    table = read_table(path)
    samples = [index for index, name in enumerate(table.names)
               if not name.startswith("standard_error")]
    order = _by_name(table, samples, chart)
    if order is None and len(samples) != len(chart.names):
        raise InputError(f"{path.name} holds {len(samples)} columns; {len(chart.names)} are "
                         f"needed, one per patch, {chart.names[0]} first")
    chosen = samples if order is None else order
    reflectances = np.array([
        spectrum_on_grid(spectrum_of(table, role=Quantity.REFLECTANCE, column=index + 2), grid)
        for index in chosen])
    if order is None and chart.has_known_colours:
        _require_chart(path.name, reflectances, grid, chart)
    return reflectances


def _by_name(table: SpectralTable, samples: list[int], chart: Chart) -> list[int] | None:
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


def _require_chart(file: str, reflectances: np.ndarray, grid: WavelengthGrid, chart: Chart) -> None:
    """Refuse reflectances of another chart, or in another order."""
    correlations = order_correlations(typical_camera_signals(reflectances, grid),
                                      published_signals(chart, grid), chart.rows)
    best = max(correlations, key=lambda words: correlations[words])
    as_listed = correlations[AS_ASKED]
    if correlations[best] > max(SURE_CORRELATION, as_listed + CLEAR_GAIN):
        raise CheckError(f"{file} lists the patches of a {chart.name} {best}: in that order they "
                         f"correlate with a published chart by {correlations[best]:.2f}, as listed "
                         f"by {as_listed:.2f}; list them row by row, {chart.names[0]} first, or "
                         "name them after the patches")
    if as_listed < SURE_CORRELATION:
        raise CheckError(f"{file} holds the reflectances of another chart than a {chart.name}: its "
                         f"{len(chart.names)} patches correlate with a published one by "
                         f"{as_listed:.2f}, in any order; give the file of this chart, or the "
                         "layout that the file is of")
