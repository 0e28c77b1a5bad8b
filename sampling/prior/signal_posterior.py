"""The posterior of one signal under the learnt prior, solved once: everything that is asked of it.

A signal unlike all that the learnt prior was learnt from keeps it, with a band that grows with how
unlikely the signal is (`mixture_posterior.tail_growth`). One that it cannot reach is given to the
smoothness prior. The outcome says either. Mean, standard deviation and band are those of the
distribution that draws follow (`calibrated_marginals`), so that they need no draws. All are over
the states in which the capture may have been (`state_posteriors`).
"""
from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from spectrabox.radiometry import covariance, errors, grid
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.records import spectra as spectral_records
from spectrabox.sampling import spectral_measurement, summary
from spectrabox.sampling.polytope.tilt import is_reachable
from spectrabox.sampling.prior import (
    calibrated_marginals,
    mixture_posterior,
    posterior_draws,
    state_posteriors,
)
from spectrabox.sampling.prior.mixture import PRIOR_GRID, LogitMixture, load_prior, smoothness_prior

MENTIONED = 0.005               # share of a family that the outcome names
# Of white. A signal that near to that of a perfect white or black, a band of which is there to
# round-off or beyond, is taken for so much less bright, or less dark: below any camera's step.
EDGE, EXACT, INSIDE = 1e-3, 1e-6, 1e-4
SPARE = 5       # spline coefficients beyond the bands of a signal that has many
# the others are the smoothness prior's
OF_LEARNT = (spectral_records.Outcome.FAMILIAR, spectral_records.Outcome.UNFAMILIAR)
# draws come near to the signal only
APPROXIMATE = (spectral_records.Outcome.TOO_ROUGH, spectral_records.Outcome.OUT_OF_REACH)
UNREACHED = "distance to what can be reached"   # cause of error of a signal that nothing gives


@dataclass(frozen=True, eq=False)
class SignalPosterior:
    """Posterior of the reflectance (61,) behind one signal, at 400, 405 ... 700 nm.

    Attributes
    ----------
    measurement : SpectralMeasurement
        The signal (K,) with its noise covariance, and the states of its capture.
    relative_response : (K, 61) array
        Of the measurement, on the prior's wavelengths.
    learnt_prior : LogitMixture
        The prior that was asked for: of all families, or of those stated.
    learnt : tuple of StatePosterior
        Of this one signal under it, in every state that the signal allows. Families and evidence
        come from it.
    log_evidence : float
        Log density of the signal under the learnt prior, in nats.
    prior, parts : LogitMixture, tuple of StatePosterior
        Which mean, band, draws and shares of variance come from: the same, or the smoothness
        prior's.
    outcome : Outcome
        FAMILIAR, UNFAMILIAR; BEYOND_LEARNT, and UNSAID where what was found does not give the
        signal within its stated errors (smoothness prior); or TOO_ROUGH and OUT_OF_REACH, whose
        draws, of the smoothness prior as well, do not reproduce the signal: its errors must be as
        large as it is far from what can be reached.
    unreached : (K, K) array or None
        Of TOO_ROUGH and OUT_OF_REACH the covariance of that error, which the noise covariance of
        ``measurement`` holds.
    nearest : (K,) array or None
        Of these the nearest signal that smooth spectra, or any between 0 and 1, give.
    """

    measurement: spectral_records.SpectralMeasurement
    relative_response: np.ndarray
    learnt_prior: LogitMixture
    learnt: tuple[state_posteriors.StatePosterior, ...]
    log_evidence: float
    prior: LogitMixture
    parts: tuple[state_posteriors.StatePosterior, ...]
    outcome: spectral_records.Outcome
    unreached: np.ndarray | None = None
    nearest: np.ndarray | None = None

    @property
    def method(self) -> str:
        """Name of the prior that draws come from."""
        return prior_named(self.outcome)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """The outcome, and what it is conditional on."""
        if self.nearest is not None:
            return (self.outcome.finding(
                nearest=self.nearest.tolist(),
                distance=float(np.abs(self.nearest - self.measurement.signal).max())),)
        return outcome_findings(self.outcome, self.learnt_prior.stated, self.family_shares)

    @property
    def family_shares(self) -> dict[str, float]:
        """Posterior probability of each family of surfaces, by name; they sum to 1."""
        shares = sum(part.share * self.learnt_prior.shares(part.mixture.weights)[0]
                     for part in self.learnt)
        return dict(zip(self.learnt_prior.families, np.asarray(shares).tolist(), strict=True))

    @property
    def states(self) -> spectral_records.StateEstimate | None:
        """What the signal says of the states of its capture, such as the surface's gloss; None
        where the capture has but one.
        """
        if self.measurement.states is None:
            return None
        return state_posteriors.estimate_states(self.prior, self.relative_response,
                                                self.measurement, self.measurement.states,
                                                self.parts)

    @cached_property
    def _moments(self) -> list[tuple[mixture_posterior.MixturePosterior, np.ndarray]]:
        """Of each part the mixture that draws follow, and their covariance (1, 61, 21)."""
        return [
            calibrated_marginals.marginal_moments(self.prior, part.relative_response,
                                                  part.signal[None], part.noise[None], part.mixture,
                                                  part.relative) for part in self.parts
        ]

    @cached_property
    def _marginals(self) -> mixture_posterior.MixturePosterior:
        return state_posteriors.merged([mixture for mixture, _ in self._moments],
                      np.array([[part.share] for part in self.parts]))

    @cached_property
    def _mean_and_deviation(self) -> tuple[np.ndarray, np.ndarray]:
        return mixture_posterior.mean_and_spread(self._marginals)

    @property
    def mean(self) -> np.ndarray:
        """Mean reflectance (61,)."""
        return np.asarray(self._mean_and_deviation[0][0])

    def says(self, mean: np.ndarray) -> bool:
        """Whether a mean reflectance (61,) gives the signal within the stated errors, in some
        state.
        """
        return any(mixture_posterior.unsaid(part.relative_response, mean[None], part.signal[None],
                          part.noise[None], part.relative)[0] <= 1 for part in self.parts)

    @property
    def standard_deviation(self) -> np.ndarray:
        """Standard deviation (61,) of the reflectance."""
        return np.asarray(self._mean_and_deviation[1][0])

    @property
    def covariance(self) -> np.ndarray:
        """Covariance (61, 61) of the reflectance, linearised within each part."""
        total = np.zeros(self._moments[0][1].shape[1:])
        for part, (mixture, within) in zip(self.parts, self._moments, strict=True):
            off = mixture_posterior.mean_and_spread(mixture)[0][0] - self.mean
            total += part.share * (within[0] + np.outer(off, off[calibrated_marginals.COARSE]))
        return covariance.symmetric(total @ calibrated_marginals.BETWEEN.T)

    def band(self, level: float) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper reflectance (61,) of the calibrated central band of a level, 0 to 1."""
        lower, upper = mixture_posterior.central_band(self._marginals, level)
        return lower[0], upper[0]

    def variances_by_cause(self, causes: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Variance (1, 61) of the reflectance by cause.

        Parameters
        ----------
        causes : mapping to (K, K) arrays
            Covariances, whose sum is the noise covariance of the measurement that was given, by
            name; what the states of the capture add comes besides, and ``unreached``.

        Returns
        -------
        dict
            Metamerism, the causes, and those of the capture's states.

        Raises
        ------
        InputError
            If the covariances do not add up.
        """
        noise = self.measurement.noise_covariance
        if self.unreached is not None:
            causes = {**causes, UNREACHED: self.unreached}
        total = sum(causes.values(), np.zeros_like(noise))
        if np.abs(total - noise).max() > 1e-9 + 1e-6 * np.abs(total).max():
            raise errors.InputError(
                "the covariances by cause do not add up to the noise covariance of "
                "the measurement")
        mixture = state_posteriors.merged([part.mixture for part in self.parts],
                         np.array([[part.share] for part in self.parts]))
        likely = max(self.parts, key=lambda part: part.share)
        seen = likely.signal if likely.relative is None \
            else likely.relative_response @ likely.answer[0]
        return summary.error_budgets(
            self.prior, likely.relative_response, seen[None], mixture,
            state_posteriors.grown_over_states(self.prior, self.parts, self.measurement, causes))

    def variance_shares(self, causes: Mapping[str, np.ndarray]) -> dict[str, float]:
        """Share of each cause in the mean variance over wavelength; they sum to 1.

        ``causes`` are those of `variances_by_cause`.
        """
        shares = summary.shares_by_cause(self.variances_by_cause(causes))
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
        return self.draws_with_variables(count, seed)[0]

    def draws_with_variables(self, count: int, seed: int) -> tuple[np.ndarray, np.ndarray | None]:
        """The draws (T, 61), and of the capture's states the variables (T, V), such as the gloss,
        that each goes with; None where the capture has but one state.

        Raises
        ------
        InputError, ConvergenceError
            As `draws`.
        """
        spectral_measurement.check_draw_count(count)
        spectral_measurement.check_seed(seed)
        if self.measurement.states is None:
            return self._draws_in(self.parts[0], count, seed), None
        own, *seeds = np.random.SeedSequence(seed).generate_state(1 + len(self.parts)).tolist()
        rng = np.random.default_rng(own)
        counts = rng.multinomial(count, [part.share for part in self.parts])
        spectra, variables = [], []
        for part, some, part_seed in zip(self.parts, counts.tolist(), seeds, strict=True):
            if some:
                spectra.append(self._draws_in(part, some, part_seed))
                variables.append(state_posteriors.draw_variables(self.measurement, part.state,
                                                spectra[-1] @ self.relative_response.T, rng))
        order = rng.permutation(count)      # else state after state
        return np.concatenate(spectra)[order], np.concatenate(variables)[order]

    def _draws_in(self, part: state_posteriors.StatePosterior, count: int, seed: int) -> np.ndarray:
        return posterior_draws.draw_reflectances(self.prior, part.mixture, part.relative_response,
                                 _inside(part.signal, part.total_noise), part.noise, count, seed,
                                 approximate=self.outcome in APPROXIMATE, relative=part.relative)

    def samples(self, count: int, seed: int, coefficients: int) -> spectral_records.SpectrumSamples:
        """The draws as a record, with the splines of N = ``coefficients`` nearest to each; of more
        where the signal has more bands than that, for which no such spline might be found.

        Raises
        ------
        InputError, ConvergenceError
            As `draws`.
        """
        spectra, variables = self.draws_with_variables(count, seed)
        splines = spectral_measurement.nearest_splines(spectra, grid.basis_matrix(
            PRIOR_GRID.nm, enough_coefficients(coefficients, self.measurement.signal.size)))
        return spectral_records.SpectrumSamples(PRIOR_GRID, spectra, splines, self.method,
                                                float(count), seed, self.outcome, self.findings,
                                                variables)


def _inside(signal: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """The signal (K,), or the nearest that draws reach where it is, without noise, that of a
    perfect white or black: a single reflectance gives it wherever the bands see, and no draw is it.
    """
    if noise.any():
        return signal
    if signal.max() >= 1 - EXACT and np.all(np.abs(signal - 1) < EDGE):
        return np.minimum(signal, 1 - INSIDE)
    if signal.min() <= EXACT and np.all(np.abs(signal) < EDGE):
        return np.maximum(signal, INSIDE)
    return signal


def enough_coefficients(coefficients: int, bands: int) -> int:
    """Number of spline coefficients that some spectrum can be made of for any signal of so many
    bands: as many as asked for, or more than the bands where those are fewer.

    Parameters
    ----------
    coefficients : int
        N, asked for.
    bands : int
        K.
    """
    return coefficients if coefficients >= bands else bands + SPARE


def solve_posterior(prior: LogitMixture,
                    measurement: spectral_records.SpectralMeasurement) -> SignalPosterior:
    """Solve the posterior of one signal, under the smoothness prior where the learnt one does not
    reach it.

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
        For numbers that are not finite, a covariance that is none, or bands that respond alike;
        with states of the capture, photos may repeat bands.
    """
    spectral_measurement.check_measurement(measurement)
    response = spectral_measurement.response_on(measurement, PRIOR_GRID)
    learnt, evidence, novelty = state_posteriors.solve_in_states(prior, response, measurement)
    reached = novelty <= 1 or _reached(learnt)
    posterior = SignalPosterior(measurement, response, prior, learnt, evidence, prior, learnt,
                                spectral_records.Outcome.FAMILIAR if novelty <= 1
                                else spectral_records.Outcome.UNFAMILIAR)
    if reached and posterior.says(posterior.mean):
        return posterior
    smooth = smoothness_prior()
    wider, _, _ = state_posteriors.solve_in_states(smooth, response, measurement)
    widened = replace(posterior, prior=smooth, parts=wider)
    outcome = spectral_records.Outcome.UNSAID if reached or not widened.says(widened.mean) \
        else spectral_records.Outcome.BEYOND_LEARNT
    if not _reached(wider):
        return _given_distance(widened)
    return replace(widened, outcome=outcome)


def _given_distance(found: SignalPosterior) -> SignalPosterior:
    """The posterior of a signal that no spectrum of the smoothness prior gives, solved again with
    an error as large as the signal is far from what these spectra give.

    The signal alone says that it errs by that much in some band or other; nothing says in which.
    """
    part = max(found.parts, key=lambda each: each.share)
    response, signal = part.relative_response, part.signal
    reachable = is_reachable(spectral_measurement.MeasurementOperator(response, signal,
                                                                      part.total_noise))
    smooth = response @ part.answer[0]
    nearest = smooth if reachable else response @ spectral_measurement.nearest_coefficients(
        response, signal)
    distance = max(float(np.abs(each - signal).max()) for each in (smooth, nearest))
    # bands that several photos repeat err alike
    _, repeated = spectral_measurement.different_bands(found.relative_response)
    unreached = distance**2 * (repeated @ repeated.T)
    measured = replace(found.measurement, noise_covariance=found.measurement.noise_covariance
                       + unreached)
    parts, _, _ = state_posteriors.solve_in_states(found.prior, found.relative_response, measured)
    return replace(found, measurement=measured, parts=parts, unreached=unreached,
                   nearest=found.measurement.signal + (nearest - signal) @ repeated.T,
                   outcome=spectral_records.Outcome.TOO_ROUGH if reachable
                   else spectral_records.Outcome.OUT_OF_REACH)


def _reached(parts: tuple[state_posteriors.StatePosterior, ...]) -> bool:
    """Whether spectra of a prior give the signal in some state."""
    return any(part.mixture.misfit[0] <= mixture_posterior.allowed_misfit(part.noise)
               for part in parts)


def prior_named(outcome: spectral_records.Outcome) -> str:
    """Name of the prior that draws with this outcome come from.

    Parameters
    ----------
    outcome : Outcome
        Of a `SignalPosterior`.
    """
    return "learnt prior" if outcome in OF_LEARNT else "smoothness prior"


def sample_prior(measurement: spectral_records.SpectralMeasurement, draws: int, seed: int,
                 coefficients: int = 13,
                 prior: LogitMixture | None = None) -> spectral_records.SpectrumSamples:
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


def outcome_findings(outcome: spectral_records.Outcome, stated: tuple[str, ...],
                     shares: Mapping[str, float]) -> tuple[Finding, ...]:
    """The outcome, and the families stated or allowed that it is conditional on.

    Parameters
    ----------
    outcome : Outcome
    stated : names of families
    shares : mapping of float
        Posterior probabilities of the families, by name.
    """
    if outcome not in OF_LEARNT:
        return (outcome.finding(),)
    allowed = {name: shares[name] for name in sorted(shares, key=lambda name: -shares[name])
               if shares[name] >= MENTIONED}
    return (outcome.finding(), Finding("draws.of-families", Severity.INFO, values={
        "stated": list(stated), "shares": allowed}))
