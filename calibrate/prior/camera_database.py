"""Measured camera curves from a folder: rawtoaces JSON, CSV."""
from __future__ import annotations

import difflib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.files import read_text
from spectrabox.radiometry.grid import grid_from_nm
from spectrabox.radiometry.shaped import Record
from spectrabox.radiometry.spectra.spectrum_files import on_grid, read_curves

STEP_NM = 5.0
GRID = grid_from_nm(np.arange(400.0, 700.0 + STEP_NM, STEP_NM))
NEGATIVE = 0.05                                 # of the largest value: more is not a sensitivity
SUFFIXES = (".json", ".csv")


@dataclass(frozen=True, eq=False)
class CameraDatabase(Record):
    """Curves of C cameras on one grid; ``skipped`` says which files could not be used."""

    nm: Annotated[np.ndarray, "P"]
    curves: Annotated[np.ndarray, "C K P"]
    names: tuple[str, ...]
    skipped: tuple[str, ...]


def read_camera_database(folder: Path, *, leave_out: tuple[str, ...] = ()) -> CameraDatabase:
    """Every camera of a folder, on 400-700 nm in steps of 5 nm.

    Parameters
    ----------
    folder : Path
        Of files *.json (rawtoaces) and *.csv (one column per band).
    leave_out : tuple of str
        Names of cameras to leave out.

    Raises
    ------
    InputError
        If the folder is missing, no camera in it can be read, or one to be left out is not there. A
        broken file, and a camera that another file held already, are skipped and named.
    """
    if not folder.is_dir():
        raise InputError(f"{folder} is not a folder; give a folder of measured camera curves")
    cameras: dict[str, np.ndarray] = {}
    skipped = []
    for path in sorted(path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES):
        try:
            in_file = {name: _checked(*table, f"{path.name}, {name}")
                       for name, table in cameras_of_file(path).items()}
        except InputError as error:
            skipped.append(str(error))
            continue
        skipped += [f"{path.name} holds {name} once more; the first is kept" for name in in_file
                    if name in cameras]
        cameras |= {name: curves for name, curves in in_file.items() if name not in cameras}
    if absent := [name for name in leave_out if name not in cameras]:
        near = difflib.get_close_matches(absent[0], cameras, n=3)
        raise InputError(f"{folder} holds no camera {absent[0]!r} to leave out"
                         + (f"; nearest are {', '.join(near)}" if near else ""))
    kept = {name: curves for name, curves in cameras.items() if name not in leave_out}
    if not kept:
        raise InputError(f"{folder} holds no camera that can be read"
                         + (f"; the first problem: {skipped[0]}" if skipped
                            else "; JSON or CSV files are needed"))
    bands = len(next(iter(kept.values())))
    skipped += [f"{name} has {len(curves)} bands, the others {bands}"
                for name, curves in kept.items() if len(curves) != bands]
    kept = {name: curves for name, curves in kept.items() if len(curves) == bands}
    return CameraDatabase(GRID.nm, np.array(list(kept.values())), tuple(kept), tuple(skipped))


def cameras_of_file(path: Path) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Wavelengths (P,) and curves (K, P) of every camera of one file by name.

    Parameters
    ----------
    path : Path
        .json (rawtoaces) or .csv.

    Raises
    ------
    InputError
        If it cannot be read, or is of no known kind.
    """
    readers = {".json": _read_rawtoaces, ".csv": _read_csv}
    if path.suffix.lower() not in readers:
        raise InputError(f"{path.name} is no file of camera curves; .json (rawtoaces) or "
                         ".csv is needed")
    cameras = readers[path.suffix.lower()](path)
    for name, (nm, curves) in cameras.items():
        _checked(nm, curves, f"{path.name}, {name}")
    return cameras


def _checked(nm: np.ndarray, curves: np.ndarray, name: str) -> np.ndarray:
    """Curves (K, P) on ``GRID``."""
    if not np.all(np.isfinite(curves)):
        raise InputError(f"{name}: some values are not numbers")
    values = on_grid(nm, curves, GRID, name)
    largest = float(values.max())
    if largest <= 0 or values.min() < -NEGATIVE * largest or np.any(values.max(axis=1) <= 0):
        raise InputError(f"{name}: sensitivities must be positive; they run from "
                         f"{values.min():.3g} to {values.max():.3g}")
    return np.maximum(values, 0.0)


def _read_rawtoaces(path: Path) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    try:
        stored = json.loads(read_text(path, "utf-8"))
        rows = stored["spectral_data"]["data"]["main"]
        header = stored["header"]
        name = f"{header['manufacturer']} {header['model']}"
        nm = np.array([float(wavelength) for wavelength in rows])
        curves = np.array(list(rows.values()), dtype=float).T
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError):
        raise InputError(f"{path.name} is not a rawtoaces camera file; it is left out") from None
    if curves.ndim != 2 or nm.size < 2 or np.any(np.diff(nm) <= 0):
        raise InputError(f"{path.name} holds no table of ascending wavelengths; it is left out")
    return {name: (nm, curves)}


def _read_csv(path: Path) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    nm, _, curves = read_curves(path)
    return {path.stem: (nm, curves)}
