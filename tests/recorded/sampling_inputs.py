"""Lopsided inputs for the recorded results of sampling: no two weights, widths, bands, errors or
factors alike, so that whatever takes one for another shows.
"""
import numpy as np
from sampling_cameras import response, surface

from spectrabox.radiometry.errors import SpectraboxError
from spectrabox.radiometry.records import SpectralMeasurement
from spectrabox.sampling.prior.certified import BandCertificate, FamilyCertificate
from spectrabox.sampling.prior.mixture import GRID, Components, LogitMixture
from spectrabox.sampling.prior.training import LEVELS

FAMILIES = ("paint", "leaves", "skin")


def result_or_refusal(call, *values, **named):
    """What a call returns, or its error as text."""
    try:
        return call(*values, **named)
    except (SpectraboxError, ValueError) as error:
        return f"{type(error).__name__}: {error}"


def rough_covariance(size, deviation, length_nm, seed):
    """Covariance (61, 61) of which no two eigenvalues are alike."""
    rng = np.random.default_rng(seed)
    spread = deviation * rng.uniform(0.7, 1.3, size)
    nm = GRID.nm[:size]
    return np.outer(spread, spread) * (0.1 + 0.9 * np.exp(-np.abs(nm[:, None] - nm) / length_nm)) \
        + np.diag(rng.uniform(1e-4, 4e-4, size))


def lopsided_prior(familiar_surprise=14.0, width_power=-0.3):
    """Five components of three families, one of which has two others where it is stated."""
    nm, rng = GRID.nm, np.random.default_rng(11)
    tilt = (nm - 550) / 150
    means = np.array([-1.2 + 0.5 * tilt, 0.3 - 0.4 * tilt, -0.6 + 0.8 * np.sin(nm / 45),
                      -1.5 + 0.9 * tilt**2, -0.4 + 0.7 * tilt])
    covariances = np.array([rough_covariance(61, deviation, length, seed)
                            for seed, (deviation, length) in enumerate(
                                [(0.5, 60), (0.9, 90), (0.35, 45), (0.7, 120), (0.45, 75)])])
    factors = 1 + 0.25 * rng.random((3, LEVELS.size, 1)) + 0.1 * np.sin(
        nm / np.array([30, 50, 70])[:, None, None])
    stated = 0.9 + 0.2 * rng.random((3, LEVELS.size, 1)) + 0.05 * np.cos(
        nm / np.array([40, 25, 60])[:, None, None])
    other = Components(np.array([0.35, 0.65]), means[[2, 3]] + np.array([[0.2], [-0.15]]) * tilt,
                       covariances[[3, 1]] * 0.8, np.array([1, 1]))
    certificates = {
        "paint": FamilyCertificate(True, 4, 812, BandCertificate(0.947, 0.13),
                                   BandCertificate(0.928, 0.17)),
        "leaves": FamilyCertificate(False, 2, 600, BandCertificate(0.951, 0.21),
                                    BandCertificate(0.94, 0.19))}
    return LogitMixture(nm, np.array([0.3, 0.22, 0.18, 0.12, 0.18]), means, covariances, FAMILIES,
                        np.array([0, 0, 1, 1, 2]), LEVELS, factors, stated, 1.37,
                        familiar_surprise, width_power, "hand (812); leaves: theory", (),
                        certificates, other)


def lopsided_noise(bands, size=0.006, seed=5):
    """Covariance (K, K) of errors that are correlated and of unlike sizes."""
    rng = np.random.default_rng(seed)
    root = size * (np.diag(rng.uniform(0.6, 1.6, bands)) + 0.3 * rng.random((bands, bands)))
    return root @ root.T


def lopsided_measurement(bands=3, noise=0.006, step_nm=5, seed=4):
    """A smooth surface as a camera of so many bands sees it, a little off."""
    grid, matrix = response(bands, step_nm)
    signal = matrix @ surface(grid.nm, seed) + 0.002 * np.arange(bands)
    covariance = lopsided_noise(bands, noise) if noise else np.zeros((bands, bands))
    return SpectralMeasurement(grid, matrix, signal, covariance)
