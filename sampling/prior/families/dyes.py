"""Dyed textile and plastic: absorption bands of dyes in a body that scatters.

A dye absorbs in a few electronic bands, each a Gaussian in photon energy with a vibronic shoulder
0.14 to 0.19 eV above it, the stretching vibration of a conjugated chain (Suppan, 'Chemistry and
Light', 1994, ch. 2). Most dyes in use, azo and anthraquinone, have broad bands, of a standard
deviation of 0.13 to 0.25 eV (a half-width of 80 to 120 nm); one in five, such as rhodamines,
cyanines and phthalocyanines, absorbs above 470 nm in bands of 0.06 to 0.12 eV (spectra in Christie,
'Colour Chemistry', 2nd ed. 2015). Three dyes together are a yellow, a red and a blue, as dyers mix
them (Broadbent, 'Basic Principles of Textile Coloration', 2001, ch. 26). K / S of the dyes and of
the ground add (two constants in one; Kubelka-Munk, kubelka_munk.py). Grounds:

- textile: undyed fibre, white 0.6 to 0.9, yellowed towards the blue by exp(-(nm - 400) / 60);
  titanium dioxide in man-made fibres absorbs below 385 nm (anatase) with a tail;
- plastic: pigmented with rutile, whose edge at 3.0 eV begins at 415 nm, under a glossy surface that
  a meter may include (Saunderson's k1 up to 0.04).

Optical brighteners are left out: what they emit depends on the light, and is no reflectance. Nor
are there fluorescent dyes, metal threads and interference colours.
"""
from __future__ import annotations

import numpy as np

from spectrabox.sampling.prior.families.kubelka_munk import (
    ENERGY,
    EV_NM,
    absorption_of,
    band,
    behind_surface,
    chance,
    log_uniform,
    reflectance_of,
    uniform,
)
from spectrabox.sampling.prior.mixture import PRIOR_GRID

DYES = (0.4, 0.3, 0.3)          # chance of one, two and three
SHARP = 0.2                     # chance of a dye with narrow bands
ANY_NM = (355, 700)             # where the first band of a dye may peak
THREE_NM = ((380, 455), (485, 550), (570, 660))     # of a yellow, a red and a blue mixed together


def textile(rng: np.random.Generator, count: int) -> np.ndarray:
    """Reflectances (count, 61) of dyed cloth, leather and yarn."""
    white = uniform(rng, 0.55, 0.92, count)
    yellowed = 1 - uniform(rng, 0, 0.35, count) * np.exp(
        -(PRIOR_GRID.nm - 400) / uniform(rng, 40, 90, count))
    ground = white * yellowed * ultraviolet_edge(rng, 370, 400, count)
    body = reflectance_of(absorption_of(ground) + dyes(rng, count, 15))
    return (1 - uniform(rng, 0, 0.03, count)) * body + uniform(rng, 0, 0.04, count)


def plastic(rng: np.random.Generator, count: int) -> np.ndarray:
    """Reflectances (count, 61) of coloured plastic, lacquer and painted metal."""
    rutile = rutile_absorption(rng, count) * log_uniform(rng, 0.02, 1, count)
    black = chance(rng, 0.4, count) * log_uniform(rng, 0.01, 2, count) * (PRIOR_GRID.nm / 550)**-0.3
    body = reflectance_of(rutile + black + dyes(rng, count, 8) + uniform(rng, 0.003, 0.03, count))
    entering = uniform(rng, 0, 0.045, count)
    return behind_surface(body, entering, uniform(rng, 0.3, 0.6, count))


def dyes(rng: np.random.Generator, count: int, strongest: float) -> np.ndarray:
    """K / S (count, 61) of one dye, of two, or of a yellow, a red and a blue."""
    number = rng.choice(len(DYES), (count, 1), p=DYES)
    three = number == len(DYES) - 1
    total = np.zeros((count, PRIOR_GRID.nm.size))
    for peak_nm in THREE_NM:
        total += three * log_uniform(rng, 0.03, strongest, count) * _dye(rng, count, *peak_nm)
    for index in range(len(DYES) - 1):
        present = ~three & (index <= number)
        total += present * log_uniform(rng, 0.03, strongest, count) * _dye(rng, count, *ANY_NM)
    return total


def _dye(rng: np.random.Generator, count: int, low_nm: float, high_nm: float) -> np.ndarray:
    """Absorption (count, 61) of dyes whose first band has the height 1, between two wavelengths."""
    sharp = rng.random((count, 1)) < SHARP
    peak_nm = np.where(sharp, uniform(rng, max(low_nm, 470), max(high_nm, 480), count),
                       uniform(rng, low_nm, high_nm, count))
    width = np.where(sharp, uniform(rng, 0.06, 0.12, count), uniform(rng, 0.13, 0.25, count))
    vibration = np.where(sharp, uniform(rng, 0.2, 0.8, count), uniform(rng, 0, 0.5, count))
    peak = EV_NM / peak_nm
    shoulder = vibration * band(peak + uniform(rng, 0.14, 0.19, count), 1.1 * width)
    second = chance(rng, 0.5, count) * uniform(rng, 0, 0.6, count) * band(
        peak + uniform(rng, 0.5, 1.3, count), 1.5 * np.maximum(width, 0.12))
    return band(peak, width, uniform(rng, 0, 0.6, count)) + shoulder + second


def ultraviolet_edge(rng: np.random.Generator, low_nm: float, high_nm: float,
                     count: int) -> np.ndarray:
    """Factor (count, 61) by which six in ten grounds fall off towards the ultraviolet."""
    edge = 1 / (1 + np.exp(-(PRIOR_GRID.nm - uniform(rng, low_nm, high_nm, count))
                           / uniform(rng, 4, 14, count)))
    return 1 - chance(rng, 0.6, count) * uniform(rng, 0.4, 0.9, count) * (1 - edge)


def rutile_absorption(rng: np.random.Generator, count: int) -> np.ndarray:
    """K / S (count, 61) of rutile: Urbach's exponential tail below its gap of 3.0 eV, at most 3."""
    gap, tail = uniform(rng, 2.98, 3.08, count), uniform(rng, 0.025, 0.06, count)
    return 3 * np.exp(np.minimum((ENERGY - gap) / tail, 0))
