"""Synthetic cameras and measurements shared by the tests of sampling."""
import numpy as np

from spectrabox.radiometry.grid import basis_matrix, visible_grid
from spectrabox.radiometry.interreflection import relative_operator, response_matrix
from spectrabox.radiometry.records.spectra import SpectralMeasurement
from spectrabox.sampling.spectral_measurement import MeasurementOperator


def curves(nm, bands=3):
    """Gaussian sensitivities (K, P) and a smooth light (P,)."""
    centres = np.linspace(450, 610, bands)[:, None]
    return np.exp(-0.5 * ((nm - centres) / (105 / bands))**2), 1 + 0.3 * np.sin(nm / 40)


def camera(coefficients, bands=3):
    """A (K, N) relative to white."""
    grid = visible_grid(5)
    return relative_operator(response_matrix(grid, *curves(grid.nm, bands)),
                             basis_matrix(grid.nm, coefficients))


def response(bands=3, step_nm=5):
    """Grid and response (K, P), rows summing to 1."""
    grid = visible_grid(step_nm)
    matrix = response_matrix(grid, *curves(grid.nm, bands))
    return grid, matrix / matrix.sum(axis=1, keepdims=True)


def measurement(A, y, error=0.0):
    return MeasurementOperator(A, y, error**2 * np.eye(len(y)))


def grey(coefficients, error=0.0, bands=3, seed=8):
    A = camera(coefficients, bands)
    return measurement(A, A @ np.random.default_rng(seed).uniform(0.05, 0.95, coefficients), error)


def surface(nm, seed=0):
    """A smooth reflectance (P,) such as a paint has: an edge and a hump."""
    rng = np.random.default_rng(seed)
    edge = rng.uniform(0.1, 0.5) / (1 + np.exp(-(nm - rng.uniform(480, 620)) / rng.uniform(15, 40)))
    return 0.05 + edge + rng.uniform(0, 0.3) * np.exp(-0.5 * ((nm - rng.uniform(420, 560)) / 40)**2)


def seen(reflectance, error=0.0, bands=3, step_nm=5):
    """The measurement of a reflectance given on the grid of that step."""
    grid, matrix = response(bands, step_nm)
    return SpectralMeasurement(grid, matrix, matrix @ reflectance, error**2 * np.eye(bands))
