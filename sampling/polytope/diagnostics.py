"""Whether averages with importance weights may be trusted."""
from __future__ import annotations

import numpy as np


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
