"""Camera signal from reflectance, light and sensitivity (Eqs. 1, 4 and 8).

The paper's Eqs. 4 and 8 carry the reflectance inside M; read as printed, the signal would be
quadratic in it. Here M_ij = sensitivity_i(nm_j) light(nm_j) weight_j, and signal = M @ reflectance.
"""
from __future__ import annotations

import numpy as np

from spectrabox.radiometry.records import WavelengthGrid


def response_matrix(grid: WavelengthGrid, sensitivities: np.ndarray,
                    light: np.ndarray) -> np.ndarray:
    """M (K, P) of Eq. 8 from sensitivities (K, P) and light (P,) on the grid."""
    return sensitivities * light * grid.weights_nm


def white_signal(response: np.ndarray) -> np.ndarray:
    """Signal (K,) of a surface of reflectance 1 at every wavelength."""
    return response.sum(axis=1)


def relative_operator(response: np.ndarray, basis: np.ndarray) -> np.ndarray:
    """A (K, N) of Eq. 4, with each band divided by its white signal: coefficients of 1 give a
    signal of 1.
    """
    return response @ basis / white_signal(response)[:, None]
