"""Whites, greys, pale tints: tiles, plaster, primer, paper without brightener, unbleached bodies.

K / S is small and of four parts: a constant (dirt, black: nm^0 to nm^-0.5), an exponential tail of
yellowing (iron in clay, oxidised binder, lignin; exp(-(nm - 400) / s), s 30 to 120 nm), an
absorption edge in the violet (rutile at 3.0 eV, anatase at 3.2 eV, zinc oxide at 3.2 eV, or none:
chalk, barium sulphate, zircon glazes, PTFE), and a weak tint. Band gaps: Strehlow and Cook, J.
Phys. Chem. Ref. Data 2 (1973) 163. A glaze reflects 4 % at its surface.
"""
from __future__ import annotations

import numpy as np

from spectrabox.sampling.prior.families.dyes import dyes
from spectrabox.sampling.prior.families.kubelka_munk import (
    ENERGY,
    behind_surface,
    chance,
    log_uniform,
    reflectance_of,
    uniform,
)
from spectrabox.sampling.prior.mixture import PRIOR_GRID


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
