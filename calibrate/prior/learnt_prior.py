"""A prior on sensitivities learnt from measured cameras.

Cameras of one maker and generation lie close together, others far apart, in the logarithm of their
curves. Families of similar cameras (Ward's method) give components of three levels: ``family``, a
camera of that family; ``kin``, one like it that another maker built; and ``broad``, about the mean
of all cameras, every maker counting once, for a camera unlike those measured.

How far each level reaches are the constants below, chosen by what chart photos of cameras whose
maker was left out then give (``benchmarks/bench_unknown_makers.py``). Errors hardly depend on them:
each may be halved or doubled for some per cent.
"""
from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np

from spectrabox.calibrate.prior.camera_prior import CameraPrior
from spectrabox.radiometry import errors, files, grid, shaped
from spectrabox.radiometry.spectra.spectrum_files import on_grid, read_curves
from spectrabox.radiometry.system.words import nearest_words

FAMILIES_PER_CAMERA = 0.33   # 13 families of 39 cameras
MIN_CAMERAS_FOR_FAMILIES = 12  # fewer cameras make one Gaussian
KEPT_VARIANCE = 0.9999
MIN_CAMERAS = 4
MIN_FREEDOM = 3              # of Student's t: fewer makers say nothing of how makers differ
FLOOR = 0.008                # of the mean of all curves: below it changes are no longer relative
UNLIKE = "a camera unlike those measured"


# Reach of the three levels; departures as in ``CameraPrior``, scaled for family and kin.
FAMILY_WEIGHT, KIN_WEIGHT = 0.25, 0.50
WITHIN = 1.2                 # of the variance within families; the rest localised
# share of the variance between all cameras
FAMILY_BETWEEN, KIN_BETWEEN, BROAD_BETWEEN = 0.03, 0.50, 1.7
LOCALISED = (0.5, 60.0, 0.3)
# of the standard deviation of what each band departs by
FAMILY_DEPARTURE, KIN_DEPARTURE = 0.10, 0.25
# One body with two lenses differs by 1 to 6 %: the last two.
DEPARTURES = (0.0, 1.0, 0.10, 30.0, 0.03, 120.0)


def build_prior(nm: np.ndarray, curves: np.ndarray, names: tuple[str, ...], *, source: str,
                licence: str) -> CameraPrior:
    """Prior learnt from measured cameras.

    Parameters
    ----------
    nm : (P,) array
    curves : (C, K, P) array
        Sensitivities of C cameras, any scale.
    names : tuple of str
        Of the C cameras; the first word is the maker.
    source, licence : str
        Stored with the prior and shown wherever it is used.

    Raises
    ------
    InputError
        If there are fewer than 4 cameras.
    """
    from scipy.special import ndtri, stdtrit
    cameras = len(curves)
    if cameras < MIN_CAMERAS:
        raise errors.InputError(f"a prior needs {MIN_CAMERAS} measured cameras or more; {cameras} "
                         "could be read")
    vectors = (curves / curves.mean(axis=(1, 2), keepdims=True)).reshape(cameras, -1)
    states = np.log(vectors + FLOOR)
    groups = families(states)
    middle, between = between_makers(states, names)
    sizes = np.array([len(group) for group in groups], dtype=float)
    sizes /= max(sizes.sum(), 1.0)
    family, kin = (FAMILY_WEIGHT, KIN_WEIGHT) if groups else (0.0, 0.0)
    centres = [states[group].mean(axis=0) for group in groups]
    joined = [", ".join(names[index] for index in group) for group in groups]
    departures = np.tile(DEPARTURES, (3, 1))
    departures[:, 2] *= [FAMILY_DEPARTURE, KIN_DEPARTURE, 1.0]
    # Student's t over the normal quantile at 95 %, for a covariance learnt from few makers
    freedom = max(len({_maker(name) for name in names}) - 1, MIN_FREEDOM)
    widening = float(stdtrit(freedom, 0.95) / ndtri(0.95))
    of_kin = (f"another maker's like {members}" for members in joined)
    return CameraPrior(
        nm=nm, weights=np.concatenate([family * sizes, kin * sizes, [1 - family - kin]]),
        means=np.array([*centres, *centres, middle]),
        level=np.repeat([0, 1, 2], [len(groups), len(groups), 1]),
        shares=np.array([[WITHIN, FAMILY_BETWEEN], [WITHIN, KIN_BETWEEN], [0.0, BROAD_BETWEEN]]),
        departures=departures, widening=np.array([1.0, widening, widening]),
        within=_leading(within_families(states, groups)), between=_leading(between),
        members=(*joined, *of_kin, UNLIKE), source=source, licence=licence, floor=FLOOR,
        localised=LOCALISED)


def families(states: np.ndarray) -> list[np.ndarray]:
    """Indices of the members of each family of two or more cameras, by Ward's method.

    Parameters
    ----------
    states : (C, D) array
        Logarithms of the curves of C cameras, band after band, each camera of mean 1.

    Returns
    -------
    list of int arrays
        Empty where there are fewer than 12 cameras.
    """
    if len(states) < MIN_CAMERAS_FOR_FAMILIES:
        return []
    from scipy.cluster.hierarchy import fcluster, linkage
    label = fcluster(linkage(states, "ward"), round(FAMILIES_PER_CAMERA * len(states)),
                     "maxclust")
    groups = [np.flatnonzero(label == family) for family in np.unique(label)]
    return [group for group in groups if len(group) > 1]


def within_families(states: np.ndarray, groups: list[np.ndarray]) -> np.ndarray:
    """Rows (C, D) whose products add up to the pooled covariance within families.

    Parameters
    ----------
    states : (C, D) array
    groups : list of int arrays
        From ``families``.
    """
    if not groups:
        return np.zeros((1, states.shape[1]))
    freedom = max(sum(len(group) for group in groups) - len(groups), 1)
    return np.vstack([states[group] - states[group].mean(axis=0) for group in groups]) / np.sqrt(
        freedom)


def between_makers(states: np.ndarray, names: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Mean (D,) in which every maker counts once, and rows of the covariance about it.

    The products of the rows (C, D) add up to the covariance. The mean itself is uncertain: a new
    camera lies further out, by sqrt(1 + 1 / effective number of makers).

    Parameters
    ----------
    states : (C, D) array
    names : tuple of str
        Of the C cameras; the first word is the maker.
    """
    makers = [_maker(name) for name in names]
    weights = np.array([1 / makers.count(maker) for maker in makers])
    weights /= weights.sum()
    effective = 1 / np.sum(weights**2)
    middle = weights @ states
    factor = np.sqrt(effective / (effective - 1) * (1 + 1 / effective))
    return middle, factor * np.sqrt(weights)[:, None] * (states - middle)


def _maker(name: str) -> str:
    return name.split()[0] if name.split() else name


def _leading(rows: np.ndarray) -> np.ndarray:
    """Factors (D, Q) with the leading directions of ``rows.T @ rows``."""
    _, singular, directions = np.linalg.svd(rows, full_matrices=False)
    share = np.cumsum(singular**2) / max(np.sum(singular**2), np.finfo(float).tiny)
    kept = int(np.searchsorted(share, KEPT_VARIANCE)) + 1
    return (directions[:kept] * singular[:kept, None]).T


# ---- measured cameras ----------------------------------------------------------------------------
# Measured camera curves from a folder: rawtoaces JSON, CSV.

STEP_NM = 5.0
GRID = grid.grid_from_nm(np.arange(400.0, 700.0 + STEP_NM, STEP_NM))
NEGATIVE = 0.05                                 # of the largest value: more is not a sensitivity
SUFFIXES = (".json", ".csv")


@dataclass(frozen=True, eq=False)
class CameraDatabase(shaped.Record):
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
        raise errors.InputError(
            f"{folder} is not a folder; give a folder of measured camera curves")
    cameras: dict[str, np.ndarray] = {}
    skipped = []
    for path in sorted(path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES):
        try:
            in_file = {name: _checked(*table, f"{path.name}, {name}")
                       for name, table in cameras_of_file(path).items()}
        except errors.InputError as error:
            skipped.append(str(error))
            continue
        skipped += [f"{path.name} holds {name} once more; the first is kept" for name in in_file
                    if name in cameras]
        cameras |= {name: curves for name, curves in in_file.items() if name not in cameras}
    if absent := [name for name in leave_out if name not in cameras]:
        raise errors.InputError(f"{folder} holds no camera {absent[0]!r} to leave out"
                         f"{nearest_words(absent[0], cameras)}")
    kept = {name: curves for name, curves in cameras.items() if name not in leave_out}
    if not kept:
        raise errors.InputError(f"{folder} holds no camera that can be read"
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
        raise errors.InputError(f"{path.name} is no file of camera curves; .json (rawtoaces) or "
                         ".csv is needed")
    cameras = readers[path.suffix.lower()](path)
    for name, (nm, curves) in cameras.items():
        _checked(nm, curves, f"{path.name}, {name}")
    return cameras


def _checked(nm: np.ndarray, curves: np.ndarray, name: str) -> np.ndarray:
    """Curves (K, P) on ``GRID``."""
    if not np.all(np.isfinite(curves)):
        raise errors.InputError(f"{name}: some values are not numbers")
    values = on_grid(nm, curves, GRID, name)
    largest = float(values.max())
    if largest <= 0 or values.min() < -NEGATIVE * largest or np.any(values.max(axis=1) <= 0):
        raise errors.InputError(f"{name}: sensitivities must be positive; they run from "
                         f"{values.min():.3g} to {values.max():.3g}")
    return np.maximum(values, 0.0)


def _read_rawtoaces(path: Path) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    try:
        stored = json.loads(files.read_text(path, "utf-8"))
        rows = stored["spectral_data"]["data"]["main"]
        header = stored["header"]
        name = f"{header['manufacturer']} {header['model']}"
        nm = np.array([float(wavelength) for wavelength in rows])
        curves = np.array(list(rows.values()), dtype=float).T
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError):
        raise errors.InputError(
            f"{path.name} is not a rawtoaces camera file; it is left out") from None
    if curves.ndim != 2 or nm.size < 2 or np.any(np.diff(nm) <= 0):
        raise errors.InputError(
            f"{path.name} holds no table of ascending wavelengths; it is left out")
    return {name: (nm, curves)}


def _read_csv(path: Path) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    nm, _, curves = read_curves(path)
    return {path.stem: (nm, curves)}
