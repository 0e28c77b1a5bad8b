"""Paints: pigments mixed with white, black and each other.

K / S of a mixture is the sum of its pigments' K / S, weighted by their amounts (Duncan, Proc. Phys.
Soc. 52 (1940) 390), relative to the scattering of the white that most paints are let down with. The
pigments are measured ones, given as an argument: no measured curve ships. White is rutile, whose
absorption edge at 3.0 eV is what bends paints between 400 and 420 nm; black absorbs as nm^-0.3.
Measured curves hold a surface already; a glossy one comes on top with a chance of one half, more or
less of it (k1 -0.02 to 0.04).
"""
from __future__ import annotations

import numpy as np

from spectrabox.sampling.prior.families.dyes import rutile_absorption
from spectrabox.sampling.prior.families.kubelka_munk import (
    absorption_of,
    chance,
    log_uniform,
    reflectance_of,
    uniform,
)
from spectrabox.sampling.prior.mixture import EDGE, PRIOR_GRID

DARK = 0.02     # reflectance below which a measured K / S says more of the surface than the pigment


def pigment_mixtures(rng: np.random.Generator, count: int, pigments: np.ndarray) -> np.ndarray:
    """Reflectances (count, 61) of mixtures of measured pigments (n, 61) with white and black."""
    measured = absorption_of(np.clip(pigments, DARK, 1 - EDGE))
    strength = measured / measured.max(axis=1, keepdims=True)

    def some() -> np.ndarray:
        amount = log_uniform(rng, 0.02, 20, count)
        return np.asarray(amount * strength[rng.integers(len(strength), size=count)])

    total = some() + chance(rng, 0.5, count) * some()
    total += chance(rng, 0.7, count) * log_uniform(rng, 0.05, 1, count) * rutile_absorption(rng,
                                                                                           count)
    total += chance(rng, 0.3, count) * log_uniform(rng, 0.01, 3, count) * (
        PRIOR_GRID.nm / 550)**-0.3
    inside = reflectance_of(total + uniform(rng, 0.001, 0.02, count))
    gloss = chance(rng, 0.5, count) * uniform(rng, -0.02, 0.04, count)
    return np.maximum((1 - gloss) * inside + gloss, EDGE)
