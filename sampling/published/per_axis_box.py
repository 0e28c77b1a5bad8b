"""The sampler as published (paper Sec. 3.2, steps 2 to 4), for comparison only: it under-states the
spread.

Step 2 finds, for every null direction d on its own, the interval of z_d that keeps c0 + N_d z_d in
[0, 1]; step 3 draws z uniformly in the box of these intervals; step 4 keeps the draws whose
coefficients all lie in [0, 1].

What this samples is the part of the polytope {A c = A c0, 0 <= c <= 1} inside a box through c0,
uniformly. That part depends on c0 and on the rotation of the null directions, neither of which the
camera knows. Against uniform draws of the whole polytope (median of 24 chart colours, three bands):

    coefficients                     5      7      9      13
    share of the polytope in it     0.82   0.21   0.055  0.0003
    standard deviation, ratio       0.85   0.66   0.62   0.53
    largest bias of the mean        0.03   0.13   0.24   0.33

The yield of step 4 stays near 0.8 because the box misses the polytope: it is no sign of health.
"""
from __future__ import annotations

import numpy as np

from spectrabox.radiometry.errors import ConvergenceError, InputError
from spectrabox.radiometry.records import spectra
from spectrabox.sampling import spectral_measurement, uniform
from spectrabox.sampling.polytope import tilt, tilted_rejection
from spectrabox.sampling.prior.mixture import LogitMixture

METHOD = "per-axis box as published (under-states the spread)"
BOX_ATOL = 1e-9  # bounded least squares returns coefficients this far outside [0, 1]


def sample_published(measurement: spectra.SpectralMeasurement, draws: int, seed: int,
                     coefficients: int, prior: LogitMixture | None = None, *,
                     unbounded_start: bool = False) -> spectra.SpectrumSamples:
    """Draws as published (Sec. 3.2); see `sampling.draw_methods.draw_spectra`.

    ``prior`` is not used. The start is bounded least squares or, with ``unbounded_start`` and as
    printed, unbounded least squares.

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
    unbounded_start : bool

    Raises
    ------
    ConvergenceError
        If the unbounded start leaves [0, 1].
    """
    spectral_measurement.check_measurement(measurement)
    spectral_measurement.check_draw_count(draws)
    operator = spectral_measurement.spline_operator(measurement, coefficients)
    tilt.check_operator(operator)
    if unbounded_start:
        start = np.linalg.lstsq(operator.A, operator.y, rcond=None)[0]
        if np.any((start < 0) | (start > 1)):
            raise ConvergenceError(
                f"the unbounded least-squares start runs from {start.min():.3g} to "
                f"{start.max():.3g}, outside 0 to 1, where the published sampler has no draws; "
                "use the bounded start")
    else:
        start = spectral_measurement.nearest_coefficients(operator.A, operator.y)
    box, outcome = sample_per_axis(operator, start, draws, seed)
    ended = () if outcome is spectra.Outcome.CONVERGED else (outcome.finding(),)
    return uniform.as_spectra(box, METHOD, seed, spectra.Outcome.AS_PUBLISHED,
                      spectra.Outcome.AS_PUBLISHED.finding(), *ended)


def sample_per_axis(operator: spectral_measurement.MeasurementOperator, c0: np.ndarray, draws: int,
                    seed: int) -> tuple[np.ndarray, spectra.Outcome]:
    """Draw coefficients (T, N) as published, around ``c0`` (N,), until ``draws`` are kept.

    The draws reproduce ``A c0``; the noise of the signal is not used. The outcome is
    ``Outcome.UNREACHABLE`` where ``A c0`` is not the signal.

    Parameters
    ----------
    operator : MeasurementOperator
        ``A`` (K, N), signal ``y`` (K,) relative to white, and its noise covariance (K, K).
    c0 : (N,) array
        Start, within 0 to 1.
    draws : int
        T, at least 1.
    seed : int
        Of the random generator; the same seed gives the same draws bit for bit.

    Raises
    ------
    InputError
        If c0 has another size or leaves [0, 1], or no draws are asked for; see also
        `sampling.polytope.tilt.check_operator`.
    CalibrationError
        If A is rank deficient.
    ConvergenceError
        If the acceptance is below about 1e-5.
    """
    tilt.check_operator(operator)
    if c0.shape != operator.A.shape[1:]:
        raise InputError(f"c0 has shape {c0.shape}; ({operator.A.shape[1]},) is needed")
    if not np.all((c0 >= -BOX_ATOL) & (c0 <= 1 + BOX_ATOL)):
        raise InputError(f"c0 runs from {c0.min():.3g} to {c0.max():.3g}; the method needs a start "
                         "within 0 to 1, as bounded least squares gives")
    start = np.clip(c0, 0, 1)
    directions = tilt.null_space(operator)
    coefficients, _ = draw_in_box(start, directions, draws, seed)
    # 1e-6 of white: the accuracy to which a least-squares start reproduces a signal that is within
    # reach.
    fits = np.allclose(operator.A @ start, operator.y, rtol=0, atol=1e-6)
    return coefficients, spectra.Outcome.CONVERGED if fits else spectra.Outcome.UNREACHABLE


def axis_intervals(c0: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Ends (D,) of the z_d that keep c0 + directions[:, d] z_d in [0, 1], for each of (N, D)
    directions by itself.

    Parameters
    ----------
    c0 : (N,) array
    directions : (N, D) array
        Null directions.
    """
    moves = np.where(np.abs(directions) < np.finfo(float).eps, np.finfo(float).eps, directions)
    at_zero, at_one = -c0[:, None] / moves, (1 - c0[:, None]) / moves
    return np.minimum(at_zero, at_one).max(axis=0), np.maximum(at_zero, at_one).min(axis=0)


def draw_in_box(start: np.ndarray, directions: np.ndarray, draws: int,
                seed: int) -> tuple[np.ndarray, float]:
    """Coefficients (T, N) in [0, 1] drawn evenly in the box of ``axis_intervals``, and the share
    that was accepted.

    Parameters
    ----------
    start : (N,) array
        Coefficients in [0, 1].
    directions : (N, D) array
        Null directions.
    draws : int
        T, at least 1.
    seed : int
        Of the random generator; the same seed gives the same draws bit for bit.
    """
    low, high = axis_intervals(start, directions)
    rng = np.random.default_rng(seed)

    def propose(proposals: int) -> np.ndarray:
        c = start + (low + (high - low) * rng.random((proposals, low.size))) @ directions.T
        return c[np.all((c >= 0) & (c <= 1), axis=1)]

    return tilted_rejection.collect(propose, draws)
