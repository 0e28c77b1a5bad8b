"""What a signal says under the learnt prior: posterior of each component, mean, calibrated bands.

Per component an iterated extended Kalman filter in the logit: with p = reflectance(x) and J = M
diag(p (1 - p)),

    Q = J S J' + R,   x <- mu + S J' Q^-1 (y - M p + J (x - mu))

until x converges. This is Gauss-Newton on the posterior's logarithm; its Gaussian at the end is
the component's posterior (Laplace), and -r' Q^-1 r / 2 - log det Q / 2 its log evidence. All
signals are treated at once; a component that is far behind after a few steps is given up for a
signal, and weighs nothing.

Errors that multiply (`RelativeErrors`) are K more variables e of the filter, normal with a
covariance C. With T = M p, what it gives, D = diag(T), E = e^e, and N the covariance of what adds,

    y = T E + n,    R = D C D + N / (E E'),    r = (y - T E) / E + T e + J (x - mu)
    x <- mu + S J' Q^-1 r,      e <- C D Q^-1 r

and the sum of e is taken off the log evidence: the density is that of y, not of y / E. What comes
after the mode sees the signal T + (y - T E) / E + T e with the noise R, each component its own
(`seen_by`). Without such errors these are y and N.
"""
from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import Annotated, Any

import numpy as np
from scipy.special import chdtri

from spectrabox.radiometry.shaped import Record, array_fields
from spectrabox.sampling.prior.level import tilt, with_stretch
from spectrabox.sampling.prior.mixture import LogitMixture, logit, reflectance
from spectrabox.sampling.prior.quantiles import quantiles, stretched

# of the filter; the largest change of a logit at which it has converged
STEPS, TOLERANCE = 25, 1e-6
TRIED, EVIDENCE_CUTOFF = 2, 15.0     # steps before components are compared; nats that exclude one
BLOCK = 64                  # signals at a time: what they take then fits the cache
NEGLIGIBLE = 2e-3           # weight of a component that is left out of a signal's posterior
MAX_STEP = 2.0              # logits per step: keeps the linearisation where it is of use
SIGNAL_FLOOR = 1e-3  # of white: the least standard error of a signal taken into the likelihood
# a component that misses the signal by more than 0.5 % of white and 4 sigma is given up
MISFIT, PENALTY = 5e-3, 1e5
# Gauss-Hermite quadrature of nine points, by Golub and Welsch: nodes are the eigenvalues of the
# polynomials' recurrence, weights the squares of the first components of its eigenvectors.
RECURRENCE = np.sqrt(np.arange(1, 9))
HERMITE_NODES, _VECTORS = np.linalg.eigh(np.diag(RECURRENCE, 1) + np.diag(RECURRENCE, -1))
HERMITE_WEIGHTS = _VECTORS[0]**2
# of the prior's limit of surprise: the share of curves within it, and the bands it was found with
FAMILIAR, CALIBRATED_BANDS = 0.995, 3
NORMAL_95 = NormalDist().inv_cdf(0.975)
# where errors multiply: steps, the largest of a log error, and after how many they are halved,
# since some swing about the mode
RELATIVE_STEPS, MAX_LOG_STEP, WHOLE_STEPS, HALVED = 40, 1.0, 8, 0.5
FURTHEST_START = 4.0        # of log errors
LEAST = 1e-6                # of white: what errors multiply is taken for at least as much
UNMOVED = 0.5               # novelty up to which bands are as wide as the families' factors say
USUAL_WIDTH = 0.12          # mean of a 95 % band before calibration
LEVEL = 0.95                # whose calibrated factor enlarges draws and their moments


@dataclass(frozen=True, eq=False)
class MixturePosterior(Record):
    """Posterior of T signals under C components: weights, and mean and variance of the logits."""

    weights: Annotated[np.ndarray, "T C"]
    logits: Annotated[np.ndarray, "C T P"]
    variances: Annotated[np.ndarray, "C T P"]
    # of the components' means and covariances at the levels of the signals (level.py)
    shift: Annotated[np.ndarray, "T C"]
    stretch: Annotated[np.ndarray, "T C"]
    misfit: Annotated[np.ndarray, "T"]  # largest |signal - M p|, averaged over the components
    # least r' Q^-1 r over the components: chi-square with K degrees
    surprise: Annotated[np.ndarray, "T"]
    # of the signals under the mixture, in nats; a misfit is judged by the noise alone
    log_evidence: Annotated[np.ndarray, "T"]
    growth: Annotated[np.ndarray, "T"]  # of the calibrated bands, for novelty (`tail_growth`)
    # of the components' marginal distributions (quantiles.py); None for normal ones
    skews: Annotated[np.ndarray, "C T P"] | None = None
    # e of the errors that multiply the signals; None where none do
    log_errors: Annotated[np.ndarray, "C T K"] | None = None
    # of the noise in the variance of the signals, under the component of least surprise
    noise_share: Annotated[np.ndarray, "T"] | None = None

    def rows(self, rows: slice) -> MixturePosterior:
        """That of some of the signals."""
        some: dict[str, Any] = {
            name: values[tuple(rows if letter == "T" else slice(None)
                               for letter in letters.split())]
            for name, letters in array_fields(MixturePosterior).items()
            if (values := getattr(self, name)) is not None}
        return replace(self, **some)


@dataclass(frozen=True, eq=False)
class RelativeErrors:
    """Errors that multiply the signals of T captures, and what else they multiply:

        signal + added = (M p + added + v) e^eps + n

    The noise that is given with it is that of n and of v, light such as gloss that is added before
    the errors act.
    """

    covariance: np.ndarray              # (T, K, K) of eps
    added: np.ndarray                   # (K,)
    added_covariance: np.ndarray        # (K, K) of v

    def rows(self, index: np.ndarray | slice) -> RelativeErrors:
        """Those of some of the captures."""
        return replace(self, covariance=self.covariance[index])

    def start(self, signals: np.ndarray, noise: np.ndarray, of_prior: np.ndarray) -> np.ndarray:
        """Log errors (T, K) that would explain the signals (T, K), those of the prior being these
        (T, K).
        """
        light = np.maximum(of_prior + self.added, LEAST)
        seen = np.maximum(signals + self.added,
                          np.sqrt(np.diagonal(noise, axis1=1, axis2=2)))
        own = noise / (seen[:, :, None] * seen[:, None, :]) + LEAST**2 * np.eye(light.shape[1])
        wanted = np.linalg.solve(self.covariance + own, np.log(seen / light)[..., None])
        return np.clip((self.covariance @ wanted)[..., 0], -FURTHEST_START, FURTHEST_START)

    def effective(self, signals: np.ndarray, noise: np.ndarray, log_errors: np.ndarray,
                  of_spectra: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The signals (T, K) and the noise R (T, K, K) that spectra of some signals (T, K) see at
        some log errors (T, K), and what these multiply (T, K).
        """
        light = np.maximum(of_spectra + self.added, LEAST)
        factor = np.exp(log_errors)
        seen = (signals + self.added) / factor - self.added + light * log_errors
        adds = (noise - self.added_covariance) / (factor[:, :, None] * factor[:, None, :])
        return seen, light[:, :, None] * self.covariance * light[:, None, :] + adds \
            + self.added_covariance, light


def multiplying(covariance: np.ndarray | None, added: np.ndarray | None = None,
                added_covariance: np.ndarray | None = None) -> RelativeErrors | None:
    """Errors that multiply signals, of a covariance (T, K, K); None where there are none.

    Parameters
    ----------
    covariance : (T, K, K) array or None
    added, added_covariance : (K,) and (K, K) arrays, optional
        Of light that they multiply as well; none by default.
    """
    if covariance is None or not covariance.any():
        return None
    none = np.zeros(covariance.shape[-1])
    return RelativeErrors(covariance, none if added is None else added,
                          np.diag(none) if added_covariance is None else added_covariance)


@dataclass(frozen=True)
class Pairs:
    """Some pairs of a component and a signal, as n rows."""

    index: tuple[int | slice, int | slice]      # of the rows in arrays (C, T)
    component: int | np.ndarray                 # one for all rows, or (n,): one for each
    relative_response: np.ndarray               # (K, P)
    signals: np.ndarray                         # (n, K)
    noise: np.ndarray                           # (n, K, K) with its floor
    logits: np.ndarray                          # (n, P), a view
    relative: RelativeErrors | None = None      # of the n rows
    log_errors: np.ndarray | None = None        # (n, K), a view, of these

    def of(self, values: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Values (C, ...) of the component of all rows, or (n, ...) of each row's own."""
        return np.asarray(values[self.component if isinstance(self.component, int)
                                 else self.component[rows]])


@dataclass(frozen=True)
class Linearised:
    """A component and the signals at logits x: what a step and the evidence are made of."""

    mean: np.ndarray            # (n, P) of the component at the level of x
    gain_base: np.ndarray       # (n, K, P) J S
    Q: np.ndarray               # (n, K, K)
    residual: np.ndarray        # (n, K)
    shift: np.ndarray           # (n,) of the component's mean, stretch of its covariance, and
    stretch: np.ndarray         # (n,)
    log_weight: np.ndarray      # (n,) by its level (level.py)
    noise: np.ndarray           # (n, K, K) R
    light: np.ndarray | None = None         # (n, K) that errors multiply; None where none do
    log_errors: np.ndarray | None = None    # (n, K) of these


def posterior(prior: LogitMixture, relative_response: np.ndarray, signals: np.ndarray,
              covariance: np.ndarray, start: MixturePosterior | None = None, *,
              tolerance: float = TOLERANCE,
              relative: RelativeErrors | None = None) -> MixturePosterior:
    """Posterior of T signals, all at once.

    Parameters
    ----------
    prior : LogitMixture
    relative_response : (K, P) array
        On the prior's wavelengths, rows summing to 1.
    signals : (T, K) array
        Relative to white.
    covariance : (T, K, K) or (K, K) array
        Of the signals' noise; 0.1 % of white is added.
    start : MixturePosterior, optional
        Of the same signals under other noise, whose modes are near: a third of the work.
    tolerance : float
        Change of a logit at which the mode is reached.
    relative : RelativeErrors, optional
        Errors that multiply the signals, which are not among the noise.
    """
    noise = np.broadcast_to(with_floor(covariance), (len(signals), *covariance.shape[-2:]))
    shape = (len(prior.means), len(signals))
    logits = np.repeat(prior.means[:, None], len(signals), axis=1) if start is None \
        else start.logits.copy()
    variances = np.repeat(np.diagonal(prior.covariances, axis1=1, axis2=2)[:, None], len(signals),
                          axis=1)
    log_weights = np.log(prior.weights)
    log_errors = None if relative is None else _first_log_errors(
        relative, relative_response, signals, noise, logits, start)
    parts = list(_components_of_signals(relative_response, signals, noise, logits, relative,
                                        log_errors))
    tried = TRIED if start is None else 1
    rough = log_weights[:, None] + np.reshape([rough_evidence(prior, part, tried)
                                               for part in parts], shape)
    plain, misfit, surprise = np.full(shape, -np.inf), np.zeros(shape), np.full(shape, np.inf)
    shift, stretch, of_noise = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    close = rough > rough.max(axis=0) - EVIDENCE_CUTOFF
    for part in parts:
        near = np.flatnonzero(close[part.index])
        gauss_newton(prior, part, near, STEPS if relative is None else RELATIVE_STEPS, tolerance)
        for target, values in zip((variances, plain, misfit, surprise, shift, stretch, of_noise),
                                  laplace(prior, part, near), strict=True):
            target[part.index][near] = values
    plain += log_weights[:, None]
    score = plain - PENALTY * np.maximum(misfit - allowed_misfit(noise), 0)
    weights = np.exp(score - score.max(axis=0))
    weights /= weights.sum(axis=0)
    weights[weights < NEGLIGIBLE] = 0
    weights /= weights.sum(axis=0)
    largest = plain.max(axis=0)             # kept apart: exponentials of evidences underflow
    log_evidence = largest + np.log(np.exp(plain - largest).sum(axis=0)) \
        - signals.shape[1] / 2 * np.log(2 * np.pi)
    likely = np.argmin(surprise, axis=0)
    least, share = surprise.min(axis=0), of_noise[likely, np.arange(likely.size)]
    growth = tail_growth(prior.tail, least / surprise_limit(prior, noise.shape[-1], share))
    return MixturePosterior(weights.T, logits, variances, shift.T, stretch.T,
                            (weights * misfit).sum(axis=0), least, log_evidence, growth,
                            log_errors=log_errors, noise_share=share)


def _first_log_errors(relative: RelativeErrors, relative_response: np.ndarray, signals: np.ndarray,
                      noise: np.ndarray, logits: np.ndarray,
                      start: MixturePosterior | None) -> np.ndarray:
    """Log errors (C, T, K) to begin with."""
    if start is not None and start.log_errors is not None:
        return start.log_errors.copy()
    return np.array([relative.start(signals, noise, reflectance(own) @ relative_response.T)
                     for own in logits])


def _components_of_signals(relative_response: np.ndarray, signals: np.ndarray, noise: np.ndarray,
                           logits: np.ndarray, relative: RelativeErrors | None,
                           log_errors: np.ndarray | None) -> Iterator[Pairs]:
    """All pairs of a component and a signal: a part for each component, its rows the signals; or,
    for one signal, one part whose rows are the components.
    """
    components = len(logits)
    if len(signals) == 1:
        yield Pairs((slice(None), 0), np.arange(components), relative_response,
                     np.repeat(signals, components, axis=0),
                     np.repeat(noise, components, axis=0), logits[:, 0],
                     None if relative is None else relative.rows(np.zeros(components, int)),
                     None if log_errors is None else log_errors[:, 0])
        return
    for index in range(components):
        yield Pairs((index, slice(None)), index, relative_response, signals, noise,
                     logits[index], relative, None if log_errors is None else log_errors[index])


def with_floor(covariance: np.ndarray) -> np.ndarray:
    """The covariance (..., K, K) with at least 0.1 % of white of independent error per band.

    Parameters
    ----------
    covariance : (..., K, K) array
        Of the signals' noise.
    """
    return covariance + SIGNAL_FLOOR**2 * np.eye(covariance.shape[-1])


def gauss_newton(prior: LogitMixture, pairs: Pairs, rows: np.ndarray, steps: int,
                 tolerance: float = TOLERANCE, level: np.ndarray | None = None) -> None:
    """Move logits of some rows of pairs towards the modes, in place.

    Parameters
    ----------
    prior : LogitMixture
    pairs : Pairs
    rows : (n,) int array
        Of the pairs to move.
    steps : int
        At most.
    tolerance : float
        Largest change of a logit at which it has converged.
    level : (n,) array, optional
        At which components are tilted; by default that of the logits.
    """
    active = rows
    for number in range(steps):
        active = _step(pairs, active, linearised(prior, pairs, active, level), tolerance,
                       1.0 if number < WHOLE_STEPS else HALVED)
        if not active.size:
            break


def _step(pairs: Pairs, active: np.ndarray, here: Linearised,
          tolerance: float = TOLERANCE, part: float = 1.0) -> np.ndarray:
    """Move logits of the active rows one step, with log errors some ``part`` of it; those (n,)
    that have not converged.
    """
    solved = np.linalg.solve(here.Q, here.residual[..., None])
    step = here.mean + (solved.transpose(0, 2, 1) @ here.gain_base)[:, 0] - pairs.logits[active]
    length = np.abs(step).max(axis=1)
    scale = np.minimum(1, MAX_STEP / np.maximum(length, TOLERANCE))[:, None]
    if pairs.relative is not None and pairs.log_errors is not None:
        assert here.light is not None and here.log_errors is not None
        change = (pairs.relative.covariance[active]
                  @ (here.light * solved[..., 0])[..., None])[..., 0] - here.log_errors
        largest = np.abs(change).max(axis=1)
        scale = part * np.minimum(scale, MAX_LOG_STEP / np.maximum(largest, TOLERANCE)[:, None])
        pairs.log_errors[active] += scale * change
        length = np.maximum(length, largest)
    pairs.logits[active] += step * scale
    return active[length > tolerance]


def rough_evidence(prior: LogitMixture, pairs: Pairs, tried: int = TRIED) -> np.ndarray:
    """Move logits of all pairs a few steps towards the modes, in place; log evidence (n,) where the
    last step began. Components are tilted at the level of the signal.

    Parameters
    ----------
    prior : LogitMixture
    pairs : Pairs
    tried : int
        Number of steps.
    """
    everyone = np.arange(len(pairs.logits))
    level = logit(pairs.signals.mean(axis=1))
    gauss_newton(prior, pairs, everyone, tried - 1, level=level)
    here = linearised(prior, pairs, everyone, level)
    _step(pairs, everyone, here)
    return _log_evidence(here, np.linalg.solve(here.Q, here.residual[..., None])[..., 0])


def laplace(prior: LogitMixture, pairs: Pairs, rows: np.ndarray) -> tuple[np.ndarray, ...]:
    """Variances (n, P), log evidence (n,), largest misfit (n,), r' Q^-1 r (n,), shift and stretch
    (n,) of the component, and the share (n,) of the noise in Q, of some rows of pairs at their
    modes.

    Parameters
    ----------
    prior : LogitMixture
    pairs : Pairs
    rows : (n,) int array
    """
    here = linearised(prior, pairs, rows)
    solved = np.linalg.solve(here.Q, np.concatenate(
        [here.gain_base, here.noise, here.residual[..., None]], axis=2))
    bands, wavelengths = here.gain_base.shape[1:]
    own = pairs.of(np.diagonal(prior.covariances, axis1=1, axis2=2), rows)
    with_level = pairs.of(prior.with_level, rows)
    variance = own + here.stretch[:, None] * with_level**2 \
        - np.einsum("tkp,tkp->tp", here.gain_base, solved[..., :wavelengths])
    surprise = np.einsum("tk,tk->t", here.residual, solved[..., -1])
    given = reflectance(pairs.logits[rows]) @ pairs.relative_response.T
    if pairs.relative is not None and here.log_errors is not None:
        added = pairs.relative.added
        given = (given + added) * np.exp(here.log_errors) - added
    misfit = np.abs(pairs.signals[rows] - given).max(axis=1)
    share = np.einsum("tkk->t", solved[..., wavelengths:-1]) / bands
    return (np.maximum(variance, 1e-8), _log_evidence(here, solved[..., -1]), misfit, surprise,
            here.shift, here.stretch, share)


def _log_evidence(here: Linearised, solved: np.ndarray) -> np.ndarray:
    evidence = here.log_weight - np.einsum("tk,tk->t", here.residual, solved) / 2 \
        - np.linalg.slogdet(here.Q)[1] / 2
    return np.asarray(evidence if here.log_errors is None
                      else evidence - here.log_errors.sum(axis=1))


def linearised(prior: LogitMixture, pairs: Pairs, rows: np.ndarray,
               level: np.ndarray | None = None) -> Linearised:
    """J S, Q and the residual of some rows of pairs at their logits, as at the top of this file.

    Parameters
    ----------
    prior : LogitMixture
    pairs : Pairs
    rows : (n,) int array
    level : (n,) array, optional
        At which components are tilted; by default that of the logits.
    """
    x = pairs.logits[rows]
    p, own = reflectance(x), pairs.of(prior.covariances, rows)
    signals, noise = pairs.signals[rows], pairs.noise[rows]
    log_errors = light = share = None
    if pairs.relative is not None and pairs.log_errors is not None:
        log_errors = pairs.log_errors[rows]
        relative = pairs.relative.rows(rows)
        signals, noise, light = relative.effective(signals, noise, log_errors,
                                                   p @ pairs.relative_response.T)
        if prior.uniform_level:
            share = np.einsum("tk,tkl,tl->t", light, relative.covariance, light) \
                / noise.sum(axis=(1, 2))
    shift, stretch, log_weight = tilt(
        prior, pairs.of(np.arange(len(prior.means)), rows),
        x.mean(axis=1) if level is None else level[rows], share)
    with_level = pairs.of(prior.with_level, rows)
    mean = pairs.of(prior.means, rows) + shift[:, None] * with_level
    slope = p * (1 - p)
    jacobian = pairs.relative_response * slope[:, None, :]
    gain_base = jacobian @ own if own.ndim > 2 else \
        (jacobian.reshape(-1, x.shape[1]) @ own).reshape(jacobian.shape)
    gain_base = with_stretch(gain_base, jacobian, with_level, stretch)
    Q = gain_base @ jacobian.transpose(0, 2, 1) + noise
    residual = signals + (slope * (x - mean) - p) @ pairs.relative_response.T
    return Linearised(mean, gain_base, Q, residual, shift, stretch, log_weight, noise, light,
                      log_errors)


def seen_by(component: np.ndarray, signal: np.ndarray, mixture: MixturePosterior,
            relative_response: np.ndarray, signals: np.ndarray, covariance: np.ndarray,
            relative: RelativeErrors | None
            ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The signals (n, K) that components of a posterior see at their modes, with their noise
    (n, K, K), without its floor and with it.

    Parameters
    ----------
    component, signal : (n,) int arrays
        Of the pairs.
    mixture : MixturePosterior
    relative_response : (K, P) array
    signals : (T, K) array
    covariance : (T, K, K) array
        Of the signals' noise.
    relative : RelativeErrors or None
        As the posterior was solved with.
    """
    own, noise = signals[signal], covariance[signal]
    if relative is None or mixture.log_errors is None:
        return own, noise, with_floor(noise)
    given = reflectance(mixture.logits[component, signal]) @ relative_response.T
    log_errors = mixture.log_errors[component, signal]
    seen, less, _ = relative.rows(signal).effective(own, noise, log_errors, given)
    factor = np.exp(-2 * log_errors)
    return seen, less, less + SIGNAL_FLOOR**2 * factor[..., None] * np.eye(factor.shape[1])


def mean_and_spread(mixture: MixturePosterior) -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard deviation (T, P) of the reflectance, by nine-point Gauss-Hermite
    quadrature.

    Parameters
    ----------
    mixture : MixturePosterior
        Of T signals under a prior.
    """
    first, second = np.zeros(mixture.logits.shape[1:]), np.zeros(mixture.logits.shape[1:])
    for rows, weights, logits, deviations, skews in _blocks(mixture):
        for node, node_weight in zip(HERMITE_NODES, HERMITE_WEIGHTS, strict=True):
            values = reflectance(logits + stretched(node, skews) * deviations)
            first[rows] += node_weight * np.einsum("tc,tcp->tp", weights, values)
            second[rows] += node_weight * np.einsum("tc,tcp->tp", weights, values**2)
    return first, np.sqrt(np.maximum(second - first**2, 1e-12))


def central_band(mixture: MixturePosterior, level: float) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper reflectance (T, P) of the mixture's central band, not yet calibrated.

    Parameters
    ----------
    mixture : MixturePosterior
        Of T signals under a prior.
    level : float
        Probability of the band, 0 to 1.
    """
    lower, upper = (1 - level) / 2, (1 + level) / 2
    return (reflectance(mixture_quantile(mixture, lower)),
            reflectance(mixture_quantile(mixture, upper)))


def mixture_quantile(mixture: MixturePosterior, probability: float) -> np.ndarray:
    """Quantile (T, P) of the mixture in the logit.

    Parameters
    ----------
    mixture : MixturePosterior
        Of T signals under a prior.
    probability : float
        Between 0 and 1.
    """
    quantile = np.empty(mixture.logits.shape[1:])
    for rows, weights, logits, deviations, skews in _blocks(mixture):
        quantile[rows] = quantiles(weights, logits, deviations, skews, probability)
    return quantile


def _blocks(mixture: MixturePosterior) -> Iterator[tuple[Any, ...]]:
    """Blocks of signals that allow about as many components: their rows (n,), and weights (n, c),
    logits, deviations and skews (n, c, P) of these, the heaviest first.
    """
    counts = np.count_nonzero(mixture.weights, axis=1)
    by_count = np.argsort(counts, kind="stable")
    for start in range(0, by_count.size, BLOCK):
        rows = by_count[start:start + BLOCK]
        heaviest = np.argsort(-mixture.weights[rows], axis=1,
                              kind="stable")[:, :counts[rows[-1]]]
        chosen = heaviest, rows[:, None]
        yield (rows, mixture.weights[rows[:, None], heaviest], mixture.logits[chosen],
               np.sqrt(mixture.variances[chosen]),
               None if mixture.skews is None else mixture.skews[chosen])


def calibrated_bands(prior: LogitMixture, mixture: MixturePosterior, levels: tuple[float, ...]
                     ) -> tuple[np.ndarray, list[tuple[np.ndarray, np.ndarray]]]:
    """Mean (T, P), and of each level the ends (T, P) of its calibrated band, in [0, 1].

    Parameters
    ----------
    prior : LogitMixture
    mixture : MixturePosterior
        Of T signals under a prior.
    levels : tuple of float
        Probabilities of the bands.
    """
    mean, spread = mean_and_spread(mixture)
    width = width_factors(prior, spread) * mixture.growth[:, None]
    return mean, [widened(mean, *central_band(mixture, level),
                          width * prior.band_factor(level, mixture.weights)) for level in levels]


def widened(mean: np.ndarray, lower: np.ndarray, upper: np.ndarray,
            factor: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
    """The band (T, P) widened about the mean by factors that broadcast to it, within 0 and 1.

    Parameters
    ----------
    mean : (T, P) array
        Of the reflectance.
    lower : (T, P) array
    upper : (T, P) array
    factor : array or float
        1 leaves the band as it is.
    """
    return (np.clip(mean - factor * (mean - lower), 0, 1),
            np.clip(mean + factor * (upper - mean), 0, 1))


def novelty(prior: LogitMixture, mixture: MixturePosterior,
            covariance: np.ndarray) -> np.ndarray:
    """Novelty (T,) of signals: beyond 1 they are unlike what the prior was learnt from.

    Parameters
    ----------
    prior : LogitMixture
    mixture : MixturePosterior
        Of the signals.
    covariance : (T, K, K) or (K, K) array
        Of the signals' noise.
    """
    return np.maximum(mixture.surprise / surprise_limit(prior, covariance.shape[-1],
                                                        mixture.noise_share),
                      mixture.misfit / allowed_misfit(covariance))


def surprise_limit(prior: LogitMixture, bands: int,
                   noise_share: np.ndarray | None = None) -> np.ndarray:
    """Surprise (T,) of a signal beyond which it is unlike what a prior was learnt from.

    The prior's own limit was found with signals of three bands. What further bands have besides is
    noise and detail that the components expect, one degree of chi-square each.

    Parameters
    ----------
    prior : LogitMixture
    bands : int
        Of the signal.
    noise_share : (T,) array, optional
        Of the noise in the variance of signals: what of a surprise is that of the noise is
        chi-square, whatever the prior. None by default.
    """
    chi_square = float(chdtri(bands, 1 - FAMILIAR))
    limit = prior.familiar_surprise \
        + max(chi_square - float(chdtri(CALIBRATED_BANDS, 1 - FAMILIAR)), 0.0)
    return np.asarray(limit + (0.0 if noise_share is None else noise_share)
                      * max(chi_square - limit, 0.0))


def allowed_misfit(covariance: np.ndarray) -> np.ndarray:
    """Distance of signal and fit beyond which a prior does not reach the signal: 0.5 % of white,
    or 4 sigma of the noise (..., K, K).

    Parameters
    ----------
    covariance : (..., K, K) array
        Of the signals' noise.
    """
    largest = np.diagonal(covariance, axis1=-2, axis2=-1).max(axis=-1)
    return np.maximum(MISFIT, 4 * np.sqrt(largest))


# ---- what a posterior says of its own signal -----------------------------------------------------
# Chance of errors as large as a right answer needs them, beyond which it does not give its signal
UNSAID = 0.01


def needed_errors(given: np.ndarray, signals: np.ndarray, covariance: np.ndarray,
                  relative: RelativeErrors | None = None) -> np.ndarray:
    """Chi-square (T,) of the least errors with which spectra of some signals give others, those of
    what multiplies and of what adds together.

    An answer that left its signal would need errors that nobody stated. Residuals alone do not
    tell: of an error of half the measured signal, black is but two standard errors away.

    Parameters
    ----------
    given : (T, K) array
        Signals of the spectra.
    signals : (T, K) array
        As measured; of a state, less what it adds.
    covariance : (T, K, K) array
        Of what adds; 0.5 % of white is added, by which a mean may miss a signal that all draws
        give (`calibrated_marginals`).
    relative : RelativeErrors, optional
        Of what multiplies.
    """
    noise = covariance + MISFIT**2 * np.eye(covariance.shape[-1])
    if relative is None:
        off = signals - given
        solved = np.linalg.solve(np.broadcast_to(noise, (len(off), *noise.shape[-2:])),
                                 off[..., None])
        return np.asarray(np.einsum("tk,tk->t", off, solved[..., 0]))
    log_errors = relative.start(signals, noise, given)
    for number in range(RELATIVE_STEPS):
        seen, R, light = relative.effective(signals, noise, log_errors, given)
        off = seen - given
        solved = np.linalg.solve(R, off[..., None])[..., 0]
        step = (relative.covariance @ (light * solved)[..., None])[..., 0] - log_errors
        length = np.abs(step).max(axis=1, keepdims=True)
        if length.max(initial=0) < TOLERANCE:
            break
        log_errors = log_errors + step * np.minimum(1.0 if number < WHOLE_STEPS else HALVED,
                                                    MAX_LOG_STEP / np.maximum(length, TOLERANCE))
    return np.asarray(np.einsum("tk,tk->t", off, solved))


def unsaid(relative_response: np.ndarray, mean: np.ndarray, signals: np.ndarray,
           covariance: np.ndarray, relative: RelativeErrors | None = None) -> np.ndarray:
    """How far mean reflectances (T, P) are from giving their signals (T,): beyond 1 not within the
    stated errors.

    Parameters
    ----------
    relative_response : (K, P) array
    mean : (T, P) array
    signals, covariance, relative
        As of `needed_errors`.
    """
    return needed_errors(mean @ relative_response.T, signals, covariance, relative) \
        / chdtri(signals.shape[1], UNSAID)


def band_factors(prior: LogitMixture, mixture: MixturePosterior, level: float) -> np.ndarray:
    """Factors (T, P) by which central bands are widened: the families', by share, for the width,
    and for how unlikely the signal is.

    Parameters
    ----------
    prior : LogitMixture
    mixture : MixturePosterior
        Of T signals under a prior.
    level : float
        Probability of the band, 0 to 1.
    """
    return width_factors(prior, mean_and_spread(mixture)[1]) * mixture.growth[:, None] \
        * prior.band_factor(level, mixture.weights)


def tail_growth(tail: float, novelty: np.ndarray) -> np.ndarray:
    """Factors (T,) by which bands grow with the novelty (T,) of signals, as far as the surprise
    goes: the bands of components with tails as of Student's t.

    Given a part of it, the rest of a t variable of n degrees of freedom spreads as sqrt(n + d), d
    the chi-square of the part. Signals half as surprising as the limit are left as they are, since
    the factors of families were found with all signals.

    Parameters
    ----------
    tail : float
        The limit of surprise over n; 0 for normal components, of which no band grows.
    novelty : (T,) array
    """
    return np.sqrt(np.maximum((1 + tail * novelty) / (1 + tail * UNMOVED), 1))


def width_factors(prior: LogitMixture, spread: np.ndarray) -> np.ndarray:
    """Factors (T, 1) of bands for how wide they are before calibration, 1 for the usual width;
    ``spread`` (T, P) is the standard deviation.

    Of a learnt prior they fall: bands that are wide are too wide rather than too narrow.

    Parameters
    ----------
    prior : LogitMixture
    spread : (T, P) array
        Standard deviation of the reflectance.
    """
    width = 2 * NORMAL_95 * spread.mean(axis=1, keepdims=True)
    return np.asarray((width / USUAL_WIDTH)**prior.width_power)


def conformal_scores(mean: np.ndarray, lower: np.ndarray, upper: np.ndarray,
                     truth: np.ndarray) -> np.ndarray:
    """The factor (T, P) that each band would have needed to hold the truth.

    Parameters
    ----------
    mean : (T, P) array
        Of the reflectance.
    lower : (T, P) array
        Of the band before calibration.
    upper : (T, P) array
    truth : (T, P) array
    """
    below = (mean - truth) / np.maximum(mean - lower, 1e-4)
    above = (truth - mean) / np.maximum(upper - mean, 1e-4)
    return np.maximum(below, above)
