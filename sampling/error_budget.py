"""Where the variance of a recovered spectrum comes from: metamerism, photo noise, light ...

Linear-Gaussian at the posterior: with gain G = S J' Q^-1, Q = J S J' + R, R = sum of R_i,

    posterior covariance = (I - G J) S (I - G J)' + sum_i G R_i G'   (Joseph's form, exact)

The first term is what would remain with this estimator if every signal were perfect: metamerism.
The others add up to the rest without remainder, one term per cause.
"""
from __future__ import annotations

import numpy as np

from spectrabox.sampling.prior.mixture import LogitMixture, reflectance
from spectrabox.sampling.prior.mixture_posterior import SIGNAL_FLOOR, MixturePosterior

METAMERISM, FLOOR = "metamerism", "model floor"


def error_budgets(prior: LogitMixture, relative_response: np.ndarray, mixture: MixturePosterior,
                  causes: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Variances (T, P) of the reflectances of T signals by cause, at the most probable component of
    each.

    Parameters
    ----------
    prior : LogitMixture
    relative_response : (K, P) array
    mixture : MixturePosterior
        Of the signals, for the noise that is the sum of the causes.
    causes : dict of (T, K, K) arrays
    """
    index = np.argmax(mixture.weights, axis=1)
    row, with_level = np.arange(index.size), prior.level_weight.with_level[index]
    S = prior.covariances[index] + mixture.stretch[row, index, None, None] \
        * with_level[:, :, None] * with_level[:, None, :]
    p = reflectance(mixture.logits[index, row])
    slope = p * (1 - p)
    floor = np.broadcast_to(SIGNAL_FLOOR**2 * np.eye(len(relative_response)),
                            (index.size, *np.eye(len(relative_response)).shape))
    parts = {**causes, FLOOR: floor}
    jacobian = relative_response * slope[:, None, :]
    base = jacobian @ S                                         # (T, K, P)
    of_signal = base @ jacobian.transpose(0, 2, 1)
    gain = np.linalg.solve(of_signal + np.sum(list(parts.values()), axis=0), base)
    # diag((I - G J) S (I - G J)'), multiplied out
    left = np.diagonal(S, axis1=1, axis2=2) - 2 * np.einsum("tkp,tkp->tp", gain, base) \
        + np.einsum("tkp,tkp->tp", gain, of_signal @ gain)
    budgets = {METAMERISM: slope**2 * left}
    return budgets | {name: slope**2 * np.einsum("tkp,tkp->tp", gain, covariance @ gain)
                      for name, covariance in parts.items()}


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
