"""Gaussian priors on the spectra, which decide what the photos leave open."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spectrabox.radiometry.bspline import basis_matrix
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import interpolation_matrix
from spectrabox.radiometry.records.scenes import LearntSpectra
from spectrabox.radiometry.records.spectra import WavelengthGrid
from spectrabox.reconstruct.settings import SPECTRUM_PRIORS, InversionSettings

BROAD = 1.0  # standard deviation of a coefficient around 0.5 by the prior, besides smoothness
UNEXPLAINED = 0.01      # standard deviation of a coefficient that no learnt spectrum explains


@dataclass(frozen=True, eq=False)
class SpectrumPrior:
    """Gaussian prior of the coefficients of one material."""

    mean: np.ndarray                    # (N,)
    precision: np.ndarray               # (N, N)


def spectrum_prior(settings: InversionSettings, grid: WavelengthGrid,
                   of_family: LearntSpectra | None = None) -> SpectrumPrior:
    """Prior of the coefficients of an unknown material, as the settings choose it.

    Parameters
    ----------
    settings : InversionSettings
        Of which ``spectrum_prior``, ``smoothness``, ``coefficients`` and ``learnt`` count.
    grid : WavelengthGrid
        P wavelengths, on which a learnt prior is interpolated.
    of_family : LearntSpectra, optional
        In place of ``learnt``, where the material's family of surfaces is stated.

    Raises
    ------
    InputError
        If the settings name an unknown prior, or a learnt one without its data.
    """
    if settings.spectrum_prior not in SPECTRUM_PRIORS:
        raise InputError(f"there is no prior on spectra {settings.spectrum_prior!r}; "
                         f"use one of {', '.join(SPECTRUM_PRIORS)}")
    if settings.spectrum_prior != "learnt":
        return smooth_prior(settings.coefficients,
                            settings.smoothness if settings.spectrum_prior == "smooth" else 0.0)
    learnt = of_family or settings.learnt
    if learnt is None:
        raise InputError("a learnt prior on spectra needs the mean and covariance of measured "
                         "reflectances: give them, or choose the prior \"smooth\"")
    between = interpolation_matrix(learnt.nm, grid.nm)
    return learnt_prior(basis_matrix(grid.nm, settings.coefficients), between @ learnt.mean,
                        between @ learnt.covariance @ between.T)


def smooth_prior(coefficients: int, smoothness: float) -> SpectrumPrior:
    """Prior of N coefficients with small second differences, broadly around 0.5.

    exp(-tau/2 |second differences|^2) with tau = smoothness (N - 3)^3: the same curvature of the
    spectrum for every N. Second differences are divided by the gaps of the Greville abscissae, so
    that a straight spectrum has none.

    Parameters
    ----------
    coefficients : int
        N, 4 or more.
    smoothness : float
        0 leaves the broad prior alone.
    """
    position = greville_abscissae(coefficients)
    mean_gap = 1.0 / (coefficients - 1)
    second = np.zeros((coefficients - 2, coefficients))
    for row in range(coefficients - 2):
        left, right = np.diff(position[row:row + 3])
        second[row, row:row + 3] = np.array([1 / left, -(1 / left + 1 / right),
                                             1 / right]) * mean_gap
    tau = smoothness * (coefficients - 3) ** 3
    return SpectrumPrior(np.full(coefficients, 0.5),
                         tau * second.T @ second + np.eye(coefficients) / BROAD**2)


def learnt_prior(basis: np.ndarray, mean: np.ndarray, covariance: np.ndarray) -> SpectrumPrior:
    """Prior of the coefficients from mean and covariance of measured reflectances.

    Parameters
    ----------
    basis : (P, N) array
    mean : (P,) array
        At the wavelengths of the basis.
    covariance : (P, P) array
    """
    to_coefficients = np.linalg.pinv(basis)
    spread = to_coefficients @ covariance @ to_coefficients.T + UNEXPLAINED**2 * np.eye(
        basis.shape[1])
    return SpectrumPrior(to_coefficients @ mean, np.linalg.inv(spread))


def greville_abscissae(coefficients: int) -> np.ndarray:
    """Abscissae (N,) of the coefficients of a clamped cubic spline, 0 to 1."""
    inner = np.linspace(0, 1, coefficients - 2)
    knots = np.r_[[0.0] * 3, inner, [1.0] * 3]
    return np.array([knots[i + 1:i + 4].mean() for i in range(coefficients)])
