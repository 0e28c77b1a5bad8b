"""Errors of many signals by the curves of camera and light, all at once.

To first order they are linear in spectrum and signal (session/stages/error_budget.py derives them):
an error of a sensitivity or of a reading of the light changes the signal s of band k by

    sum over nm of (reflectance - s) x change of the band's response to white of 1.

So each error is a row of matrices: reflectance @ by_spectrum[k] - s by_white[k].
"""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spectrabox.radiometry.grid import interpolation_matrix, visible_grid
from spectrabox.radiometry.records import Calibration
from spectrabox.radiometry.response import white_signal
from spectrabox.radiometry.spectra.spectrum_files import spectrum_on_grid

GRID = visible_grid()
DARK = 1e-12


@dataclass(frozen=True, eq=False)
class CurveErrors:
    """What E independent errors of one standard deviation change in K bands."""

    by_spectrum: np.ndarray     # (K, P, E) of reflectances on the prior's wavelengths
    by_white: np.ndarray        # (K, E)
    of_brightest: np.ndarray    # (K, K) covariance relative to the brightest band's signal

    def covariance(self, signals: np.ndarray, spectra: np.ndarray) -> np.ndarray:
        """Covariance (n, K, K) of signals (n, K), for the reflectances (n, P) behind them."""
        changes = np.stack([spectra @ by_spectrum for by_spectrum in self.by_spectrum], axis=1) \
            - signals[:, :, None] * self.by_white
        brightest = signals.max(axis=1)[:, None, None]
        return np.asarray(changes @ changes.transpose(0, 2, 1) + brightest**2 * self.of_brightest)


def curve_errors(calibration: Calibration, response: np.ndarray,
                 prior_nm: np.ndarray) -> CurveErrors:
    """The errors of one calibration's sensitivities and light.

    Parameters
    ----------
    calibration : Calibration
    response : (K, P') array
        Relative response of the bands on GRID, rows summing to 1.
    prior_nm : (P,) array
        Wavelengths of the reflectances.
    """
    bands, fit = len(response), calibration.sensitivity
    to_fine, of_brightest = interpolation_matrix(prior_nm, GRID.nm), np.zeros((bands, bands))
    made = [_by_readings(calibration, response)]
    if fit.covariance is None or fit.basis is None:
        of_brightest = calibration.relative_covariance
    else:
        weight = spectrum_on_grid(calibration.light, GRID) * GRID.weights_nm
        white = white_signal(fit.curves * weight)[:, None, None]
        variances, directions = np.linalg.eigh(fit.covariance)
        independent = (directions * np.sqrt(np.maximum(variances, 0))).reshape(
            bands, fit.basis.shape[1], -1)
        made.append((weight[:, None] * fit.basis / white) @ independent)
    changes = np.concatenate(made, axis=2)      # (K, P', E)
    return CurveErrors(to_fine.T @ changes, changes.sum(axis=1), of_brightest)


def _by_readings(calibration: Calibration, response: np.ndarray) -> np.ndarray:
    """Change (K, P', readings) of the response by each reading of the light."""
    light = calibration.light
    if light.standard_error is None:
        return np.zeros((*response.shape, 0))
    power = spectrum_on_grid(light, GRID)
    by_power = response / np.maximum(power, DARK * power.max())
    return np.asarray(by_power[:, :, None] * interpolation_matrix(light.grid.nm, GRID.nm)
                      * light.standard_error)
