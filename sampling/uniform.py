"""Exact uniform draws of every spline that gives one signal, one of the METHODS.

An unreachable signal is moved into reach first, and the outcome says by how much.
"""
from __future__ import annotations

import numpy as np

from spectrabox.radiometry import errors, findings, grid
from spectrabox.radiometry.records.spectra import Outcome, SpectralMeasurement, SpectrumSamples
from spectrabox.sampling import spectral_measurement
from spectrabox.sampling.polytope import tilt, tilted_rejection
from spectrabox.sampling.prior.mixture import PRIOR_GRID, LogitMixture

# how far an unreachable signal is moved into what can be reached
TOWARDS_GREY = (0.002, 0.01, 0.03, 0.1)


def sample_uniform(measurement: SpectralMeasurement, draws: int, seed: int, coefficients: int,
                   prior: LogitMixture | None = None) -> SpectrumSamples:
    """Draw splines uniformly from all that give the signal; see `draw_methods.draw_spectra`.

    ``prior`` is not used: the coefficients are uniform in [0, 1].

    Parameters
    ----------
    measurement : SpectralMeasurement
    draws : int
        T, at least 1.
    seed : int
        Of the random generator; the same seed gives the same draws bit for bit.
    coefficients : int
        N, of the spline class.
    prior : LogitMixture, optional
        Not used.
    """
    spectral_measurement.check_measurement(measurement)
    spectral_measurement.check_draw_count(draws)
    operator, moved = into_reach(spectral_measurement.spline_operator(measurement, coefficients))
    drawn, _, outcome = tilted_rejection.sample_polytope(operator, draws, seed)
    if not moved:
        return as_spectra(drawn, tilted_rejection.METHOD, seed, outcome)
    return as_spectra(drawn, tilted_rejection.METHOD, seed, Outcome.MOVED,
                      Outcome.MOVED.finding(coefficients=coefficients, moved=float(moved)))


def as_spectra(coefficients: np.ndarray, method: str, seed: int, outcome: Outcome,
               *findings: findings.Finding) -> SpectrumSamples:
    """Independent draws as spectra at 400, 405 ... 700 nm.

    Parameters
    ----------
    coefficients : (T, N) array
        Of splines, all equally likely.
    method : str
    seed : int
        Of the random generator; the same seed gives the same draws bit for bit.
    outcome : Outcome
    *findings : Finding
        On the outcome; by default that alone.
    """
    spectra = coefficients @ grid.basis_matrix(PRIOR_GRID.nm, coefficients.shape[1]).T
    spectra.flags.writeable = False     # nobody else has them: the record need not copy
    return SpectrumSamples(PRIOR_GRID, spectra, coefficients, method, float(len(coefficients)),
                           seed, outcome, findings or (outcome.finding(),))


def into_reach(
    operator: spectral_measurement.MeasurementOperator
) -> tuple[spectral_measurement.MeasurementOperator, float]:
    """The operator with its signal moved into reach where need be, and the largest move of a band.

    The nearest signal in the least-squares sense is on the edge of the reachable set, where one
    spectrum fits; it is moved 0.2 % (then 1, 3, 10 %) of the way to middle grey.

    Parameters
    ----------
    operator : MeasurementOperator
        ``A`` (K, N), signal ``y`` (K,) relative to white, and its noise covariance (K, K).

    Raises
    ------
    ConvergenceError
        If the signal lies too far away.
    """
    tilt.check_operator(operator)
    try:
        tilt.max_entropy_tilt(operator)
        return operator, 0.0
    except errors.ConvergenceError:
        nearest = spectral_measurement.nearest_coefficients(operator.A, operator.y)
    for share in TOWARDS_GREY:
        y = operator.A @ ((1 - share) * nearest + share / 2)
        moved = spectral_measurement.MeasurementOperator(operator.A, y, operator.noise_covariance)
        try:
            tilt.max_entropy_tilt(moved)
            return moved, float(np.abs(y - operator.y).max())
        except errors.ConvergenceError:
            continue
    raise errors.ConvergenceError(
        "the signal lies too far from what reflectances between 0 and 1 can "
        "give; check the white it is relative to")
