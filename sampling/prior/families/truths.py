"""Reflectances to test a prior with: made by the families' models, not by the fitted mixture.

A mixture of normals is fitted to the models' curves and smooths them; truths that come from the
models themselves are unlike its draws, as a real surface is. No measured curve ships, so that the
pigments that paints are mixed of are draws of the mixture, and one paint in two is a mixture of
such, let down with white and black.
"""
from __future__ import annotations

import numpy as np

from spectrabox.sampling.prior.families.coatings import pigment_mixtures
from spectrabox.sampling.prior.families.family_models import FAMILIES
from spectrabox.sampling.prior.mixture import LogitMixture, reflectance

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
    mixed = pigment_mixtures(rng, count, pigments)
    return np.asarray(np.where(rng.random((count, 1)) < MIXED, mixed, pigments[:count]))
