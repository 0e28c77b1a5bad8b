"""Files of swatches: signals with spectra in one table, or spectra named as regions of a photo."""
from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.files import csv_rows
from spectrabox.radiometry.records.spectra import Quantity, Spectrum
from spectrabox.radiometry.spectra.band_columns import columns_of_bands
from spectrabox.radiometry.spectra.spectrum_files import on_grid, read_table, spectrum_of
from spectrabox.radiometry.system.words import is_number
from spectrabox.sampling.prior.mixture import PRIOR_GRID


def read_swatches(path: Path, bands: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    """Signals (n, K) and reflectances (n, 61) of a CSV of measured samples of a material.

    Its header names the bands, then the wavelengths in nm; every further row is one swatch.
    Columns may come in any order, and one before the bands may hold the swatches' names.

    Parameters
    ----------
    path : Path
    bands : sequence of K str
        Of the camera.

    Raises
    ------
    InputError
        Naming the row, or the columns that are not the camera's bands.
    """
    head, *rows = csv_rows(path, "swatches") or [[]]
    spectral = np.array([is_number(cell) for cell in head], bool)
    count = len(bands)
    named = np.flatnonzero(~spectral)[-count:]
    if not rows or len(named) != count or np.count_nonzero(~spectral) > count + 1 \
            or np.count_nonzero(spectral) < 2:
        raise InputError(f"{path.name} is no table of swatches: a header of {count} band names "
                         "(letters in each: 450 nm) and of wavelengths in nm is needed, and below "
                         "it of each swatch its signals and its reflectances")
    named = named[columns_of_bands([head[at] for at in named], bands, path.name)]
    order = np.argsort([float(head[at]) for at in np.flatnonzero(spectral)])
    measured = np.flatnonzero(spectral)[order]
    values = np.empty((len(rows), count + measured.size))
    for at, row in enumerate(rows):
        try:
            values[at] = [float(row[column]) for column in (*named, *measured)]
        except (ValueError, IndexError):
            raise InputError(f"{path.name} row {at + 2} does not hold a number for each band and "
                             "wavelength") from None
    return values[:, :count], swatch_reflectances(np.array([float(head[at]) for at in measured]),
                                                  values[:, count:], path.name)


def swatch_reflectances(nm: np.ndarray, values: np.ndarray, name: str) -> np.ndarray:
    """Reflectances (n, 61) of swatches that were measured at other wavelengths.

    Parameters
    ----------
    nm : (Q,) array
        Ascending.
    values : (n, Q) array
    name : str
        Of the swatches, for messages.

    Raises
    ------
    InputError
        If they do not cover 400-700 nm, or are no reflectances.
    """
    if not np.isfinite(values).all() or values.min() < -0.05 or values.max() > 1.5:
        raise InputError(f"{name} holds values from {values.min():g} to {values.max():g}; "
                         "reflectances are 0 to 1: divide percentages by 100")
    if not np.all(np.diff(nm) > 0):         # nor where one is no number
        raise InputError(f"{name}: the wavelengths are not all different; give each once")
    return on_grid(nm, values, PRIOR_GRID, name)


def read_swatch_spectra(path: Path, regions: Collection[str]) -> dict[str, Spectrum]:
    """Reflectances of the regions that are named as columns of a file of spectra.

    Parameters
    ----------
    path : Path
        Of any format of spectra.
    regions : collection of str
        Names.

    Raises
    ------
    InputError
        If the file cannot be read, or names none of the regions.
    """
    table = read_table(path)
    found = {name: spectrum_of(table, role=Quantity.REFLECTANCE, column=name)
             for name in table.names if name in regions}
    if not found:
        raise InputError(f"{path.name} holds {', '.join(table.names[:4])} ..., and no region has "
                         "such a name; name the regions of swatches as their spectra")
    return found
