"""Tristimulus values and luminance of a spectrum (CIE 1931 2 degree observer, 683 lm/W)."""
from __future__ import annotations

import functools

import numpy as np

from spectrabox.radiometry.grid import trapezoid_weights_nm
from spectrabox.radiometry.published.published_tables import OBSERVERS, published_curves

LUMENS_PER_WATT = 683.0
WITHIN_NM = (380.0, 780.0)      # CIE 15; beyond, the observer's table changes no digit


def luminance_of(nm: np.ndarray, values: np.ndarray) -> float:
    """Luminance in cd m-2 of a radiance, or illuminance in lx of an irradiance.

    Parameters
    ----------
    nm : (P,) array
        Ascending.
    values : (P,) array
        W m-2 sr-1 nm-1, or W m-2 nm-1.
    """
    return float(tristimulus_of(nm, values)[1])


def tristimulus_of(nm: np.ndarray, values: np.ndarray) -> np.ndarray:
    """X, Y, Z (3,) with Y in cd m-2 of a radiance, or in lx of an irradiance.

    Parameters
    ----------
    nm : (P,) array
        Ascending.
    values : (P,) array
        W m-2 sr-1 nm-1, or W m-2 nm-1.
    """
    return LUMENS_PER_WATT * colour_matching(nm) @ (trapezoid_weights_nm(nm) * values)


def colour_matching(nm: np.ndarray) -> np.ndarray:
    """x-bar, y-bar and z-bar (3, P), 0 outside 380-780 nm.

    Parameters
    ----------
    nm : (P,) array
    """
    inside = (nm >= WITHIN_NM[0]) & (nm <= WITHIN_NM[1])
    table_nm, curves = _observer()
    return np.array([np.where(inside, np.interp(nm, table_nm, curve), 0.0) for curve in curves])


@functools.cache
def _observer() -> tuple[np.ndarray, np.ndarray]:
    return published_curves(OBSERVERS, "CIE 1931 2 Degree Standard Observer")
