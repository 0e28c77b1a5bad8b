"""Camera sensitivities as splines fitted band by band (paper Eqs. 18-20), without other cameras.

``paper``: 10 clamped cubic coefficients, zero at 400 and 700 nm, plain least squares.
``nonnegative``: the same with coefficients that are not negative, each patch weighted by its error.
``smooth``: 24 coefficients with free ends and a penalty on second differences, whose weight is the
one that best predicts patches left out of the fit.

The stated error of the first two holds the noise of the patches alone: that a few splines cannot
draw the steep flanks of a camera (7 to 10 % of the curve) is not in it.
"""
from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from spectrabox.radiometry.errors import CalibrationError
from spectrabox.radiometry.grid import basis_matrix
from spectrabox.radiometry.records.spectra import WavelengthGrid

SPLINE_METHODS = ("paper", "nonnegative", "smooth")
Solver = Callable[[np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
SPLINE_COEFFICIENTS = 10     # of each band, and for the condition number of every method
SMOOTH_COEFFICIENTS = 24
PENALTIES = tuple(10.0 ** power for power in np.arange(-8, 3.1, 0.5))  # of a mean information
MAX_CONDITION = 1e8


def band_fits(method: str, rows: np.ndarray, signal: np.ndarray, sigma: np.ndarray,
              grid: WavelengthGrid, coefficients: int, used: np.ndarray
              ) -> tuple[np.ndarray, Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]]:
    """Fits of every band by one of ``SPLINE_METHODS``.

    Parameters
    ----------
    method : str
    rows : (I, P) array
        Signal of each patch for a sensitivity of 1 at one wavelength alone.
    signal, sigma : (I, K) arrays
        Signals of the patches and their standard errors.
    grid : WavelengthGrid
        Working grid, of P wavelengths.
    coefficients : int
        Of ``paper`` and ``nonnegative``, with the two zero ends.
    used : (I, K) bool array
        Signals that fits may use.

    Returns
    -------
    basis : (P, N) array
    fit : function
        From the signals that one fit uses, (I, K) of bool, to its coefficients (K, N), not yet
        divided by the largest value of the curves, and their covariances (K, N, N).

    Raises
    ------
    CalibrationError
        If there are fewer patches than coefficients in a band, or the light leaves fewer
        independent directions.
    """
    full = basis_matrix(grid.nm, SMOOTH_COEFFICIENTS if method == "smooth" else coefficients)
    basis = full if method == "smooth" else full[:, 1:-1]  # b_400 c = b_700 c = 0
    design, patches = rows @ basis, used.any(axis=1)
    if method != "smooth":
        _require_determined(design[patches], int(used.sum(axis=0).min()),
                            condition_number(rows[patches], grid, coefficients), coefficients)
    solvers: dict[str, Solver] = {"paper": _solve_paper, "nonnegative": _solve_nonnegative}
    solve = (solvers[method] if method in solvers
             else partial(_solve_smooth, roughness=_best_roughness(
                 design[patches], signal[patches], sigma[patches], used[patches])))
    ends = (0, 0) if method == "smooth" else (1, 1)         # the two are zero

    def fit(chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        solved, covariances = zip(*(
            solve(design[of_band], signal[of_band, band], sigma[of_band, band])
            for band, of_band in enumerate(chosen.T)), strict=True)
        return np.pad(solved, ((0, 0), ends)), np.pad(covariances, ((0, 0), ends, ends))
    return full, fit


def condition_number(rows: np.ndarray, grid: WavelengthGrid,
                     coefficients: int = SPLINE_COEFFICIENTS) -> float:
    """How well chart and light alone determine the curves: of the paper's fit.

    Parameters
    ----------
    rows : (I, P) array
        Signal of each patch for a sensitivity of 1 at one wavelength alone.
    grid : WavelengthGrid
    coefficients : int
        Of each band, with the two zero ends.
    """
    return float(np.linalg.cond(rows @ basis_matrix(grid.nm, coefficients)[:, 1:-1]))


def _require_determined(design: np.ndarray, fewest: int, condition: float,
                        coefficients: int) -> None:
    if fewest < design.shape[1]:
        raise CalibrationError(f"{fewest} usable patches cannot determine {coefficients} "
                               "coefficients a band; use method \"prior\", or shoot the chart "
                               "again")
    if not np.isfinite(condition) or condition > MAX_CONDITION:
        raise CalibrationError(f"the chart under this light cannot determine {coefficients} "
                               f"coefficients (condition number {condition:.1e}); check that the "
                               "light covers 400-700 nm")


def _solve_paper(design: np.ndarray, signal: np.ndarray,
                 sigma: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Plain least squares (Eq. 20); its covariance from the residuals."""
    solution, *_ = np.linalg.lstsq(design, signal, rcond=None)
    freedom = max(signal.size - solution.size, 1)
    variance = np.sum((signal - design @ solution) ** 2) / freedom
    return solution, variance * np.linalg.pinv(design.T @ design)


def _solve_nonnegative(design: np.ndarray, signal: np.ndarray,
                       sigma: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Non-negative coefficients, and their covariance over those that are not held at zero."""
    weighted = design / sigma[:, None]
    solution, norm = _least_squares_above_zero(weighted, signal / sigma)
    free = solution > 0
    covariance = np.zeros((solution.size,) * 2)
    freedom = max(signal.size - int(np.count_nonzero(free)), 1)
    misfit = max(norm**2 / freedom, 1.0)  # never surer than the stated patch errors
    covariance[np.ix_(free, free)] = misfit * np.linalg.pinv(
        weighted[:, free].T @ weighted[:, free])
    return solution, covariance


def _solve_smooth(design: np.ndarray, signal: np.ndarray, sigma: np.ndarray, *,
                  roughness: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Non-negative coefficients under a roughness penalty (N, N).

    The covariance is that of the penalised estimate as a Bayesian reads it, whatever is held at
    zero: the penalty is the only prior on the curve between the directions that the patches
    observe. Its size follows the misfit of this fit, below the assumed patch errors too: those are
    for unknown charts, and held with them the band is too wide.
    """
    weighted, target = design / sigma[:, None], signal / sigma
    precision = weighted.T @ weighted + roughness
    lower = np.linalg.cholesky(precision)
    solution, _ = _least_squares_above_zero(lower.T, np.linalg.solve(lower, weighted.T @ target))
    inverse = np.linalg.inv(precision)
    freedom = max(signal.size - np.trace(inverse @ weighted.T @ weighted), 1.0)
    misfit = np.sum((target - weighted @ solution) ** 2) / freedom
    return solution, misfit * inverse


def _least_squares_above_zero(rows: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, float]:
    """Non-negative coefficients and the norm of the residuals."""
    from scipy.optimize import nnls  # slow to import, and only splines need it
    try:
        solution, norm = nnls(rows, target)
    except RuntimeError:    # which coefficients are zero hangs on rounding
        raise CalibrationError("the chart under this light leaves open which coefficients are "
                               "zero; use method \"prior\", or a light that covers 400-700 nm"
                               ) from None
    return solution, float(norm)


def _best_roughness(design: np.ndarray, signal: np.ndarray, sigma: np.ndarray,
                    used: np.ndarray) -> np.ndarray:
    """Penalty (N, N), one for all bands, that best predicts each patch from the others."""
    size = design.shape[1]
    differences = np.diff(np.eye(size), 2, axis=0)
    # a straight line is not penalised: keep it invertible
    rough = differences.T @ differences + 1e-9 * np.eye(size)
    unit = float(np.sum((design / sigma.mean(axis=1, keepdims=True, where=used)) ** 2)) / size
    errors = [_left_out_error(design, signal, sigma, used, penalty * unit * rough)
              for penalty in PENALTIES]
    return PENALTIES[int(np.argmin(errors))] * unit * rough


def _left_out_error(design: np.ndarray, signal: np.ndarray, sigma: np.ndarray, used: np.ndarray,
                    roughness: np.ndarray) -> float:
    """Sum of squared left-out residuals in standard errors, in closed form, signs unconstrained."""
    total = 0.0
    for band, of_band in enumerate(used.T):
        error = sigma[of_band, band]
        weighted, target = design[of_band] / error[:, None], signal[of_band, band] / error
        hat = weighted @ np.linalg.solve(weighted.T @ weighted + roughness, weighted.T)
        total += float(np.sum(((target - hat @ target) / (1 - np.diag(hat))) ** 2))
    return total
