"""Leaves and petals: PROSPECT-D, a pile of plates with pigments in it.

One plate of refractive index n, in light that is diffuse inside, transmits tau = (1 - k) exp(-k) +
k^2 E1(k), k = sum of concentration times specific absorption over the number of plates N (Allen,
Gausman, Richardson and Thomas, J. Opt. Soc. Am. 59 (1969) 1376). With t12 the mean transmission of
its surface for light from all directions (from within 40 degrees for the first), t21 = t12 / n^2
and r21 = 1 - t21, a plate reflects r = r12 + t12 r21 tau^2 t21 / (1 - r21^2 tau^2). N plates follow
from one by Stokes (Proc. R. Soc. 11 (1862) 545). Index and absorption are those of PROSPECT-D
(Feret, Gitelson, Noble and Jacquemoud, Remote Sens. Environ. 193 (2017) 204), in prospect_d.csv.

Leaves: chlorophyll 3 to 90 microgram/cm2, carotenoids a tenth to a third of it and up to 25,
anthocyanins, dry matter 2 to 20 mg/cm2, tannins of dying leaves (absorption exp(-(nm - 400) / 90)).
Petals: little or no chlorophyll; anthocyanins whose band lies 20 nm shorter (pelargonidin) to 90 nm
longer (metal complexes and co-pigments; Harborne and Williams, Phytochemistry 55 (2000) 481) than
the one of leaves. Some lie over what shines through from below; some shine.

Not in it: wax blooms, hairs, fluorescence of chlorophyll (under 2 % at 685 nm), and structural
colour.
"""
from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.special import exp1

from spectrabox.sampling.prior.families import layered
from spectrabox.sampling.prior.mixture import PRIOR_GRID

COEFFICIENTS = Path(__file__).with_name("prospect_d.csv")
FIRST_CONE_DEG = 40             # of the light that falls on the leaf, as in PROSPECT
ANGLES = 64                     # of the quadrature


def leaves(rng: np.random.Generator, count: int) -> np.ndarray:
    """Reflectances (count, 61) of leaves, from green to red, yellow and brown."""
    chlorophyll = layered.log_uniform(rng, 3, 90, count) * (1 - layered.chance(rng, 0.08, count))
    carotenoids = np.minimum(
        chlorophyll * layered.uniform(rng, 0.1, 0.35, count)
        + layered.chance(rng, 0.25, count) * layered.uniform(rng, 0, 15, count), 25)
    anthocyanins = layered.chance(rng, 0.25, count) * layered.log_uniform(rng, 0.1, 30, count)
    tannins = layered.chance(rng, 0.35, count) * layered.log_uniform(rng, 0.02, 2, count)
    return _seen(rng, chlorophyll, carotenoids, anthocyanins, tannins,
                 layered.uniform(rng, -5, 5, count))


def petals(rng: np.random.Generator, count: int) -> np.ndarray:
    """Reflectances (count, 61) of petals and fruit skins."""
    chlorophyll = layered.chance(rng, 0.4, count) * layered.log_uniform(rng, 0.2, 15, count)
    carotenoids = layered.chance(rng, 0.6, count) * layered.log_uniform(rng, 0.2, 40, count)
    anthocyanins = layered.chance(rng, 0.65, count) * layered.log_uniform(rng, 0.1, 60, count)
    tannins = layered.chance(rng, 0.3, count) * layered.log_uniform(rng, 0.02, 1, count)
    shift = layered.uniform(rng, -20, 90, count) * layered.chance(rng, 0.8, count)
    return _seen(rng, chlorophyll, carotenoids, anthocyanins, tannins, shift)


def leaf(plates: np.ndarray, absorption: np.ndarray,
         index: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Reflectance and transmittance (n, P) of piles of plates (n, 1) with absorption (n, P)."""
    k = np.maximum(absorption / plates, 1e-6)
    tau = (1 - k) * np.exp(-k) + k**2 * exp1(k)
    t12, t_first = surface_transmission(index, 90), surface_transmission(index, FIRST_CONE_DEG)
    t21 = t12 / index**2
    r21 = 1 - t21
    through = tau * t21 / (1 - (r21 * tau)**2)
    t, r = t12 * through, 1 - t12 + t12 * r21 * tau * through
    t_top, r_top = t_first * through, 1 - t_first + t_first * r21 * tau * through
    D = np.sqrt((1 + r + t) * (1 + r - t) * (1 - r + t) * (1 - r - t))
    a = (1 + r**2 - t**2 + D) / (2 * r)
    b = ((1 - r**2 + t**2 + D) / (2 * t))**(plates - 1)
    r_rest = a * (b**2 - 1) / (a**2 * b**2 - 1)
    t_rest = b * (a**2 - 1) / (a**2 * b**2 - 1)
    between = 1 - r_rest * r
    return r_top + t_top * r_rest * t / between, t_top * t_rest / between


def surface_transmission(index: np.ndarray, cone_deg: float) -> np.ndarray:
    """Mean transmission into index (P,) of unpolarised light from all directions of a cone.

    Fresnel's equations, weighted by sin 2 theta: what Allen (J. Opt. Soc. Am. 63 (1973) 664)
    integrated in closed form.
    """
    nodes, weights = np.polynomial.legendre.leggauss(ANGLES)
    theta = np.deg2rad(cone_deg) * (nodes[:, None] + 1) / 2
    inside = np.sqrt(1 - (np.sin(theta) / index)**2)
    across = (np.cos(theta) - index * inside) / (np.cos(theta) + index * inside)
    along = (index * np.cos(theta) - inside) / (index * np.cos(theta) + inside)
    weight = weights[:, None] * np.sin(2 * theta)
    return (weight * (1 - (across**2 + along**2) / 2)).sum(axis=0) / weight.sum(axis=0)


def _seen(rng: np.random.Generator, chlorophyll: np.ndarray, carotenoids: np.ndarray,
          anthocyanins: np.ndarray, tannins: np.ndarray, shift_nm: np.ndarray) -> np.ndarray:
    count = len(chlorophyll)
    _, index, green, yellow, red, dry = np.loadtxt(
        COEFFICIENTS, delimiter=",", skiprows=5).T
    absorption = (chlorophyll * green + carotenoids * yellow
                  + anthocyanins * _shifted(red, shift_nm)
                  + tannins * np.exp(-(PRIOR_GRID.nm - 400) / layered.uniform(rng, 70, 130, count))
                  + layered.uniform(rng, 0.002, 0.02, count) * dry)
    r, t = leaf(layered.uniform(rng, 1.1, 2.6, count), absorption, index)
    ground = layered.chance(rng, 0.5, count) * layered.uniform(rng, 0, 0.8, count)
    whole = r + t**2 * ground / (1 - r * ground)
    return layered.uniform(rng, 0.75, 1.05, count) * whole + layered.uniform(
        rng, -0.02, 0.03, count)


def _shifted(curve: np.ndarray, shift_nm: np.ndarray) -> np.ndarray:
    """A curve (P,) moved to the red by every shift (n, 1); its ends go on level."""
    return np.interp(PRIOR_GRID.nm - shift_nm, PRIOR_GRID.nm, curve)


# ---- tissue --------------------------------------------------------------------------------------
# Leaves and petals by another theory than PROSPECT-D: free pigments in tissue that scatters.
#
# A layer of Kubelka and Munk of finite thickness over a ground (Kubelka, J. Opt. Soc. Am. 38
# (1948) 448). PROSPECT has one spectrum for each pigment, what leaves have on average; here every
# pigment's bands move, since its chemistry and what it is bound to do:
#
# - chlorophyll a at 430-445 and 670-682 nm with weaker bands to 580 nm, and 0.15 to 0.6 of
#   chlorophyll b, at 455-475 and 643-655 nm, in the leaf (Lichtenthaler, Methods Enzymol. 148
#   (1987) 350, moved by 8 to 15 nm from a solvent to the membrane);
# - carotenoids: three vibronic bands 0.17 eV apart, the lowest at 465 to 510 nm (violaxanthin to
#   beta-carotene in a membrane; Britton, Liaaen-Jensen and Pfander, 'Carotenoids' 1B, 1995);
# - anthocyanins and betalains at 470 to 605 nm, 0.1 to 0.24 eV wide, wider towards the blue:
#   pelargonidin at 505, delphinidin at 535, with co-pigments and metals to 590 nm and beyond, when
#   two or three bands stand 0.12 to 0.17 eV apart (Goto and Kondo, Angew. Chem. Int. Ed. 30 (1991)
#   17; Yoshida, Mori and Kondo, Nat. Prod. Rep. 26 (2009) 884), and a weaker one at 400-450 nm;
# - flavonols, chalcones and aurones that end between 390 and 450 nm; tannins.
#
# Pigments lie in plastids and vacuoles, between which light passes: an absorption A of one becomes
# (1 - exp(-s A)) / s of the tissue, s from nearly 0 to 1 (the sieve effect; Duysens, Biochim.
# Biophys. Acta 19 (1956) 1). The surface reflects up to 5 %.
#
# These models are fitted only where leaves are stated. With none stated so free a pigment takes
# weight from skin, whose blood absorbs where anthocyanins do.

def green_tissue(rng: np.random.Generator, count: int) -> np.ndarray:
    """Reflectances (count, 61) of leaves, from green to yellow, red and brown."""
    amount = layered.log_uniform(rng, 0.1, 12, count)
    red = layered.chance(rng, 0.15, count) * layered.log_uniform(rng, 0.02, 4, count)
    absorption = (amount * chlorophyll(rng, count)
                  + amount * layered.uniform(rng, 0.1, 0.8, count) * carotenoids(rng, count)
                  + layered.chance(rng, 0.2, count) * layered.log_uniform(rng, 0.1, 6, count)
                  * carotenoids(rng, count) + red * anthocyanins(rng, count))
    return _seen_in_tissue(rng, absorption)


def petal_tissue(rng: np.random.Generator, count: int) -> np.ndarray:
    """Reflectances (count, 61) of petals, fruits and coloured leaves."""
    absorption = (layered.chance(rng, 0.65, count) * layered.log_uniform(rng, 0.03, 10, count)
                  * anthocyanins(rng, count)
                  + layered.chance(rng, 0.55, count) * layered.log_uniform(rng, 0.05, 12, count)
                  * carotenoids(rng, count)
                  + layered.chance(rng, 0.25, count) * layered.log_uniform(rng, 0.02, 2, count)
                  * chlorophyll(rng, count))
    return _seen_in_tissue(rng, absorption)


def chlorophyll(rng: np.random.Generator, count: int) -> np.ndarray:
    """Absorption (count, 61) of chlorophylls a and b, 1 at the blue band of a."""
    def some(low: float, high: float) -> np.ndarray:
        return layered.uniform(rng, low, high, count)

    a = (layered.band(layered.EV_NM / some(430, 445), some(0.08, 0.16), some(0, 0.8))
         + some(0.6, 0.95)
         * layered.band(layered.EV_NM / some(670, 682), some(0.03, 0.05), some(0.2, 0.8))
         + some(0.12, 0.3) * layered.band(layered.EV_NM / some(615, 630), some(0.05, 0.1))
         + some(0.03, 0.12) * layered.band(layered.EV_NM / some(575, 590), some(0.06, 0.12)))
    b = (layered.band(layered.EV_NM / some(455, 475), some(0.06, 0.12), some(0, 0.5))
         + some(0.3, 0.45)
         * layered.band(layered.EV_NM / some(643, 655), some(0.03, 0.06), some(0, 0.5))
         + some(0.05, 0.15) * layered.band(layered.EV_NM / some(590, 605), some(0.05, 0.12)))
    return a + some(0.15, 0.6) * b + some(0, 0.05)


def carotenoids(rng: np.random.Generator, count: int) -> np.ndarray:
    """Absorption (count, 61) of carotenoids, about 1 at the second of three bands."""
    lowest, width = layered.EV_NM / layered.uniform(rng, 465, 510, count), layered.uniform(
        rng, 0.05, 0.11, count)
    ultraviolet = layered.uniform(rng, 0, 0.3, count) * layered.band(3.7, 0.5)
    return ultraviolet + sum(
        height * layered.band(lowest + step
                              * layered.uniform(rng, 0.16, 0.18, count), width * (1 + step / 4))
        for step, height in enumerate((layered.uniform(rng, 0.6, 1, count), 1.0,
                                       layered.uniform(rng, 0.5, 0.8, count), 0.3)))


def anthocyanins(rng: np.random.Generator, count: int) -> np.ndarray:
    """Absorption (count, 61) of anthocyanins or betalains, 1 at the first of their bands."""
    peak = layered.EV_NM / layered.uniform(rng, 470, 605, count)
    width = layered.uniform(rng, 0.1, 0.24, count)
    complexed = layered.chance(rng, 0.3, count) * layered.uniform(rng, 0, 1, count)
    step = layered.uniform(rng, 0.12, 0.17, count)
    return (layered.band(peak, np.where(complexed > 0, 0.6 * width, width),
                         layered.uniform(rng, 0, 0.6, count)) + complexed *
            (layered.band(peak + step, 0.6 * width) + 0.5 * layered.band(peak + 2 * step, width))
            + layered.uniform(rng, 0, 0.35, count)
            * layered.band(layered.EV_NM / layered.uniform(rng, 380, 450, count),
                           layered.uniform(rng, 0.2, 0.4, count)))


def layer(absorption: np.ndarray, thickness: np.ndarray, ground: np.ndarray) -> np.ndarray:
    """Reflectance of a layer of K / S whose scattering power S X is ``thickness``, over a ground
    of reflectance ``ground``; shapes that broadcast, absorption above 0.
    """
    a = 1 + absorption
    b = np.sqrt(absorption * (absorption + 2))
    c = b / np.tanh(b * thickness)
    return np.asarray((1 - ground * (a - c)) / (a - ground + c))


def _seen_in_tissue(rng: np.random.Generator, pigments: np.ndarray) -> np.ndarray:
    count = len(pigments)
    sieve = layered.log_uniform(rng, 0.01, 1, count)
    passed = -np.expm1(-sieve * pigments) / sieve
    ends = layered.EV_NM / layered.uniform(rng, 350, 420, count)
    violet = layered.chance(rng, 0.5, count) * layered.log_uniform(
        rng, 0.05, 3, count) * layered.band(ends, layered.uniform(rng, 0.12, 0.3, count))
    tannins = layered.chance(rng, 0.3, count) * layered.log_uniform(rng, 0.02, 2, count) * np.exp(
        -(PRIOR_GRID.nm - 400) / layered.uniform(rng, 60, 140, count))
    tissue = layered.log_uniform(rng, 0.003, 0.5, count)
    inside = layer(passed + violet + tannins + tissue, layered.log_uniform(rng, 0.5, 20, count),
                   layered.chance(rng, 0.5, count) * layered.uniform(rng, 0, 0.8, count))
    gloss = layered.uniform(rng, 0, 0.05, count)
    return (1 - gloss) * layered.uniform(rng, 0.75, 1.05, count) * inside + gloss
