"""The posterior of one signal under the learnt prior, solved once: everything that is asked of it.

A signal that the learnt prior does not explain is given to the smoothness prior, and the outcome
says so. Mean, standard deviation and band are those of the distribution that draws follow
(`calibrated_marginals`), so that they need no draws.
"""
from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from spectrabox.radiometry.bspline import basis_matrix
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records.spectra import Outcome, SpectralMeasurement, SpectrumSamples
from spectrabox.sampling.error_budget import error_budgets, shares_by_cause
from spectrabox.sampling.polytope.tilt import is_reachable
from spectrabox.sampling.prior.calibrated_marginals import marginal_moments
from spectrabox.sampling.prior.mixture import PRIOR_GRID, LogitMixture, load_prior, smoothness_prior
from spectrabox.sampling.prior.mixture_posterior import (
    MixturePosterior,
    allowed_misfit,
    central_band,
    mean_and_spread,
    novelty,
    posterior,
)
from spectrabox.sampling.prior.posterior_draws import draw_reflectances
from spectrabox.sampling.spectral_measurement import (
    MeasurementOperator,
    check_draw_count,
    check_measurement,
    nearest_splines,
    response_on,
)

MENTIONED = 0.005               # share of a family that the outcome names
SPARE = 5       # spline coefficients beyond the bands of a signal that has many
APPROXIMATE = (Outcome.TOO_ROUGH, Outcome.OUT_OF_REACH)     # draws come near to the signal only


@dataclass(frozen=True, eq=False)
class SignalPosterior:
    """Posterior of the reflectance (61,) behind one signal, at 400, 405 ... 700 nm.

    Attributes
    ----------
    measurement : SpectralMeasurement
        The signal (K,) with its noise covariance.
    relative_response : (K, 61) array
        Of the measurement, on the prior's wavelengths.
    learnt_prior : LogitMixture
        The prior that was asked for: of all families, or of those stated.
    learnt_mixture : MixturePosterior
        Of this one signal under it. Families, evidence and shares of variance come from it.
    prior, mixture : LogitMixture, MixturePosterior
        Which mean, band and draws come from: the same, or the smoothness prior's.
    outcome : Outcome
        FAMILIAR, UNFAMILIAR (smoothness prior), or TOO_ROUGH and OUT_OF_REACH, whose draws do not
        reproduce the signal.
    """

    measurement: SpectralMeasurement
    relative_response: np.ndarray
    learnt_prior: LogitMixture
    learnt_mixture: MixturePosterior
    prior: LogitMixture
    mixture: MixturePosterior
    outcome: Outcome

    @property
    def method(self) -> str:
        """Name of the prior that draws come from."""
        return "smoothness prior" if self.prior is not self.learnt_prior else "learnt prior"

    @property
    def sentence(self) -> str:
        """The outcome, and what it is conditional on."""
        return describe_outcome(self.outcome, self.learnt_prior.stated, self.family_shares)

    @property
    def family_shares(self) -> dict[str, float]:
        """Posterior probability of each family of surfaces, by name; they sum to 1."""
        shares = self.learnt_prior.shares(self.learnt_mixture.weights)[0].tolist()
        return dict(zip(self.learnt_prior.families, shares, strict=True))

    @property
    def log_evidence(self) -> float:
        """Log density of the signal under the learnt prior, in nats."""
        return float(self.learnt_mixture.log_evidence[0])

    @cached_property
    def _marginals(self) -> tuple[MixturePosterior, np.ndarray]:
        return marginal_moments(self.prior, self.relative_response, self.measurement.signal[None],
                                self.measurement.noise_covariance[None], self.mixture)

    @cached_property
    def _mean_and_deviation(self) -> tuple[np.ndarray, np.ndarray]:
        return mean_and_spread(self._marginals[0])

    @property
    def mean(self) -> np.ndarray:
        """Mean reflectance (61,)."""
        return np.asarray(self._mean_and_deviation[0][0])

    @property
    def standard_deviation(self) -> np.ndarray:
        """Standard deviation (61,) of the reflectance."""
        return np.asarray(self._mean_and_deviation[1][0])

    def band(self, level: float) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper reflectance (61,) of the calibrated central band of a level, 0 to 1."""
        lower, upper = central_band(self._marginals[0], level)
        return lower[0], upper[0]

    def variances_by_cause(self, causes: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Variance (61,) of the reflectance by cause, at the most probable component.

        Parameters
        ----------
        causes : mapping to (K, K) arrays
            Covariances, whose sum is the measurement's noise covariance, by name.

        Returns
        -------
        dict
            Metamerism, the causes and the model floor.

        Raises
        ------
        InputError
            If the covariances do not add up.
        """
        noise = self.measurement.noise_covariance
        total = sum(causes.values(), np.zeros_like(noise))
        if np.abs(total - noise).max() > 1e-9 + 1e-6 * np.abs(total).max():
            raise InputError("the covariances by cause do not add up to the noise covariance of "
                             "the measurement")
        budgets = error_budgets(self.learnt_prior, self.relative_response, self.learnt_mixture,
                                {name: covariance[None] for name, covariance in causes.items()})
        return {name: variance[0] for name, variance in budgets.items()}

    def variance_shares(self, causes: Mapping[str, np.ndarray]) -> dict[str, float]:
        """Share of each cause in the mean variance over wavelength; they sum to 1.

        ``causes`` are those of `variances_by_cause`.
        """
        shares = shares_by_cause({name: variance[None] for name, variance
                                  in self.variances_by_cause(causes).items()})
        return {name: float(share[0]) for name, share in shares.items()}

    def draws(self, count: int, seed: int) -> np.ndarray:
        """Independent draws (T, 61) that reproduce the signal, each with a noise of its own.

        Raises
        ------
        InputError
            For no draws.
        ConvergenceError
            If draws do not reach the signal.
        """
        check_draw_count(count)
        return draw_reflectances(self.prior, self.mixture, self.relative_response,
                                 self.measurement, count, seed,
                                 approximate=self.outcome in APPROXIMATE)

    def samples(self, count: int, seed: int, coefficients: int) -> SpectrumSamples:
        """The draws as a record, with the splines of N = ``coefficients`` nearest to each; of more
        where the signal has more bands than that, for which no such spline might be found.

        Raises
        ------
        InputError, ConvergenceError
            As `draws`.
        """
        spectra = self.draws(count, seed)
        bands = self.measurement.signal.size
        splines = nearest_splines(spectra, basis_matrix(
            PRIOR_GRID.nm, coefficients if coefficients >= bands else bands + SPARE))
        return SpectrumSamples(PRIOR_GRID, spectra, splines, self.method, float(count), seed,
                               self.outcome, self.sentence)


def solve_posterior(prior: LogitMixture, measurement: SpectralMeasurement) -> SignalPosterior:
    """Solve the posterior of one signal, under the smoothness prior where the learnt one fails.

    Parameters
    ----------
    prior : LogitMixture
        Of all families, or of those stated (`of_families`).
    measurement : SpectralMeasurement
        Its noise covariance should carry photo noise and calibration error; zeros for a hard
        equality.

    Raises
    ------
    InputError
        For numbers that are not finite, a covariance that is none, or bands that respond alike.
    """
    check_measurement(measurement)
    response = response_on(measurement, PRIOR_GRID)
    signals, noise = measurement.signal[None], measurement.noise_covariance
    learnt = posterior(prior, response, signals, noise)
    if novelty(prior, learnt, noise)[0] <= 1:
        return SignalPosterior(measurement, response, prior, learnt, prior, learnt,
                               Outcome.FAMILIAR)
    smooth = smoothness_prior()
    wider = posterior(smooth, response, signals, noise)
    outcome = Outcome.UNFAMILIAR
    if wider.misfit[0] > allowed_misfit(noise):
        operator = MeasurementOperator(response, measurement.signal, noise)
        outcome = Outcome.TOO_ROUGH if is_reachable(operator) else Outcome.OUT_OF_REACH
    return SignalPosterior(measurement, response, prior, learnt, smooth, wider, outcome)


def sample_prior(measurement: SpectralMeasurement, draws: int, seed: int, coefficients: int = 13,
                 prior: LogitMixture | None = None) -> SpectrumSamples:
    """Spectra drawn from the posterior of one signal; see `sampling.draw_methods.draw_spectra`.

    ``coefficients`` is the N of the splines that are fitted to the draws.

    Parameters
    ----------
    measurement : SpectralMeasurement
    draws : int
        T, at least 1.
    seed : int
        Of the random generator; the same seed gives the same draws bit for bit.
    coefficients : int
        N, of the spline class.
    prior : LogitMixture, optional
        By default the shipped one.

    Raises
    ------
    InputError, ConvergenceError
        As `solve_posterior` and `SignalPosterior.draws`.
    """
    return solve_posterior(prior or load_prior(), measurement).samples(draws, seed, coefficients)


def describe_outcome(outcome: Outcome, stated: tuple[str, ...], shares: Mapping[str, float]) -> str:
    """The outcome in words, and the families stated or allowed that it is conditional on.

    Parameters
    ----------
    outcome : Outcome
    stated : names of families
    shares : mapping of float
        Posterior probabilities of the families, by name.
    """
    if outcome is not Outcome.FAMILIAR:
        return outcome.value
    allowed = ", ".join(f"{name} {100 * shares[name]:.0f} %"
                        for name in sorted(shares, key=lambda name: -shares[name])
                        if shares[name] >= MENTIONED)
    if stated:
        given = f"Conditional on the surface being {' or '.join(stated)}, as stated"
        return f"{outcome.value} {given}{f': {allowed}' if len(stated) > 1 else ''}."
    return f"{outcome.value} No family of surfaces was stated; the signal allows {allowed}."
