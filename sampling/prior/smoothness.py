"""What is believed of a reflectance that is like none measured so far: that its logit is smooth,
and no more.

A Gaussian process: a level for the whole curve and two squared-exponential terms. Its constants
maximise the marginal likelihood of the training libraries of the learnt prior, then all standard
deviations are enlarged by 1.5, for it is called where those libraries do not reach.
"""
from __future__ import annotations

import numpy as np

from spectrabox.sampling.prior.mixture import PRIOR_GRID, LogitMixture

MEAN = -1.14
LEVEL, BROAD, NARROW = 0.97, 1.04, 0.23     # standard deviations of the logit
BROAD_NM, NARROW_NM = 81.0, 28.0
ENLARGED = 1.5
INDEPENDENT = 4e-3                          # variance


def smoothness_prior() -> LogitMixture:
    """The prior with one component; its bands carry no conformal calibration (all factors 1)."""
    covariance = ENLARGED**2 * smooth_covariance() + INDEPENDENT * np.eye(PRIOR_GRID.nm.size)
    ones = np.ones((1, 2, PRIOR_GRID.nm.size))
    return LogitMixture(PRIOR_GRID.nm, np.ones(1), np.full((1, PRIOR_GRID.nm.size), MEAN),
                        covariance[None],
                        ("smooth",), np.zeros(1), np.array([0.5, 0.99]), ones, ones, 1.0, np.inf,
                        0.0, "smoothness alone")


def smooth_covariance() -> np.ndarray:
    """Covariance (61, 61) of the logit of measured reflectances that are taken for smooth alone."""
    distance = PRIOR_GRID.nm[:, None] - PRIOR_GRID.nm
    return np.asarray(LEVEL**2 + BROAD**2 * np.exp(-0.5 * (distance / BROAD_NM)**2)
                      + NARROW**2 * np.exp(-0.5 * (distance / NARROW_NM)**2))
