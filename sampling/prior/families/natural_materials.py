"""Natural materials: wood, soil and stone; hair, fur, feathers, scales and shells.

Wood, soil and stone: absorption that falls from blue to red, with the bands of iron.

Soil and stone: K / S of goethite, with bands at 425, 480 and 650 nm, and of haematite, at 445, 530
and 650 nm, whose edges lie near 500 and 580 nm (Scheinost, Chavernas, Barron and Torrent, Clays and
Clay Minerals 46 (1998) 528), humus exp(-(nm - 400) / s) with s 100 to 400 nm, and a neutral part;
water darkens by multiplying K / S.

Wood, bark, straw, cork, cardboard: lignin and its quinones, exp(-(nm - 400) / s), s 50 to 150 nm
(Schmidt and Heitner, Tappi J. 76 (1993) 117), tannins, and greying by the weather.

Hair, fur, feathers, scales and shells: melanins, carotenoids and structure in keratin.

K / S of eumelanin falls as nm^-2.5 to nm^-4 and of pheomelanin as exp(-(nm - 400) / 60 to 100)
(Zonios, J. Biomed. Opt. 13 (2008) 014017; Riley, Int. J. Biochem. Cell Biol. 29 (1997) 1235).
Carotenoids of feathers and scales: three vibronic bands 0.17 eV apart, the lowest at 470 to 560 nm
(yellow to red), so that they end in a steep edge (Stradi, Int. J. Mol. Sci. 1998; Toral, Funct.
Ecol. 22 (2008) 1). Structure: a reflection peak, Gaussian in photon energy and 0.12 to 0.45 eV
wide, over melanin, as keratin and air scatter coherently (Prum and Torres, J. Exp. Biol. 206 (2003)
2409). Iridescence, which depends on the angle, is left out.
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


def animals(rng: np.random.Generator, count: int) -> np.ndarray:
    """Reflectances (count, 61) of hair, fur, feathers, scales and shells."""
    nm = PRIOR_GRID.nm
    eumelanin = log_uniform(rng, 0.01, 20, count) * (nm / 550)**-uniform(rng, 2.5, 4, count)
    pheomelanin = chance(rng, 0.5, count) * log_uniform(rng, 0.05, 30, count) * np.exp(
        -(nm - 400) / uniform(rng, 60, 100, count))
    lowest = EV_NM / uniform(rng, 470, 560, count)
    width = uniform(rng, 0.05, 0.1, count)
    chain = sum(height * band(lowest + step * 0.17, width * (1 + step / 4))
                for step, height in enumerate((0.8, 1.0, 0.7, 0.3)))
    carotenoids = chance(rng, 0.4, count) * log_uniform(rng, 0.1, 40, count) * chain
    keratin = 0.02 + 0.1 * np.exp(-(nm - 400) / 40)
    pigment = reflectance_of(eumelanin + pheomelanin + carotenoids + keratin)
    structure = chance(rng, 0.3, count) * uniform(rng, 0.02, 0.5, count) * band(
        EV_NM / uniform(rng, 390, 620, count), uniform(rng, 0.12, 0.45, count))
    shade = uniform(rng, 0.5, 1.05, count)
    gloss = uniform(rng, 0, 0.04, count)
    return shade * (pigment + structure * (1 - pigment)) * (1 - gloss) + gloss
