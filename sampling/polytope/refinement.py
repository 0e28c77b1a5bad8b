"""Adaptive refinement of the basis (paper Sec. 3.3.3, Eqs. 11-16).

Only nested knots are refined: (fine - 3) must be a multiple of (coarse - 3). Then lifting is exact
knot insertion, its matrix T has rows that sum to 1 and no negative entries, and a coarse c in [0,
1] stays there. For other pairs the lifted curve is off by up to 0.02 and the camera's signal with
it, which the paper does not mention.

Read literally, Eq. 16 adds residual directions to one lifted solution; those bands hold the truth
far too rarely. Here every coarse draw gets its own residual draw.
"""
from __future__ import annotations

import numpy as np

from spectrabox.radiometry import errors, grid
from spectrabox.radiometry.records.spectra import SpectralMeasurement
from spectrabox.sampling import spectral_measurement
from spectrabox.sampling.polytope.tilted_rejection import sample_polytope

SWEEPS = 20         # of hit-and-run along the residual directions, per draw


def lifting(coarse: int, fine: int) -> np.ndarray:
    """T (fine, coarse) with B_fine T = B_coarse (Eq. 12).

    Parameters
    ----------
    coarse : int
        Number of coefficients.
    fine : int
        Larger number, whose knots contain the coarse ones.

    Raises
    ------
    InputError
        If the knots do not nest.
    """
    if fine <= coarse or (fine - grid.DEGREE) % (coarse - grid.DEGREE):
        nested = [grid.DEGREE + factor * (coarse - grid.DEGREE) for factor in (2, 3, 4)]
        raise errors.InputError(
            f"{coarse} coefficients cannot be refined to {fine}: the knots do not "
            f"nest; take {', '.join(map(str, nested))}")
    return np.linalg.lstsq(grid.basis_matrix(grid.FINE_GRID.nm, fine),
                           grid.basis_matrix(grid.FINE_GRID.nm, coarse), rcond=None)[0]


def residual_directions(A_fine: np.ndarray, T: np.ndarray) -> np.ndarray:
    """Directions (fine, d) that the camera does not see and that are orthogonal to the lifted span
    (Eqs. 13-15).

    Parameters
    ----------
    A_fine : (K, fine) array
        From fine coefficients to signal.
    T : (fine, coarse) array
        From `lifting`.
    """
    from scipy.linalg import null_space

    basis = grid.basis_matrix(grid.FINE_GRID.nm, len(T))
    gram = basis.T @ basis
    complement = null_space((gram @ T).T)
    seen = A_fine @ complement
    return complement @ null_space(seen)


def sample_refined(measurement: SpectralMeasurement,
                   operator: spectral_measurement.MeasurementOperator, fine: int, draws: int,
                   seed: int) -> np.ndarray:
    """Coarse draws of ``operator``, each refined to ``fine`` coefficients (T, fine) by its own
    residual draw.

    Parameters
    ----------
    measurement : SpectralMeasurement
        From whose response A of the fine basis is made.
    operator : MeasurementOperator
        The same in the coarse basis, its signal moved into reach where need be.
    fine : int
        Coefficients of the fine basis, whose knots must nest the coarse ones.
    draws, seed : int

    Raises
    ------
    InputError
        If the knots do not nest.
    """
    T = lifting(operator.A.shape[1], fine)
    directions = residual_directions(spectral_measurement.spline_operator(measurement, fine).A, T)
    coarse, _, _ = sample_polytope(operator, draws, seed)
    c = np.clip(coarse @ T.T, 0, 1)
    rng = np.random.default_rng(seed + 1)
    for _ in range(SWEEPS if directions.shape[1] else 0):
        direction = directions @ rng.standard_normal((directions.shape[1], draws))
        moves = np.where(np.abs(direction.T) < 1e-12, 1e-12, direction.T)
        at_zero, at_one = -c / moves, (1 - c) / moves
        low, high = np.minimum(at_zero, at_one).max(axis=1), np.maximum(at_zero, at_one).min(axis=1)
        c = np.clip(c + (low + (high - low) * rng.random(draws))[:, None] * moves, 0, 1)
    return c
