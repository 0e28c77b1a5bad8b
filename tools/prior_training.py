"""Training of the learnt prior: families of surfaces, each a mixture of its own.

A family is fitted to its measured libraries and to reflectances made by its models
(sampling/prior/families/). Collections are small next to the colours that occur, so four times as
many spectra are made from the measured ones: geometric means of two (mixtures of two dyes), powers
from 1/2 to 2 (thinner and thicker layers, as in the law of Beer and Lambert), products of two
powers (a layer over another body) and shifts by about 12 nm (related dyes). Paints are also mixed
by their K / S. Every component is widened by a little of the smoothness prior. Training libraries
left out in turn decided how much of each. See prior_calibration.py for what makes the bands hold.
"""
from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.sampling.prior.families.family_models import FAMILIES, MIXTURES, Family
from spectrabox.sampling.prior.families.made_materials import pigment_mixtures
from spectrabox.sampling.prior.libraries import without_near_duplicates
from spectrabox.sampling.prior.mixture import (
    EDGE,
    PRIOR_GRID,
    LogitMixture,
    logit,
    smooth_covariance,
)

DIRECTIONS = 10
# variance added to the components and to every logit: what the sets do not show
RIDGE, FLOOR = 3e-3, 5e-4
MADE = 4                        # spectra made of the measured ones, per measured one
MIN_CURVES = 200
MAX_OF_LIBRARY = 500    # curves, so that no collection outvotes the others
LEVELS = np.array([0.5, 0.8, 0.9, 0.95, 0.99])
SHIFT_NM = 12.5
# of bands before calibration, for how wide they are: chosen on the libraries left out in turn
WIDTH_POWER = -0.3
MIXED = "mixed"                 # in place of a family: surfaces of several
Library = tuple[str, np.ndarray]        # its name, and measured reflectances (n, 61)


@dataclass(frozen=True)
class Part:
    """A library or a model, as one of the things that a family is fitted to."""

    name: str
    family: str
    measured: bool
    mixed: bool                 # of surfaces of several families; fitted with the paints
    stated: bool                # fitted and judged only where the family is stated
    curves: np.ndarray          # (n, 61) that are fitted
    judged: np.ndarray          # (m, 61) that bands are judged on where the part is left out


@dataclass(frozen=True)
class Fitted:
    """Mixtures of families by name: as parts of the whole, and of some where they are stated."""

    plain: dict[str, LogitMixture]
    stated: dict[str, LogitMixture]


def fitted_families(parts: Sequence[Part], families: dict[str, Family], seed: int) -> Fitted:
    """The mixtures of each family that has parts.

    Parameters
    ----------
    parts : sequence of Part
    families : dict of Family
        By name.
    seed : int

    Raises
    ------
    InputError
        For too few curves.
    """
    fitted = Fitted({}, {})
    for name, family in families.items():
        mine = [part for part in parts if part.family == name]
        if plain := [part for part in mine if not part.stated]:
            fitted.plain[name] = fit_family(plain, family, seed)
        if mine and family.stated_components:
            fitted.stated[name] = fit_family(mine, family, seed, family.stated_components)
    return fitted


def fit_family(parts: Iterable[Part], family: Family, seed: int,
               components: int | None = None) -> LogitMixture:
    """The mixture of one family, of as many components as it has where none are given.

    Parameters
    ----------
    parts : iterable of Part
    family : Family
    seed : int
    components : int, optional

    Raises
    ------
    InputError
        For fewer than 200 curves.
    """
    parts = list(parts)
    curves = [enriched(balanced(part.curves, np.random.default_rng(seed)), seed) if part.measured
              else part.curves for part in parts]
    pigments = [part.curves for part in parts if part.family == "paint"]
    if pigments:
        curves.append(pigment_mixtures(np.random.default_rng(seed), MIXTURES,
                                       np.concatenate(pigments)))
    return fit_mixture(np.concatenate(curves), components or family.components, seed,
                       family.smooth)


def joined(fitted: Fitted, families: dict[str, Family], source: str = "") -> LogitMixture:
    """One mixture of those of several families, by their shares, and what takes the place of some
    where they are stated.

    Parameters
    ----------
    fitted : Fitted
    families : dict of Family
        With their shares.
    source : str
        What it was trained on.
    """
    names = tuple(fitted.plain)
    shares = np.array([families[name].share for name in names])
    ones = np.ones((len(names), LEVELS.size, PRIOR_GRID.nm.size))

    def together(mixtures: dict[str, LogitMixture]) -> LogitMixture:
        each = list(mixtures.values())
        return LogitMixture(PRIOR_GRID.nm, np.concatenate([one.weights for one in each]),
                            np.concatenate([one.means for one in each]),
                            np.concatenate([one.covariances for one in each]), names,
                            np.repeat([names.index(name) for name in mixtures],
                                      [one.weights.size for one in each]), LEVELS, ones, ones,
                            1.0, np.inf, WIDTH_POWER, source, uniform_level=True)
    plain = together(fitted.plain)
    return replace(plain, weights=plain.weights * (shares / shares.sum())[plain.family],
                   where_stated=together(fitted.stated) if fitted.stated else None)


def parts_of(libraries: dict[str, list[Library]], families: dict[str, Family], seed: int,
             judged: int) -> list[Part]:
    """Everything that a prior is fitted to: libraries by family, and what the models make.

    Parameters
    ----------
    libraries : lists of Library by the name of their family, or "mixed"
    families : with the models
    seed : int
        Of what the models make.
    judged : int
        Curves of each that bands are judged on.

    Raises
    ------
    InputError
        For a family that there is not.
    """
    rng, parts = np.random.default_rng(seed), []
    for family, listed in libraries.items():
        if family not in (*families, MIXED):
            raise InputError(f"{family!r} is no family of surfaces; known are "
                             f"{', '.join(families)} and {MIXED}")
        for library, curves in listed:
            parts.append(Part(library, "paint" if family == MIXED else family, True,
                              family == MIXED, False, without_near_duplicates(curves),
                              curves[rng.permutation(len(curves))[:judged]]))
    for stated in (False, True):
        for name, one in families.items():
            for model, count in (one.stated_models if stated else one.models).items():
                curves = np.clip(model(rng, count + judged), EDGE, 1 - EDGE)
                parts.append(Part(model.__name__, name, False, False, stated, curves[:count],
                                  curves[count:]))
    return parts


def balanced(reflectances: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """At most 500 curves of a library; one with fewer than 250 counts up to three times.

    Parameters
    ----------
    reflectances : (n, 61) array
    rng : numpy.random.Generator
    """
    if len(reflectances) > MAX_OF_LIBRARY:
        return reflectances[rng.permutation(len(reflectances))[:MAX_OF_LIBRARY]]
    times = min(3, MAX_OF_LIBRARY // 2 // len(reflectances) + 1)
    return np.concatenate([reflectances] * times)


def enriched(reflectances: np.ndarray, seed: int = 0) -> np.ndarray:
    """The curves (n, 61) and four times as many made of them: mixtures, powers, shifts and layers,
    a quarter each.

    Parameters
    ----------
    reflectances : (n, 61) array
    seed : int
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
    shifted = np.array([np.interp(PRIOR_GRID.nm + shift, PRIOR_GRID.nm, curve)
                        for shift, curve in zip(rng.normal(0, SHIFT_NM, share), some(),
                                                strict=True)])
    return np.concatenate([reflectances, mixed, some()**power(0.5, 2), shifted, layered])


def fit_mixture(reflectances: np.ndarray, components: int = FAMILIES["paint"].components,
                seed: int = 0, smooth: float = FAMILIES["paint"].smooth) -> LogitMixture:
    """The mixture of reflectances, of one family, not yet calibrated: all band factors are 1.

    Ten principal directions of the logit with full covariances; the rest is taken for noise.

    Parameters
    ----------
    reflectances : (n, 61) array
    components : int
        C.
    seed : int
        Of the mixture's start.
    smooth : float
        Share of the smoothness prior's covariance that is added to every component.

    Raises
    ------
    InputError
        For fewer than 200 reflectances, or others than on the grid.
    """
    from sklearn.mixture import GaussianMixture  # takes half a second to import

    if reflectances.ndim != 2 or reflectances.shape[1] != PRIOR_GRID.nm.size:
        raise InputError(f"training reflectances have shape {reflectances.shape}; (n, "
                         f"{PRIOR_GRID.nm.size}) is needed")
    if len(reflectances) < MIN_CURVES:
        raise InputError(f"{len(reflectances)} reflectances are too few to learn from; give at "
                         f"least {MIN_CURVES}")
    x = logit(reflectances)
    centre = x.mean(axis=0)
    directions = np.linalg.svd(x - centre, full_matrices=False)[2][:DIRECTIONS].T
    scores = (x - centre) @ directions
    rest = (np.cov(x - centre - scores @ directions.T, rowvar=False) + FLOOR
            * np.eye(PRIOR_GRID.nm.size)
            + smooth * smooth_covariance())
    mixture = GaussianMixture(components, reg_covar=RIDGE, random_state=seed,
                              max_iter=300).fit(scores)
    covariances = directions @ mixture.covariances_ @ directions.T + rest
    ones = np.ones((1, LEVELS.size, PRIOR_GRID.nm.size))
    return LogitMixture(PRIOR_GRID.nm, mixture.weights_ / mixture.weights_.sum(),
                        centre + mixture.means_ @ directions.T,
                        (covariances + covariances.transpose(0, 2, 1)) / 2, ("any",),
                        np.zeros(components), LEVELS, ones, ones, 1.0, np.inf, 0.0, "")
