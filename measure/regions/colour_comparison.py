"""Two colours of one photo beside each other: how far apart they look, and whether the camera sees
a difference.

Surfaces of one photo share most errors of their signals: the white level, the camera's curves,
the veil. What they share (``error_model.CAUSES``) is counted once, so that two areas of one paint
do not differ by it. Each has a gloss of its own.
"""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from spectrabox.measure.regions.flat_signals import RegionSignal
from spectrabox.measure.surfaces.metamers import LIGHTS, colour_weights
from spectrabox.radiometry.appearance import ciede2000, encoded_srgb, lab_from_xyz
from spectrabox.radiometry.covariance import symmetric, symmetric_root
from spectrabox.radiometry.error_model import CAUSES
from spectrabox.radiometry.errors import CheckError
from spectrabox.radiometry.grid import interpolation_matrix
from spectrabox.sampling.prior.mixture import PRIOR_GRID

DRAWS = 1000            # of each colour
SEED = 1                    # of the draws
PAIRS = 2000            # of draws; the error of a standard deviation is 2 % of it
BY_CHANCE = 0.01        # how often two areas of one colour are told apart


@dataclass(frozen=True, eq=False)
class ColourComparison:
    """How two colours A and B differ.

    ``spectra`` (2, 61) are their mean reflectances on the prior's wavelengths; ``srgb`` (L, 2, 3)
    their colours under each of ``LIGHTS``, adapted to D65 by Bradford; ``delta_e00`` (L,) the
    CIEDE2000 between their means, with ``standard_error`` (L,). ``difference`` is that of their
    signals in its standard errors (Mahalanobis), and ``limit`` the one that chance exceeds in 1 %
    of pairs of areas of one colour.
    """

    spectra: np.ndarray
    srgb: np.ndarray
    delta_e00: np.ndarray
    standard_error: np.ndarray
    difference: float
    limit: float

    @property
    def distinct(self) -> bool:
        """Whether the camera tells them apart."""
        return self.difference > self.limit

    @property
    def sentence(self) -> str:
        """Whether the camera tells them apart, and by how much."""
        if self.distinct:
            return ("The camera tells these colours apart: their signals differ by "
                    f"{self.difference:.1f} standard errors ({self.limit:.1f} are needed).")
        return ("The camera cannot tell these colours apart: their signals differ by "
                f"{self.difference:.1f} standard errors, and {self.limit:.1f} are needed. Under "
                "another light they may still look different.")


def compare_colours(first: RegionSignal, second: RegionSignal, families: Sequence[Sequence[str]]
                    ) -> ColourComparison:
    """Compare the colours of two regions of the same photos.

    Parameters
    ----------
    first, second : RegionSignal
    families : two sequences of str
        That each is said to be of; none for any.

    Raises
    ------
    CheckError
        If no band shows both.
    ConvergenceError
        If draws do not reach a signal.
    """
    regions = (first, second)
    difference, limit = signal_difference(first, second)
    seen, covariance = _joint_covariance(regions)
    posteriors = [region.posterior(own) for region, own in zip(regions, families, strict=True)]
    drawn_with_gloss = [posterior.draws_with_variables(DRAWS, SEED + number)
                        for number, posterior in enumerate(posteriors)]
    spectra = [draws for draws, _ in drawn_with_gloss]
    coarse = interpolation_matrix(PRIOR_GRID.nm, first.signals.grid.nm)
    errors = []
    for (draws, gloss), region in zip(drawn_with_gloss, regions, strict=True):
        signals = draws @ (region.signals.response[seen] @ coarse).T
        if gloss is not None:
            signals += gloss @ region.signals.states[0].pattern[seen].T
        errors.append(region.signals.signal[0, seen] - signals)
    pairs = _pairs(errors[0], errors[1], covariance, np.random.default_rng(SEED))
    drawn = [own[chosen] for own, chosen in zip(spectra, pairs, strict=True)]
    srgb, delta, spread = [], [], []
    for light in LIGHTS:
        weights, adapted = colour_weights(light, tuple(PRIOR_GRID.nm.tolist()))
        white = weights.sum(axis=1)
        srgb.append([encoded_srgb(adapted @ posterior.mean) for posterior in posteriors])
        delta.append(ciede2000(*(lab_from_xyz(posterior.mean @ weights.T, white)
                                 for posterior in posteriors)))
        spread.append(ciede2000(*(lab_from_xyz(own @ weights.T, white) for own in drawn)).std())
    return ColourComparison(np.array([posterior.mean for posterior in posteriors]), np.array(srgb),
                            np.array(delta), np.array(spread), difference, limit)


def signal_difference(first: RegionSignal, second: RegionSignal) -> tuple[float, float]:
    """How far the signals of two regions differ, and the ``limit`` of a ``ColourComparison``.

    Parameters
    ----------
    first, second : RegionSignal

    Raises
    ------
    CheckError
        If no band shows both.
    """
    seen, covariance = _joint_covariance((first, second))
    step = np.hstack([np.eye(seen.size), -np.eye(seen.size)])
    apart = first.signals.signal[0, seen] - second.signals.signal[0, seen]
    spread = step @ covariance @ step.T
    for region, sign in ((first, 1), (second, -1)):
        for states in region.signals.states:
            pattern = states.pattern[seen]
            apart -= sign * pattern @ states.mean
            spread += pattern @ states.covariance @ pattern.T
    squared = apart @ np.linalg.solve(spread, apart)
    return float(np.sqrt(squared)), float(np.sqrt(chdtri(seen.size, BY_CHANCE)))


def _joint_covariance(regions: Sequence[RegionSignal]) -> tuple[np.ndarray, np.ndarray]:
    """Indices (J,) of the bands that show both regions, and the covariance (2 J, 2 J) of both
    signals there, without what their gloss adds.

    An error that both share acts on both by the symmetric root of its covariance: exact where the
    signals are in proportion to each other, as of two areas of nearly one colour.
    """
    seen = np.flatnonzero(np.isfinite([region.signals.signal[0] for region in regions]).all(axis=0))
    if not seen.size:
        raise CheckError("no band shows both colours: compare colours of one photo")
    count = seen.size
    joint = np.zeros((2 * count, 2 * count))
    for errors in zip(*(region.signals.errors for region in regions), strict=True):
        own = [error.covariance[0][np.ix_(seen, seen)] for error in errors]
        joint[:count, :count] += own[0]
        joint[count:, count:] += own[1]
        if CAUSES[errors[0].cause].surfaces:
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
