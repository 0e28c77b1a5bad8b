"""Made materials: coatings, dyed textile and plastic, printed and dyed paper."""
from __future__ import annotations

from itertools import product

import numpy as np

from spectrabox.sampling.prior.families import layered
from spectrabox.sampling.prior.mixture import EDGE, PRIOR_GRID

# ---- coatings ------------------------------------------------------------------------------------
# Coatings: whites, greys and pale tints; paints.
#
# Whites, greys, pale tints: tiles, plaster, primer, paper without brightener, unbleached bodies.
#
# K / S is small and of four parts: a constant (dirt, black: nm^0 to nm^-0.5), an exponential tail
# of yellowing (iron in clay, oxidised binder, lignin; exp(-(nm - 400) / s), s 30 to 120 nm), an
# absorption edge in the violet (rutile at 3.0 eV, anatase at 3.2 eV, zinc oxide at 3.2 eV, or
# none: chalk, barium sulphate, zircon glazes, PTFE), and a weak tint. Band gaps: Strehlow and
# Cook, J. Phys. Chem. Ref. Data 2 (1973) 163. A glaze reflects 4 % at its surface.
#
# Paints: pigments mixed with white, black and each other.
#
# K / S of a mixture is the sum of its pigments' K / S, weighted by their amounts (Duncan, Proc.
# Phys. Soc. 52 (1940) 390), relative to the scattering of the white that most paints are let down
# with. The pigments are measured ones, given as an argument: no measured curve ships. White is
# rutile, whose absorption edge at 3.0 eV is what bends paints between 400 and 420 nm; black
# absorbs as nm^-0.3. Measured curves hold a surface already; a glossy one comes on top with a
# chance of one half, more or less of it (k1 -0.02 to 0.04).

def whites(rng: np.random.Generator, count: int) -> np.ndarray:
    """Reflectances (count, 61) of white, grey and pale matt surfaces."""
    return layered.reflectance_of(_absorption(rng, count))


def tiles(rng: np.random.Generator, count: int) -> np.ndarray:
    """Reflectances (count, 61) of glazed and lacquered ones, the gloss measured or shut out."""
    entering = layered.chance(rng, 0.5, count) * layered.uniform(rng, 0.03, 0.05, count)
    return layered.behind_surface(layered.reflectance_of(_absorption(rng, count) / 4), entering,
                          layered.uniform(rng, 0.4, 0.6, count))


def _absorption(rng: np.random.Generator, count: int) -> np.ndarray:
    nm = PRIOR_GRID.nm
    dirt = layered.log_uniform(rng, 0.0005, 1.5,
                               count) * (nm / 550)**-layered.uniform(rng, 0, 0.5, count)
    yellow = layered.log_uniform(rng, 0.001, 0.3, count) * np.exp(
        -(nm - 400) / layered.uniform(rng, 30, 120, count))
    gap = 3.02 + 0.2 * layered.chance(rng, 0.4, count) + layered.uniform(rng, -0.03, 0.03, count)
    edge = layered.chance(rng, 0.6, count) * layered.log_uniform(rng, 0.2, 3, count) * np.exp(
        np.minimum((layered.ENERGY - gap) / layered.uniform(rng, 0.025, 0.07, count), 0))
    tint = layered.chance(rng, 0.5, count) * dyes(rng, count, 0.3)
    return dirt + yellow + edge + tint + 1e-4


DARK = 0.02     # reflectance below which a measured K / S says more of the surface than the pigment


def pigment_mixtures(rng: np.random.Generator, count: int, pigments: np.ndarray) -> np.ndarray:
    """Reflectances (count, 61) of mixtures of measured pigments (n, 61) with white and black."""
    measured = layered.absorption_of(np.clip(pigments, DARK, 1 - EDGE))
    strength = measured / measured.max(axis=1, keepdims=True)

    def some() -> np.ndarray:
        amount = layered.log_uniform(rng, 0.02, 20, count)
        return np.asarray(amount * strength[rng.integers(len(strength), size=count)])

    total = some() + layered.chance(rng, 0.5, count) * some()
    total += layered.chance(rng, 0.7, count) * layered.log_uniform(
        rng, 0.05, 1, count) * rutile_absorption(rng, count)
    total += layered.chance(rng, 0.3, count) * layered.log_uniform(rng, 0.01, 3, count) * (
        PRIOR_GRID.nm / 550)**-0.3
    inside = layered.reflectance_of(total + layered.uniform(rng, 0.001, 0.02, count))
    gloss = layered.chance(rng, 0.5, count) * layered.uniform(rng, -0.02, 0.04, count)
    return np.maximum((1 - gloss) * inside + gloss, EDGE)


# ---- dyes ----------------------------------------------------------------------------------------
# Dyed textile and plastic: absorption bands of dyes in a body that scatters.
#
# A dye absorbs in a few electronic bands, each a Gaussian in photon energy with a vibronic
# shoulder 0.14 to 0.19 eV above it, the stretching vibration of a conjugated chain (Suppan,
# 'Chemistry and Light', 1994, ch. 2). Most dyes in use, azo and anthraquinone, have broad bands,
# of a standard deviation of 0.13 to 0.25 eV (a half-width of 80 to 120 nm); one in five, such as
# rhodamines, cyanines and phthalocyanines, absorbs above 470 nm in bands of 0.06 to 0.12 eV
# (spectra in Christie, 'Colour Chemistry', 2nd ed. 2015). Three dyes together are a yellow, a red
# and a blue, as dyers mix them (Broadbent, 'Basic Principles of Textile Coloration', 2001, ch.
# 26). K / S of the dyes and of the ground add (two constants in one; Kubelka-Munk,
# kubelka_munk.py). Grounds:
#
# - textile: undyed fibre, white 0.6 to 0.9, yellowed towards the blue by exp(-(nm - 400) / 60);
#   titanium dioxide in man-made fibres absorbs below 385 nm (anatase) with a tail;
# - plastic: pigmented with rutile, whose edge at 3.0 eV begins at 415 nm, under a glossy surface
#   that a meter may include (Saunderson's k1 up to 0.04).
#
# Optical brighteners are left out: what they emit depends on the light, and is no reflectance. Nor
# are there fluorescent dyes, metal threads and interference colours.

DYES = (0.4, 0.3, 0.3)          # chance of one, two and three
SHARP = 0.2                     # chance of a dye with narrow bands
ANY_NM = (355, 700)             # where the first band of a dye may peak
THREE_NM = ((380, 455), (485, 550), (570, 660))     # of a yellow, a red and a blue mixed together


def textile(rng: np.random.Generator, count: int) -> np.ndarray:
    """Reflectances (count, 61) of dyed cloth, leather and yarn."""
    white = layered.uniform(rng, 0.55, 0.92, count)
    yellowed = 1 - layered.uniform(rng, 0, 0.35, count) * np.exp(
        -(PRIOR_GRID.nm - 400) / layered.uniform(rng, 40, 90, count))
    ground = white * yellowed * ultraviolet_edge(rng, 370, 400, count)
    body = layered.reflectance_of(layered.absorption_of(ground) + dyes(rng, count, 15))
    return (1 - layered.uniform(rng, 0, 0.03, count)) * body + layered.uniform(rng, 0, 0.04, count)


def plastic(rng: np.random.Generator, count: int) -> np.ndarray:
    """Reflectances (count, 61) of coloured plastic, lacquer and painted metal."""
    rutile = rutile_absorption(rng, count) * layered.log_uniform(rng, 0.02, 1, count)
    black = layered.chance(rng, 0.4, count) * layered.log_uniform(
        rng, 0.01, 2, count) * (PRIOR_GRID.nm / 550)**-0.3
    body = layered.reflectance_of(rutile + black + dyes(rng, count, 8)
                                  + layered.uniform(rng, 0.003, 0.03, count))
    entering = layered.uniform(rng, 0, 0.045, count)
    return layered.behind_surface(body, entering, layered.uniform(rng, 0.3, 0.6, count))


def dyes(rng: np.random.Generator, count: int, strongest: float) -> np.ndarray:
    """K / S (count, 61) of one dye, of two, or of a yellow, a red and a blue."""
    number = rng.choice(len(DYES), (count, 1), p=DYES)
    three = number == len(DYES) - 1
    total = np.zeros((count, PRIOR_GRID.nm.size))
    for peak_nm in THREE_NM:
        total += three * layered.log_uniform(rng, 0.03, strongest, count) * _dye(
            rng, count, *peak_nm)
    for index in range(len(DYES) - 1):
        present = ~three & (index <= number)
        total += present * layered.log_uniform(rng, 0.03, strongest, count) * _dye(
            rng, count, *ANY_NM)
    return total


def _dye(rng: np.random.Generator, count: int, low_nm: float, high_nm: float) -> np.ndarray:
    """Absorption (count, 61) of dyes whose first band has the height 1, between two wavelengths."""
    sharp = rng.random((count, 1)) < SHARP
    peak_nm = np.where(sharp, layered.uniform(rng, max(low_nm, 470), max(high_nm, 480), count),
                       layered.uniform(rng, low_nm, high_nm, count))
    width = np.where(sharp, layered.uniform(rng, 0.06, 0.12, count),
                     layered.uniform(rng, 0.13, 0.25, count))
    vibration = np.where(sharp, layered.uniform(rng, 0.2, 0.8, count),
                         layered.uniform(rng, 0, 0.5, count))
    peak = layered.EV_NM / peak_nm
    shoulder = vibration * layered.band(peak + layered.uniform(rng, 0.14, 0.19, count), 1.1 * width)
    second = layered.chance(rng, 0.5, count) * layered.uniform(rng, 0, 0.6, count) * layered.band(
        peak + layered.uniform(rng, 0.5, 1.3, count), 1.5 * np.maximum(width, 0.12))
    return layered.band(peak, width, layered.uniform(rng, 0, 0.6, count)) + shoulder + second


def ultraviolet_edge(rng: np.random.Generator, low_nm: float, high_nm: float,
                     count: int) -> np.ndarray:
    """Factor (count, 61) by which six in ten grounds fall off towards the ultraviolet."""
    edge = 1 / (1 + np.exp(-(PRIOR_GRID.nm - layered.uniform(rng, low_nm, high_nm, count))
                           / layered.uniform(rng, 4, 14, count)))
    return 1 - layered.chance(rng, 0.6, count) * layered.uniform(rng, 0.4, 0.9, count) * (1 - edge)


def rutile_absorption(rng: np.random.Generator, count: int) -> np.ndarray:
    """K / S (count, 61) of rutile: Urbach's exponential tail below its gap of 3.0 eV, at most 3."""
    gap, tail = layered.uniform(rng, 2.98, 3.08, count), layered.uniform(rng, 0.025, 0.06, count)
    return 3 * np.exp(np.minimum((layered.ENERGY - gap) / tail, 0))


# ---- paper ---------------------------------------------------------------------------------------
# Printed and dyed paper.
#
# Two in three sheets carry a halftone of cyan, magenta, yellow and black. Where inks overprint,
# the light passes all of them; the share of every overprint follows from the shares that the inks
# cover (Neugebauer, Z. wiss. Photogr. 36 (1937) 73), and reflectances mix as the power 1 / n, n
# from 1 to 3 as light spreads within the paper (Yule and Nielsen, TAGA Proc. 3 (1951) 65; of
# spectra: Viggiano, TAGA Proc. 37 (1985) 647). The inks are those of ISO 2846-1; positions of
# their bands after Herbst and Hunger, 'Industrial Organic Pigments', 3rd ed. 2004:
#
# - cyan, copper phthalocyanine (Pigment Blue 15:3): bands at 608-628 and beyond 670 nm, and one in
#   the ultraviolet;
# - magenta, a lake of an azo dye (Red 57:1): 560-578, 525-540 and about 500 nm;
# - yellow, a diarylide (Yellow 12 and 13): 425-445 and about 395 nm;
# - black, carbon.
#
# The other sheets are dyed through, or printed solid, with the dyes above. Optical brighteners
# are left out; paper with them is whiter than here below 450 nm.

HALFTONES = 0.65                # share of sheets
USED = (0.7, 0.7, 0.7, 0.4)     # chance that an ink is printed: cyan, magenta, yellow, black
# of a solid ink in absorbances (natural logarithm, light passing down and up) at its peak
DENSEST = ((1.2, 2.6), (1.2, 2.6), (1.0, 2.4), (2.0, 4.5))


def paper(rng: np.random.Generator, count: int) -> np.ndarray:
    """Reflectances (count, 61) of printed and dyed paper and board."""
    ground = layered.uniform(rng, 0.7, 0.94, count) * ultraviolet_edge(rng, 365, 405, count)
    dyed = layered.reflectance_of(layered.absorption_of(ground) + dyes(rng, count, 6))
    printed = ground * halftone(rng, count)
    sheet = np.where(rng.random((count, 1)) < HALFTONES, printed, dyed)
    return sheet * (1 - layered.uniform(rng, 0, 0.03, count)) + layered.uniform(rng, 0, 0.04, count)


def halftone(rng: np.random.Generator, count: int) -> np.ndarray:
    """Reflectance (count, 61), relative to bare paper, of halftones of four inks."""
    solids = [np.exp(-absorption * layered.uniform(rng, *densest, count))
              for absorption, densest in zip(_inks(rng, count), DENSEST, strict=True)]
    covered = [rng.beta(0.7, 0.9, (count, 1)) * layered.chance(rng, used, count) for used in USED]
    spread = layered.uniform(rng, 1, 3, count)
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
        return layered.uniform(rng, low, high, count)

    cyan = (layered.band(layered.EV_NM / some(672, 700), some(0.09, 0.13))
            + some(0.75, 1.1) * layered.band(layered.EV_NM / some(608, 628), some(0.10, 0.15))
            + some(0, 0.15) * layered.band(layered.EV_NM / some(340, 370), 0.35))
    magenta = (layered.band(layered.EV_NM / some(560, 578), some(0.06, 0.1))
               + some(0.7, 1.05) * layered.band(layered.EV_NM / some(525, 540), some(0.1, 0.15))
               + some(0.3, 0.6) * layered.band(layered.EV_NM / some(490, 505), some(0.15, 0.25))
               + some(0.05, 0.3) * layered.band(layered.EV_NM / some(380, 410), 0.3))
    yellow = (layered.band(layered.EV_NM / some(425, 445), some(0.16, 0.24))
              + some(0.5, 1) * layered.band(layered.EV_NM / some(385, 410), some(0.2, 0.3)))
    return cyan, magenta, yellow, (PRIOR_GRID.nm / 550)**-some(-0.1, 0.5)
