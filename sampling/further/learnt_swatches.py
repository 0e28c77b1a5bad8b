"""What measured swatches of the material at hand add to the learnt prior: a smooth correction.

The prior's mean m(y) of a signal y is right on average over surfaces of all kinds. Of one material
it errs alike at like signals, by its metamers as by the camera's curves. Swatches show by how much:
reflectances s_i at signals y_i. Their spectra are modelled as

    s = w m(y) + (1 - w) s_mean + f(y) + e,    f ~ GP(0, variance k),    e ~ N(0, nu variance)

with the kernel k(y, y') = 1 + z z' + a (1 + r) exp(-r), r = sqrt(3) |z - z'| / length, of signals z
about their mean, in units of their spread [Rasmussen & Williams 2006, Eqs. 2.25, 4.17]. With w = 0
and a = 0 this is least squares, with w = 1 and a large nu the prior alone. Leave-one-out weighs all
of them: errors without swatch i are in closed form [Eq. 5.12], and the weight is the likelihood
(mean square)^(-n / 2). Where their mixture predicts swatches no better than the prior does, the
prior stays alone.

The correction holds for samples of the swatches' material; in proportion to the probability that a
sample is of it, correction and prior make up mean and band, and what they differ by widens it. Of
many bands it falls as the variance of f at the signal grows over that at swatches left out. Three
bands say little of kinds: there it is the density of the signal among the swatches', over that
among surfaces of any kind, the prior's evidence, at even odds. In many bands so few swatches do not
tell a density.
"""
from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Annotated

import numpy as np
from scipy.special import expit, gammaln

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records.spectra import MIN_SWATCHES
from spectrabox.radiometry.shaped import Record

SHARES_OF_PRIOR = (0.0, 0.25, 0.5, 0.75, 1.0)                               # w
SHAPES = ((0.0, 1.0), *product((0.3, 1.0), (1.0, 3.0)))         # a, and length in spreads
NOISES = np.geomspace(3e-5, 30, 19)                                         # nu
TELLING_BANDS = 6           # of fewer, samples of other materials look like the swatches
SAME_MATERIAL = 0.9         # probability that samples whose signals are alike are of the material
LIKENESS_NOISE = 1e-3       # nu at which signals are judged for being alike
LEAST_SPREAD = 1e-3         # of the mean variance of signals over swatches: in any direction
ODD = 6.0                   # deviations of the others, beyond which a swatch contradicts its signal
MAD_TO_SD, LEAST_SCATTER = 1.4826, 0.03     # of a normal distribution; relative
DARK = 0.01                 # of white: darker is not told apart
NEGLIGIBLE = 1e-3           # weight below which a model is left out


@dataclass(frozen=True, eq=False)
class Swatches(Record):
    """Measured swatches as camera and prior see them: n of them, K bands, P wavelengths."""

    signals: Annotated[np.ndarray, "n K"]           # relative to white
    reflectances: Annotated[np.ndarray, "n P"]      # measured
    mean: Annotated[np.ndarray, "n P"]              # that the prior expects behind the signals
    deviation: Annotated[np.ndarray, "n P"]         # its standard deviation


@dataclass(frozen=True, eq=False)
class SwatchCorrection(Record):
    """A correction learnt on swatches, and what leave-one-out found."""

    swatches: Swatches
    models: Annotated[np.ndarray, "M 4"]            # w, a, length, nu
    weights: Annotated[np.ndarray, "M"]
    prior_weight: float             # of the prior alone; with ``weights`` 1 together
    prior_scale: float              # of the prior's deviation, by its errors at swatches; from 1
    rmse_before: float              # of swatches, by the prior alone
    rmse: float                     # of swatches, each by the others
    contradicted: tuple[str, ...] = ()      # names of swatches that would give another signal

    @property
    def helps(self) -> bool:
        """Whether swatches are predicted better with the correction than without."""
        return self.rmse < self.rmse_before

    @property
    def sentence(self) -> str:
        """What the swatches did, in words."""
        count = len(self.swatches.signals)
        if not self.helps:
            return (f"{count} swatches of the operator leave the spectra as they are: "
                    f"leave-one-out error {self.rmse:.4f} with a correction, "
                    f"{self.rmse_before:.4f} without.")
        return (f"{count} swatches of the operator corrected the spectra: leave-one-out error "
                f"{self.rmse:.4f} instead of {self.rmse_before:.4f}.")

    @property
    def doubt(self) -> str:
        """Which swatches contradict their signals, in a sentence; empty where none does."""
        return "" if not self.contradicted else (
            f"{' and '.join(self.contradicted)}: the spectra of these swatches contradict their "
            "signals by far more than errors: look whether names or files were exchanged, or "
            "measure them again.")


@dataclass(frozen=True, eq=False)
class CorrectedSpectra(Record):
    """Reflectances of T samples after the correction."""

    mean: Annotated[np.ndarray, "T P"]
    deviation: Annotated[np.ndarray, "T P"]
    probability: Annotated[np.ndarray, "T"]         # of being of the swatches' material


def learn_correction(swatches: Swatches) -> SwatchCorrection:
    """The correction that swatches teach, weighed by leave-one-out.

    Parameters
    ----------
    swatches : Swatches
        Their means and deviations by a calibration that did not use them.

    Raises
    ------
    InputError
        For fewer than 8 swatches, or swatches of one signal.
    """
    count = len(swatches.signals)
    if count < MIN_SWATCHES:
        raise InputError(f"{count} swatches are given; a correction needs {MIN_SWATCHES} or more "
                         "of the material, better 24, spread over its colours")
    if np.ptp(swatches.signals, axis=0).max() <= 0:
        raise InputError("all swatches have the same signal; give swatches of different colours")
    alone = swatches.reflectances - swatches.mean
    models, errors = [], [alone]
    z = _standardised(swatches, swatches.signals)
    for (amplitude, length), noise in product(SHAPES, NOISES):
        inverse = np.linalg.inv(_kernel(z, z, amplitude, length) + noise * np.eye(count))
        for share in SHARES_OF_PRIOR:
            without = inverse @ _targets(swatches, share)
            models.append((share, amplitude, length, noise))
            errors.append(without / np.diag(inverse)[:, None])
    squares = np.mean(np.square(errors), axis=2)          # (M + 1, n)
    weights = _weights(squares.sum(axis=1), count)
    # the weights that predict a swatch are those by the other swatches' errors
    each = _weights(squares.sum(axis=1, keepdims=True) - squares, count - 1)
    left_out = np.einsum("mn,mnp->np", each, np.array(errors))
    before, after = (float(np.sqrt(np.mean(one**2, axis=1)).mean())
                     for one in (alone, left_out))
    if after >= before:
        weights = np.eye(len(weights))[0]
    kept = weights[1:] > NEGLIGIBLE
    scale = np.sqrt(np.mean((alone / np.maximum(swatches.deviation, 1e-6))**2))
    total = weights[0] + weights[1:][kept].sum()
    return SwatchCorrection(swatches, np.array(models)[kept], weights[1:][kept] / total,
                            float(weights[0] / total), float(max(1.0, scale)), before,
                            after)


def odd_swatches(signals: np.ndarray, predicted: np.ndarray) -> np.ndarray:
    """Which swatches (n,) are brighter or darker than their spectra make them, in any band, by far
    more than the others scatter: outliers of the ratio by its median and median deviation [Hampel
    1974]. What all have in common, such as an error of white, is none of theirs.

    Parameters
    ----------
    signals, predicted : (n, K) arrays
        Measured, and by their reflectances; relative to white.
    """
    ratio = np.log(np.maximum(signals, DARK) / np.maximum(predicted, DARK))
    off = np.abs(ratio - np.median(ratio, axis=0))
    scatter = np.maximum(MAD_TO_SD * np.median(off, axis=0), LEAST_SCATTER)
    return np.asarray((off > ODD * scatter).any(axis=1))


def correct(correction: SwatchCorrection, signals: np.ndarray, mean: np.ndarray,
            deviation: np.ndarray, log_evidence: np.ndarray) -> CorrectedSpectra:
    """Mean and standard deviation of samples behind signals, by prior and swatches together.

    Parameters
    ----------
    correction : SwatchCorrection
    signals : (T, K) array
        Relative to white.
    mean, deviation : (T, P) arrays
        By the prior.
    log_evidence : (T,) array
        Log density of the signals under the prior, in nats.
    """
    swatches = correction.swatches
    count = len(swatches.signals)
    z, own = _standardised(swatches, swatches.signals), _standardised(swatches, signals)
    unsure = correction.prior_scale * deviation
    first = correction.prior_weight * mean
    second = correction.prior_weight * (mean**2 + unsure**2)
    for (share, amplitude, length, noise), weight in zip(correction.models, correction.weights,
                                                         strict=True):
        inverse = np.linalg.inv(_kernel(z, z, amplitude, length) + noise * np.eye(count))
        gain = _kernel(own, z, amplitude, length) @ inverse
        targets = _targets(swatches, share)
        left_out = inverse @ targets
        # variance by leave-one-out, so that bands hold what they say at swatches
        variance = np.mean(left_out**2 / np.diag(inverse)[:, None], axis=0)
        wider = noise + _at_itself(own, amplitude) \
            - np.einsum("tn,tn->t", gain, _kernel(own, z, amplitude, length))
        one = gain @ targets + share * mean + (1 - share) * swatches.reflectances.mean(axis=0)
        first = first + weight * one
        second = second + weight * (one**2 + wider[:, None] * variance)
    spread = np.sqrt(np.maximum(second - first**2, 1e-12))
    probability = SAME_MATERIAL * _likeness(swatches, signals) \
        if signals.shape[1] >= TELLING_BANDS \
        else expit(_log_density(swatches.signals, signals) - log_evidence)
    like = probability[:, None]
    # errors of both are taken as wholly alike, which is the widest that they can be together; what
    # they differ by is the error of having chosen the wrong one
    deviation = np.hypot(like * spread + (1 - like) * unsure,
                         np.sqrt(like * (1 - like)) * (first - mean))
    return CorrectedSpectra(np.clip(mean + like * (first - mean), 0, 1), deviation, probability)


def corrected_draws(draws: np.ndarray, mean: np.ndarray, deviation: np.ndarray) -> np.ndarray:
    """Draws (T, P) moved and stretched to another mean and standard deviation, within 0 and 1.

    Parameters
    ----------
    draws : (T, P) array
        Reflectances of one sample, by the prior.
    mean, deviation : (P,) arrays
        After the correction.
    """
    stretch = deviation / np.maximum(draws.std(axis=0), 1e-6)
    return np.clip(mean + stretch * (draws - draws.mean(axis=0)), 0, 1)


def _likeness(swatches: Swatches, signals: np.ndarray) -> np.ndarray:
    """How like the swatches (T,) signals are: 1 where the linear part of f is as sure as at
    swatches that are left out, and less in proportion.
    """
    z, own = _standardised(swatches, swatches.signals), _standardised(swatches, signals)
    inverse = np.linalg.inv(_kernel(z, z) + LIKENESS_NOISE * np.eye(len(z)))
    seen = _kernel(own, z)
    variance = LIKENESS_NOISE + _at_itself(own) - np.einsum("tn,nm,tm->t", seen, inverse, seen)
    return np.minimum(1, np.mean(1 / np.diag(inverse)) / variance)


def _log_density(known: np.ndarray, signals: np.ndarray) -> np.ndarray:
    """Log density (T,) of signals (T, K) of a material of which n swatches' (n, K) are known: of a
    normal distribution whose mean and covariance are estimated from them, a Student t [Gelman et
    al. 2013, Sec. 3.6; no knowledge of the mean, and of the covariance ``LEAST_SPREAD``].
    """
    count, bands = known.shape
    away = known - known.mean(axis=0)
    least = LEAST_SPREAD * np.mean(away**2) * np.eye(bands)
    degrees = count + 2                 # the least at which the covariance has a mean, and n
    spread = (away.T @ away + least) * (1 + 1 / count)          # ``degrees`` times its shape
    from_mean = signals - known.mean(axis=0)
    square = np.sum(from_mean * np.linalg.solve(spread, from_mean.T).T, axis=1)
    return np.asarray(gammaln((degrees + bands) / 2) - gammaln(degrees / 2)
                      - bands / 2 * np.log(np.pi) - np.linalg.slogdet(spread)[1] / 2
                      - (degrees + bands) / 2 * np.log1p(square))


def _standardised(swatches: Swatches, signals: np.ndarray) -> np.ndarray:
    away = swatches.signals - swatches.signals.mean(axis=0)
    return np.asarray((signals - swatches.signals.mean(axis=0))
                      / np.sqrt(np.mean(np.sum(away**2, axis=1))))


def _targets(swatches: Swatches, share: float) -> np.ndarray:
    """What f and e explain (n, P)."""
    return np.asarray(swatches.reflectances - share * swatches.mean
                      - (1 - share) * swatches.reflectances.mean(axis=0))


def _kernel(one: np.ndarray, other: np.ndarray, amplitude: float = 0.0,
            length: float = 1.0) -> np.ndarray:
    kernel = 1 + one @ other.T
    if amplitude:
        square = np.sum((one[:, None] - other[None])**2, axis=2)
        r = np.sqrt(3 * square) / length
        kernel = kernel + amplitude * (1 + r) * np.exp(-r)
    return np.asarray(kernel)


def _at_itself(one: np.ndarray, amplitude: float = 0.0) -> np.ndarray:
    return np.asarray(1 + np.sum(one**2, axis=1) + amplitude)


def _weights(squares: np.ndarray, count: int) -> np.ndarray:
    """Weights of models from their sums of squared errors, along the first axis."""
    weights = (np.maximum(squares, 1e-30) / np.maximum(squares.min(axis=0), 1e-30)) ** (-count / 2)
    return np.asarray(weights / weights.sum(axis=0))
