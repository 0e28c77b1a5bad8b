"""Wood, soil and stone: absorption that falls from blue to red, with the bands of iron.

Soil and stone: K / S of goethite, with bands at 425, 480 and 650 nm, and of haematite, at 445, 530
and 650 nm, whose edges lie near 500 and 580 nm (Scheinost, Chavernas, Barron and Torrent, Clays and
Clay Minerals 46 (1998) 528), humus exp(-(nm - 400) / s) with s 100 to 400 nm, and a neutral part;
water darkens by multiplying K / S.

Wood, bark, straw, cork, cardboard: lignin and its quinones, exp(-(nm - 400) / s), s 50 to 150 nm
(Schmidt and Heitner, Tappi J. 76 (1993) 117), tannins, and greying by the weather.
"""
from __future__ import annotations

import numpy as np

from spectrabox.sampling.prior.families.kubelka_munk import (
    EV_NM,
    band,
    chance,
    log_uniform,
    reflectance_of,
    uniform,
)
from spectrabox.sampling.prior.mixture import PRIOR_GRID


def soils(rng: np.random.Generator, count: int) -> np.ndarray:
    """Reflectances (count, 61) of soils, stones, bricks and ochres."""
    goethite = (band(EV_NM / 425, 0.30) + uniform(rng, 0.4, 0.8, count) * band(EV_NM / 480, 0.13)
                + uniform(rng, 0.02, 0.08, count) * band(EV_NM / 650, 0.12))
    haematite = (band(EV_NM / 445, 0.40)
                 + uniform(rng, 0.6, 1.0, count) * band(EV_NM / (530 + uniform(rng, -6, 10, count)),
                                                        0.13)
                 + uniform(rng, 0.05, 0.15, count) * band(EV_NM / 650, 0.12))
    humus = np.exp(-(PRIOR_GRID.nm - 400) / uniform(rng, 100, 400, count))
    dirt = log_uniform(rng, 0.002, 4, count) * (PRIOR_GRID.nm / 550)**-uniform(rng, 0, 0.6, count)
    total = (log_uniform(rng, 0.01, 8, count) * goethite
             + chance(rng, 0.6, count) * log_uniform(rng, 0.01, 12, count) * haematite
             + chance(rng, 0.7, count) * log_uniform(rng, 0.02, 6, count) * humus + dirt)
    return _surface(rng, reflectance_of(total))


def woods(rng: np.random.Generator, count: int) -> np.ndarray:
    """Reflectances (count, 61) of wood, bark, straw, cork, cardboard and unbleached wool."""
    lignin = log_uniform(rng, 0.05, 6, count) * np.exp(
        -(PRIOR_GRID.nm - 400) / uniform(rng, 50, 150, count))
    tannin = chance(rng, 0.5, count) * log_uniform(rng, 0.02, 3, count) * np.exp(
        -(PRIOR_GRID.nm - 400) / uniform(rng, 100, 300, count))
    red = chance(rng, 0.4, count) * log_uniform(rng, 0.01, 0.6, count) * band(
        EV_NM / uniform(rng, 460, 540, count), uniform(rng, 0.12, 0.3, count))
    dirt = log_uniform(rng, 0.002, 1.5, count) * (PRIOR_GRID.nm / 550)**-uniform(rng, 0, 0.5, count)
    return _surface(rng, reflectance_of(lignin + tannin + red + dirt))


def _surface(rng: np.random.Generator, inside: np.ndarray) -> np.ndarray:
    gloss = uniform(rng, 0, 0.04, len(inside))
    return (1 - gloss) * inside + gloss
