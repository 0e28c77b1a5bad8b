"""Uniform draws of a polytope in bulk: circuit hit-and-run from exact independent starts.

Every chain starts at an independent exact draw (`tilted_rejection`), so every output is exactly
uniform up to single precision; chains that share a start are correlated only through what the
schedule has not made them forget, and that is measured. Single precision lets A c drift from y by
about 1e-6 of it.
"""
from __future__ import annotations

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records import Outcome
from spectrabox.sampling.polytope.circuits import (
    Circuits,
    design,
    find_circuits,
    schedule,
    steps_for,
)
from spectrabox.sampling.polytope.diagnostics import diagnose, refuse_poor
from spectrabox.sampling.polytope.tilt import Tilt, max_entropy_tilt
from spectrabox.sampling.polytope.tilted_rejection import collect, tilted_proposals
from spectrabox.sampling.spline_measurement import CoefficientDraws, MeasurementOperator

METHOD = "uniform (circuit hit-and-run)"
STARTS = 1024
CHAINS = 4096           # at a time: the coefficients of more would leave the processor's cache


def sample_in_bulk(operator: MeasurementOperator, draws: int, seed: int) -> CoefficientDraws:
    """Draw from {A c = y, 0 <= c <= 1} uniformly, many at a time.

    Parameters
    ----------
    operator : MeasurementOperator
        Without noise.
    draws, seed : int
        T; the same seed gives the same draws bit for bit.

    Raises
    ------
    InputError
        For a signal with noise: use `sample_polytope`.
    ConvergenceError
        If the signal is out of reach, or the draws have not mixed.
    """
    if operator.noise_covariance.any():
        raise InputError("circuit hit-and-run draws for signals without noise; use tilted "
                         "rejection for this one")
    rng = np.random.default_rng(seed)
    tilt = max_entropy_tilt(operator)
    order, circuits = plan_moves(operator, tilt, rng)
    starts = collect(tilted_proposals(operator, tilt, rng), min(STARTS, draws))[0]
    coefficients = run_chains(starts, circuits, order, draws, rng)
    diagnosis = diagnose(starts, coefficients)
    if draws >= STARTS:
        refuse_poor(diagnosis, draws)
    return CoefficientDraws(coefficients, 1.0, diagnosis.effective_samples, Outcome.EXACT)


def plan_moves(operator: MeasurementOperator, tilt: Tilt, rng: np.random.Generator
               ) -> tuple[np.ndarray, Circuits]:
    """The schedule of one measurement and the circuits it refers to.

    Parameters
    ----------
    operator : MeasurementOperator
        ``A`` (K, N), signal ``y`` (K,) relative to white, and its noise covariance (K, K).
    tilt : Tilt
    rng : numpy.random.Generator
    """
    circuits = find_circuits(operator.A, rng)
    bands, coefficients = operator.A.shape
    probabilities = design(circuits, operator.A, tilt.h, rng)
    steps = steps_for(coefficients, bands)
    return schedule(circuits, probabilities, steps, coefficients, rng), circuits


def run_chains(starts: np.ndarray, circuits: Circuits, order: np.ndarray, draws: int,
               rng: np.random.Generator) -> np.ndarray:
    """Ends of chains that make the same moves, each with random lengths of its own.

    Given the schedule the chains are independent: a move is along one circuit, to a point uniform
    on the part of that line within the box.

    Parameters
    ----------
    starts : (n, N) array
        Where chains start: reused in turn.
    circuits : Circuits
    order : (steps,) array
        Indices of the circuits, from `plan_moves`.
    draws : int
        T, the number of chains.
    rng : Generator

    Returns
    -------
    (T, N) array
    """
    members = circuits.members[order]
    components = circuits.components[order, :, None].astype(np.float32)
    ends = np.empty((draws, starts.shape[1]))
    by_coefficient = np.ascontiguousarray(starts.T, dtype=np.float32)
    for first in range(0, draws, CHAINS):
        count = min(CHAINS, draws - first)
        c = by_coefficient[:, np.arange(first, first + count) % len(starts)]
        for touched, component in zip(members, components, strict=True):
            x = c[touched]
            to_zero = x / -component
            to_one = to_zero + 1 / component
            length = np.minimum(to_zero, to_one).max(axis=0)
            longest = np.maximum(to_zero, to_one).min(axis=0)
            length += (longest - length) * rng.random(count, dtype=np.float32)
            x += component * length
            c[touched] = np.clip(x, 0, 1, out=x)    # round-off could leave the box
        ends[first:first + count] = c.T
    return ends
