"""Filters before the lens or the lamp: transmittance by wavelength, and how well it is known.

Whoever states a transmittance states it with the error of an instrument: smooth over the spectrum,
a shift of its wavelengths, and a little stray light where next to nothing passes. What nobody
measured is smooth, and no more.
"""
from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.records.calibration import Filter
from spectrabox.radiometry.spectra import light_words, spectrum_files

RELATIVE_ERROR, LENGTH_NM = 0.02, 60.0      # of a stated transmittance; and how smooth its error is
SHIFT_NM = 0.5              # standard error of the wavelengths of a spectrometer
STRAY = 0.002               # of the largest transmittance: standard error where nothing passes
MAX_MODE = 1.0              # of the logarithm
# of the logarithm of a transmittance that nobody measured: gels and glasses change by a factor of
# 10 over some tens of nm
UNKNOWN_SD, UNKNOWN_LENGTH_NM, UNKNOWN_LEVEL = 1.5, 35.0, 0.3
KEPT = 0.995                # of the variance of errors by their modes
AS_FILTERS = ("transmittance", "relative")      # quantities that a file of filters may state
PERCENT = 1.5               # a transmittance beyond it is in per cent
MIN_TRANSMITTANCE = 1e-5    # of the largest


def stated_filter(name: str, transmittance: np.ndarray,
                  relative_error: np.ndarray | float = RELATIVE_ERROR) -> Filter:
    """A filter whose transmittance somebody measured or printed.

    Parameters
    ----------
    name : str
    transmittance : (301,) array
        At 400, 401 ... 700 nm, 0 to 1.
    relative_error : float or (301,) array
        Standard error, which is smooth over the spectrum.
    """
    top = transmittance.max()
    passed = np.maximum(transmittance, MIN_TRANSMITTANCE * top)
    deviation = np.minimum(np.hypot(relative_error, STRAY * top / passed), MAX_MODE)
    shift = np.clip(SHIFT_NM * np.gradient(np.log(passed), FINE_GRID.nm), -MAX_MODE, MAX_MODE)
    modes = np.column_stack([shift, _smooth_modes(deviation, LENGTH_NM)])
    return Filter(name, passed, modes, np.eye(modes.shape[1]))


def unknown_filter() -> Filter:
    """A filter whose transmittance nobody measured: smooth, of any level."""
    modes = _smooth_modes(np.full(FINE_GRID.nm.size, UNKNOWN_SD), UNKNOWN_LENGTH_NM)
    return Filter(light_words.UNKNOWN, np.full(FINE_GRID.nm.size, UNKNOWN_LEVEL), modes,
                  np.eye(modes.shape[1]))


def read_filters(path: Path) -> dict[str, Filter]:
    """Every filter of a file of spectra, by the name of its column; of its only one, of the file.

    Values beyond 1.5 are taken for per cent. A column ``standard_error`` states the error.

    Parameters
    ----------
    path : Path

    Raises
    ------
    InputError
        If the file cannot be read, does not cover 400-700 nm, or is no transmittance.
    """
    return _filters_of(spectrum_files.read_table(path), path)


def read_filter(path: Path, column: str | int | None = None) -> Filter:
    """One filter of a file.

    Parameters
    ----------
    path : Path
    column : str or int, optional
        Name or number (from 1) of its column; needed where the file holds several.

    Raises
    ------
    InputError
        As ``read_filters``, or if the file holds several and none is named.
    """
    table = spectrum_files.read_table(path)
    chosen = spectrum_files.column_index(table, column)
    kept = [chosen, *(index for index, name in enumerate(table.names) if name == "standard_error")]
    own = replace(table, names=tuple(table.names[index] for index in kept),
                  values=table.values[kept])
    return next(iter(_filters_of(own, path).values()))


def _filters_of(table: spectrum_files.SpectralTable, path: Path) -> dict[str, Filter]:
    error = next((values for name, values in zip(table.names, table.values, strict=True)
                  if name == "standard_error"), None)
    curves = {name: values for name, values in zip(table.names, table.values, strict=True)
              if not name.startswith("standard_error")}
    stated = {table.fact("quantity", index) for index, name in enumerate(table.names)
              if name in curves}
    if wrong := sorted(each for each in stated if each and each.lower() not in AS_FILTERS):
        raise InputError(f"{path.name} holds {' and '.join(wrong)}, and of a filter the "
                         "transmittance is needed; if it is one, correct the quantity that the "
                         "file states")
    if table.nm[-1] < FINE_GRID.nm[0] or table.nm[0] > FINE_GRID.nm[-1]:
        raise InputError(f"{path.name} covers {table.nm[0]:g}-{table.nm[-1]:g} nm, none of it "
                         "visible; a transmittance over 400-700 nm is needed: check the unit of "
                         "its wavelengths")
    return {name: filter_of(name, table.nm, values, error, path.name)
            for name, values in (curves if len(curves) > 1 else
                                 {path.stem: next(iter(curves.values()))}).items()}


def filters_at_hand(path: Path) -> Mapping[str, Filter]:
    """All filters of a folder of files, or of one file.

    Parameters
    ----------
    path : Path

    Raises
    ------
    InputError
        As ``read_filters``, or if the folder holds no file.
    """
    if not path.is_dir():
        return read_filters(path)
    files = sorted(file for file in path.iterdir() if file.is_file()
                   and not file.name.startswith("."))
    if not files:
        raise InputError(f"{path} holds no file; put files of transmittances into it")
    return {name: each for file in files for name, each in read_filters(file).items()}


def filter_of(name: str, nm: np.ndarray, values: np.ndarray, error: np.ndarray | None = None,
              source: str = "transmittance") -> Filter:
    """A filter of a measured transmittance.

    Parameters
    ----------
    name : str
    nm, values : (Q,) arrays
        Values beyond 1.5 are taken for per cent.
    error : (Q,) array, optional
        Standard error of the values.
    source : str
        For error messages.

    Raises
    ------
    InputError
        If the wavelengths do not cover 400-700 nm, or the values are no transmittance.
    """
    valid = np.isfinite(values)
    if valid.sum() < 2:
        raise InputError(f"{source}: {name!r} holds no numbers")
    factor = 0.01 if np.max(values[valid]) > PERCENT else 1.0
    passed = factor * spectrum_files.on_grid(nm[valid], values[valid], FINE_GRID, f"filter {name}")
    if passed.min() < -0.02 or not 0 < passed.max() <= 1.05:
        raise InputError(f"{source}: the filter {name} lets {passed.min():.3g} to "
                         f"{passed.max():.3g} of the light pass; a transmittance between 0 and 1 "
                         "is needed")
    passed = np.clip(passed, MIN_TRANSMITTANCE * passed.max(), 1)
    if error is None:
        return stated_filter(name, passed)
    stated = factor * spectrum_files.on_grid(nm[valid], error[valid], FINE_GRID, f"filter {name}")
    return stated_filter(name, passed, stated / passed)


def _smooth_modes(deviation: np.ndarray, length_nm: float) -> np.ndarray:
    """Principal errors (P, E) of a smooth curve of a given standard deviation (P,)."""
    apart = (FINE_GRID.nm[:, None] - FINE_GRID.nm) / length_nm
    values, vectors = np.linalg.eigh(np.exp(-0.5 * apart**2))
    values, vectors = values[::-1], vectors[:, ::-1]
    kept = int(np.searchsorted(np.cumsum(values), KEPT * values.sum())) + 1
    return np.asarray(deviation[:, None] * vectors[:, :kept] * np.sqrt(values[:kept]))
