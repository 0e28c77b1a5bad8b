"""What is known of one spectrum, from draws or a posterior: mean, band, exact bounds, and where its
variance comes from.

Where the variance of a recovered spectrum comes from: metamerism, photo noise, light ...

Metamerism is what would remain if the signal were perfect: the posterior of the same signal is
solved again without errors. The rest is what errors add. It is shared out as
they grow together from nothing, each by what it then adds [Aumann & Shapley 1974], linear-Gaussian
at the most probable component; with S before the signal, J its derivative and R the sum of R_i

    P(R) - P(0) = sum_i integral of G(t) R_i G(t)' over t from 0 to 1
    G(t) = S J' (J S J' + t R)^-1

without remainder. Errors that multiply a signal are those of the signal that the component gives
(`about_answer`). The integral is closed in the basis that makes J S J' and R diagonal at once. The
gain of the answer in place of G(t) would charge large errors to metamerism: where they are large,
the answer hardly looks at the signal.
"""


from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from spectrabox.radiometry import error_model, findings, grid
from spectrabox.radiometry.errors import ConvergenceError, InputError
from spectrabox.radiometry.records import spectra
from spectrabox.sampling.polytope.bounds import reflectance_bounds
from spectrabox.sampling.prior import mixture_posterior
from spectrabox.sampling.prior.mixture import LogitMixture, reflectance
from spectrabox.sampling.spectral_measurement import spline_operator

METAMERISM = "metamerism"
LEAST_RATIO = 1e-12     # of the variance of signals to that of their errors
ALIKE = 1e-6            # relative: closer numbers are one


def grown_by_causes(prior: LogitMixture, relative_response: np.ndarray,
                    mixture: mixture_posterior.MixturePosterior,
                    causes: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """What errors add to the variances (T, P) of the reflectances of T signals, by cause, at the
    most probable component of each.

    Parameters
    ----------
    prior : LogitMixture
    relative_response : (K, P) array
    mixture : MixturePosterior
        Of the signals, for the noise that is the sum of the causes.
    causes : mapping to (T, K, K) arrays
    """
    index = np.argmax(mixture.weights, axis=1)
    row, with_level = np.arange(index.size), prior.with_level[index]
    S = prior.covariances[index] + mixture.stretch[row, index, None, None] \
        * with_level[:, :, None] * with_level[:, None, :]
    p = reflectance(mixture.logits[index, row])
    slope = p * (1 - p)
    jacobian = relative_response * slope[:, None, :]
    base = jacobian @ S                                         # (T, K, P)
    whiten = np.linalg.inv(
        np.linalg.cholesky(mixture_posterior.with_floor(np.sum(list(causes.values()), axis=0))))
    ratios, vectors = np.linalg.eigh(whiten @ (base @ jacobian.transpose(0, 2, 1))
                                     @ whiten.transpose(0, 2, 1))
    ratios = np.maximum(ratios, LEAST_RATIO)                    # (T, K) of signal to errors
    to_basis = vectors.transpose(0, 2, 1) @ whiten              # (T, K, K)
    seen = to_basis @ base
    weights = _integral(ratios[:, :, None], ratios[:, None, :])
    return {name: slope**2 * np.sum(seen * (
        (weights * (to_basis @ covariance @ to_basis.transpose(0, 2, 1))) @ seen), axis=1)
        for name, covariance in causes.items()}


def about_answer(causes: Mapping[str, np.ndarray], signals: np.ndarray, given: np.ndarray,
                 log_errors: np.ndarray | None) -> dict[str, np.ndarray]:
    """Covariances of the errors by cause about what an answer gives, from those about the measured
    signals; the same where no error multiplies.

    Parameters
    ----------
    causes : mapping to (T, K, K) arrays
    signals : (T, K) array
        As measured.
    given : (T, K) array
        What the errors multiply, by the answer.
    log_errors : (T, K) array or None
        By how much, in its logarithm.
    """
    if log_errors is None:
        return dict(causes)
    less = np.exp(-log_errors)
    split = {name: error_model.split_errors(signals, {name: covariance})
             for name, covariance in causes.items()}
    return {
        name:
        error_model.proportional_covariance(given, errors.relative)
        + error_model.proportional_covariance(less, errors.absolute)
        for name, errors in split.items()
    }


def error_budgets(prior: LogitMixture, relative_response: np.ndarray, signals: np.ndarray,
                  mixture: mixture_posterior.MixturePosterior,
                  grown: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Variances (T, P) of the reflectances of T signals by cause, metamerism first.

    Parameters
    ----------
    prior : LogitMixture
    relative_response : (K, P) array
    signals : (T, K) array
        Relative to white, without what is not the reflectance's; with errors that multiply them,
        those of the answer.
    mixture : MixturePosterior
        Of the signals, with all errors.
    grown : mapping to (T, P) arrays
        From `grown_by_causes`.
    """
    variance = mixture_posterior.mean_and_spread(mixture)[1]**2
    total = np.sum(list(grown.values()), axis=0)
    left = variance
    if np.any(total > 0):
        perfect = mixture_posterior.posterior(prior, relative_response, signals,
                                              np.zeros((signals.shape[1],) * 2))
        left = np.where(total > 0,
                        np.minimum(mixture_posterior.mean_and_spread(perfect)[1]**2, variance),
                        variance)
    return {METAMERISM: left} | {name: (variance - left) * each / np.where(total > 0, total, 1.0)
                                 for name, each in grown.items()}


def _integral(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Integral of 1 / ((a + t) (b + t)) over t from 0 to 1, of numbers above 0."""
    apart = np.abs(b - a) > ALIKE * (a + b)
    middle = np.sqrt(a * b)
    return np.where(apart, (np.log1p(1 / a) - np.log1p(1 / b)) / np.where(apart, b - a, 1.0),
                    1 / (middle * (middle + 1)))


def shares_by_cause(budgets: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Shares (T,) of the causes in the mean variance over wavelength.

    Parameters
    ----------
    budgets : dict of (T, P) arrays
        From `error_budgets`.
    """
    means = {name: variance.mean(axis=1) for name, variance in budgets.items()}
    total = np.sum(list(means.values()), axis=0)
    return {name: mean / total for name, mean in means.items()}


# ---- what the draws say of one spectrum ----------------------------------------------------------

# effective draws beyond each end of a band: the level of each tail is then known to 20 %
TAIL_DRAWS = 25
# standard error of the next reading, in reflectance: that of a good spectroradiometer
READING_ERROR = 0.005


def summarise(
        samples: spectra.SpectrumSamples, measurement: spectra.SpectralMeasurement,
        level: float = 0.95,
        conditional_on: tuple[findings.Finding, ...] | None = None) -> spectra.SpectrumSummary:
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
    basis = grid.basis_matrix(samples.grid.nm, count)
    bound_lower, bound_upper = reflectance_bounds(spline_operator(measurement, count), basis, level)
    lower, upper = np.quantile(samples.spectra, [(1 - level) / 2, (1 + level) / 2], axis=0)
    covariance = np.cov(samples.spectra, rowvar=False, ddof=0)
    return spectra.SpectrumSummary(
        grid=samples.grid, mean=samples.spectra.mean(axis=0),
        standard_deviation=samples.spectra.std(axis=0), lower=lower, upper=upper,
        bound_lower=bound_lower, bound_upper=bound_upper, level=level, conditional_on=conditional_on
        or (findings.Finding("band.prior-and-sampler", findings.Severity.INFO,
                             values={"method": samples.method}), *samples.findings),
        next_measurement_nm=next_measurement_nm(samples.grid, covariance), samples=samples)


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


def next_measurement_nm(grid: spectra.WavelengthGrid, covariance: np.ndarray) -> float:
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
