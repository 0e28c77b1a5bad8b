"""The families of surfaces that the shipped prior is made of: models, share and size of each.

The shares are those of surfaces in front of a camera as far as anybody knows them: paint and print
most, then cloth and plastic, plants, skin. They weigh families against each other where a signal
allows several; bands are calibrated for whatever they are. Numbers of components, and how much of
the smoothness prior each component is widened by, were chosen on the training libraries left out
in turn (models/surface_families.md).
"""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from spectrabox.sampling.prior.families import layered, made_materials
from spectrabox.sampling.prior.families.leaves import green_tissue, leaves, petal_tissue, petals
from spectrabox.sampling.prior.mixture import LogitMixture, reflectance

Model = Callable[[np.random.Generator, int], np.ndarray]


@dataclass(frozen=True)
class Family:
    """One kind of surface in the mixture."""

    share: float                    # prior probability
    components: int
    smooth: float                   # share of the smoothness prior's covariance in each component
    models: dict[Model, int]        # and how many reflectances each makes for training
    # Where the family is stated, a mixture of its own takes the place of the components above: of
    # this many, fitted to these models too. 0 for none.
    stated_components: int = 0
    stated_models: dict[Model, int] = field(default_factory=dict)


FAMILIES = {
    "paint":
    Family(0.50, 12, 0.02, {}),  # measured, and mixtures of those measured
    "textile":
    Family(
        0.12, 8, 0.02,
        {made_materials.textile: 1500, made_materials.paper: 1200, made_materials.plastic: 1200}),
    "leaves":
    Family(0.12, 4, 0.01, {leaves: 1500, petals: 1500}, 20,
           {green_tissue: 1500, petal_tissue: 3000}),
    "skin":
    Family(
        0.10, 5, 0.01,
        {layered.skin: 1500, layered.skin_in_two_fluxes: 1500, layered.skin_by_absorbance: 1000}),
    "white":
    Family(0.05, 2, 0.02, {made_materials.whites: 1500, made_materials.tiles: 1500}),
    "earth":
    Family(0.07, 2, 0.02, {layered.soils: 1500, layered.woods: 1500}),
    "animal":
    Family(0.04, 2, 0.02, {layered.animals: 1500}),
}
MIXTURES = 3000                     # of measured paints


# ---- truths --------------------------------------------------------------------------------------
# Reflectances to test a prior with: made by the families' models, not by the fitted mixture.
#
# A mixture of normals is fitted to the models' curves and smooths them; truths that come from the
# models themselves are unlike its draws, as a real surface is. No measured curve ships, so that the
# pigments that paints are mixed of are draws of the mixture, and one paint in two is a mixture of
# such, let down with white and black.

MIXED = 0.5              # of the truths of families that have measured curves alone


def true_reflectances(prior: LogitMixture, count: int, rng: np.random.Generator) -> np.ndarray:
    """Reflectances (count, 61) of the prior's families, by their weights.

    Parameters
    ----------
    prior : LogitMixture
        Of all families, or of those that were stated.
    count : int
    rng : numpy.random.Generator
    """
    shares = prior.shares(prior.weights[None] / prior.weights.sum())[0]
    chosen = rng.choice(len(shares), size=count, p=shares / shares.sum())
    truths = np.empty((count, prior.means.shape[1]))
    for number in np.unique(chosen):
        mine = np.flatnonzero(chosen == number)
        family = FAMILIES[prior.families[number]]
        models = family.models | (family.stated_models if prior.stated else {})
        if not models:
            truths[mine] = _paints(prior, int(number), mine.size, rng)
            continue
        sizes = np.array(list(models.values()), dtype=float)
        of_model = rng.choice(len(models), size=mine.size, p=sizes / sizes.sum())
        for index, model in enumerate(models):
            rows = mine[of_model == index]
            if rows.size:
                truths[rows] = model(rng, rows.size)
    return truths


def _paints(prior: LogitMixture, family: int, count: int, rng: np.random.Generator) -> np.ndarray:
    """Paints (count, 61): draws of the family's components, and mixtures of such."""
    own = np.flatnonzero(prior.family == family)
    chosen = rng.choice(own, size=4 * count, p=prior.weights[own] / prior.weights[own].sum())
    logits = np.empty((4 * count, prior.means.shape[1]))
    for index in np.unique(chosen):
        rows = np.flatnonzero(chosen == index)
        logits[rows] = rng.multivariate_normal(prior.means[index],
                                               prior.covariances[index].astype(float), rows.size)
    pigments = reflectance(logits)
    mixed = made_materials.pigment_mixtures(rng, count, pigments)
    return np.asarray(np.where(rng.random((count, 1)) < MIXED, mixed, pigments[:count]))
