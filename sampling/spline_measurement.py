"""A measurement in spline coefficients, and the draws that polytope samplers make of it."""
from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from spectrabox.radiometry.bspline import basis_matrix
from spectrabox.radiometry.grid import interpolation_matrix
from spectrabox.radiometry.records import Outcome, SpectralMeasurement, WavelengthGrid
from spectrabox.radiometry.shaped import Record

PROJECTION_STEPS = 300      # of the accelerated projected gradient; 1e-7 of the optimum at N = 31


@dataclass(frozen=True, eq=False)
class MeasurementOperator(Record):
    """A measurement of spline coefficients: ``y = A c + noise``, c of 1 giving y of 1."""

    A: Annotated[np.ndarray, "K N"]
    y: Annotated[np.ndarray, "K"]
    noise_covariance: Annotated[np.ndarray, "K K"]


@dataclass(frozen=True, eq=False)
class CoefficientDraws(Record):
    """Draws of spline coefficients in [0, 1], all equally likely, and how the sampler did."""

    coefficients: Annotated[np.ndarray, "T N"]
    acceptance: float
    effective_samples: float
    outcome: Outcome


def spline_operator(measurement: SpectralMeasurement, coefficients: int) -> MeasurementOperator:
    """The measurement in a B-spline basis of N = ``coefficients`` functions.

    Parameters
    ----------
    measurement : SpectralMeasurement
    coefficients : int
        N, of the spline class.
    """
    A = measurement.relative_response @ basis_matrix(measurement.grid.nm, coefficients)
    return MeasurementOperator(A, measurement.signal, measurement.noise_covariance)


def nearest_coefficients(A: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Coefficients (N,) in [0, 1] whose signal A c is nearest to y, by bounded least squares.

    Parameters
    ----------
    A : (K, N) array
        From coefficients to signal.
    y : (K,) array
        Signal.
    """
    from scipy.optimize import lsq_linear  # 0.3 s to import, and few signals need it

    return np.clip(lsq_linear(A, y, bounds=(0, 1), tol=1e-12).x, 0, 1)


def response_on(measurement: SpectralMeasurement, grid: WavelengthGrid) -> np.ndarray:
    """Relative response (K, P') to reflectances that are straight lines between the P' wavelengths
    of a coarser grid; rows sum to 1.

    Parameters
    ----------
    measurement : SpectralMeasurement
    grid : WavelengthGrid
        Of P wavelengths, coarser.
    """
    return measurement.relative_response @ interpolation_matrix(grid.nm, measurement.grid.nm)


def nearest_splines(spectra: np.ndarray, basis: np.ndarray) -> np.ndarray:
    """Coefficients (T, N) in [0, 1] of the splines nearest to spectra (T, P), all at once.

    Accelerated projected gradient with restarts (O'Donoghue and Candes 2015) from the clipped
    least-squares fit.

    Parameters
    ----------
    spectra : (T, P) array
        Reflectances.
    basis : (P, N) array
        Basis functions at the same wavelengths.
    """
    gram, target = basis.T @ basis, spectra @ basis
    step = 1 / np.linalg.eigvalsh(gram)[-1]
    c = np.clip(np.linalg.solve(gram, target.T).T, 0, 1)
    ahead, momentum = c, 1.0
    for _ in range(PROJECTION_STEPS):
        new = np.clip(ahead - step * (ahead @ gram - target), 0, 1)
        if np.abs(new - c).max() < 1e-9:
            return new
        restart = np.sum((ahead - new) * (new - c)) > 0
        following = 1.0 if restart else (1 + np.sqrt(1 + 4 * momentum**2)) / 2
        ahead = new + (0.0 if restart else (momentum - 1) / following) * (new - c)
        c, momentum = new, following
    return c
