"""The draws of a finished session as a file: one array a surface (.npz), or in long form, a row for
each surface, draw and wavelength (.csv, .parquet).
"""
from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.measure.records import SampleRecords
from spectrabox.radiometry.errors import EnvironmentProblem, InputError
from spectrabox.radiometry.files import whole_file
from spectrabox.radiometry.grid import at_whole_steps
from spectrabox.radiometry.system.words import cell

FORMS = {".npz": "wavelengths and one array of draws a surface",
         ".csv": "a row for each surface, draw and wavelength",
         ".parquet": "the same as a Parquet table"}
COLUMNS = ("surface", "draw", "wavelength_nm", "reflectance")
MAX_ROWS = 50_000_000       # of a long form


def stored_draws(records: SampleRecords, step_nm: int,
                 draws: int | None) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Wavelengths (P,) and draws (n, P) of every surface whose spectrum was not given.

    Parameters
    ----------
    records : SampleRecords
        Of a finished session.
    step_nm : int
        Between wavelengths: those that are whole steps from the first are kept.
    draws : int or None
        Of each surface, the first so many; None for all.

    Raises
    ------
    InputError
        If there are none.
    """
    if not records.spectra:
        raise InputError("every spectrum of this session was given; there are no draws to write")
    draws_of = {}
    for name, spectrum in records.spectra.items():
        nm = spectrum.samples.grid.nm
        kept = at_whole_steps(nm, step_nm)
        draws_of[name] = nm[kept], spectrum.samples.spectra[:draws, kept]
    return draws_of


def write_draws(path: Path, draws: dict[str, tuple[np.ndarray, np.ndarray]]) -> None:
    """Write draws as the path's ending says, whole or not at all.

    Parameters
    ----------
    path : Path
    draws : dict
        As ``stored_draws`` gives them.

    Raises
    ------
    InputError
        If a long form would have more rows than any program reads.
    EnvironmentProblem
        If a Parquet table is asked for and pyarrow is not installed.
    """
    rows = sum(values.size for _, values in draws.values())
    if path.suffix.lower() != ".npz" and rows > MAX_ROWS:
        raise InputError(f"{path.name} would have {rows} rows; take fewer --samples, a wider "
        "--step, "
                         "or .npz")
    with whole_file(path) as unfinished:
        {".npz": _npz, ".csv": _csv, ".parquet": _parquet}[path.suffix.lower()](unfinished, draws)


def _npz(path: Path, draws: dict[str, tuple[np.ndarray, np.ndarray]]) -> None:
    nm, _ = next(iter(draws.values()))
    arrays: dict[str, Any] = {f"draws_{index}": values.astype(np.float32)
                              for index, (_, values) in enumerate(draws.values())}
    with path.open("wb") as file:
        np.savez_compressed(file, wavelengths_nm=nm, surfaces=np.array(list(draws)), **arrays)


def _csv(path: Path, draws: dict[str, tuple[np.ndarray, np.ndarray]]) -> None:
    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.write(",".join(COLUMNS) + "\n")
        for name, (nm, values) in draws.items():
            word = '"' + cell(name).replace('"', '""') + '"'
            points = [f"{wavelength:g}" for wavelength in nm]
            for number, spectrum in enumerate(values):
                file.write("".join(f"{word},{number},{point},{value:.7g}\n"
                                   for point, value in zip(points, spectrum, strict=True)))


def _parquet(path: Path, draws: dict[str, tuple[np.ndarray, np.ndarray]]) -> None:
    try:
        arrow = importlib.import_module("pyarrow")      # optional: no other format needs it
        parquet = importlib.import_module("pyarrow.parquet")
    except ModuleNotFoundError:
        raise EnvironmentProblem("a Parquet table is written by pyarrow, which is not installed: "
                                 "pip install pyarrow, or give --out NAME.csv or NAME.npz"
                                 ) from None
    tables = []
    for name, (nm, values) in draws.items():
        count, width = values.shape
        tables.append(arrow.table(dict(zip(COLUMNS, (
            [name] * values.size, np.repeat(np.arange(count, dtype=np.int32), width),
            np.tile(nm, count), values.astype(np.float32).ravel()), strict=True))))
    parquet.write_table(arrow.concat_tables(tables), path)
