"""What the learnt prior says of many signals, without draws: from the mixture that draws follow.

Draws of one signal follow its posterior mixture, moved away from its mean by the calibrated factors
(draws.py). Mean, standard deviation and band here are that mixture's own; draws scatter about them.
Correlations between wavelengths, which choose the next reading, are those of the linearised
components. All signals have one response; their noise may differ.
"""
from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields, replace

import numpy as np
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from spectrabox.radiometry.records import Outcome
from spectrabox.sampling.error_budget import error_budgets, shares_by_cause
from spectrabox.sampling.prior.mixture import GRID, LogitMixture, reflectance
from spectrabox.sampling.prior.posterior import (
    LEVEL,
    MISFIT,
    MixturePosterior,
    as_drawn,
    central_band,
    mean_and_spread,
    posterior,
    with_floor,
)
from spectrabox.sampling.prior.smoothness import smoothness_prior
from spectrabox.sampling.summary import READING_ERROR

BATCH = 100         # signals: those of one batch are carried with as many components as any needs


@dataclass(frozen=True)
class PriorSummaries:
    """Of T signals. The outcomes are FAMILIAR, UNFAMILIAR, or TOO_ROUGH for those that no spectrum
    of the priors gives, whose numbers are then of no use.
    """

    mean: np.ndarray                    # (T, 61)
    standard_deviation: np.ndarray      # (T, 61)
    lower: np.ndarray                   # (T, 61)
    upper: np.ndarray                   # (T, 61)
    next_measurement_nm: np.ndarray     # (T,)
    family_shares: np.ndarray           # (T, F) under the learnt prior
    # (T, causes + 2) shares of the mean variance: metamerism, the causes, model floor
    budget: np.ndarray
    outcome: np.ndarray                 # (T,) of Outcome


def summaries(prior: LogitMixture, relative_response: np.ndarray, signals: np.ndarray,
              causes: dict[str, np.ndarray], level: float) -> PriorSummaries:
    """Mean, standard deviation and band of many signals, and what else is said of one.

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
    """
    def part(start: int) -> PriorSummaries:
        rows = slice(start, start + BATCH)
        return _batch(prior, relative_response, signals[rows],
                      {name: covariance[rows] for name, covariance in causes.items()}, level)

    # Every core has a part of its own: threads within its small products would only wait.
    with threadpool_limits(1, "blas"), ThreadPoolExecutor(os.cpu_count()) as pool:
        parts = list(pool.map(part, range(0, len(signals), BATCH)))
    return PriorSummaries(*(np.concatenate([getattr(part, field.name) for part in parts])
                            for field in fields(PriorSummaries)))


def _batch(prior: LogitMixture, relative_response: np.ndarray, signals: np.ndarray,
           causes: dict[str, np.ndarray], level: float) -> PriorSummaries:
    noise = np.sum(list(causes.values()), axis=0)
    mixture = posterior(prior, relative_response, signals, noise)
    variances = np.diagonal(noise, axis1=1, axis2=2)
    allowed = np.maximum(MISFIT, 4 * np.sqrt(variances.max(axis=1)))
    strange = (mixture.surprise > prior.familiar_surprise) | (mixture.misfit > allowed)
    found = _of_mixture(prior, relative_response, noise, mixture, level)
    budgets = error_budgets(prior, relative_response, mixture, causes)
    found = replace(found, budget=np.column_stack(list(shares_by_cause(budgets).values())))
    if not strange.any():
        return found
    smooth = smoothness_prior()
    wider = posterior(smooth, relative_response, signals[strange], noise[strange])
    rest = _of_mixture(smooth, relative_response, noise[strange], wider, level)
    for name in ("mean", "standard_deviation", "lower", "upper", "next_measurement_nm"):
        getattr(found, name)[strange] = getattr(rest, name)
    found.outcome[strange] = Outcome.UNFAMILIAR
    found.outcome[np.flatnonzero(strange)[wider.misfit > allowed[strange]]] = Outcome.TOO_ROUGH
    return found


def _of_mixture(prior: LogitMixture, relative_response: np.ndarray, noise: np.ndarray,
                mixture: MixturePosterior, level: float) -> PriorSummaries:
    drawn = as_drawn(prior, mixture, LEVEL)
    mean, spread = mean_and_spread(drawn)
    lower, upper = central_band(drawn, level)
    correlation = _correlation(prior, relative_response, noise, mixture)
    # As `summary.next_measurement_nm`, all at once.
    covariance = correlation * spread[:, :, None] * spread[:, None, :]
    reduction = np.einsum("p,tpq->tq", GRID.weights_nm, covariance**2) \
        / (spread**2 + READING_ERROR**2)
    return PriorSummaries(mean, spread, lower, upper, GRID.nm[np.argmax(reduction, axis=1)],
                          prior.shares(mixture.weights), np.empty((len(mean), 0)),
                          np.full(len(mean), Outcome.FAMILIAR, dtype=object))


def _correlation(prior: LogitMixture, relative_response: np.ndarray, noise: np.ndarray,
                 mixture: MixturePosterior) -> np.ndarray:
    """Correlation (T, 61, 61) of reflectances between wavelengths, components linearised."""
    p = reflectance(np.asarray(mixture.logits))
    away = p - np.einsum("tc,ctp->tp", mixture.weights, p)
    covariance = np.zeros((len(noise), GRID.nm.size, GRID.nm.size))
    for index, prior_covariance in enumerate(prior.covariances):
        rows = np.flatnonzero(mixture.weights[:, index])
        slope = (p * (1 - p))[index, rows]
        jacobian = relative_response * slope[:, None, :]
        base = jacobian @ prior_covariance
        Q = base @ jacobian.transpose(0, 2, 1) + with_floor(noise[rows])
        left = prior_covariance - base.transpose(0, 2, 1) @ np.linalg.solve(Q, base)
        left *= slope[:, :, None] * slope[:, None, :]
        left += away[index, rows][:, :, None] * away[index, rows][:, None, :]
        covariance[rows] += mixture.weights[rows, index][:, None, None] * left
    deviation = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    return covariance / (deviation[:, :, None] * deviation[:, None, :])
