"""Training of the learnt prior, and its conformal calibration on libraries left out in turn.

Collections are small next to the colours that occur, so the mixture is fitted to them and to eight
times as many spectra made from them: geometric means of two (mixtures of two dyes), powers from 1/2
to 2 (thinner and thicker layers, as in the law of Beer and Lambert), products of two powers (a
layer over another body) and shifts by about 12 nm (related dyes). Every component is widened by a
little of the smoothness prior. Training libraries left out in turn decided how much of each.
"""
from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.sampling.prior.libraries import ReflectanceLibrary, without_near_duplicates
from spectrabox.sampling.prior.mixture import EDGE, GRID, LogitMixture, logit
from spectrabox.sampling.prior.posterior import (
    central_band,
    conformal_scores,
    mean_and_spread,
    posterior,
)
from spectrabox.sampling.prior.smoothness import smooth_covariance

DIRECTIONS, COMPONENTS = 10, 8
# variance added to the components and to every logit: what the sets do not show
RIDGE, FLOOR = 3e-3, 1e-3
SMOOTH = 0.03  # share of the smoothness prior's covariance that is added to every component
MADE = 8                        # spectra made of the measured ones, per measured one
MIN_CURVES = 200
MAX_OF_LIBRARY = 500    # curves, so that no collection outvotes the others
LEVELS = np.array([0.5, 0.8, 0.9, 0.95, 0.99])
SHIFT_NM = 12.5
JUDGED = 400                    # curves of a left-out library that are judged
FAMILIAR = 0.995


@dataclass(frozen=True)
class LeftOut:
    """How bands did on a library that the mixture had not seen, before calibration."""

    name: str
    curves: int
    rmse: float
    scores: np.ndarray          # (levels, curves, 61): factors that the bands would have needed
    width: np.ndarray           # (levels,): mean width of the bands
    surprise: np.ndarray        # (curves,)


def train(libraries: list[ReflectanceLibrary], relative_response: np.ndarray,
          components: int = COMPONENTS, seed: int = 0) -> tuple[LogitMixture, list[LeftOut]]:
    """Fit the prior to all libraries and calibrate it on each of them left out in turn.

    Parameters
    ----------
    libraries : list of ReflectanceLibrary
        At least two, so that one can be left out.
    relative_response : (K, 61) array
        Of the camera that the calibration is made with, rows summing to 1.

    Raises
    ------
    InputError
        For fewer than two libraries, or too few curves.
    """
    if len(libraries) < 2:
        raise InputError("one library cannot be left out of itself; give at least two folders of "
                         "reflectances")
    rng = np.random.default_rng(seed)
    shares = [balanced(without_near_duplicates(library.reflectances), rng) for library in libraries]
    judged = []
    for index, library in enumerate(libraries):
        others = np.concatenate([share for number, share in enumerate(shares) if number != index])
        mixture = fit_mixture(enriched(others, seed), components, seed)
        judged.append(judge(mixture, library.name, relative_response,
                            _some(library.reflectances, JUDGED, rng)))
    source = "; ".join(f"{library.name} ({len(library.reflectances)})" for library in libraries)
    final = fit_mixture(enriched(np.concatenate(shares), seed), components, seed, source)
    return calibrated(final, judged), judged


def balanced(reflectances: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """At most 500 curves of a library; one with fewer than 250 counts up to three times."""
    if len(reflectances) > MAX_OF_LIBRARY:
        return _some(reflectances, MAX_OF_LIBRARY, rng)
    times = min(3, MAX_OF_LIBRARY // 2 // len(reflectances) + 1)
    return np.concatenate([reflectances] * times)


def enriched(reflectances: np.ndarray, seed: int = 0) -> np.ndarray:
    """The curves (n, 61) and eight times as many made of them: mixtures, powers, shifts and layers,
    a quarter each.
    """
    rng = np.random.default_rng(seed)
    share = MADE * len(reflectances) // 4
    positive = np.clip(reflectances, EDGE, 1 - EDGE)

    def some() -> np.ndarray:
        return positive[rng.integers(len(positive), size=share)]

    def power(low: float, high: float) -> np.ndarray:
        return rng.uniform(low, high, (share, 1))

    weight = power(0, 1)
    mixed = some()**weight * some()**(1 - weight)
    layered = some()**power(0.2, 1) * some()**power(0.2, 1)
    shifted = np.array([np.interp(GRID.nm + shift, GRID.nm, curve)
                        for shift, curve in zip(rng.normal(0, SHIFT_NM, share), some(),
                                                strict=True)])
    return np.concatenate([reflectances, mixed, some()**power(0.5, 2), shifted, layered])


def fit_mixture(reflectances: np.ndarray, components: int = COMPONENTS, seed: int = 0,
                source: str = "") -> LogitMixture:
    """The mixture of reflectances, not yet calibrated: all band factors are 1.

    Ten principal directions of the logit with full covariances; the rest is taken for noise.

    Parameters
    ----------
    reflectances : (n, 61) array
    components : int
        C.
    seed : int
        Of the mixture's start.
    source : str
        What the reflectances are, for the record.

    Raises
    ------
    InputError
        For fewer than 200 reflectances, or others than on the grid.
    """
    from sklearn.mixture import GaussianMixture  # takes half a second to import

    if reflectances.ndim != 2 or reflectances.shape[1] != GRID.nm.size:
        raise InputError(f"training reflectances have shape {reflectances.shape}; (n, "
                         f"{GRID.nm.size}) is needed")
    if len(reflectances) < MIN_CURVES:
        raise InputError(f"{len(reflectances)} reflectances are too few to learn from; give at "
                         f"least {MIN_CURVES}")
    x = logit(reflectances)
    centre = x.mean(axis=0)
    directions = np.linalg.svd(x - centre, full_matrices=False)[2][:DIRECTIONS].T
    scores = (x - centre) @ directions
    rest = (np.cov(x - centre - scores @ directions.T, rowvar=False) + FLOOR * np.eye(GRID.nm.size)
            + SMOOTH * smooth_covariance())
    mixture = GaussianMixture(components, reg_covar=RIDGE, random_state=seed,
                              max_iter=300).fit(scores)
    covariances = directions @ mixture.covariances_ @ directions.T + rest
    return LogitMixture(GRID.nm, mixture.weights_ / mixture.weights_.sum(),
                        centre + mixture.means_ @ directions.T,
                        (covariances + covariances.transpose(0, 2, 1)) / 2, LEVELS,
                        np.ones(LEVELS.size), 1.0, np.inf, source)


def judge(prior: LogitMixture, name: str, relative_response: np.ndarray,
          reflectances: np.ndarray) -> LeftOut:
    """Bands of every level for noise-free signals of reflectances (n, 61), against the truth."""
    bands = len(relative_response)
    mixture = posterior(prior, relative_response, reflectances @ relative_response.T,
                        np.zeros((bands, bands)))
    mean, _ = mean_and_spread(mixture)
    intervals = [central_band(mixture, level) for level in LEVELS]
    scores = np.array([conformal_scores(mean, lower, upper, reflectances)
                       for lower, upper in intervals])
    widths = np.array([np.mean(upper - lower) for lower, upper in intervals])
    rmse = float(np.sqrt(np.mean((mean - reflectances)**2, axis=1)).mean())
    return LeftOut(name, len(reflectances), rmse, scores, widths, np.asarray(mixture.surprise))


def calibrated(prior: LogitMixture, judged: list[LeftOut]) -> LogitMixture:
    """The prior with band factors from libraries left out in turn.

    The factor of a level is the least at which no left-out library misses more than 1 - level of
    its wavelengths; the curve factor is the least at which 95 % of all left-out curves lie wholly
    within their band.
    """
    factors = np.max([[np.quantile(scores, level)
                       for scores, level in zip(library.scores, LEVELS, strict=True)]
                      for library in judged], axis=0)
    at_95 = list(LEVELS).index(0.95)
    per_curve = np.concatenate([library.scores[at_95].max(axis=1) for library in judged])
    surprise = np.concatenate([library.surprise for library in judged])
    return replace(prior, band_factors=factors, curve_factor=float(np.quantile(per_curve, 0.95)),
                   familiar_surprise=float(np.quantile(surprise, FAMILIAR)))


def _some(reflectances: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    return reflectances[rng.permutation(len(reflectances))[:count]]
