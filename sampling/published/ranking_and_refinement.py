"""What the paper does with more measurements and more coefficients, for comparison: ranking (Eqs.
9, 10), Eq. 16.
"""
from __future__ import annotations

from dataclasses import replace

import numpy as np

from spectrabox.radiometry.bspline import basis_matrix
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records.spectra import Outcome, SpectralMeasurement, SpectrumSamples
from spectrabox.sampling.further.more_measurements import MoreMeasurement, measured_rows
from spectrabox.sampling.polytope.refinement import lifting, residual_directions
from spectrabox.sampling.prior.mixture import PRIOR_GRID
from spectrabox.sampling.published.per_axis_box import draw_in_box
from spectrabox.sampling.spectral_measurement import (
    CoefficientDraws,
    nearest_coefficients,
    response_on,
    spline_operator,
)


def ranked(samples: SpectrumSamples, base: SpectralMeasurement, more: list[MoreMeasurement],
           twice: np.ndarray | None, keep: int) -> SpectrumSamples:
    """The ``keep`` draws nearest to all further measurements (Eq. 9) and to light reflected twice
    (Eq. 10).

    Parameters
    ----------
    samples : SpectrumSamples
        T draws.
    base : SpectralMeasurement
        What the photo says of the surface.
    more : list of MoreMeasurement
        Further measurements of the same surface.
    twice : (K,) array, optional
        Signal of light reflected twice.
    keep : int
        How many.

    Raises
    ------
    InputError
        If there is nothing to rank by, or fewer draws than are to be kept.
    """
    seen, measured = [], []
    for further in more:
        rows, values, _ = measured_rows(base, further)
        seen.append(samples.spectra @ rows.T)
        measured.append(values)
    if twice is not None:
        seen.append(samples.spectra**2 @ response_on(base, PRIOR_GRID).T)
        measured.append(twice)
    if not seen:
        raise InputError("--best ranks draws by further measurements; give some, or leave it out")
    kept = best_by_signals(np.hstack(seen), np.concatenate(measured), keep)
    return replace(samples, spectra=samples.spectra[kept], coefficients=samples.coefficients[kept],
                   effective_samples=float(keep),
                   method=f"{samples.method}, best {keep} of {len(samples.spectra)}",
                   outcome=Outcome.RANKED,
                   findings=(*samples.findings, Outcome.RANKED.finding()))


def best_by_signals(signals: np.ndarray, measured: np.ndarray, keep: int) -> np.ndarray:
    """Indices (keep,) of the draws whose signals (T, ...) come nearest to the measured ones (Eqs.
    9, 10).

    Ranking keeps the best of the draws however badly they fit; `conditioning` makes every draw fit.

    Parameters
    ----------
    signals : (T, ...) array
        Of the draws.
    measured : (...) array
    keep : int
        How many.

    Raises
    ------
    InputError
        If fewer than one or more than all are to be kept.
    """
    loss = np.sum((signals - measured).reshape(len(signals), -1)**2, axis=1)
    if not 1 <= keep <= loss.size:
        raise InputError(f"the best {keep} of {loss.size} draws were asked for; ask for 1 to "
                         f"{loss.size}")
    return np.argsort(loss, kind="stable")[:keep]


def refined_as_published(measurement: SpectralMeasurement, coarse: int, fine: int, draws: int,
                         seed: int) -> CoefficientDraws:
    """Draws around one lifted solution in the box of the residual directions (Eqs. 11-16 read
    literally).

    Parameters
    ----------
    measurement : SpectralMeasurement
    coarse : int
        Number of coefficients.
    fine : int
        Larger number, whose knots contain the coarse ones.
    draws : int
        T, at least 1.
    seed : int
        Of the random generator; the same seed gives the same draws bit for bit.

    Raises
    ------
    InputError
        If the knots do not nest, or nothing is left to draw along.
    """
    operator = spline_operator(measurement, coarse)
    solution = nearest_coefficients(operator.A, operator.y)
    T = lifting(coarse, fine)
    start = np.clip(T @ solution, 0, 1)
    fine_basis = basis_matrix(measurement.grid.nm, fine)
    directions = residual_directions(measurement.relative_response @ fine_basis, T)
    if not directions.shape[1]:
        raise InputError(f"refining {coarse} coefficients to {fine} leaves no direction that the "
                         "camera does not see; refine to more")
    coefficients, acceptance = draw_in_box(start, directions, draws, seed)
    return CoefficientDraws(coefficients, acceptance, float(draws), Outcome.CONVERGED)
