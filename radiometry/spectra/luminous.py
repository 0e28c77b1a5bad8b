"""Luminance and illuminance of a spectrum (CIE 1931 2 degree observer, 683 lm/W)."""
from __future__ import annotations

import numpy as np

from spectrabox.radiometry.grid import trapezoid_weights_nm
from spectrabox.radiometry.spectra.pchip import pchip

LUMENS_PER_WATT = 683.0
# V(lambda) = y-bar of CIE 15 every 5 nm. A table, as loading colour-science takes longer than a
# reading.
EFFICIENCY_NM = np.arange(380.0, 781.0, 5.0)
EFFICIENCY = np.array([
    3.9e-05, 6.4e-05, 0.00012, 0.000217, 0.000396, 0.00064, 0.00121, 0.00218, 0.004,
    0.0073, 0.0116, 0.01684, 0.023, 0.0298, 0.038, 0.048, 0.06, 0.0739,
    0.09098, 0.1126, 0.13902, 0.1693, 0.20802, 0.2586, 0.323, 0.4073, 0.503,
    0.6082, 0.71, 0.7932, 0.862, 0.9148501, 0.954, 0.9803, 0.9949501, 1,
    0.995, 0.9786, 0.952, 0.9154, 0.87, 0.8163, 0.757, 0.6949, 0.631,
    0.5668, 0.503, 0.4412, 0.381, 0.321, 0.265, 0.217, 0.175, 0.1382,
    0.107, 0.0816, 0.061, 0.04458, 0.032, 0.0232, 0.017, 0.01192, 0.00821,
    0.005723, 0.004102, 0.002929, 0.002091, 0.001484, 0.001047, 0.00074, 0.00052, 0.0003611,
    0.0002492, 0.0001719, 0.00012, 8.48e-05, 6e-05, 4.24e-05, 3e-05, 2.12e-05, 1.499e-05,
])


def luminance_of(nm: np.ndarray, values: np.ndarray) -> float:
    """Luminance in cd m-2 of a radiance, or illuminance in lx of an irradiance.

    Parameters
    ----------
    nm : (P,) array
        Ascending.
    values : (P,) array
        W m-2 sr-1 nm-1, or W m-2 nm-1.
    """
    return float(LUMENS_PER_WATT * np.sum(trapezoid_weights_nm(nm) * luminous_efficiency(nm)
                                          * values))


def luminous_efficiency(nm: np.ndarray) -> np.ndarray:
    """V(lambda) (P,), 0 outside 380-780 nm.

    Parameters
    ----------
    nm : (P,) array
    """
    inside = (nm >= EFFICIENCY_NM[0]) & (nm <= EFFICIENCY_NM[-1])
    return np.where(inside,
                    pchip(EFFICIENCY_NM, EFFICIENCY, np.where(inside, nm, 560.0)), 0.0)
