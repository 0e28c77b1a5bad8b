"""Printed and dyed paper.

Two in three sheets carry a halftone of cyan, magenta, yellow and black. Where inks overprint, the
light passes all of them; the share of every overprint follows from the shares that the inks cover
(Neugebauer, Z. wiss. Photogr. 36 (1937) 73), and reflectances mix as the power 1 / n, n from 1 to 3
as light spreads within the paper (Yule and Nielsen, TAGA Proc. 3 (1951) 65; of spectra: Viggiano,
TAGA Proc. 37 (1985) 647). The inks are those of ISO 2846-1; positions of their bands after Herbst
and Hunger, 'Industrial Organic Pigments', 3rd ed. 2004:

- cyan, copper phthalocyanine (Pigment Blue 15:3): bands at 608-628 and beyond 670 nm, and one in
  the ultraviolet;
- magenta, a lake of an azo dye (Red 57:1): 560-578, 525-540 and about 500 nm;
- yellow, a diarylide (Yellow 12 and 13): 425-445 and about 395 nm;
- black, carbon.

The other sheets are dyed through, or printed solid, with the dyes of dyes.py. Optical brighteners
are left out; paper with them is whiter than here below 450 nm.
"""
from __future__ import annotations

from itertools import product

import numpy as np

from spectrabox.sampling.prior.families.dyes import dyes, ultraviolet_edge
from spectrabox.sampling.prior.families.kubelka_munk import (
    EV_NM,
    absorption_of,
    band,
    chance,
    reflectance_of,
    uniform,
)
from spectrabox.sampling.prior.mixture import PRIOR_GRID

HALFTONES = 0.65                # share of sheets
USED = (0.7, 0.7, 0.7, 0.4)     # chance that an ink is printed: cyan, magenta, yellow, black
# of a solid ink in absorbances (natural logarithm, light passing down and up) at its peak
DENSEST = ((1.2, 2.6), (1.2, 2.6), (1.0, 2.4), (2.0, 4.5))


def paper(rng: np.random.Generator, count: int) -> np.ndarray:
    """Reflectances (count, 61) of printed and dyed paper and board."""
    ground = uniform(rng, 0.7, 0.94, count) * ultraviolet_edge(rng, 365, 405, count)
    dyed = reflectance_of(absorption_of(ground) + dyes(rng, count, 6))
    printed = ground * halftone(rng, count)
    sheet = np.where(rng.random((count, 1)) < HALFTONES, printed, dyed)
    return sheet * (1 - uniform(rng, 0, 0.03, count)) + uniform(rng, 0, 0.04, count)


def halftone(rng: np.random.Generator, count: int) -> np.ndarray:
    """Reflectance (count, 61), relative to bare paper, of halftones of four inks."""
    solids = [np.exp(-absorption * uniform(rng, *densest, count))
              for absorption, densest in zip(_inks(rng, count), DENSEST, strict=True)]
    covered = [rng.beta(0.7, 0.9, (count, 1)) * chance(rng, used, count) for used in USED]
    spread = uniform(rng, 1, 3, count)
    total = np.zeros((count, PRIOR_GRID.nm.size))
    for overprint in product((False, True), repeat=len(solids)):
        share, passed = np.ones((count, 1)), np.ones((count, PRIOR_GRID.nm.size))
        for printed, solid, part in zip(overprint, solids, covered, strict=True):
            share = share * (part if printed else 1 - part)
            passed = passed * solid if printed else passed
        total += share * passed**(1 / spread)
    return total**spread


def _inks(rng: np.random.Generator, count: int) -> tuple[np.ndarray, ...]:
    """Absorption (count, 61) of cyan, magenta, yellow and black, about 1 at their peaks."""
    def some(low: float, high: float) -> np.ndarray:
        return uniform(rng, low, high, count)

    cyan = (band(EV_NM / some(672, 700), some(0.09, 0.13))
            + some(0.75, 1.1) * band(EV_NM / some(608, 628), some(0.10, 0.15))
            + some(0, 0.15) * band(EV_NM / some(340, 370), 0.35))
    magenta = (band(EV_NM / some(560, 578), some(0.06, 0.1))
               + some(0.7, 1.05) * band(EV_NM / some(525, 540), some(0.1, 0.15))
               + some(0.3, 0.6) * band(EV_NM / some(490, 505), some(0.15, 0.25))
               + some(0.05, 0.3) * band(EV_NM / some(380, 410), 0.3))
    yellow = (band(EV_NM / some(425, 445), some(0.16, 0.24))
              + some(0.5, 1) * band(EV_NM / some(385, 410), some(0.2, 0.3)))
    return cyan, magenta, yellow, (PRIOR_GRID.nm / 550)**-some(-0.1, 0.5)
