"""Simulated cameras and chart photos for the tests of calibrate/: smooth bumps that vary as real
cameras do.
"""
from functools import cache

import numpy as np

from spectrabox.calibrate.chart_equations import ChartEquations
from spectrabox.calibrate.prior.learnt_prior import build_prior
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.records.photos import PatchSamples

GRID = visible_grid()
NODES = np.arange(400.0, 701.0, 5.0)


def cameras(count, seed):
    """Curves (C, 3, 61): Gaussian bumps of random peak, width and height, and a smaller second bump
    of red.
    """
    rng = np.random.default_rng(seed)
    peaks = np.array([600.0, 535.0, 460.0]) + rng.normal(0, 5, (count, 3))
    widths = np.array([32.0, 38.0, 28.0]) + rng.normal(0, 3, (count, 3))
    heights = np.array([0.7, 1.0, 0.8]) * np.exp(rng.normal(0, 0.05, (count, 3)))
    curves = heights[..., None] * np.exp(-0.5 * ((NODES - peaks[..., None]) / widths[..., None])
                                         ** 2)
    curves[:, 0] += rng.uniform(0.02, 0.06, (count, 1)) * np.exp(-0.5 * ((NODES - 430) / 20) ** 2)
    return curves


def cameras_at_10_nm(count, seed):
    """The same (C, 3, 31), for tests of many fits: half the wavelengths take half the time."""
    return cameras(count, seed)[..., ::2]


@cache
def prior(count=30, seed=1):
    """A prior of such cameras on 31 wavelengths."""
    return build_prior(NODES[::2], cameras_at_10_nm(count, seed),
                       tuple(f"camera {i}" for i in range(count)), source="simulated",
                       licence="none")


@cache
def coarse_prior():
    """A prior of twelve cameras on 21 wavelengths."""
    names = tuple(f"maker{i} one" for i in range(12))
    return build_prior(NODES[::3], cameras(12, 1)[..., ::3], names, source="", licence="")


def reflectances(count=24, seed=5):
    """Smooth reflectances (I, P) between 0.05 and 0.9; the last six are neutral, as on the
    chart.
    """
    rng = np.random.default_rng(seed)
    steps = (rng.uniform(420, 680, (count, 2)), rng.uniform(15, 60, (count, 2)),
             rng.uniform(-1, 1, (count, 2)))
    shape = sum(height[:, None] / (1 + np.exp(-(GRID.nm - place[:, None]) / width[:, None]))
                for place, width, height in zip(*(part.T for part in steps), strict=True))
    low, high = shape.min(axis=1, keepdims=True), shape.max(axis=1, keepdims=True)
    estimate = 0.06 + 0.6 * (shape - low) / (high - low)
    estimate[-6:] = np.array([0.9, 0.6, 0.36, 0.2, 0.09, 0.035])[:, None]
    return estimate


def daylight():
    return 1 + 0.2 * np.sin(GRID.nm / 60)


def led():
    return (0.02 + np.exp(-0.5 * ((GRID.nm - 450) / 10) ** 2)
            + 0.8 * np.exp(-0.5 * ((GRID.nm - 570) / 55) ** 2))


def on_grid(curves):
    """Curves (..., 61) or (..., 31) at 1 nm by linear interpolation, the class of the fit, so that
    recovery can be exact.
    """
    nodes = NODES[::60 // (curves.shape[-1] - 1)]
    return np.apply_along_axis(lambda row: np.interp(GRID.nm, nodes, row), -1, curves)


def signals(curves, light, surfaces):
    """Noise-free signals (I, K) of curves (K, P)."""
    return surfaces @ (curves * light * GRID.weights_nm).T


def samples(signal, relative_error=0.0):
    covariance = np.einsum("ik,kl->ikl", (relative_error * signal) ** 2, np.eye(signal.shape[1]))
    return PatchSamples(signal, covariance, np.ones(24), np.zeros(signal.shape),
                        np.zeros(signal.shape))


def photo(signal, light, surfaces, relative_error=0.0, terms=None, glare=False, **more):
    covariance = np.einsum("ik,kl->ikl", (relative_error * signal) ** 2, np.eye(signal.shape[1]))
    return ChartEquations(signal, covariance, surfaces, light * GRID.weights_nm,
                      np.full(len(signal), np.pi), np.zeros((len(signal), 0)) if terms is None
                      else terms, glare, **more)
