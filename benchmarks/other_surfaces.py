"""Reflectances of every family made otherwise than the prior makes them, to judge its bands on.

Where the prior's models (sampling/prior/families/) follow light through layers, these describe what
is seen: absorbances added to a path (Dawson et al., Phys. Med. Biol. 25 (1980) 695, of skin),
pigment bands of Gaussians in nanometres, Voigt-like bands of dyes, edges as logistic functions,
areas side by side (Murray, J. Franklin Inst. 221 (1936) 721), polynomials of soils. No code or
constant is shared.
"""
from __future__ import annotations

from collections.abc import Callable

import numpy as np

NM = np.arange(400, 701, 5.0)


def skin(rng: np.random.Generator, count: int) -> np.ndarray:
    """Skin: absorbance of a base, of melanin and of oxygenated and other blood."""
    oxygenated = _peaks((415, 13, 8.0), (542, 11, 1.0), (577, 8, 1.05), (500, 60, 0.25))
    reduced = _peaks((433, 12, 8.0), (556, 17, 0.95), (600, 60, 0.12))
    share = _some(rng, count, 0.4, 0.98)
    blood = share * oxygenated + (1 - share) * reduced
    melanin = _log(rng, count, 0.05, 1.6) * np.exp(-(NM - 400) / _some(rng, count, 90, 140))
    seen = 1 - np.exp(-_log(rng, count, 0.1, 0.6) * blood)      # short paths: strong bands saturate
    absorbance = _some(rng, count, 0.15, 0.35) + melanin + 0.25 * seen
    absorbance += _some(rng, count, 0.0, 0.25) * np.exp(-(NM - 400) / 90)
    return 10**-absorbance


def leaves(rng: np.random.Generator, count: int) -> np.ndarray:
    """Leaves: K / S of chlorophylls and carotenoids, over tissue."""
    green = _peaks((430, 22, 1.0), (460, 18, 0.55), (640, 22, 0.35), (675, 14, 0.8), (600, 35, 0.2),
                   (550, 60, 0.07))
    yellow = _peaks((425, 14, 0.7), (450, 13, 1.0), (480, 12, 0.85))
    amount = _log(rng, count, 0.5, 15)
    total = amount * green + amount * _some(rng, count, 0.1, 0.6) * yellow + _log(rng, count, 0.05,
                                                                                 0.6)
    return _layer(total) * _some(rng, count, 0.8, 1.0) + _some(rng, count, 0, 0.04)


def petals(rng: np.random.Generator, count: int) -> np.ndarray:
    """Petals: anthocyanins or carotenoids over white tissue."""
    red = np.exp(-0.5 * ((NM - _some(rng, count, 505, 590)) / _some(rng, count, 28, 48))**2)
    red = red + 0.25 * np.exp(-0.5 * ((NM - 400) / 40)**2)
    yellow = _peaks((422, 14, 0.75), (447, 13, 1.0), (476, 12, 0.9))
    kind = rng.random((count, 1))
    total = (kind < 0.7) * _log(rng, count, 0.05, 6) * red \
        + (kind > 0.5) * _log(rng, count, 0.1, 8) * yellow + _log(rng, count, 0.02, 0.15)
    return _layer(total)


def textile(rng: np.random.Generator, count: int) -> np.ndarray:
    """Cloth: one or two yarns side by side, dyed with bands half Gaussian, half Lorentzian."""
    part = np.where(rng.random((count, 1)) < 0.7, 1.0, rng.random((count, 1)))
    return part * _dyed(rng, count) + (1 - part) * _dyed(rng, count)


def prints(rng: np.random.Generator, count: int) -> np.ndarray:
    """Prints: areas of two inks with logistic edges, side by side on paper."""
    white = _some(rng, count, 0.75, 0.92)
    first, second = (rng.beta(0.8, 0.8, (count, 1)) for _ in range(2))
    inks = [_some(rng, count, 0.03, 0.12) + 0.8 * _edges(rng, count) for _ in range(2)]
    return white * (1 - first + first * inks[0]) * (1 - second + second * inks[1])


def paint(rng: np.random.Generator, count: int) -> np.ndarray:
    """Paint: one logistic edge or a window of two, tinted with white and greyed."""
    pure = _edges(rng, count)
    low, high = _some(rng, count, 0.02, 0.3), _some(rng, count, 0.35, 0.9)
    return (low + (high - low) * pure) * (1 - _some(rng, count, 0, 0.25) * np.exp(-(NM - 400) / 35))


def soil(rng: np.random.Generator, count: int) -> np.ndarray:
    """Soil and wood: a slope, a step of iron near 530 nm and a dip at 480 nm."""
    level, slope = _some(rng, count, 0.05, 0.3), _some(rng, count, 0.0, 0.3)
    step = 1 / (1 + np.exp(-(NM - _some(rng, count, 520, 580)) / _some(rng, count, 15, 35)))
    dip = np.exp(-0.5 * ((NM - 480) / 22)**2)
    seen = level + slope * (NM - 400) / 300 + _some(rng, count, 0, 0.25) * step
    return seen * (1 - _some(rng, count, 0, 0.12) * dip)


def white(rng: np.random.Generator, count: int) -> np.ndarray:
    """Whites and greys: flat, with a slope, a yellowed blue and an edge near 400 nm."""
    level = _some(rng, count, 0.05, 0.95) + _some(rng, count, -0.05, 0.05) * (NM - 550) / 300
    yellow = 1 - _some(rng, count, 0, 0.3) * np.exp(-(NM - 400) / _some(rng, count, 30, 90))
    edge = 1 / (1 + np.exp(-(NM - _some(rng, count, 370, 410)) / 6))
    return level * yellow * (1 - _some(rng, count, 0, 0.6) * (1 - edge))


def animal(rng: np.random.Generator, count: int) -> np.ndarray:
    """Hair and feathers: melanin in absorbance, some with an edge of carotenoids or a blue peak."""
    dark = 10**-(_log(rng, count, 0.05, 1.5) * np.exp(-(NM - 400) / _some(rng, count, 150, 400)))
    kind = rng.random((count, 1))
    edge = 0.1 + 0.9 / (1 + np.exp(-(NM - _some(rng, count, 480, 600)) / _some(rng, count, 8, 20)))
    peak = 1 + _some(rng, count, 0.2, 1.5) * np.exp(
        -0.5 * ((NM - _some(rng, count, 420, 560)) / _some(rng, count, 35, 70))**2)
    return 0.55 * dark * np.where(kind < 0.25, edge, np.where(kind < 0.45, peak / 2, 1.0))


# the family that an operator would state of each
OTHERS: dict[Callable[[np.random.Generator, int], np.ndarray], str] = {
    paint: "paint", textile: "textile", prints: "textile", leaves: "leaves", petals: "leaves",
    skin: "skin", white: "white", soil: "earth", animal: "animal"}


def _dyed(rng: np.random.Generator, count: int) -> np.ndarray:
    total = 1 / _log(rng, count, 4, 200)
    for present in (1.0, 0.5, 0.3):
        away = (NM - _some(rng, count, 380, 690)) / _some(rng, count, 25, 60)
        shape = 0.5 * np.exp(-0.5 * away**2) + 0.5 / (1 + away**2)
        total = total + (rng.random((count, 1)) < present) * _log(rng, count, 0.05, 8) * shape
    return 0.02 + 0.95 * _layer(total)


def _edges(rng: np.random.Generator, count: int) -> np.ndarray:
    """Logistic edges, one in three with a second one that closes a window."""
    first, rise = _some(rng, count, 420, 640), _some(rng, count, 8, 30)
    up = 1 / (1 + np.exp(-(NM - first) / rise))
    down = 1 / (1 + np.exp((NM - first - _some(rng, count, 60, 160)) / _some(rng, count, 12, 35)))
    blue = 1 / (1 + np.exp((NM - _some(rng, count, 430, 560)) / _some(rng, count, 12, 35)))
    kind = rng.random((count, 1))
    return np.where(kind < 0.5, up, np.where(kind < 0.8, up * down, blue))


def _peaks(*peaks: tuple[float, float, float]) -> np.ndarray:
    """Sum (61,) of Gaussians of (centre, standard deviation, height) in nm."""
    return np.sum([height * np.exp(-0.5 * ((NM - centre) / width)**2)
                   for centre, width, height in peaks], axis=0)


def _layer(total: np.ndarray) -> np.ndarray:
    return 1 + total - np.sqrt(total**2 + 2 * total)


def _some(rng: np.random.Generator, count: int, low: float, high: float) -> np.ndarray:
    return rng.uniform(low, high, (count, 1))


def _log(rng: np.random.Generator, count: int, low: float, high: float) -> np.ndarray:
    return np.exp(rng.uniform(np.log(low), np.log(high), (count, 1)))
