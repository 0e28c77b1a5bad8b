"""One signal, one method, T spectra: the published sampler, the exact uniform one, or the learnt
prior.
"""
from __future__ import annotations

import numpy as np
from scipy.optimize import lsq_linear

from spectrabox.radiometry.bspline import basis_matrix
from spectrabox.radiometry.errors import ConvergenceError, InputError
from spectrabox.radiometry.records import MeasurementOperator, Outcome, SpectrumSamples
from spectrabox.sampling.measurement import SpectralMeasurement, SpectralSamples
from spectrabox.sampling.polytope.tilt import check_operator, max_entropy_tilt
from spectrabox.sampling.polytope.tilted_rejection import sample_spectra
from spectrabox.sampling.prior.draws import check_measurement, sample_prior
from spectrabox.sampling.prior.mixture import GRID, LogitMixture
from spectrabox.sampling.published.per_axis_box import sample_per_axis

METHODS = ("paper", "uniform", "prior")
# how far an unreachable signal is moved into what can be reached
TOWARDS_GREY = (0.002, 0.01, 0.03, 0.1)
BULK = 20_000                               # draws from which compiled hit-and-run is the faster


def draw_spectra(measurement: SpectralMeasurement, method: str, draws: int, seed: int,
                 coefficients: int,
                 prior: LogitMixture | None = None,
                 unbounded_start: bool = False) -> SpectralSamples:
    """Draw spectra that fit a measurement by one of the METHODS.

    Raises
    ------
    InputError
        For an unknown method, or a measurement that cannot be sampled.
    CalibrationError
        If bands respond alike.
    ConvergenceError
        If the sampler fails; the message says what to change.
    """
    if method not in METHODS:
        raise InputError(f"the method {method!r} is not known; known are {', '.join(METHODS)}")
    check_measurement(measurement, draws)
    if method == "prior":
        return sample_prior(measurement, draws, seed, prior, coefficients)
    operator = measurement.operator(coefficients)
    samples, sentence = (published(operator, draws, seed, unbounded_start) if method == "paper"
                         else uniform(operator, draws, seed))
    spectra = samples.coefficients @ basis_matrix(GRID.nm, coefficients).T
    return SpectralSamples(GRID, spectra, samples.coefficients, samples.method,
                           samples.effective_samples, seed, sentence)


def uniform(operator: MeasurementOperator, draws: int, seed: int) -> tuple[SpectrumSamples, str]:
    """Exact uniform draws and the sentence that says what they are; an unreachable signal is moved
    into reach first.
    """
    operator, moved = into_reach(operator)
    if (draws < BULK and len(operator.y) <= 5) or operator.noise_covariance.any():
        samples = sample_spectra(operator, draws, seed)
    else:
        # numba: compiled once, then cached
        from spectrabox.sampling.polytope.circuit_hit_and_run import sample_in_bulk
        samples = sample_in_bulk(operator, draws, seed)
    if moved:
        return samples, (f"No spectrum of {operator.A.shape[1]} coefficients between 0 and 1 gives "
                         f"the signal: it was moved by up to {100 * moved:.2g} % of white to the "
                         "nearest that can be reached.")
    return samples, samples.outcome.value


def into_reach(operator: MeasurementOperator) -> tuple[MeasurementOperator, float]:
    """The operator with its signal moved into reach where need be, and the largest move of a band.

    The nearest signal in the least-squares sense is on the edge of the reachable set, where one
    spectrum fits; it is moved 0.2 % (then 1, 3, 10 %) of the way to middle grey.
    """
    check_operator(operator)
    try:
        max_entropy_tilt(operator)
        return operator, 0.0
    except ConvergenceError:
        nearest = lsq_linear(operator.A, operator.y, bounds=(0, 1), tol=1e-12).x
    for share in TOWARDS_GREY:
        y = operator.A @ ((1 - share) * np.clip(nearest, 0, 1) + share / 2)
        moved = MeasurementOperator(operator.A, y, operator.noise_covariance)
        try:
            max_entropy_tilt(moved)
            return moved, float(np.abs(y - operator.y).max())
        except ConvergenceError:
            continue
    raise ConvergenceError("the signal lies too far from what reflectances between 0 and 1 can "
                           "give; check the white it is relative to")


def published(operator: MeasurementOperator, draws: int, seed: int,
              unbounded_start: bool = False) -> tuple[SpectrumSamples, str]:
    """Draws as published (Sec. 3.2), from bounded least squares or, as printed, unbounded least
    squares clipped.
    """
    check_operator(operator)
    if unbounded_start:
        start = np.linalg.lstsq(operator.A, operator.y, rcond=None)[0]
        if np.any((start < 0) | (start > 1)):
            raise ConvergenceError(f"the unbounded least-squares start runs from {start.min():.3g} "
                                   f"to {start.max():.3g}, outside 0 to 1, where the published "
                                   "sampler finds nothing; use the bounded start")
    else:
        start = np.clip(lsq_linear(operator.A, operator.y, bounds=(0, 1), tol=1e-12).x, 0, 1)
    samples = sample_per_axis(operator, start, draws, seed)
    sentence = ("As published: a box around one solution, which under-states the spread."
                + ("" if samples.outcome is Outcome.CONVERGED else f" {samples.outcome.value}"))
    return samples, sentence
