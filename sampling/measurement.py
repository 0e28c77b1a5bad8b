"""A measurement on wavelengths instead of spline coefficients, draws of spectra from it, and their
summary.
"""
from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from spectrabox.radiometry.bspline import basis_matrix
from spectrabox.radiometry.errors import ConvergenceError, InputError
from spectrabox.radiometry.records import MeasurementOperator, SpectrumSummary, WavelengthGrid
from spectrabox.radiometry.shaped import Record
from spectrabox.sampling.polytope.bounds import reflectance_bounds
from spectrabox.sampling.summary import TAIL_DRAWS, next_measurement_nm

PROJECTION_STEPS = 300      # of the accelerated projected gradient; 1e-7 of the optimum at N = 31


@dataclass(frozen=True, eq=False)
class SpectralMeasurement(Record):
    """What the camera said of one surface: ``signal = response @ reflectance + noise``, white
    giving 1 in each band.
    """

    grid: WavelengthGrid
    response: Annotated[np.ndarray, "K P"]          # every row sums to 1
    signal: Annotated[np.ndarray, "K"]
    noise_covariance: Annotated[np.ndarray, "K K"]

    def operator(self, coefficients: int) -> MeasurementOperator:
        """The same in a B-spline basis of that many functions."""
        return MeasurementOperator(self.response @ basis_matrix(self.grid.nm, coefficients),
                                   self.signal, self.noise_covariance)

    def response_on(self, grid: WavelengthGrid) -> np.ndarray:
        """Response (K, P') to reflectances that are straight lines between the wavelengths of a
        coarser grid.
        """
        return self.response @ linear_between(grid, self.grid)


@dataclass(frozen=True, eq=False)
class SpectralSamples(Record):
    """Independent draws of spectra that fit one measurement, and the spline nearest to each."""

    grid: WavelengthGrid
    spectra: Annotated[np.ndarray, "T P"]
    # in [0, 1]: the bounded least-squares spline of each draw
    coefficients: Annotated[np.ndarray, "T N"]
    method: str
    effective_samples: float
    seed: int
    outcome: str                                    # a sentence


def linear_between(coarse: WavelengthGrid, fine: WavelengthGrid) -> np.ndarray:
    """Matrix (P, P') that interpolates values on the coarse grid linearly to the fine one."""
    return np.array([np.interp(fine.nm, coarse.nm, unit) for unit in np.eye(coarse.nm.size)]).T


def nearest_splines(spectra: np.ndarray, basis: np.ndarray) -> np.ndarray:
    """Coefficients (T, N) in [0, 1] of the splines nearest to spectra (T, P), all at once.

    Accelerated projected gradient with restarts (O'Donoghue and Candes 2015) from the clipped
    least-squares fit.
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


def summarise_spectra(samples: SpectralSamples, measurement: SpectralMeasurement,
                      level: float = 0.95,
                      conditional_on: str | None = None) -> SpectrumSummary:
    """Mean, standard deviation, central band and exact bounds from draws of spectra.

    The bounds are those of the spline class with as many coefficients as ``samples.coefficients``.

    Raises
    ------
    InputError
        If the level is no probability.
    ConvergenceError
        If there are too few draws for the band (1000 at 95 %).
    """
    if not 0 < level < 1:
        raise InputError(f"a level of {level} was asked for; it is a probability between 0 and 1")
    needed = round(2 * TAIL_DRAWS / (1 - level))
    if samples.effective_samples < needed:
        raise ConvergenceError(f"a {100 * level:.4g} % band needs {needed} effective draws and "
                               f"there are {samples.effective_samples:.0f}; draw more")
    count = samples.coefficients.shape[1]
    basis = basis_matrix(samples.grid.nm, count)
    bound_lower, bound_upper = reflectance_bounds(measurement.operator(count), basis, level)
    lower, upper = np.quantile(samples.spectra, [(1 - level) / 2, (1 + level) / 2], axis=0)
    covariance = np.cov(samples.spectra, rowvar=False, ddof=0)
    return SpectrumSummary(
        grid=samples.grid, mean=samples.spectra.mean(axis=0),
        standard_deviation=samples.spectra.std(axis=0), lower=lower, upper=upper,
        bound_lower=bound_lower, bound_upper=bound_upper, level=level, conditional_on=conditional_on
        or f"Conditional on the prior and sampler {samples.method}. {samples.outcome}",
        next_measurement_nm=next_measurement_nm(samples.grid, covariance))
