"""Layers that scatter and absorb: what the families of surfaces share.

Kubelka and Munk (Z. techn. Phys. 12 (1931) 593): an opaque layer that absorbs K and scatters S per
unit of depth reflects R with K / S = (1 - R)^2 / (2 R), inside its surface. A glossy surface
reflects a share k1 of the light before it enters and k2 of what would leave (Saunderson, J. Opt.
Soc. Am. 32 (1942) 727): R_seen = k1 + (1 - k1) (1 - k2) R / (1 - k2 R). Absorption bands are taken
in photon energy, where their shape does not depend on where they are.
"""
from __future__ import annotations

import numpy as np

from spectrabox.sampling.prior.mixture import PRIOR_GRID

EV_NM = 1239.84                 # h c: photon energy in eV times wavelength in nm
ENERGY = EV_NM / PRIOR_GRID.nm


def reflectance_of(absorption: np.ndarray) -> np.ndarray:
    """Reflectance of an opaque layer of K / S, any shape."""
    return 1 / (1 + absorption + np.sqrt(absorption**2 + 2 * absorption))


def absorption_of(reflectance: np.ndarray) -> np.ndarray:
    """K / S of an opaque layer of a reflectance in (0, 1]."""
    return (1 - reflectance)**2 / (2 * reflectance)


def behind_surface(inside: np.ndarray, entering: np.ndarray, leaving: np.ndarray) -> np.ndarray:
    """Reflectance seen through a surface that reflects ``entering`` (k1) and ``leaving`` (k2)."""
    return entering + (1 - entering) * (1 - leaving) * inside / (1 - leaving * inside)


def band(peak_ev: np.ndarray | float, width_ev: np.ndarray | float,
         skew: np.ndarray | float = 0.0) -> np.ndarray:
    """Gaussian absorption bands (n, 61) of height 1, wider by ``skew`` towards the blue."""
    away = ENERGY - peak_ev
    return np.exp(-0.5 * (away / np.where(away > 0, width_ev * (1 + skew), width_ev))**2)


def log_uniform(rng: np.random.Generator, low: float, high: float, count: int) -> np.ndarray:
    """Column (count, 1) of numbers whose logarithm is uniform."""
    return np.exp(uniform(rng, np.log(low), np.log(high), count))


def uniform(rng: np.random.Generator, low: float, high: float, count: int) -> np.ndarray:
    """Column (count, 1) of uniform numbers."""
    return rng.uniform(low, high, (count, 1))


def chance(rng: np.random.Generator, probability: float, count: int) -> np.ndarray:
    """Column (count, 1) of zeros and, with a probability, ones."""
    return (rng.random((count, 1)) < probability).astype(float)
