"""Camera signal from reflectance, light and sensitivity (Eqs. 1, 4 and 8).

The paper's Eqs. 4 and 8 carry the reflectance inside M; read as printed, the signal would be
quadratic in it. Here M_ij = sensitivity_i(nm_j) light(nm_j) weight_j, and signal = M @ reflectance.
"""
from __future__ import annotations

import numpy as np

from spectrabox.radiometry.records.calibration import Calibration
from spectrabox.radiometry.records.spectra import WavelengthGrid
from spectrabox.radiometry.spectra.spectrum_files import spectrum_on_grid


def response_matrix(grid: WavelengthGrid, sensitivities: np.ndarray,
                    light: np.ndarray) -> np.ndarray:
    """M (K, P) of Eq. 8.

    Parameters
    ----------
    grid : WavelengthGrid
    sensitivities : (K, P) array
    light : (P,) array
        Its spectrum, any unit.
    """
    return sensitivities * light * grid.weights_nm


def white_signal(response: np.ndarray) -> np.ndarray:
    """White signal (K,) of each band: that of a reflectance of 1 at every wavelength.

    Parameters
    ----------
    response : (K, P) array
        As ``response_matrix`` gives it.
    """
    return response.sum(axis=1)


def relative_response(calibration: Calibration, grid: WavelengthGrid) -> np.ndarray:
    """Response (K, P) of a calibrated camera's bands to reflectances under its light; rows sum
    to 1.

    Parameters
    ----------
    calibration : Calibration
    grid : WavelengthGrid
        Of its curves.
    """
    matrix = response_matrix(grid, calibration.sensitivity.curves,
                             spectrum_on_grid(calibration.light, grid))
    return np.asarray(matrix / white_signal(matrix)[:, None])


def relative_operator(response: np.ndarray, basis: np.ndarray) -> np.ndarray:
    """A (K, N) of Eq. 4 over the white signal of each band: coefficients of 1 give a signal of 1.

    Parameters
    ----------
    response : (K, P) array
        As ``response_matrix`` gives it.
    basis : (P, N) array
    """
    return response @ basis / white_signal(response)[:, None]
