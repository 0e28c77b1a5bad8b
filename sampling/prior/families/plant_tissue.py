"""Leaves and petals by another theory than leaves.py: free pigments in tissue that scatters.

A layer of Kubelka and Munk of finite thickness over a ground (Kubelka, J. Opt. Soc. Am. 38 (1948)
448). PROSPECT has one spectrum for each pigment, what leaves have on average; here every pigment's
bands move, since its chemistry and what it is bound to do:

- chlorophyll a at 430-445 and 670-682 nm with weaker bands to 580 nm, and 0.15 to 0.6 of
  chlorophyll b, at 455-475 and 643-655 nm, in the leaf (Lichtenthaler, Methods Enzymol. 148 (1987)
  350, moved by 8 to 15 nm from a solvent to the membrane);
- carotenoids: three vibronic bands 0.17 eV apart, the lowest at 465 to 510 nm (violaxanthin to
  beta-carotene in a membrane; Britton, Liaaen-Jensen and Pfander, 'Carotenoids' 1B, 1995);
- anthocyanins and betalains at 470 to 605 nm, 0.1 to 0.24 eV wide, wider towards the blue:
  pelargonidin at 505, delphinidin at 535, with co-pigments and metals to 590 nm and beyond, when
  two or three bands stand 0.12 to 0.17 eV apart (Goto and Kondo, Angew. Chem. Int. Ed. 30 (1991)
  17; Yoshida, Mori and Kondo, Nat. Prod. Rep. 26 (2009) 884), and a weaker one at 400-450 nm;
- flavonols, chalcones and aurones that end between 390 and 450 nm; tannins.

Pigments lie in plastids and vacuoles, between which light passes: an absorption A of one becomes
(1 - exp(-s A)) / s of the tissue, s from nearly 0 to 1 (the sieve effect; Duysens, Biochim.
Biophys. Acta 19 (1956) 1). The surface reflects up to 5 %.

These models are fitted only where leaves are stated. With none stated so free a pigment takes
weight from skin, whose blood absorbs where anthocyanins do.
"""
from __future__ import annotations

import numpy as np

from spectrabox.sampling.prior.families.kubelka_munk import (
    EV_NM,
    band,
    chance,
    log_uniform,
    uniform,
)
from spectrabox.sampling.prior.mixture import PRIOR_GRID


def green_tissue(rng: np.random.Generator, count: int) -> np.ndarray:
    """Reflectances (count, 61) of leaves, from green to yellow, red and brown."""
    amount = log_uniform(rng, 0.1, 12, count)
    red = chance(rng, 0.15, count) * log_uniform(rng, 0.02, 4, count)
    absorption = (amount * chlorophyll(rng, count)
                  + amount * uniform(rng, 0.1, 0.8, count) * carotenoids(rng, count)
                  + chance(rng, 0.2, count) * log_uniform(rng, 0.1, 6, count)
                  * carotenoids(rng, count) + red * anthocyanins(rng, count))
    return _seen(rng, absorption)


def petal_tissue(rng: np.random.Generator, count: int) -> np.ndarray:
    """Reflectances (count, 61) of petals, fruits and coloured leaves."""
    absorption = (chance(rng, 0.65, count) * log_uniform(rng, 0.03, 10, count)
                  * anthocyanins(rng, count)
                  + chance(rng, 0.55, count) * log_uniform(rng, 0.05, 12, count)
                  * carotenoids(rng, count)
                  + chance(rng, 0.25, count) * log_uniform(rng, 0.02, 2, count)
                  * chlorophyll(rng, count))
    return _seen(rng, absorption)


def chlorophyll(rng: np.random.Generator, count: int) -> np.ndarray:
    """Absorption (count, 61) of chlorophylls a and b, 1 at the blue band of a."""
    def some(low: float, high: float) -> np.ndarray:
        return uniform(rng, low, high, count)

    a = (band(EV_NM / some(430, 445), some(0.08, 0.16), some(0, 0.8))
         + some(0.6, 0.95) * band(EV_NM / some(670, 682), some(0.03, 0.05), some(0.2, 0.8))
         + some(0.12, 0.3) * band(EV_NM / some(615, 630), some(0.05, 0.1))
         + some(0.03, 0.12) * band(EV_NM / some(575, 590), some(0.06, 0.12)))
    b = (band(EV_NM / some(455, 475), some(0.06, 0.12), some(0, 0.5))
         + some(0.3, 0.45) * band(EV_NM / some(643, 655), some(0.03, 0.06), some(0, 0.5))
         + some(0.05, 0.15) * band(EV_NM / some(590, 605), some(0.05, 0.12)))
    return a + some(0.15, 0.6) * b + some(0, 0.05)


def carotenoids(rng: np.random.Generator, count: int) -> np.ndarray:
    """Absorption (count, 61) of carotenoids, about 1 at the second of three bands."""
    lowest, width = EV_NM / uniform(rng, 465, 510, count), uniform(rng, 0.05, 0.11, count)
    ultraviolet = uniform(rng, 0, 0.3, count) * band(3.7, 0.5)
    return ultraviolet + sum(
        height * band(lowest + step * uniform(rng, 0.16, 0.18, count), width * (1 + step / 4))
        for step, height in enumerate((uniform(rng, 0.6, 1, count), 1.0,
                                       uniform(rng, 0.5, 0.8, count), 0.3)))


def anthocyanins(rng: np.random.Generator, count: int) -> np.ndarray:
    """Absorption (count, 61) of anthocyanins or betalains, 1 at the first of their bands."""
    peak = EV_NM / uniform(rng, 470, 605, count)
    width = uniform(rng, 0.1, 0.24, count)
    complexed = chance(rng, 0.3, count) * uniform(rng, 0, 1, count)
    step = uniform(rng, 0.12, 0.17, count)
    return (band(peak, np.where(complexed > 0, 0.6 * width, width), uniform(rng, 0, 0.6, count))
            + complexed * (band(peak + step, 0.6 * width) + 0.5 * band(peak + 2 * step, width))
            + uniform(rng, 0, 0.35, count) * band(EV_NM / uniform(rng, 380, 450, count),
                                                  uniform(rng, 0.2, 0.4, count)))


def layer(absorption: np.ndarray, thickness: np.ndarray, ground: np.ndarray) -> np.ndarray:
    """Reflectance of a layer of K / S whose scattering power S X is ``thickness``, over a ground
    of reflectance ``ground``; shapes that broadcast, absorption above 0.
    """
    a = 1 + absorption
    b = np.sqrt(absorption * (absorption + 2))
    c = b / np.tanh(b * thickness)
    return np.asarray((1 - ground * (a - c)) / (a - ground + c))


def _seen(rng: np.random.Generator, pigments: np.ndarray) -> np.ndarray:
    count = len(pigments)
    sieve = log_uniform(rng, 0.01, 1, count)
    passed = -np.expm1(-sieve * pigments) / sieve
    ends = EV_NM / uniform(rng, 350, 420, count)
    violet = chance(rng, 0.5, count) * log_uniform(rng, 0.05, 3, count) * band(
        ends, uniform(rng, 0.12, 0.3, count))
    tannins = chance(rng, 0.3, count) * log_uniform(rng, 0.02, 2, count) * np.exp(
        -(PRIOR_GRID.nm - 400) / uniform(rng, 60, 140, count))
    tissue = log_uniform(rng, 0.003, 0.5, count)
    inside = layer(passed + violet + tannins + tissue, log_uniform(rng, 0.5, 20, count),
                   chance(rng, 0.5, count) * uniform(rng, 0, 0.8, count))
    gloss = uniform(rng, 0, 0.05, count)
    return (1 - gloss) * uniform(rng, 0.75, 1.05, count) * inside + gloss
