"""The level of a surface as a variable of its own, uniform in reflectance.

How light a surface is, is not what a library of spectra tells: it holds few whites and blacks
because nobody measured more of them. Its shapes are what is learnt from it. So where no family is
stated the families' mixture is multiplied by a function w of the level l, the mean logit over
wavelength, which makes the level of a surface of any family uniform in reflectance. Shapes and
families given a level stay as they were. A family that is stated keeps its own level: whoever says
"skin" says how light it is.

w is that density of the level over the families' own. Errors of a signal's level are normal in
reflectance, not in the logit, so the mode is sought in reflectance: the first density enters the
evidence alone, and only the second moves the mode. Errors that are shares are normal in the
logarithm of the reflectance T of the level: of the uniform density, T (1 - T) for a logit, they
leave 1 - T to move the mode, by as much of the signal's variance as is theirs.

About a level l0 a component of mean mu and covariance S, its level of mean m and variance s, stays
normal. With b and c the first and second derivatives of the logarithm of what moves the mode,

    1 / s' = 1 / s - c,     m' = s' (m / s + b - c l0),

its mean becomes mu + shift S u and its covariance S + stretch S u u' S, u the mean over wavelength,
shift = (m' - m) / s and stretch = (s' - s) / s^2. A signal tells the level well, so it is enough
that w is so approximated where the mode lies.
"""
from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.special import logsumexp

if TYPE_CHECKING:
    from spectrabox.sampling.prior.mixture import LogitMixture

GRID = np.linspace(-8, 8, 801)      # mean logits
# reflectances of 0.004 and 0.996: levels beyond grow rare as in the tail of a normal logit
OUTERMOST = 5.5
SMOOTHED = 0.4                      # logits: w tells no finer how frequent a level is
# of the variance of a component's level, at most this share of what would make it endless
MOST_OF_CURVATURE = 0.9


def level_weight(prior: LogitMixture) -> np.ndarray:
    """log w (3, 801) on GRID of the w that makes the level of a mixture uniform in reflectance, and
    the first two derivatives of what moves the mode.

    Parameters
    ----------
    prior : LogitMixture
    """
    weights, mean, variance = prior.weights, prior.level_mean, prior.level_variance
    wide = variance + SMOOTHED**2
    away = (GRID[:, None] - mean) / wide
    terms = np.log(weights / np.sqrt(wide)) - away**2 * wide / 2
    known = logsumexp(terms, axis=1)
    share = np.exp(terms - known[:, None])
    slope = -(share * away).sum(axis=1)
    bend = (share * (away**2 - 1 / wide)).sum(axis=1) - slope**2
    beyond = GRID - np.clip(GRID, -OUTERMOST, OUTERMOST)
    # log density of the logit of a reflectance that is uniform between 0 and 1
    uniform = -np.log(4) - 2 * np.log(np.cosh(GRID / 2)) - beyond**2 / 2
    log_weight = uniform - known
    # the product is a density again: evidence is compared with that of other priors
    density = np.exp(log_weight - (GRID - mean[:, None])**2 / variance[:, None] / 2) \
        * (weights / np.sqrt(2 * np.pi * variance))[:, None]
    log_weight -= np.log(density.sum() * (GRID[1] - GRID[0]) / weights.sum())
    return np.array([log_weight, -slope - beyond, -bend - (beyond != 0)])


def tilt(prior: LogitMixture, component: np.ndarray | int, level: np.ndarray,
         share: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What w makes of components about levels (n,): the shift (n,) of the mean, by S u, the stretch
    (n,) of the covariance, by S u u' S, and the log weight (n,).

    Parameters
    ----------
    prior : LogitMixture
    component : (n,) int array, or int
    level : (n,) array
        Mean logits.
    share : (n,) array, optional
        Of errors in proportion to the signal, in the variance of its level; none by default.
    """
    at = np.clip(level, GRID[0], GRID[-1])
    place = (at - GRID[0]) / (GRID[1] - GRID[0])
    below = np.minimum(place.astype(int), GRID.size - 2)
    part, near = place - below, prior.level_weight.take([below, below + 1], axis=1)
    log_weight, slope, bend = (1 - part) * near[:, 0] + part * near[:, 1]
    if share is not None:
        T = 1 / (1 + np.exp(-at))
        slope, bend = slope + share * (1 - T), bend - share * T * (1 - T)
    m, s = prior.level_mean[component], prior.level_variance[component]
    bend = np.minimum(bend, MOST_OF_CURVATURE / s)
    variance = s / (1 - bend * s)
    mean = variance * (m / s + slope - bend * at)
    return ((mean - m) / s, (variance - s) / s**2,
            log_weight - slope * at + bend * at**2 / 2 + np.log(variance / s) / 2
            + mean**2 / variance / 2 - m**2 / s / 2)


def with_stretch(products: np.ndarray, rows: np.ndarray, with_level: np.ndarray,
                 stretch: np.ndarray) -> np.ndarray:
    """Products (n, K, P) of rows (n, K, P) and covariances S, with stretch S u u' S added to S.

    Parameters
    ----------
    products : (n, K, P) array
        Rows and S.
    rows : (n, K, P) array
    with_level : (P,) or (n, P) array
        S u.
    stretch : (n,) array
    """
    of_level = (rows @ with_level[..., None])[..., 0] * stretch[:, None]        # (n, K)
    return np.asarray(products + of_level[..., None] * with_level[..., None, :])


def levels_of(prior: LogitMixture) -> np.ndarray:
    """Probabilities (C, 801) of each component and level of GRID, which sum to 1.

    Parameters
    ----------
    prior : LogitMixture
    """
    away = (GRID - prior.level_mean[:, None])**2 / prior.level_variance[:, None]
    density = np.exp(prior.level_weight[0] - away / 2) \
        * (prior.weights / np.sqrt(prior.level_variance))[:, None]
    return np.asarray(density / density.sum())


def moved_to_level(prior: LogitMixture, component: int, logits: np.ndarray,
                   level: np.ndarray) -> np.ndarray:
    """Draws (n, P) of a component as they are at levels (n,).

    Parameters
    ----------
    prior : LogitMixture
    component : int
    logits : (n, P) array
    level : (n,) array
    """
    by_level = prior.with_level[component] / prior.level_variance[component]
    return logits + (level - logits.mean(axis=1))[:, None] * by_level
