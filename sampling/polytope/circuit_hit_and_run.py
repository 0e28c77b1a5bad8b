"""Uniform draws of a polytope in bulk: circuit hit-and-run, compiled, from exact independent
starts.

Every chain starts at an independent exact draw (`tilted_rejection`), so every output is exactly
uniform up to single precision; chains that share a start are correlated only through what the
schedule has not made them forget, and that is measured. Single precision lets A c drift from y by
about 1e-6 of it.
"""
from __future__ import annotations

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records import Outcome
from spectrabox.sampling.measurement import CoefficientDraws, MeasurementOperator
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

METHOD = "uniform (circuit hit-and-run)"
STARTS = 1024
SEED_LIMIT = 2**32 - 1


def sample_in_bulk(operator: MeasurementOperator, draws: int, seed: int, steps: int | None = None,
                   parallel: bool = True) -> CoefficientDraws:
    """Draw from {A c = y, 0 <= c <= 1} uniformly, many at a time.

    Parameters
    ----------
    operator : MeasurementOperator
        Without noise.
    draws, seed : int
        T; the same seed gives the same draws bit for bit, on any number of cores.
    steps : int, optional
        Of every chain; by default enough to forget the start.
    parallel : bool
        Over all cores.

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
    order, circuits = plan_moves(operator, tilt, rng, steps)
    starts = collect(tilted_proposals(operator, tilt, rng), min(STARTS, draws))[0]
    coefficients = run_chains(starts, circuits, order, draws, rng, parallel)
    diagnosis = diagnose(starts, coefficients)
    if draws >= STARTS:
        refuse_poor(diagnosis, draws)
    return CoefficientDraws(coefficients, 1.0, diagnosis.effective_samples, Outcome.EXACT)


def plan_moves(operator: MeasurementOperator, tilt: Tilt, rng: np.random.Generator,
               steps: int | None = None) -> tuple[np.ndarray, Circuits]:
    """The schedule of one measurement and the circuits it refers to."""
    circuits = find_circuits(operator.A, rng)
    bands, coefficients = operator.A.shape
    probabilities = design(circuits, operator.A, tilt.h, rng)
    count = steps if steps is not None else steps_for(coefficients, bands)
    return schedule(circuits, probabilities, count, coefficients, rng), circuits


def run_chains(starts: np.ndarray, circuits: Circuits, order: np.ndarray, draws: int,
               rng: np.random.Generator, parallel: bool) -> np.ndarray:
    """Ends (T, N) of ``draws`` chains that go through the schedule from the starts (n, N), reused
    in turn.
    """
    from spectrabox.sampling.polytope import circuit_kernels as kernels

    blocks = -(-draws // kernels.CHAINS)
    states = rng.integers(1, SEED_LIMIT, (blocks, kernels.CHAINS), dtype=np.uint32)
    weyls = rng.integers(0, SEED_LIMIT, blocks, dtype=np.uint32)
    out = np.empty((blocks, starts.shape[1], kernels.CHAINS), np.float32)
    run = kernels.run_parallel if parallel else kernels.run_serial
    # kernels then read a short table that stays in the cache
    used, where = np.unique(order, return_inverse=True)
    run(np.ascontiguousarray(starts.T, dtype=np.float32), circuits.members[used],
        circuits.components[used], where, states, weyls, out)
    return kernels.chains_as_rows(out, draws)
