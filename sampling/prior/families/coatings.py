"""Coatings: whites, greys and pale tints; paints.

Whites, greys, pale tints: tiles, plaster, primer, paper without brightener, unbleached bodies.

K / S is small and of four parts: a constant (dirt, black: nm^0 to nm^-0.5), an exponential tail of
yellowing (iron in clay, oxidised binder, lignin; exp(-(nm - 400) / s), s 30 to 120 nm), an
absorption edge in the violet (rutile at 3.0 eV, anatase at 3.2 eV, zinc oxide at 3.2 eV, or none:
chalk, barium sulphate, zircon glazes, PTFE), and a weak tint. Band gaps: Strehlow and Cook, J.
Phys. Chem. Ref. Data 2 (1973) 163. A glaze reflects 4 % at its surface.

Paints: pigments mixed with white, black and each other.

K / S of a mixture is the sum of its pigments' K / S, weighted by their amounts (Duncan, Proc. Phys.
Soc. 52 (1940) 390), relative to the scattering of the white that most paints are let down with. The
pigments are measured ones, given as an argument: no measured curve ships. White is rutile, whose
absorption edge at 3.0 eV is what bends paints between 400 and 420 nm; black absorbs as nm^-0.3.
Measured curves hold a surface already; a glossy one comes on top with a chance of one half, more or
less of it (k1 -0.02 to 0.04).
"""
from __future__ import annotations

import numpy as np

from spectrabox.sampling.prior.families.dyes import dyes, rutile_absorption
from spectrabox.sampling.prior.families.kubelka_munk import (
    ENERGY,
    absorption_of,
    behind_surface,
    chance,
    log_uniform,
    reflectance_of,
    uniform,
)
from spectrabox.sampling.prior.mixture import EDGE, PRIOR_GRID


def whites(rng: np.random.Generator, count: int) -> np.ndarray:
    """Reflectances (count, 61) of white, grey and pale matt surfaces."""
    return reflectance_of(_absorption(rng, count))


def tiles(rng: np.random.Generator, count: int) -> np.ndarray:
    """Reflectances (count, 61) of glazed and lacquered ones, the gloss measured or shut out."""
    entering = chance(rng, 0.5, count) * uniform(rng, 0.03, 0.05, count)
    return behind_surface(reflectance_of(_absorption(rng, count) / 4), entering,
                          uniform(rng, 0.4, 0.6, count))


def _absorption(rng: np.random.Generator, count: int) -> np.ndarray:
    nm = PRIOR_GRID.nm
    dirt = log_uniform(rng, 0.0005, 1.5, count) * (nm / 550)**-uniform(rng, 0, 0.5, count)
    yellow = log_uniform(rng, 0.001, 0.3, count) * np.exp(
        -(nm - 400) / uniform(rng, 30, 120, count))
    gap = 3.02 + 0.2 * chance(rng, 0.4, count) + uniform(rng, -0.03, 0.03, count)
    edge = chance(rng, 0.6, count) * log_uniform(rng, 0.2, 3, count) * np.exp(
        np.minimum((ENERGY - gap) / uniform(rng, 0.025, 0.07, count), 0))
    tint = chance(rng, 0.5, count) * dyes(rng, count, 0.3)
    return dirt + yellow + edge + tint + 1e-4


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
