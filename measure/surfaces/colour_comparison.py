"""Surfaces compared: how two differ in spectrum and colour, whether the camera tells them apart,
and spectra that it cannot.

Many bands as the few that do not depend on each other.

Three channels under one narrow lamp see nearly the same part of the spectrum, and of 36 bands many
are sums of others. What they say of a reflectance is then said by a few of them, whose signals are
estimated from all by generalised least squares. Nothing is lost but the check that bands which
repeat each other agree.

Two surfaces of the same photos beside each other: how their spectra and colours differ, and
whether the camera sees a difference.

Surfaces of one photo share most errors of their signals: the white level, the camera's curves,
the veil. What they share (``error_model.CAUSES``) is counted once, so that two areas of one paint
do not differ by it. Each has a gloss of its own.
"""


from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.special import chdtri

from spectrabox.measure import texts
from spectrabox.radiometry import appearance, error_model, errors
from spectrabox.radiometry.covariance import symmetric, symmetric_root
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.grid import interpolation_matrix
from spectrabox.radiometry.records.spectra import SpectrumSamples, SurfaceSignals
from spectrabox.sampling.prior.mixture import PRIOR_GRID
from spectrabox.sampling.prior.signal_posterior import SignalPosterior

# of a band's response, that no sum of the others gives: below, the others give its signal too
DEPENDENT = 0.02
# of reflectances along one direction of unit length on a grid of 1 nm, at most: they vary by 0.2
# over 50 nm. What a sum leaves out of a band errs by this times what it leaves out.
ALONG_A_DIRECTION = 0.2 * 50**0.5


def independent_bands(response: np.ndarray, covariance: np.ndarray
                      ) -> tuple[np.ndarray, np.ndarray]:
    """Indices (r,) of bands that do not depend on each other, in order, and the gain (r, K) that
    estimates their signals from those of all; all bands and ones where none depends.

    Parameters
    ----------
    response : (K, P) array
        To reflectances.
    covariance : (K, K) array
        Of the signals' errors.
    """
    bands = len(response)
    left = response / np.maximum(np.linalg.norm(response, axis=1, keepdims=True),
                                 np.finfo(float).tiny)
    chosen: list[int] = []
    # Gram-Schmidt, the band that is least like those before first; as in a pivoted QR
    for _ in range(bands):
        length = np.linalg.norm(left, axis=1)
        band = int(np.argmax(length))
        if length[band] < DEPENDENT:
            break
        chosen.append(band)
        direction = left[band] / length[band]
        left = left - np.outer(left @ direction, direction)
    if len(chosen) in (0, bands):
        return np.arange(bands), np.eye(bands)
    order = np.sort(chosen)
    sums = np.linalg.lstsq(response[order].T, response.T, rcond=None)[0].T      # (K, r)
    missed = ALONG_A_DIRECTION * np.linalg.norm(response - sums @ response[order], axis=1)
    weighted = np.linalg.solve(covariance + np.diag(missed**2), sums)
    return order, np.linalg.solve(sums.T @ weighted, weighted.T)


# ---- two spectra that the photo cannot tell apart, and the lights under which the eye can --------

LIGHTS = ("D65", "A", "FL11", "LED-B3", "LED-RGB1")
ENDS = (0.025, 0.975)           # of the draws along their main difference


def metamer_pair(samples: SpectrumSamples) -> SpectrumSamples:
    """Two of some draws: those at the ends of what all span along their main difference.

    Parameters
    ----------
    samples : SpectrumSamples
        Two draws or more.
    """
    grid, spectra = samples.grid, samples.spectra
    off = (spectra - spectra.mean(axis=0)) * np.sqrt(grid.weights_nm)
    _, axes = np.linalg.eigh(off.T @ off)
    along = off @ axes[:, -1]
    chosen = [int(np.argmin(np.abs(along - np.quantile(along, share)))) for share in ENDS]
    return replace(samples, spectra=np.clip(spectra[chosen], 0.0, 1.0),
                   coefficients=samples.coefficients[chosen], variables=None)


def apart_nm(pair: SpectrumSamples) -> float:
    """Where a reading tells two spectra apart best."""
    return float(pair.grid.nm[np.abs(pair.spectra[0] - pair.spectra[1]).argmax()])


def under_lights(pair: SpectrumSamples) -> tuple[np.ndarray, np.ndarray]:
    """Colours (L, 2, 3) of two spectra under each of ``LIGHTS``, encoded sRGB adapted to D65 by
    Bradford, and their CIEDE2000 (L,) there.
    """
    colours, differences = [], []
    for name in LIGHTS:
        weights, adapted = colour_weights(name, tuple(pair.grid.nm.tolist()))
        lab = appearance.lab_from_xyz(pair.spectra @ weights.T, weights.sum(axis=1))
        differences.append(float(appearance.ciede2000(lab[0], lab[1])))
        colours.append([appearance.encoded_srgb(adapted @ one) for one in pair.spectra])
    return np.array(colours), np.array(differences)


@functools.cache
def colour_weights(light: str, nm: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Weights (3, P) of X, Y, Z under a light, and of what looks alike under D65.

    Parameters
    ----------
    light : str
        CIE name.
    nm : tuple of P floats
        Ascending.
    """
    return appearance.tristimulus_weights(np.array(nm), light), appearance.adapted_tristimulus(
        np.array(nm), light)


# ---- two surfaces of the same photos beside each other -------------------------------------------

DRAWS = 1000            # of each colour
SEED = 1                    # of the draws
PAIRS = 2000            # of draws; the error of a standard deviation is 2 % of it
BY_CHANCE = 0.01        # how often two areas of one colour are told apart
COMPARED_ENDS = (0.025, 0.975)       # of the pairs' colour differences


class Colour(NamedTuple):
    """A colour value, or a spectrum, with its standard error."""

    value: np.ndarray
    standard_error: np.ndarray


class ColourDifference(NamedTuple):
    """A CIEDE2000 with the ends of its 95 % interval.

    Differences are never negative, so that plus and minus of two like colours would say nothing.
    """

    value: float
    lower: float
    upper: float


@dataclass(frozen=True, eq=False)
class ColourComparison:
    """How two surfaces of the same photos differ.

    Errors that both share, of white and of the camera's curves above all, are counted once: two
    areas of one paint do not differ by them. What remains is noise, the light from place to place,
    gloss, and what the camera cannot see: it may be that two surfaces are metamers, which look
    alike to the camera and not to the eye.

    Attributes
    ----------
    nm : (P,) array
        400, 405 ... 700 nm.
    means : (2, P) array
        Mean reflectance of each.
    draws : (2, T, P) array
        Pairs of spectra that belong together, for what else is to be computed of the difference.
    difference : float
        Of the signals, in its standard errors (Mahalanobis).
    limit : float
        That chance exceeds in 1 % of pairs of areas of one colour.

    References
    ----------
    Which errors surfaces share: `CAUSES` of radiometry/error_model.py.

    Examples
    --------
    >>> result = sb.flat("painting/photos/painting.dng", {"wall": (986, 462, 1073, 537),
    ...                                                   "meadow": (649, 524, 824, 624)})
    >>> both = result.compare("wall", "meadow")
    >>> print(both.sentence)
    >>> difference, lower, upper = both.delta_e("A")
    >>> both.spectrum.value, both.spectrum.standard_error
    """

    nm: np.ndarray
    means: np.ndarray
    draws: np.ndarray
    difference: float
    limit: float

    @property
    def distinct(self) -> bool:
        """Whether the camera tells them apart."""
        return self.difference > self.limit

    @property
    def finding(self) -> Finding:
        """Whether the camera tells them apart, and by how much."""
        return Finding("colours.distinct" if self.distinct else "colours.alike", Severity.INFO,
                       values={"value": self.difference, "needed": self.limit})

    @property
    def sentence(self) -> str:
        """The same for a person."""
        return texts.sentence(self.finding)

    @property
    def spectrum(self) -> Colour:
        """The first reflectance less the second: ``value`` and ``standard_error``, (P,) each."""
        return Colour(self.means[0] - self.means[1], (self.draws[0] - self.draws[1]).std(axis=0))

    def lab(self, light: str = "D65") -> Colour:
        """L*, a*, b* of the first less those of the second under a light, 2 degree observer.

        Parameters
        ----------
        light : str
            CIE name: D65, A, FL11, LED-B3.

        Returns
        -------
        Colour
            ``value`` (3,) and ``standard_error`` (3,).

        Raises
        ------
        InputError
            If no light of that name is published.
        """
        first, second = self._labs(self.means, light)
        drawn, others = self._labs(self.draws, light)
        return Colour(first - second, (drawn - others).std(axis=0))

    def delta_e(self, light: str = "D65") -> ColourDifference:
        """CIEDE2000 between the means of both under a light, and the interval that holds 95 % of
        the differences between spectra that give these signals.

        Parameters
        ----------
        light : str
            CIE name: D65, A, FL11, LED-B3.

        Returns
        -------
        ColourDifference
            ``value``, ``lower`` and ``upper``. Of colours that the camera cannot tell apart
            ``lower`` is 0, since they may be one, and ``upper`` is how far metamers and gloss may
            take them apart.

        Raises
        ------
        InputError
            If no light of that name is published.
        """
        drawn = appearance.ciede2000(*self._labs(self.draws, light))
        lower, upper = np.quantile(drawn, COMPARED_ENDS)
        return ColourDifference(float(appearance.ciede2000(*self._labs(self.means, light))),
                                float(lower) if self.distinct else 0.0, float(upper))

    def srgb(self, light: str) -> np.ndarray:
        """Encoded sRGB (2, 3), 0 to 1, of what looks alike under D65.

        Parameters
        ----------
        light : str
            CIE name: D65, A, FL11, LED-B3.

        Returns
        -------
        (2, 3) array
        """
        _, adapted = colour_weights(light, tuple(self.nm.tolist()))
        return np.array([appearance.encoded_srgb(adapted @ mean) for mean in self.means])

    def _labs(self, spectra: np.ndarray, light: str) -> np.ndarray:
        weights, _ = colour_weights(light, tuple(self.nm.tolist()))
        return appearance.lab_from_xyz(spectra @ weights.T, weights.sum(axis=1))

    def __repr__(self) -> str:
        lightness, a, b = self.lab().value
        value, lower, upper = self.delta_e()
        return (f"<ColourComparison: the first less the second L*a*b* {lightness:+.1f} {a:+.1f} "
                f"{b:+.1f}, dE00 {value:.1f} (95 %: {lower:.1f} to {upper:.1f}) under D65. "
                f"{self.sentence}>")


def compare_colours(signals: Sequence[SurfaceSignals], posteriors: Sequence[SignalPosterior]
                    ) -> ColourComparison:
    """Compare two surfaces of the same photos.

    Parameters
    ----------
    signals : two SurfaceSignals
        Of each surface alone.
    posteriors : two SignalPosterior
        Every spectrum behind each signal.

    Raises
    ------
    CheckError
        If no band shows both.
    ConvergenceError
        If draws do not reach a signal.
    """
    difference, limit = signal_difference(*signals)
    seen, covariance = _joint_covariance(signals)
    drawn_with_gloss = [posterior.draws_with_variables(DRAWS, SEED + number)
                        for number, posterior in enumerate(posteriors)]
    coarse = interpolation_matrix(PRIOR_GRID.nm, signals[0].grid.nm)
    errors = []
    for (draws, gloss), own in zip(drawn_with_gloss, signals, strict=True):
        expected = draws @ (own.response[seen] @ coarse).T
        if gloss is not None:
            expected += gloss @ own.states[0].pattern[seen].T
        errors.append(own.signal[0, seen] - expected)
    pairs = _pairs(errors[0], errors[1], covariance, np.random.default_rng(SEED))
    drawn = np.array([draws[chosen] for (draws, _), chosen
                      in zip(drawn_with_gloss, pairs, strict=True)])
    return ColourComparison(PRIOR_GRID.nm, np.array([posterior.mean for posterior in posteriors]),
                            drawn, difference, limit)


def signal_difference(first: SurfaceSignals, second: SurfaceSignals) -> tuple[float, float]:
    """How far the signals of two surfaces differ, and the ``limit`` of a ``ColourComparison``.

    Parameters
    ----------
    first, second : SurfaceSignals
        Of each surface alone.

    Raises
    ------
    CheckError
        If no band shows both.
    """
    seen, covariance = _joint_covariance((first, second))
    step = np.hstack([np.eye(seen.size), -np.eye(seen.size)])
    apart = first.signal[0, seen] - second.signal[0, seen]
    spread = step @ covariance @ step.T
    for signals, sign in ((first, 1), (second, -1)):
        for states in signals.states:
            pattern = states.pattern[seen]
            apart -= sign * pattern @ states.mean
            spread += pattern @ states.covariance @ pattern.T
    squared = apart @ np.linalg.solve(spread, apart)
    return float(np.sqrt(squared)), float(np.sqrt(chdtri(seen.size, BY_CHANCE)))


def _joint_covariance(signals: Sequence[SurfaceSignals]) -> tuple[np.ndarray, np.ndarray]:
    """Indices (J,) of the bands that show both surfaces, and the covariance (2 J, 2 J) of both
    signals there, without what their gloss adds.

    An error that both share acts on both by the symmetric root of its covariance: exact where the
    signals are in proportion to each other, as of two areas of nearly one colour.
    """
    seen = np.flatnonzero(np.isfinite([own.signal[0] for own in signals]).all(axis=0))
    if not seen.size:
        raise errors.CheckError("no band shows both colours: compare colours of one photo")
    count = seen.size
    joint = np.zeros((2 * count, 2 * count))
    for cause in signals[0].errors:
        own = [each.errors[cause][0][np.ix_(seen, seen)] for each in signals]
        joint[:count, :count] += own[0]
        joint[count:, count:] += own[1]
        if error_model.CAUSES[cause].surfaces:
            cross = symmetric_root(own[0]) @ symmetric_root(own[1])
            joint[:count, count:] += cross
            joint[count:, :count] += cross.T
    return seen, symmetric(joint)


def _pairs(first: np.ndarray, second: np.ndarray, covariance: np.ndarray,
           rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Indices of draws of both colours that belong together, given the errors (T, J) of the signals
    that each draw implies: importance sampling among all T x T pairs.

    Each draw follows its own likelihood; a pair has the weight of both errors together.
    """
    count = first.shape[1]
    precision = np.linalg.inv(covariance)
    own = [precision[part, part] - np.linalg.inv(covariance[part, part])
           for part in (slice(count), slice(count, None))]
    log = -0.5 * (np.einsum("tj,jk,tk->t", first, own[0], first)[:, None]
                  + np.einsum("tj,jk,tk->t", second, own[1], second)
                  ) - first @ precision[:count, count:] @ second.T
    cumulative = np.cumsum(np.exp(log - log.max()).ravel())
    chosen = np.searchsorted(cumulative, rng.uniform(size=PAIRS) * cumulative[-1])
    return chosen // len(second), chosen % len(second)
