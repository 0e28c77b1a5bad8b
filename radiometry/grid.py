"""Wavelength grids in nm and their integration weights."""
from __future__ import annotations

import numpy as np

from spectrabox.radiometry.records.spectra import WavelengthGrid

VISIBLE_NM = (400.0, 700.0)  # the range used throughout, as in the paper (Sec. 3.1)
NM_ROUNDING = 1e-6


def trapezoid_weights_nm(nm: np.ndarray) -> np.ndarray:
    """Weights (P,) such that ``weights @ f(nm)`` is the trapezoid rule, for ascending
    wavelengths.

    Parameters
    ----------
    nm : (P,) array
        Ascending, P >= 2.
    """
    gaps = np.diff(nm)
    weights = np.zeros_like(nm, dtype=float)
    weights[:-1] += gaps / 2
    weights[1:] += gaps / 2
    return weights


def grid_from_nm(nm: np.ndarray) -> WavelengthGrid:
    """Grid of the given ascending wavelengths, (P,) in nm, P >= 2.

    Parameters
    ----------
    nm : (P,) array
        Ascending, P >= 2.

    Raises
    ------
    ValueError
        If the wavelengths are not strictly ascending.
    """
    nm = np.asarray(nm, dtype=float)
    if nm.size < 2 or not np.all(np.diff(nm) > 0):
        raise ValueError("a wavelength grid needs at least two strictly ascending wavelengths")
    return WavelengthGrid(nm, trapezoid_weights_nm(nm))


def interpolation_matrix(from_nm: np.ndarray, to_nm: np.ndarray) -> np.ndarray:
    """Matrix (P', P) that interpolates values linearly from wavelengths (P,) to others (P',).

    Beyond the ends the first and the last value hold.

    Parameters
    ----------
    from_nm : (P,) array
        Ascending.
    to_nm : (P',) array
    """
    start = np.clip(np.searchsorted(from_nm, to_nm, side="right") - 1, 0, from_nm.size - 2)
    along = np.clip(to_nm, from_nm[0], from_nm[-1]) - from_nm[start]
    slope = 1 / (from_nm[start + 1] - from_nm[start])
    # an array (P, P'), transposed: BLAS sums in another order over another layout
    weights, columns = np.zeros((from_nm.size, len(to_nm))), np.arange(len(to_nm))
    weights[start, columns], weights[start + 1, columns] = 1 - slope * along, slope * along
    return weights.T


def at_whole_steps(nm: np.ndarray, step_nm: float) -> np.ndarray:
    """Whether each wavelength (P,) is a whole number of steps from the first.

    Parameters
    ----------
    nm : (P,) array
    step_nm : float
    """
    return np.abs(np.remainder(nm - nm[0] + step_nm / 2, step_nm) - step_nm / 2) < NM_ROUNDING


def visible_grid(step_nm: float = 1.0) -> WavelengthGrid:
    """400 to 700 nm in steps of ``step_nm``, which must divide 300.

    Parameters
    ----------
    step_nm : float
        Must divide 300.
    """
    intervals = round((VISIBLE_NM[1] - VISIBLE_NM[0]) / step_nm)
    return grid_from_nm(np.linspace(*VISIBLE_NM, intervals + 1))


FINE_GRID = visible_grid()       # on which everything is integrated
