"""What the draws say of one spectrum: mean and standard deviation (Eq. 7), a pointwise band, exact
bounds, and where to look next.
"""
from __future__ import annotations

import numpy as np

from spectrabox.radiometry.bspline import basis_matrix
from spectrabox.radiometry.errors import ConvergenceError, InputError
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.records.spectra import (
    SpectralMeasurement,
    SpectrumSamples,
    SpectrumSummary,
    WavelengthGrid,
)
from spectrabox.sampling.polytope.bounds import reflectance_bounds
from spectrabox.sampling.spectral_measurement import spline_operator

# effective draws beyond each end of a band: the level of each tail is then known to 20 %
TAIL_DRAWS = 25
# standard error of the next reading, in reflectance: that of a good spectroradiometer
READING_ERROR = 0.005


def summarise(samples: SpectrumSamples, measurement: SpectralMeasurement, level: float = 0.95,
              conditional_on: tuple[Finding, ...] | None = None) -> SpectrumSummary:
    """Mean, standard deviation, central band and exact bounds from draws of spectra.

    Parameters
    ----------
    samples : SpectrumSamples
    measurement : SpectralMeasurement
        Which the bounds obey; those of the spline class with as many coefficients as
        ``samples.coefficients``.
    level : float
        Of the pointwise band: central, equal tails.
    conditional_on : tuple of Finding, optional
        What the numbers rest on; by default prior, sampler and outcome.

    Returns
    -------
    SpectrumSummary
        Standard deviations divide by the number of draws (ddof 0), as in Eq. 7.

    Raises
    ------
    InputError
        If the level is no probability.
    ConvergenceError
        If there are too few draws for the band (1000 at 95 %), or the bounds cannot be computed.
    """
    check_draws(samples.effective_samples, level)
    count = samples.coefficients.shape[1]
    basis = basis_matrix(samples.grid.nm, count)
    bound_lower, bound_upper = reflectance_bounds(spline_operator(measurement, count), basis, level)
    lower, upper = np.quantile(samples.spectra, [(1 - level) / 2, (1 + level) / 2], axis=0)
    covariance = np.cov(samples.spectra, rowvar=False, ddof=0)
    return SpectrumSummary(
        grid=samples.grid, mean=samples.spectra.mean(axis=0),
        standard_deviation=samples.spectra.std(axis=0), lower=lower, upper=upper,
        bound_lower=bound_lower, bound_upper=bound_upper, level=level,
        conditional_on=conditional_on or (
            Finding("band.prior-and-sampler", Severity.INFO, values={"method": samples.method}),
            *samples.findings),
        next_measurement_nm=next_measurement_nm(samples.grid, covariance))


def check_draws(effective_samples: float, level: float) -> None:
    """Raise unless that many draws can tell a band of that level.

    Parameters
    ----------
    effective_samples : float
    level : float
        Probability of the band, 0 to 1.

    Raises
    ------
    InputError
        If the level is no probability.
    ConvergenceError
        If fewer than 25 draws are to be expected beyond each end of the band.
    """
    check_level(level)
    needed = round(2 * TAIL_DRAWS / (1 - level))
    if effective_samples < needed:
        raise ConvergenceError(f"a {100 * level:.4g} % band needs {needed} effective draws and "
                               f"there are {effective_samples:.0f}; draw more")


def check_level(level: float) -> None:
    """Raise unless a level is a probability.

    Parameters
    ----------
    level : float
        Asked for.

    Raises
    ------
    InputError
    """
    if not 0 < level < 1:
        raise InputError(f"a level of {level} was asked for; it is a probability between 0 and 1")


def next_measurement_nm(grid: WavelengthGrid, covariance: np.ndarray) -> float:
    """Wavelength whose reading, with a standard error of 0.005, would take most off the total
    variance.

    Linear-Gaussian: a reading at p lowers the integral of the variance over wavelength by
    sum_q w_q cov(q, p)^2 / (var(p) + 0.005^2). Where nothing is left to learn, all are equal and it
    is the first.

    Parameters
    ----------
    grid : WavelengthGrid
        Of P wavelengths.
    covariance : (P, P) array
        Of the reflectance.
    """
    reduction = grid.weights_nm @ covariance**2 / (np.diag(covariance) + READING_ERROR**2)
    return float(grid.nm[np.argmax(reduction)])
