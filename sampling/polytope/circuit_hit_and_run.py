"""Uniform draws of a polytope in bulk: circuit hit-and-run from exact independent starts.

Every chain starts at an independent exact draw (`tilted_rejection`), so every output is exactly
uniform up to single precision; chains that share a start are correlated only through what the
schedule has not made them forget, and that is measured. Single precision lets A c drift from y by
about 1e-6 of it.
"""
from __future__ import annotations

import itertools
from dataclasses import dataclass
from math import comb

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records.spectra import Outcome
from spectrabox.sampling.polytope.diagnostics import diagnose, refuse_poor
from spectrabox.sampling.polytope.tilt import Tilt, max_entropy_tilt, tilt_moments
from spectrabox.sampling.polytope.tilted_rejection import collect, draw_tilted, tilted_proposals
from spectrabox.sampling.spectral_measurement import CoefficientDraws, MeasurementOperator

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


# ---- circuits ------------------------------------------------------------------------------------
# Circuits of a camera and a schedule of moves along them.
#
# A circuit is a null vector of A that touches only K + 1 coefficients: a move along it leaves the
# signal alone and costs K + 1 numbers instead of N. Which circuits are used decides how fast the
# sampler forgets its start. The schedule is an A-optimal design (Silvey, Titterington and Torsney
# 1978): probabilities p of circuits that minimise the trace of the inverse of sum p V V', V being
# the expected squared move along the circuit in the whitened null space.

MAX_CIRCUITS = 500         # candidates; all 5985 of N = 21 mix no better
PSEUDO_SAMPLES = 50         # tilted points at which the lengths of moves are measured
ITERATIONS = 20  # of the multiplicative algorithm; more does not make the draws mix better
TINY = 1e-6  # a component of a circuit below this is set to it, or the division by it overflows
MIN_VISITS = 3           # of every coefficient: a schedule by chance alone once left one unmoved

# Steps after which the start is forgotten to a canonical correlation of about 0.05 (three bands),
# by N.
STEPS = ((5, 24), (7, 32), (9, 44), (11, 56), (13, 72), (15, 92), (21, 180), (31, 330), (40, 480))


@dataclass(frozen=True)
class Circuits:
    """Members (n, K + 1) and components (n, K + 1), the largest being 1 in size."""

    members: np.ndarray
    components: np.ndarray


def find_circuits(A: np.ndarray, rng: np.random.Generator) -> Circuits:
    """All circuits of A (K, N), or 500 chosen at random where there are more.

    Parameters
    ----------
    A : (K, N) array
        From coefficients to signal.
    rng : numpy.random.Generator
    """
    bands, coefficients = A.shape
    if comb(coefficients, bands + 1) <= MAX_CIRCUITS:
        members = np.array(list(itertools.combinations(range(coefficients), bands + 1)))
    else:
        order = np.argsort(rng.random((MAX_CIRCUITS, coefficients)), axis=1)[:, :bands + 1]
        members = np.sort(order, axis=1)
    whitened = np.linalg.svd(A, full_matrices=False)[2]
    # By Cramer's rule the null vector of K x (K + 1) is made of its signed minors: cheaper than a
    # decomposition each.
    columns = whitened[:, members].transpose(1, 0, 2)
    components = np.stack([(-1)**j * np.linalg.det(np.delete(columns, j, axis=2))
                           for j in range(bands + 1)], axis=1)
    size = np.abs(components).max(axis=1, keepdims=True)
    whole = size[:, 0] > 1e-9 * size.max()
    components = components[whole] / size[whole]
    small = np.abs(components) < TINY
    return Circuits(members[whole].astype(np.int64), np.where(small, np.copysign(TINY, components),
                                                              components))


def design(circuits: Circuits, A: np.ndarray, h: np.ndarray,
           rng: np.random.Generator) -> np.ndarray:
    """Probabilities (n,) of the circuits under the tilt h (N,); most are zero.

    Parameters
    ----------
    circuits : Circuits
    A : (K, N) array
        From coefficients to signal.
    h : (N,) array
        Slopes of the tilt.
    rng : numpy.random.Generator
    """
    _, _, variance = tilt_moments(h)
    covariance = np.diag(variance) - (A * variance).T @ np.linalg.solve((A * variance) @ A.T,
                                                                        A * variance)
    null = np.linalg.svd(A)[2][len(A):].T
    spread = null.T @ covariance @ null
    root = np.linalg.cholesky(spread + 1e-12 * np.trace(spread) * np.eye(len(spread)))
    points = draw_tilted(h, rng.random((PSEUDO_SAMPLES, h.size)))
    length = np.sqrt(_mean_square_chord(points, circuits) / 12)
    along = np.einsum("nk,nkd->nd", circuits.components, null[circuits.members])
    moves = np.linalg.solve(root, along.T).T * length[:, None]
    p = np.full(len(moves), 1 / len(moves))
    alive = np.arange(len(moves))
    for iteration in range(ITERATIONS):
        inverse = np.linalg.inv((moves[alive] * p[alive, None]).T @ moves[alive])
        p[alive] *= np.sqrt(np.sum((moves[alive] @ inverse)**2, axis=1) / np.trace(inverse))
        p /= p.sum()
        if iteration % 10 == 9:
            p[p < 1e-3 / len(moves)] = 0
            alive = np.flatnonzero(p)
            p /= p.sum()
    return p


def schedule(circuits: Circuits, probabilities: np.ndarray, steps: int, coefficients: int,
             rng: np.random.Generator) -> np.ndarray:
    """Indices of circuits, at least ``steps`` of them, in random order, every coefficient moved
    three times or more.

    Systematic resampling of the circuits sorted by their dominant coefficient gives every
    coefficient its quota.

    Parameters
    ----------
    circuits : Circuits
    probabilities : (n,) array
        Of the circuits, from `design`.
    steps : int
        Least number of moves.
    coefficients : int
        N, of the spline class.
    rng : numpy.random.Generator
    """
    dominant = np.take_along_axis(circuits.members,
                                  np.abs(circuits.components).argmax(axis=1)[:, None], axis=1)[:, 0]
    possible = np.flatnonzero(probabilities > 0)
    possible = possible[np.argsort(dominant[possible], kind="stable")]
    cumulative = np.cumsum(probabilities[possible]) / probabilities[possible].sum()
    positions = np.searchsorted(cumulative, (np.arange(steps) + rng.random()) / steps)
    chosen = possible[positions.clip(max=len(possible) - 1)]
    visits = np.zeros(coefficients, dtype=int)
    large = np.abs(circuits.components) > 0.3
    np.add.at(visits, circuits.members[chosen][large[chosen]], 1)
    extra = []
    for coefficient in np.flatnonzero(visits < MIN_VISITS):
        touching = np.flatnonzero(np.any((circuits.members == coefficient) & large, axis=1))
        if touching.size:
            extra.append(rng.choice(touching, MIN_VISITS - visits[coefficient]))
    return rng.permutation(np.concatenate([chosen, *extra]))


def steps_for(coefficients: int, bands: int) -> int:
    """Length of a schedule that mixes well; more for more bands, whose circuits are shorter.

    Parameters
    ----------
    coefficients : int
        N, of the spline class.
    bands : int
        K.
    """
    table = np.array(STEPS, dtype=float)
    return round(float(np.interp(coefficients, *table.T)) * max(1.0, bands / 3)**2)


def _mean_square_chord(points: np.ndarray, circuits: Circuits) -> np.ndarray:
    c, d = points[:, circuits.members], circuits.components
    at_zero, at_one = -c / d, (1 - c) / d
    chord = np.maximum(at_zero, at_one).min(axis=2) - np.minimum(at_zero, at_one).max(axis=2)
    return np.mean(chord**2, axis=0)
