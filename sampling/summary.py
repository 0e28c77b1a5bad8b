"""What the draws say of one spectrum: mean and standard deviation (Eq. 7), a pointwise band, and
where to look next.
"""
from __future__ import annotations

import numpy as np

from spectrabox.radiometry.errors import ConvergenceError, InputError
from spectrabox.radiometry.records import (
    MeasurementOperator,
    Outcome,
    SpectrumSamples,
    SpectrumSummary,
    WavelengthGrid,
)
from spectrabox.sampling.polytope.bounds import reflectance_bounds, widening

# effective draws beyond each end of a band: the level of each tail is then known to 20 %
TAIL_DRAWS = 25
BOUND_WAVELENGTHS = 61   # every 5 nm of 400-700 nm
# standard error of the next reading, in reflectance: that of a good spectroradiometer
READING_ERROR = 0.005
QUANTILE_COLUMNS = 32    # wavelengths evaluated at once, to hold T x 32 numbers instead of T x P


def summarise(samples: SpectrumSamples, operator: MeasurementOperator, grid: WavelengthGrid,
              basis: np.ndarray,
              level: float = 0.95, conditional_on: str | None = None) -> SpectrumSummary:
    """Summarise draws of coefficients as a spectrum with its uncertainty.

    Parameters
    ----------
    samples : SpectrumSamples
        From `sample_spectra` or another sampler of the same measurement.
    operator : MeasurementOperator
        The measurement, for the bounds.
    grid, basis : WavelengthGrid and (P, N) array
        Wavelengths and the basis functions there.
    level : float
        Of the pointwise band: central, equal tails.
    conditional_on : str or None
        The sentence that says what the numbers rest on; None for the one this function can write
        itself.

    Returns
    -------
    SpectrumSummary
        Standard deviations divide by the number of draws (ddof 0), as in Eq. 7. The bounds are
        exact at 61 wavelengths and interpolated linearly between them, where they are off by up to
        0.01 at a bend.

    Raises
    ------
    InputError
        If the shapes do not belong together, or the level is no probability.
    ConvergenceError
        If there are too few effective draws for the band (1000 at 95 %), or the bounds cannot be
        computed.
    """
    _check(samples, grid, basis, level)
    mean = np.average(samples.coefficients, axis=0, weights=samples.weights)
    covariance = np.cov(samples.coefficients, rowvar=False, ddof=0, aweights=samples.weights)
    spectral = basis @ np.atleast_2d(covariance) @ basis.T
    lower, upper = _band(samples, basis, level)
    bound_lower, bound_upper = _bounds(operator, grid, basis, level)
    return SpectrumSummary(
        grid=grid, mean=basis @ mean, standard_deviation=np.sqrt(np.maximum(np.diag(spectral), 0)),
        lower=lower, upper=upper, bound_lower=bound_lower, bound_upper=bound_upper, level=level,
        conditional_on=conditional_on or _conditions(samples, operator, level),
        next_measurement_nm=next_measurement_nm(grid, spectral))


def next_measurement_nm(grid: WavelengthGrid, covariance: np.ndarray) -> float:
    """Wavelength whose reading, with a standard error of 0.005, would take most off the total
    variance.

    Linear-Gaussian: a reading at p lowers the integral of the variance over wavelength by
    sum_q w_q cov(q, p)^2 / (var(p) + 0.005^2). Where nothing is left to learn, all are equal and it
    is the first.
    """
    reduction = grid.weights_nm @ covariance**2 / (np.diag(covariance) + READING_ERROR**2)
    return float(grid.nm[np.argmax(reduction)])


def _band(samples: SpectrumSamples, basis: np.ndarray,
          level: float) -> tuple[np.ndarray, np.ndarray]:
    parts = [basis[start:start + QUANTILE_COLUMNS] for start in range(0, len(basis),
                                                                      QUANTILE_COLUMNS)]
    lower, upper = np.hstack([_tails(samples.coefficients @ rows.T, samples.weights,
                                     level) for rows in parts])
    return lower, upper


def _tails(values: np.ndarray, weights: np.ndarray | None, level: float) -> np.ndarray:
    probabilities = np.array([(1 - level) / 2, (1 + level) / 2])
    if weights is None:
        return np.quantile(values, probabilities, axis=0)
    return np.quantile(values, probabilities, axis=0, weights=weights, method="inverted_cdf")


def _bounds(operator: MeasurementOperator, grid: WavelengthGrid, basis: np.ndarray,
            level: float) -> tuple[np.ndarray, np.ndarray]:
    some = np.unique(np.linspace(0, grid.nm.size - 1, BOUND_WAVELENGTHS).round().astype(int))
    lower, upper = reflectance_bounds(operator, basis[some], level)
    return np.interp(grid.nm, grid.nm[some], lower), np.interp(grid.nm, grid.nm[some], upper)


def _conditions(samples: SpectrumSamples, operator: MeasurementOperator, level: float) -> str:
    errors = np.sqrt(np.diag(operator.noise_covariance))
    noise = (f"Gaussian signal noise of {', '.join(f'{100 * error:.2g}' for error in errors)} % of "
             "white"
             if errors.any() else "a signal without noise")
    text = (f"Conditional on reflectance in a basis of {operator.A.shape[1]} functions with every "
            f"coefficient between 0 and 1, on {noise}, and on the prior and sampler "
            f"{samples.method}.")
    if samples.outcome is Outcome.UNREACHABLE:
        text += f" {samples.outcome.value}"
    slack = widening(operator, level)
    if slack > 0:
        text += f" No spectrum fits within the noise: the bounds allow {100 * slack:.2g} % of white more."
    return text


def _check(samples: SpectrumSamples, grid: WavelengthGrid, basis: np.ndarray, level: float) -> None:
    coefficients = samples.coefficients.shape[1]
    if basis.shape != (grid.nm.size, coefficients):
        raise InputError(f"the basis has shape {basis.shape}; ({grid.nm.size}, {coefficients}) is "
                         "needed for this grid and these draws")
    if not 0 < level < 1:
        raise InputError(f"a level of {level} was asked for; it is a probability between 0 and 1")
    needed = round(2 * TAIL_DRAWS / (1 - level))
    if samples.effective_samples < needed:
        raise ConvergenceError(f"a {100 * level:.4g} % band needs {needed} effective draws and "
                               f"there are {samples.effective_samples:.0f}; draw more")
