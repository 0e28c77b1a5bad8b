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

from spectrabox.sampling.prior.families.kubelka_munk import chance, log_uniform, uniform
from spectrabox.sampling.prior.mixture import PRIOR_GRID

COEFFICIENTS = Path(__file__).with_name("prospect_d.csv")
FIRST_CONE_DEG = 40             # of the light that falls on the leaf, as in PROSPECT
ANGLES = 64                     # of the quadrature


def leaves(rng: np.random.Generator, count: int) -> np.ndarray:
    """Reflectances (count, 61) of leaves, from green to red, yellow and brown."""
    chlorophyll = log_uniform(rng, 3, 90, count) * (1 - chance(rng, 0.08, count))
    carotenoids = np.minimum(chlorophyll * uniform(rng, 0.1, 0.35, count)
                             + chance(rng, 0.25, count) * uniform(rng, 0, 15, count), 25)
    anthocyanins = chance(rng, 0.25, count) * log_uniform(rng, 0.1, 30, count)
    tannins = chance(rng, 0.35, count) * log_uniform(rng, 0.02, 2, count)
    return _seen(rng, chlorophyll, carotenoids, anthocyanins, tannins, uniform(rng, -5, 5, count))


def petals(rng: np.random.Generator, count: int) -> np.ndarray:
    """Reflectances (count, 61) of petals and fruit skins."""
    chlorophyll = chance(rng, 0.4, count) * log_uniform(rng, 0.2, 15, count)
    carotenoids = chance(rng, 0.6, count) * log_uniform(rng, 0.2, 40, count)
    anthocyanins = chance(rng, 0.65, count) * log_uniform(rng, 0.1, 60, count)
    tannins = chance(rng, 0.3, count) * log_uniform(rng, 0.02, 1, count)
    shift = uniform(rng, -20, 90, count) * chance(rng, 0.8, count)
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
                  + tannins * np.exp(-(PRIOR_GRID.nm - 400) / uniform(rng, 70, 130, count))
                  + uniform(rng, 0.002, 0.02, count) * dry)
    r, t = leaf(uniform(rng, 1.1, 2.6, count), absorption, index)
    ground = chance(rng, 0.5, count) * uniform(rng, 0, 0.8, count)
    whole = r + t**2 * ground / (1 - r * ground)
    return uniform(rng, 0.75, 1.05, count) * whole + uniform(rng, -0.02, 0.03, count)


def _shifted(curve: np.ndarray, shift_nm: np.ndarray) -> np.ndarray:
    """A curve (P,) moved to the red by every shift (n, 1); its ends go on level."""
    return np.interp(PRIOR_GRID.nm - shift_nm, PRIOR_GRID.nm, curve)
