"""Posteriors of a signal in every state of its capture, and what they say of the state.

In each state what the capture adds to a signal is Gaussian (`CaptureStates`): the signal less its
mean, with its covariance among the noise, has a mixture as posterior. The posterior over all states
is these mixtures, each by its evidence and the state's probability beforehand. Errors that multiply
a signal multiply what a state adds to it as well.

How usual a spectrum the signal would be of is weak evidence on the state, and a wrong one of dark
greys: so much of it is not counted (`USUALNESS`).
"""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import logsumexp, ndtr, softmax

from spectrabox.radiometry.covariance import symmetric_root, with_rank
from spectrabox.radiometry.error_model import Errors, proportional_covariance
from spectrabox.radiometry.records import spectra
from spectrabox.sampling import spectral_measurement, summary
from spectrabox.sampling.prior import mixture_posterior
from spectrabox.sampling.prior.mixture import PRIOR_GRID, LogitMixture, reflectance

# Nats of evidence on the state that are not counted where they come of how usual the spectra are
# that explain the signal. Of three bands, whatever the gloss, it is within .5 for or against 3 % of
# it on nine in ten surfaces, but 2 for it of a matt grey of .05: the libraries hold more neutrals
# about .02 than about .05. A state that spectra hardly explain loses as much as ever, and what
# photos of one surface differ by counts whole.
USUALNESS = 2.0
MAX_REDRAWS = 50        # of a variable that is less than it can be; it then is what it least can be


@dataclass(frozen=True, eq=False)
class StatePosterior:
    """The posterior of one signal (K,) in one state of its capture, by its r different bands."""

    state: int                      # index; 0 where a capture has but one
    share: float                    # posterior probability of the state
    gain: np.ndarray                # (r, K) that estimates the signals of different bands from all
    relative_response: np.ndarray   # (r, P)
    signal: np.ndarray              # (r,) less what the state adds
    noise: np.ndarray               # (r, r) with what the state adds, less what multiplies
    mixture: mixture_posterior.MixturePosterior       # of this one signal
    # of the one signal; None where no error multiplies
    relative: mixture_posterior.RelativeErrors | None = None

    @property
    def answer(self) -> tuple[np.ndarray, np.ndarray]:
        """The reflectance (P,) at the mode of the most probable component, and the logarithm (r,)
        of what multiplies its signal.
        """
        likely = int(np.argmax(self.mixture.weights[0]))
        errors = self.mixture.log_errors
        return (reflectance(self.mixture.logits[likely, 0]),
                np.zeros(self.signal.size) if errors is None else errors[likely, 0])

    @property
    def total_noise(self) -> np.ndarray:
        """Covariance (r, r) of all errors about the signal."""
        return self.noise if self.relative is None else self.noise + proportional_covariance(
            self.signal + self.relative.added, self.relative.covariance[0])


def state_shares(beforehand: np.ndarray, evidence: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Posterior probabilities (H, T) of the states of T signals, and the signals' log evidence
    (T,); a state that says next to nothing has none.

    Parameters
    ----------
    beforehand : (H, T) array, or such that it broadcasts to it
        Log probability of each state, what photos of one surface differ by included.
    evidence : (H, T) array
        Log evidence of the spectra in each state.
    """
    whole = logsumexp(beforehand + evidence, axis=0)
    beyond = evidence - (whole - logsumexp(beforehand, axis=0))
    counted = np.sign(beyond) * np.maximum(np.abs(beyond) - USUALNESS, 0)
    shares = softmax(beforehand + counted, axis=0)
    shares[shares < mixture_posterior.NEGLIGIBLE] = 0
    return shares / shares.sum(axis=0), whole


def solve_in_states(prior: LogitMixture, relative_response: np.ndarray,
                    measurement: spectra.SpectralMeasurement
                    ) -> tuple[tuple[StatePosterior, ...], float, float]:
    """The posterior of one signal in all states that it allows, its log evidence in nats, and its
    novelty: beyond 1 it is unlike what the prior was learnt from in every state.

    Bands that several photos repeat are estimated as one, state by state. What their differences
    say of the state is in its evidence.

    Parameters
    ----------
    prior : LogitMixture
    relative_response : (K, P) array
        Of the measurement, on the prior's wavelengths.
    measurement : SpectralMeasurement
    """
    signal, noise, states = measurement.signal, measurement.noise_covariance, measurement.states
    if states is None:
        errors = Errors.of_total(noise, signal, measurement.relative_covariance)
        relative, noise = mixture_posterior.multiplying(errors.relative[None]), errors.absolute
        mixture = mixture_posterior.posterior(prior, relative_response, signal[None], noise,
                                              relative=relative)
        part = StatePosterior(0, 1.0, np.eye(signal.size), relative_response, signal, noise,
                              mixture, relative)
        return (part, ), float(mixture.log_evidence[0]), float(
            mixture_posterior.novelty(prior, mixture, noise)[0])
    different, repeated = spectral_measurement.different_bands(relative_response)
    response = relative_response[different]
    parts: list[StatePosterior] = []
    beforehand, evidence = np.log(states.weights), np.zeros(len(states.weights))
    for state, (added, covariance) in enumerate(zip(states.added, states.added_covariances,
                                                    strict=True)):
        own = noise + covariance
        gain, of_differences = _different(signal - added, own, repeated)
        whole, own, shares_of = spectral_measurement.reduced_errors(gain, repeated, signal, own,
                                               measurement.relative_covariance)
        errors = Errors.of_total(own, whole, shares_of)
        relative = mixture_posterior.multiplying(errors.relative[None], gain @ added,
                                                 gain @ covariance @ gain.T)
        seen = gain @ (signal - added)
        mixture = mixture_posterior.posterior(prior, response, seen[None], errors.absolute,
                            parts[-1].mixture if parts else None, relative=relative)
        beforehand[state] += of_differences
        evidence[state] = mixture.log_evidence[0]
        parts.append(StatePosterior(state, 0.0, gain, response, seen, errors.absolute, mixture,
                                    relative))
    shares, log_evidence = state_shares(beforehand[:, None], evidence[:, None])
    return (tuple(
        replace(part, share=float(share)) for part, share in zip(parts, shares[:, 0], strict=True)
        if share > 0), float(log_evidence[0]),
            float(
                min(
                    mixture_posterior.novelty(prior, part.mixture, part.noise)[0]
                    for part in parts)))


def _different(signal: np.ndarray, noise: np.ndarray,
               repeated: np.ndarray) -> tuple[np.ndarray, float]:
    """The gain (r, K) that estimates the signals of different bands from all (K,), and the log
    density of what then is left: differences between repeated bands.
    """
    bands, count = repeated.shape
    if bands == count:
        return np.eye(bands), 0.0
    contrasts = np.linalg.svd(repeated.T)[2][count:]            # (K - r, K), of no different bands
    spread, off = contrasts @ with_rank(noise,
                                        spectral_measurement.RANK) @ contrasts.T, contrasts @ signal
    return spectral_measurement.gain_of_different(noise, repeated), float(
        -(off @ np.linalg.solve(spread, off) + np.linalg.slogdet(spread)[1]
          + off.size * np.log(2 * np.pi)) / 2)


def merged(mixtures: Sequence[mixture_posterior.MixturePosterior],
           shares: np.ndarray) -> mixture_posterior.MixturePosterior:
    """One mixture (T signals) of the components of all, each mixture by its shares (H, T).

    Parameters
    ----------
    mixtures : sequence of H MixturePosterior
    shares : (H, T) array
    """
    if len(mixtures) == 1:
        return mixtures[0]
    skews = [mixture.skews for mixture in mixtures if mixture.skews is not None]
    log_errors = [mixture.log_errors for mixture in mixtures if mixture.log_errors is not None]
    return mixture_posterior.MixturePosterior(
        np.hstack([share[:, None] * mixture.weights
                   for share, mixture in zip(shares, mixtures, strict=True)]),
        np.concatenate([mixture.logits for mixture in mixtures]),
        np.concatenate([mixture.variances for mixture in mixtures]),
        np.hstack([mixture.shift for mixture in mixtures]),
        np.hstack([mixture.stretch for mixture in mixtures]),
        np.sum([share * mixture.misfit
                for share, mixture in zip(shares, mixtures, strict=True)], axis=0),
        np.min([mixture.surprise for mixture in mixtures], axis=0),
        np.sum([share * mixture.log_evidence
                for share, mixture in zip(shares, mixtures, strict=True)], axis=0),
        np.sum([share * mixture.growth
                for share, mixture in zip(shares, mixtures, strict=True)], axis=0),
        np.concatenate(skews) if skews else None,
        np.concatenate(log_errors) if log_errors else None)


def grown_over_states(prior: LogitMixture, parts: Sequence[StatePosterior],
                      measurement: spectra.SpectralMeasurement,
                      causes: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """What errors add to the variance (1, P) of the reflectance by cause: within the states, and by
    what differs between them.

    Parameters
    ----------
    prior : LogitMixture
        Whose posterior the parts are.
    parts : sequence of StatePosterior
    measurement : SpectralMeasurement
    causes : mapping to (K, K) arrays
        Covariances of the noise without what the states add, by name.
    """
    grown: dict[str, np.ndarray] = {}
    states = measurement.states
    _, repeated = spectral_measurement.different_bands(measurement.relative_response)
    for part in parts:
        own = dict(causes)
        if part.relative is not None:
            answer, log_errors = part.answer
            given = spectral_measurement.response_on(measurement, PRIOR_GRID) @ answer
            if states is not None:
                given, log_errors = given + states.added[part.state], repeated @ log_errors
            own = {name: covariance[0] for name, covariance in summary.about_answer(
                {name: covariance[None] for name, covariance in causes.items()},
                measurement.signal[None], np.maximum(given, 0)[None], log_errors[None]).items()}
        if states is not None:
            for cause in dict.fromkeys(states.causes):
                pattern = states.of_cause(cause)
                own[cause] = own.get(cause, 0.0) \
                    + pattern @ states.covariances[part.state] @ pattern.T
        own = {name: (part.gain @ covariance @ part.gain.T)[None]
               for name, covariance in own.items()}
        for name, variance in summary.grown_by_causes(prior, part.relative_response, part.mixture,
                                                      own).items():
            grown[name] = grown.get(name, 0.0) + part.share * variance
    if states is None or len(parts) == 1:
        return grown
    share = np.array([part.share for part in parts])
    means = np.array([mixture_posterior.mean_and_spread(part.mixture)[0][0] for part in parts])
    between = share @ (means - share @ means)**2
    added = {cause: states.means[[part.state for part in parts]] @ states.of_cause(cause).T
             for cause in dict.fromkeys(states.causes)}         # (H, K)
    spread = {cause: float((share @ (each - share @ each)**2).sum())
              for cause, each in added.items()}
    total = sum(spread.values())
    for cause, part_of in spread.items():
        if part_of > 0:
            grown[cause] = grown[cause] + between * part_of / total
    return grown


# ---- what a signal says of the variables ---------------------------------------------------------

def estimate_states(prior: LogitMixture, relative_response: np.ndarray,
                    measurement: spectra.SpectralMeasurement, states: spectra.CaptureStates,
                    parts: Sequence[StatePosterior]) -> spectra.StateEstimate:
    """Mean and standard deviation of the variables, and the probability of each kind of state.

    Parameters
    ----------
    prior : LogitMixture
        Whose posterior the parts are.
    relative_response : (K, P) array
        Of the measurement.
    measurement : SpectralMeasurement
    states : CaptureStates
        Of the measurement.
    parts : sequence of StatePosterior
    """
    first, second = np.zeros((2, len(states.names)))
    for part in parts:
        weights = part.mixture.weights[0]
        chosen = np.flatnonzero(weights)
        means, deviation = _given_components(prior, relative_response, measurement, states, part,
                                             chosen)
        own, spread = _not_less(means, deviation, states.least)
        share = part.share * weights[chosen]
        first += share @ own
        second += share @ (own**2 + spread**2)
    shares = dict.fromkeys(states.kinds, 0.0)
    for part in parts:
        shares[states.kinds[part.state]] += part.share
    return spectra.StateEstimate(states.names, first, np.sqrt(np.maximum(second - first**2, 0)),
                                 shares)


def _given_components(prior: LogitMixture, relative_response: np.ndarray,
                      measurement: spectra.SpectralMeasurement, states: spectra.CaptureStates,
                      part: StatePosterior, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard deviation (c, V) of the variables under each chosen component, linearised
    at its mode.
    """
    count, state = chosen.size, part.state
    errors = Errors.of_total(measurement.noise_covariance, measurement.signal,
                             measurement.relative_covariance)
    noise = mixture_posterior.with_floor(errors.absolute + states.added_covariances[state])
    relative = mixture_posterior.multiplying(np.repeat(errors.relative[None], count, axis=0),
                                             states.added[state], states.added_covariances[state])
    log_errors = part.mixture.log_errors
    if log_errors is not None:
        _, repeated = spectral_measurement.different_bands(relative_response)
        log_errors = log_errors[chosen, 0] @ repeated.T
    pairs = mixture_posterior.Pairs((slice(None), 0), chosen, relative_response,
                  np.repeat((measurement.signal - states.added[state])[None], count, axis=0),
                  np.repeat(noise[None], count, axis=0), part.mixture.logits[chosen, 0], relative,
                  log_errors)
    here = mixture_posterior.linearised(prior, pairs, np.arange(count))
    added = states.pattern @ states.covariances[state]          # (K, V) with the signal
    gain = np.linalg.solve(here.Q, np.broadcast_to(added, (count, *added.shape)))
    means = states.means[state] + np.einsum("ckv,ck->cv", gain, here.residual)
    variance = np.diag(states.covariances[state]) - np.einsum("ckv,kv->cv", gain, added)
    return means, np.sqrt(np.maximum(variance, 0))


def _not_less(mean: np.ndarray, deviation: np.ndarray,
              least: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard deviation of normal variables that are known not to be less than that."""
    certain = deviation < 1e-12
    scale = np.where(certain, 1.0, deviation)
    below = np.where(np.isinf(least), -40.0, np.clip((least - mean) / scale, -40, 8))
    ratio = np.exp(-below**2 / 2) / np.sqrt(2 * np.pi) / ndtr(-below)
    moved = mean + scale * ratio
    spread = scale * np.sqrt(np.maximum(1 + below * ratio - ratio**2, 0))
    return (np.where(certain, np.maximum(mean, least), np.maximum(moved, least)),
            np.where(certain, 0.0, spread))


def draw_variables(measurement: spectra.SpectralMeasurement, state: int, given: np.ndarray,
                   rng: np.random.Generator) -> np.ndarray:
    """Variables (T, V) that go with spectra drawn in one state, none less than it can be.

    Parameters
    ----------
    measurement : SpectralMeasurement
        Whose capture has states.
    state : int
    given : (T, K) array
        Signals of the spectra. What multiplies them does so as it does their mean.
    rng : numpy Generator
    """
    states, left, noise = measurement.states, measurement.signal - given, \
        measurement.noise_covariance
    assert states is not None
    if measurement.relative_covariance is not None:
        errors = Errors.of_total(noise, measurement.signal, measurement.relative_covariance)
        noise = errors.absolute + proportional_covariance(
            given.mean(axis=0) + states.added[state], errors.relative)
    covariance = states.covariances[state]
    gain = covariance @ states.pattern.T @ np.linalg.pinv(
        noise + states.added_covariances[state], rcond=spectral_measurement.RANK, hermitian=True)
    means = states.means[state] + (left - states.added[state]) @ gain.T
    root = symmetric_root(covariance - gain @ states.pattern @ covariance)
    variables = means + rng.standard_normal(means.shape) @ root
    for _ in range(MAX_REDRAWS):
        less = np.flatnonzero((variables < states.least).any(axis=1))
        if not less.size:
            break
        variables[less] = means[less] + rng.standard_normal((less.size, means.shape[1])) @ root
    return np.maximum(variables, states.least)
