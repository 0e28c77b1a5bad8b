"""Spectra behind very many signals of many bands, by the posteriors of some of them.

The posterior is computed at centres among the signals. Around a centre the mean of every component
that it allows is linear in the change d of the signal, and its evidence Gaussian. With S, J, R and
Q of mixture_posterior.py, r the residual at the mode and p' the mean slope of the reflectance,

    mean(d) = mean + p' S J' (J S J' + R)^-1 d,     log weight(d) ~ -(r + d)' Q^-1 (r + d) / 2.

Where errors multiply (mixture_posterior.py), d is that of the signal over what they multiply it by.
A signal is answered by its nearest centre: the components are weighed anew, their means moved.
Near are signals with nearly the same logits, as a linear estimate of the spectrum has them: their
bend is what the first order leaves out. Half of the centres are as far from each other as can be,
so that rare colours have their own; the others are as frequent as the signals.
"""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import qr

from spectrabox.radiometry.error_model import Errors
from spectrabox.sampling.prior import (
    calibrated_marginals,
    mixture_posterior,
    quantiles,
    uplift_table,
)
from spectrabox.sampling.prior.level import with_stretch
from spectrabox.sampling.prior.mixture import LogitMixture, logit, reflectance, reflectance_moments

MAX_CENTRES = 1500          # at 2 to 3 ms each
NEAR = 0.5                  # logits over all wavelengths: with every signal so near, it is enough
CHOSEN_AMONG = 16_384       # signals
FEATURES = 8                # F: further ones hold noise alone
OF_LEVEL = 2.0              # logits between the smallest and the largest errors of a picture
GREY = 0.3                  # signal whose errors are typical
COMPARED_AT_ONCE = 2048     # signals with all centres: stays in the cache
TINY = 1e-12                # keeps a signal without errors solvable

ErrorsOf = Callable[[np.ndarray], list[Errors]]     # of signals (n, K): one or two of them


@dataclass(frozen=True, eq=False)
class LocalPosteriors:
    """Posteriors at M centres, n pairs of a centre and a component that it allows; arrays of single
    precision.
    """

    first: np.ndarray           # (M + 1,) of each centre's pairs, the others' end
    gain: np.ndarray            # (r, K) to signals of r bands
    estimate: np.ndarray        # (W, 1 + r) linear estimate of the reflectance from these
    axes: np.ndarray            # (W, F) features of its logits
    features: np.ndarray        # (M, F + 1) of the centres, the level of errors last
    centres: np.ndarray         # (M, r) signals
    log_weight: np.ndarray      # (n,) without the exponent of the evidence
    root: np.ndarray            # (n, r, r) L, with L L' = Q^-1
    residual: np.ndarray        # (n, r) L' r
    mean: np.ndarray            # (n, 1 + r, P) and its change by each band
    variance: np.ndarray        # (n, Q)
    apart: np.ndarray           # (n, Q) from the centre's mean to the component's
    surprise: np.ndarray        # (M,) least of all components less that of the pairs
    misfit: np.ndarray          # (M,) of the allowed one, or by how much its signal is unsaid
    limit: np.ndarray           # (M,) surprise of a familiar signal, at most

    at_once = 65_536            # signals: many to a centre

    def values(self, signals: np.ndarray, level: np.ndarray | None) -> np.ndarray:
        """Mean (P), standard deviation (Q) and novelty (1), side by side (n, P + Q + 1).

        Parameters
        ----------
        signals : (n, K) array
        level : (n,) array or None
            Of errors: 0 where they are smallest, 1 where largest.
        """
        few = np.clip(signals, 0, uplift_table.MAX_SIGNAL, dtype=np.float32) @ self.gain.T
        near = self._nearest(features_of(self.estimate, self.axes, few, level))
        wavelengths = self.mean.shape[2]
        values = np.empty((len(few), wavelengths + self.variance.shape[1] + 1), np.float32)
        order = np.argsort(near, kind="stable")
        ends = np.flatnonzero(np.diff(near[order])) + 1
        for rows in np.split(order, ends) if len(few) else ():
            centre = near[rows[0]]
            own = slice(self.first[centre], self.first[centre + 1])
            away = few[rows] - self.centres[centre]
            weights, chi_square = self._weights(own, away)
            moved = np.concatenate([np.ones((rows.size, 1), np.float32), away], axis=1)
            moved = (weights[:, :, None] * moved[:, None]).reshape(rows.size, -1)
            mean = moved @ self.mean[own].reshape(-1, wavelengths)
            apart = weights @ self.apart[own]
            variance = weights @ (self.variance[own] + self.apart[own]**2) - apart**2
            values[rows, :wavelengths] = np.clip(mean, 0, 1)
            values[rows,
                   wavelengths:-1] = np.sqrt(np.maximum(variance,
                                                        calibrated_marginals.MIN_VARIANCE))
            values[rows, -1] = np.maximum((self.surprise[centre] + chi_square.min(axis=1))
                                          / self.limit[centre], self.misfit[centre])
        return values

    def _weights(self, own: slice, away: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Weights and surprises (n, c) of a centre's components for signals so far away (n, r)."""
        count, bands = away.shape
        with np.errstate(invalid="ignore"):     # BLAS may read, and flag, beyond a single row's end
            whitened = away @ self.root[own].transpose(1, 0, 2).reshape(bands, -1)
        whitened = whitened.reshape(count, -1, bands) + self.residual[own]
        chi_square = np.einsum("ncr,ncr->nc", whitened, whitened)
        weights = self.log_weight[own] - chi_square / 2
        weights = np.exp(weights - weights.max(axis=1, keepdims=True))
        return weights / weights.sum(axis=1, keepdims=True), chi_square

    def _nearest(self, features: np.ndarray) -> np.ndarray:
        """The nearest centre (n,) of features (n, F + 1)."""
        half = np.sum(self.features**2, axis=1) / 2
        return np.concatenate([np.argmax(features[start:start + COMPARED_AT_ONCE]
                                         @ self.features.T - half, axis=1)
                               for start in range(0, len(features), COMPARED_AT_ONCE)]
                              or [np.zeros(0, int)])


def local_posteriors(prior: LogitMixture, relative_response: np.ndarray, errors: ErrorsOf,
                     signals: np.ndarray, level: np.ndarray | None, mean: slice,
                     deviation: slice, progress: uplift_table.Progress = lambda share: None,
                     map_parts: uplift_table.MapParts = map) -> LocalPosteriors:
    """Posteriors at centres among some signals; 300 to 500 centres a second.

    Parameters
    ----------
    prior : LogitMixture
    relative_response : (K, 61) array
        Rows summing to 1.
    errors : function from signals (n, K) to a list of their errors
        One, or the smallest and the largest.
    signals : (n, K) array
        That all signals are like.
    level : (n,) array or None
        Of their errors: 0 where they are smallest, 1 where largest.
    mean, deviation : slice
        Wavelengths of mean and standard deviation, of the 61.
    progress : function of the share that is done
    map_parts : function of (function, iterable), optional
        As ``map``; of a pool of threads, on several cores.
    """
    some = slice(None, None, -(-len(signals) // CHOSEN_AMONG))
    signals, level = signals[some].astype(float), None if level is None else level[some]
    mid_grey = np.full((1, signals.shape[1]), GREY)
    grey = errors(mid_grey)[0].total(mid_grey)[0]
    expected, spread = reflectance_moments(prior)
    gain, response = informative_bands(spread, relative_response, grey)
    seen = response @ spread
    to_spectra = np.linalg.solve(
        seen @ response.T + mixture_posterior.with_floor(gain @ grey @ gain.T), seen).T
    estimate = np.column_stack([expected - to_spectra @ (response @ expected),
                                to_spectra])[calibrated_marginals.COARSE]
    few = np.clip(signals, 0, uplift_table.MAX_SIGNAL) @ gain.T
    _, axes = np.linalg.eigh(np.cov(logit(estimate[:, 0] + few @ estimate[:, 1:].T), rowvar=False))
    axes = axes[:, -FEATURES:]
    features = features_of(estimate, axes, few, level)
    chosen = _centres(features)
    at = np.clip(signals[chosen], 0, uplift_table.MAX_SIGNAL)
    smallest, *larger = errors(at)
    if larger and level is not None:
        smallest = Errors(*(low + level[chosen, None, None] * (high - low)
                            for low, high in zip(smallest, larger[0], strict=True)))
    own = smallest if len(gain) == len(gain.T) else smallest.of_sums(gain, at)

    def part(start: int) -> tuple[np.ndarray, ...]:
        rows = slice(start, start + uplift_table.BATCH)
        return _around(prior, response, few[chosen[rows]], own.rows(rows), mean, deviation)

    parts = []
    for done in map_parts(part, range(0, chosen.size, uplift_table.BATCH)):
        parts.append(done)
        progress(min(len(parts) * uplift_table.BATCH / chosen.size, 1))
    counts, *pairs = (np.concatenate(each) for each in zip(*parts, strict=True))
    return LocalPosteriors(np.append(0, np.cumsum(counts)), *(each.astype(np.float32) for each in (
        gain, estimate, axes, features[chosen], few[chosen], *pairs)))


def features_of(estimate: np.ndarray, axes: np.ndarray, signals: np.ndarray,
                level: np.ndarray | None) -> np.ndarray:
    """Features (n, F + 1) of signals (n, r), of LocalPosteriors' estimate and axes."""
    logits = logit(estimate[:, 0] + signals @ estimate[:, 1:].T)
    of_level = np.zeros(len(signals)) if level is None else OF_LEVEL * level
    return np.column_stack([logits @ axes, of_level]).astype(np.float32)


def _centres(features: np.ndarray) -> np.ndarray:
    """Indices (M,) of the centres among features (n, F + 1)."""
    if len(features) <= MAX_CENTRES:
        return np.arange(len(features))
    far, nearest = [0], np.full(len(features), np.inf, np.float32)
    while len(far) < MAX_CENTRES // 2 and nearest.max() > NEAR**2:
        away = features - features[far[-1]]
        nearest = np.minimum(nearest, np.einsum("nf,nf->n", away, away))
        far.append(int(nearest.argmax()))
    return np.union1d(far, np.linspace(0, len(features) - 1, len(far)).astype(int))


def _around(prior: LogitMixture, relative_response: np.ndarray, signals: np.ndarray,
            errors: Errors, mean: slice, deviation: slice) -> tuple[np.ndarray, ...]:
    """The number of each centre's pairs, and the arrays of LocalPosteriors from ``log_weight``."""
    covariance, relative = errors.absolute, mixture_posterior.multiplying(errors.relative)
    mixture = mixture_posterior.posterior(prior, relative_response, signals, covariance,
                                          tolerance=uplift_table.TABLE_TOLERANCE, relative=relative)
    drawn, _ = calibrated_marginals.marginal_moments(prior, relative_response, signals, covariance,
                                                     mixture, relative)
    centre, component = np.nonzero(mixture.weights)
    weights, mode = mixture.weights[centre, component], mixture.logits[component, centre]
    p = reflectance(mode)
    slope = p * (1 - p)
    jacobian = relative_response * slope[:, None, :]
    base = np.empty_like(jacobian)
    for index in np.unique(component):
        rows = component == index
        base[rows] = jacobian[rows] @ prior.covariances[index]
    with_level = prior.with_level[component]
    base = with_stretch(base, jacobian, with_level, mixture.stretch[centre, component])
    means = prior.means[component] + mixture.shift[centre, component, None] * with_level
    of_signal = base @ jacobian.transpose(0, 2, 1)
    seen, noise, floored = mixture_posterior.seen_by(component, centre, mixture, relative_response,
                                                     signals, covariance, relative)
    residual = seen + (slope * (mode - means) - p) @ relative_response.T
    root = np.linalg.inv(np.linalg.cholesky(of_signal + floored)).transpose(0, 2, 1)
    whitened = np.einsum("nkl,nk->nl", root, residual)
    chi_square = np.sum(whitened**2, axis=1)
    # without the floor, as draws reproduce the signal
    change = np.linalg.solve(of_signal + noise + TINY * np.eye(len(relative_response)), base)
    if mixture.log_errors is not None:      # of the signal, over what it is multiplied by
        less = np.exp(-mixture.log_errors[component, centre])[..., None]
        root, change = less * root, less * change
    first, second, bend = _reflectances(drawn, component, centre)
    start = np.flatnonzero(np.diff(centre, prepend=-1))
    whole = np.add.reduceat(weights[:, None] * first, start, axis=0)[centre]
    surprise = mixture.surprise - np.minimum.reduceat(chi_square, start)
    unlike = np.maximum(
        mixture.misfit / mixture_posterior.allowed_misfit(covariance),
        mixture_posterior.unsaid(relative_response, whole[start], signals, covariance, relative))
    return (np.bincount(centre), np.log(weights) + chi_square / 2, root, whitened,
            np.concatenate([first[:, None], bend[:, None] * change], axis=1)[..., mean],
            (second - first**2)[:, deviation], (first - whole)[:, deviation], surprise, unlike,
            mixture_posterior.surprise_limit(prior, len(relative_response), mixture.noise_share))


def _reflectances(drawn: mixture_posterior.MixturePosterior, component: np.ndarray,
                  centre: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """First and second moments (n, P) of the reflectance of some pairs, and its mean slope."""
    logits, deviations = drawn.logits[component, centre], \
        np.sqrt(drawn.variances[component, centre])
    skews = None if drawn.skews is None else drawn.skews[component, centre]
    first, second = np.zeros_like(logits), np.zeros_like(logits)
    for node, weight in zip(mixture_posterior.HERMITE_NODES, mixture_posterior.HERMITE_WEIGHTS,
                            strict=True):
        values = reflectance(logits + quantiles.stretched(node, skews) * deviations)
        first += weight * values
        second += weight * values**2
    return first, second, first - second


# ---- informative bands ---------------------------------------------------------------------------
# Many bands as the few that the prior and the noise tell apart.
#
# Surfaces are smooth: 36 bands of an LED lamp differ along some 12 directions by more than a share
# of the noise. Signals of as many bands, estimated from all, say what all say, and a posterior of
# them costs a fraction. Unlike measure/surfaces/colour_comparison.py this knows how reflectances
# vary.

VISIBLE = 0.1   # of the noise: a direction along which surfaces differ less says nothing


def informative_bands(covariance: np.ndarray, relative_response: np.ndarray,
                      noise: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The gain (r, K) that estimates the signals of some bands from those of all, and the response
    (r, P) that belongs to it; of independent bands, ones and the response itself.

    As many bands are taken as directions in which surfaces differ by more than a share of the
    noise, those first that say most; generalised least squares estimates them.

    Parameters
    ----------
    covariance : (P, P) array
        Of reflectances.
    relative_response : (K, P) array
        Rows summing to 1.
    noise : (K, K) array
        Covariance of a signal's errors.
    """
    signals = relative_response @ covariance @ relative_response.T
    whitening = np.linalg.inv(np.linalg.cholesky(mixture_posterior.with_floor(noise)))
    variances, directions = np.linalg.eigh(whitening @ signals @ whitening.T)
    count = int(np.sum(variances > VISIBLE**2))
    if count == len(signals):
        return np.eye(count), relative_response
    roots = directions * np.sqrt(np.maximum(variances, 0))
    scale = np.linalg.norm(whitening, axis=0)[:, None]
    order = qr((scale * np.linalg.solve(whitening, roots)).T, mode="economic", pivoting=True)[2]
    chosen = np.sort(order[:count])
    sums = np.linalg.solve(signals[np.ix_(chosen, chosen)], signals[chosen]).T      # (K, r)
    missed = signals - sums @ signals[chosen]
    weighted = np.linalg.solve(mixture_posterior.with_floor(noise) + missed, sums)
    gain = np.linalg.solve(sums.T @ weighted, weighted.T)
    response = gain @ relative_response
    white = response.sum(axis=1, keepdims=True)
    return gain / white, response / white
