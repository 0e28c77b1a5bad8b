"""What the learnt prior says of many signals, without draws: from the mixture that draws follow.

Mean, standard deviation and band are those of the distribution that draws follow
(calibrated_marginals.py); draws scatter about them. Correlations between wavelengths, which choose
the next reading, are those of its linearised components. All signals have one response; their
noise may differ.
"""
from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from spectrabox.radiometry.error_model import split_errors
from spectrabox.radiometry.records.spectra import Outcome
from spectrabox.sampling import spectral_measurement, summary
from spectrabox.sampling.prior import calibrated_marginals, mixture_posterior
from spectrabox.sampling.prior.mixture import LogitMixture, reflectance, smoothness_prior

BATCH = 250         # signals: those of one batch are carried with as many components as any needs


@dataclass(frozen=True)
class PriorSummaries:
    """Of T signals. The outcomes are FAMILIAR, UNFAMILIAR, BEYOND_LEARNT, UNSAID where mean and
    signal disagree, or TOO_ROUGH for those that no spectrum of the priors gives, whose numbers are
    then of no use.
    """

    mean: np.ndarray                    # (T, 61)
    standard_deviation: np.ndarray      # (T, 61)
    lower: np.ndarray                   # (T, 61)
    upper: np.ndarray                   # (T, 61)
    next_measurement_nm: np.ndarray     # (T,)
    family_shares: np.ndarray           # (T, F) under the learnt prior
    budget: np.ndarray      # (T, 1 + causes) shares of the mean variance: metamerism, the causes
    outcome: np.ndarray                 # (T,) of Outcome


def summaries(prior: LogitMixture, relative_response: np.ndarray, signals: np.ndarray,
              causes: dict[str, np.ndarray], level: float) -> PriorSummaries:
    """Mean, standard deviation and band of many signals, and the rest that is estimated of one.

    Parameters
    ----------
    prior : LogitMixture
    relative_response : (K, 61) array
        Rows summing to 1.
    signals : (T, K) array
        Relative to white.
    causes : dict of (T, K, K) arrays
        Covariances of the signals' errors by cause; their sum is the noise.
    level : float
        Of the band.

    Raises
    ------
    InputError
        If two bands respond alike.
    """
    spectral_measurement.check_bands(relative_response)
    batches = [slice(start, start + BATCH) for start in range(0, max(len(signals), 1), BATCH)]
    parts = [_batch(prior, relative_response, signals[rows],
                    {name: covariance[rows] for name, covariance in causes.items()}, level)
             for rows in batches]
    return PriorSummaries(*(np.concatenate([getattr(part, field.name) for part in parts])
                            for field in fields(PriorSummaries)))


def _batch(prior: LogitMixture, relative_response: np.ndarray, signals: np.ndarray,
           causes: dict[str, np.ndarray], level: float) -> PriorSummaries:
    errors = split_errors(signals, causes)
    relative = mixture_posterior.multiplying(errors.relative)
    mixture = mixture_posterior.posterior(prior, relative_response, signals, errors.absolute,
                                          relative=relative)
    allowed = mixture_posterior.allowed_misfit(errors.absolute)
    summary = _of_mixture(prior, relative_response, signals, causes, mixture, level)
    summary.outcome[mixture_posterior.novelty(prior, mixture, errors.absolute) >
                    1] = Outcome.UNFAMILIAR
    beyond = mixture.misfit > allowed
    doubtful = mixture_posterior.unsaid(relative_response, summary.mean, signals, errors.absolute,
                                        relative) > 1
    some = np.flatnonzero(beyond | doubtful)
    if not some.size:
        return summary
    summary.outcome[doubtful] = Outcome.UNSAID
    summary.outcome[beyond] = Outcome.BEYOND_LEARNT
    smooth = smoothness_prior()
    wider = mixture_posterior.posterior(smooth, relative_response, signals[some],
                                        errors.absolute[some],
                                        relative=None if relative is None else relative.rows(some))
    wider_summary = _of_mixture(smooth, relative_response, signals[some], {
        name: covariance[some] for name, covariance in causes.items()}, wider, level)
    for name in ("mean", "standard_deviation", "lower", "upper", "next_measurement_nm", "budget"):
        getattr(summary, name)[some] = getattr(wider_summary, name)
    summary.outcome[mixture_posterior.unsaid(relative_response, summary.mean, signals,
                                             errors.absolute, relative) > 1] = Outcome.UNSAID
    summary.outcome[some[wider.misfit > allowed[some]]] = Outcome.TOO_ROUGH
    return summary


def _of_mixture(prior: LogitMixture, relative_response: np.ndarray, signals: np.ndarray,
                causes: dict[str, np.ndarray], mixture: mixture_posterior.MixturePosterior,
                level: float) -> PriorSummaries:
    errors = split_errors(signals, causes)
    relative = mixture_posterior.multiplying(errors.relative)
    drawn, covariance = calibrated_marginals.marginal_moments(prior, relative_response, signals,
                                                              errors.absolute, mixture, relative)
    mean, spread = mixture_posterior.mean_and_spread(drawn)
    lower, upper = mixture_posterior.central_band(drawn, level)
    seen = signals
    if relative is not None and mixture.log_errors is not None:
        likely, rows = np.argmax(mixture.weights, axis=1), np.arange(len(signals))
        seen = reflectance(mixture.logits[likely, rows]) @ relative_response.T
        causes = summary.about_answer(causes, signals, seen, mixture.log_errors[likely, rows])
    grown = summary.grown_by_causes(prior, relative_response, mixture, causes)
    shares = summary.shares_by_cause(summary.error_budgets(prior, relative_response, seen, mixture,
                                                           grown))
    return PriorSummaries(mean, spread, lower, upper,
                          calibrated_marginals.next_readings_nm(covariance, spread),
                          prior.shares(mixture.weights), np.column_stack(list(shares.values())),
                          np.full(len(mean), Outcome.FAMILIAR, dtype=object))
