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

from spectrabox.sampling.prior.families.coatings import tiles, whites
from spectrabox.sampling.prior.families.dyes import plastic, textile
from spectrabox.sampling.prior.families.leaves import leaves, petals
from spectrabox.sampling.prior.families.natural_materials import animals, soils, woods
from spectrabox.sampling.prior.families.plant_tissue import green_tissue, petal_tissue
from spectrabox.sampling.prior.families.printing import paper
from spectrabox.sampling.prior.families.skin import skin, skin_by_absorbance, skin_in_two_fluxes

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
    "paint": Family(0.50, 12, 0.02, {}),    # measured, and mixtures of those measured
    "textile": Family(0.12, 8, 0.02, {textile: 1500, paper: 1200, plastic: 1200}),
    "leaves": Family(0.12, 4, 0.01, {leaves: 1500, petals: 1500}, 20,
                     {green_tissue: 1500, petal_tissue: 3000}),
    "skin": Family(0.10, 5, 0.01, {skin: 1500, skin_in_two_fluxes: 1500,
                                   skin_by_absorbance: 1000}),
    "white": Family(0.05, 2, 0.02, {whites: 1500, tiles: 1500}),
    "earth": Family(0.07, 2, 0.02, {soils: 1500, woods: 1500}),
    "animal": Family(0.04, 2, 0.02, {animals: 1500}),
}
MIXTURES = 3000                     # of measured paints
