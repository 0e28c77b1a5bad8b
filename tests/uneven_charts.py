"""Chart photos of which no two numbers are alike, for recorded results: an uneven grid, patches and
bands of different errors that are correlated, uneven light, glare.
"""
from __future__ import annotations

import dataclasses

import numpy as np
from calibrate_cameras import GRID, NODES, cameras, reflectances

from spectrabox.calibrate.chart_equations import ChartEquations, field_terms
from spectrabox.calibrate.prior.learnt_prior import build_prior
from spectrabox.radiometry.grid import grid_from_nm
from spectrabox.radiometry.records.photos import PatchSamples

UNEVEN = grid_from_nm(np.r_[np.arange(400.0, 520.0, 3.0), np.arange(520.0, 701.0, 4.0)])


def on(grid, curves, nm=GRID.nm):
    """Curves (..., P) at the wavelengths of a grid."""
    return np.apply_along_axis(lambda row: np.interp(grid.nm, nm, row), -1, curves)


def camera(grid=UNEVEN, seed=44):
    return on(grid, cameras(1, seed)[0], NODES)


def bands(count, grid=UNEVEN):
    """Overlapping curves (K, P) of unequal widths and heights."""
    peaks = np.linspace(420, 680, count)[::-1] + 7 * np.sin(np.arange(count))
    widths, heights = 18 + 3.0 * np.arange(count), 1 - 0.07 * np.arange(count)
    return heights[:, None] * np.exp(-0.5 * ((grid.nm - peaks[:, None]) / widths[:, None]) ** 2)


def warm_light(grid=UNEVEN):
    return 0.4 + 0.9 * ((grid.nm - 380) / 300) ** 1.5 + 0.1 * np.sin(grid.nm / 23)


def surfaces(count, grid=UNEVEN, seed=5):
    """Reflectances (I, P): two neutral, one nearly black."""
    made = reflectances(count + 5, seed)[:count]
    made[2] = 0.012 + 0.008 * np.sin(GRID.nm / 90)
    return on(grid, made)


def positions(count, seed=8):
    """Places (I, 2) on a chart that is wider than high and not centred."""
    return np.random.default_rng(seed).uniform([0.1, 0.3], [1.9, 1.2], (count, 2))


def covariances(signal, relative, seed=9):
    """Covariances (I, K, K) of signals, correlated between bands, of different relative size."""
    rng, (count, size) = np.random.default_rng(seed), signal.shape
    roots = relative * (0.6 * np.eye(size) + 0.3 * rng.standard_normal((count, size, size)))
    roots = roots * rng.uniform(0.5, 1.5, (count, 1, 1))
    return np.einsum("ik,ikm,ilm,il->ikl", signal, roots, roots, signal)


def uneven_photo(count=17, *, curves=None, light=None, grid=UNEVEN, seed=1, relative=0.006,
                 field=True, glare=True, rows=None, tie=None, level=0.7):
    """A photo of patches under uneven light with glare, noise and correlated errors."""
    rng = np.random.default_rng(seed)
    curves = camera(grid) if curves is None else curves
    power = (warm_light(grid) if light is None else light) * grid.weights_nm
    patches, places = surfaces(count, grid, 5 + seed), positions(count, 8 + seed)
    irradiance = np.pi * rng.uniform(0.7, 1.3, count)
    terms = field_terms(places) if field else np.zeros((count, 0))
    bare = patches @ (curves * power).T * (irradiance / np.pi)[:, None]
    bare *= level / bare.max() * np.exp(terms @ [0.06, -0.04, 0.03, -0.05, 0.02])[:, None] \
        if field else level / bare.max()
    signal = bare * (1 + relative * rng.standard_normal(bare.shape)
                     + 0.5 * relative * rng.standard_normal((count, 1)))
    if glare:
        signal = signal + bare.max(axis=0) * np.linspace(0.012, -0.002, len(curves))
    return ChartEquations(signal, covariances(signal, relative, 9 + seed), patches, power,
                          irradiance, terms, glare, relative_exposure_sd=tie, rows=rows)


def patch_samples(photo, camera_from_xyz=None):
    """The same as statistics of patches."""
    count, size = photo.signal.shape
    return PatchSamples(photo.signal, photo.covariance, 100.0 + np.arange(count),
                        np.zeros((count, size)), np.zeros((count, size)), camera_from_xyz)


def small_prior(count=16, bands_of=3, *, seed=2, floor=True):
    """A prior of cameras of four makers at 13 uneven wavelengths."""
    nm = np.array([400.0, 430, 450, 470, 500, 520, 545, 560, 590, 610, 640, 665, 700])
    curves = on(grid_from_nm(nm), cameras(count, seed), NODES)[:, :bands_of]
    makers = ("North", "East", "South", "West", "North")
    names = tuple(f"{makers[index % 5]} {index}" for index in range(count))
    made = build_prior(nm, curves, names, source="simulated cameras", licence="none of them")
    return made if floor else dataclasses.replace(made, means=made.curves(made.means), floor=None)


def sizes(covariance):
    """Logarithms of standard deviations, and correlations: each counts, however small it is."""
    covariance = np.asarray(covariance)
    sd = np.sqrt(np.maximum(np.diagonal(covariance, axis1=-2, axis2=-1), 0))
    safe = np.where(sd > 0, sd, 1)
    return {"log sd": np.log(safe), "known": np.count_nonzero(sd == 0),
            "correlation": covariance / safe[..., None] / safe[..., None, :]}
