"""Whether draws may be trusted: R-hat, effective sample size and the worst coordinate."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spectrabox.radiometry.errors import ConvergenceError

RHAT_LIMIT, SHARE_LIMIT = 1.01, 0.5
# Parts of the chains for the split R-hat (Gelman and Rubin 1992, with halves in time replaced by
# groups of chains, as every chain gives one draw).
GROUPS = 8


@dataclass(frozen=True)
class Diagnosis:
    """The worst coordinate decides: its index, its R-hat, its effective sample size."""

    r_hat: float
    effective_samples: float
    worst_coordinate: int


def diagnose(starts: np.ndarray, ends: np.ndarray) -> Diagnosis:
    """Diagnosis of many short chains from where they started and ended.

    Parameters
    ----------
    starts : (n0, P) array
        Where chains start: the first with the first, and after the last with the first again.
    ends : (T, P) array
        Chains with the same start are correlated through it: with n0 different starts that each
        serve T / n0 chains and a correlation rho of start and end, the variance of the mean is that
        of T / (1 + rho^2 (T / n0 - 1)) independent draws.
    """
    count, different = len(ends), len(np.unique(starts, axis=0))
    starts = starts[np.arange(count) % len(starts)]
    spread = starts.std(axis=0) * ends.std(axis=0)
    covariance = np.mean((starts - starts.mean(axis=0)) * (ends - ends.mean(axis=0)), axis=0)
    rho = np.divide(covariance, spread, out=np.zeros_like(spread), where=spread > 1e-12)
    effective = count / (1 + rho**2 * max(count / different - 1, 0))
    parts = ends[:count - count % GROUPS].reshape(GROUPS, -1, ends.shape[1])
    within = parts.var(axis=1, ddof=1).mean(axis=0)
    between = parts.mean(axis=1).var(axis=0, ddof=1)
    size = parts.shape[1]
    # A coordinate that the signal pins down does not vary: nothing there can fail to mix.
    r_hat = np.where(within > 1e-16,
                     np.sqrt((size - 1) / size + between / np.maximum(within, 1e-300)), 1.0)
    worst = int(np.argmin(effective))
    return Diagnosis(float(r_hat.max()), float(effective[worst]), worst)


def refuse_poor(diagnosis: Diagnosis, draws: int) -> None:
    """Raise if draws are too correlated to be trusted.

    Parameters
    ----------
    diagnosis : Diagnosis
    draws : int
        T, how many it is of.

    Raises
    ------
    ConvergenceError
        With the worst coordinate.
    """
    if diagnosis.r_hat > RHAT_LIMIT or diagnosis.effective_samples < SHARE_LIMIT * draws:
        raise ConvergenceError(
            f"the draws have not mixed: R-hat {diagnosis.r_hat:.4f}, "
            f"{diagnosis.effective_samples:.0f} effective of {draws} at coordinate "
            f"{diagnosis.worst_coordinate}; ask for more steps, or for fewer than 20000 draws, "
            "which are drawn independently")


def tail_shape(weights: np.ndarray) -> float:
    """Shape k of the generalised Pareto tail of importance weights (n,): below 0.7 their averages
    can be trusted.

    The largest min(n / 5, 3 sqrt n) weights are fitted by the estimator of Zhang and Stephens
    (2009), with the prior of Vehtari et al. (2024, Pareto smoothed importance sampling).

    Parameters
    ----------
    weights : (n,) array
        Not negative.
    """
    count = int(min(len(weights) / 5, 3 * np.sqrt(len(weights))))
    ordered = np.sort(weights)
    x = ordered[-count:] - ordered[-count - 1]
    if count < 5 or x[-1] <= 1e-12 * ordered[-1]:
        return 0.0  # all alike
    candidates = 30 + int(np.sqrt(count))
    quartile = x[int(count / 4 + 0.5) - 1] or x[-1] / count
    spacing = 1 - np.sqrt(candidates / (np.arange(1, candidates + 1) - 0.5))
    theta = 1 / x[-1] + spacing / (3 * quartile)
    shape = np.log1p(-theta[:, None] * x).mean(axis=1)
    likelihood = count * (np.log(-theta / shape) - shape - 1)
    belief = np.exp(likelihood - likelihood.max())
    best = float(np.sum(theta * belief) / belief.sum())
    fitted = float(np.log1p(-best * x).mean())
    return (count * fitted + 5) / (count + 10)
