"""Draws from the joint posterior of all materials: Hamiltonian Monte Carlo, whitened by Laplace, to convergence.

A picture of many pixels pins a few directions down to a thousandth of the prior and leaves the others free; through
the logit and the products of reflectances the pinned directions bend. Laplace's approximation is straight and misses
that, and random walks along it are slow. Hamiltonian trajectories (Neal 2011, Alg. 1) follow the bend: the gradient
costs about as much as the likelihood. All chains move together; step and length are jittered so that none resonates.
"""
from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from radiometry.errors import ConvergenceError, InputError
from radiometry.shaped import Record
from sampling.joint_posterior import JointLaplace, JointProblem, find_map, misfits_and_gradients, spectra_of

CHAINS = 8
WARM_UP, ROUND = 80, 150        # trajectories; rounds are added until the draws have converged
LEARNING = 250                  # trajectories from which the spread along each axis is learnt
PRIOR_WEIGHT = 20.0             # of a spread of 1, in draws
LENGTH = 4.0                    # of a trajectory, in standard deviations of Laplace, which bends make too small
LEAPS = (4, 64)                 # fewest and most steps of a trajectory
WANTED_ACCEPTANCE = 0.8
MOST_TRAJECTORIES = 1500
R_HAT_LIMIT, FEWEST_EFFECTIVE = 1.01, 400.0
WATCHED = 16                    # wavelengths per material whose mixing is watched


@dataclass(frozen=True, eq=False)
class JointSamples(Record):
    """Draws of the reflectances of all materials of a scene on the prior's wavelengths."""

    materials: tuple[str, ...]
    spectra: Annotated[np.ndarray, "T M P"]
    acceptance: float
    r_hat: float                # of the worst watched coordinate
    effective_samples: float    # of the worst watched coordinate
    trajectories: int
    seed: int


def sample_joint(problem: JointProblem, seed: int, found: JointLaplace | None = None,
                 kept: int = 4000, refuse: bool = True) -> JointSamples:
    """Draw from the joint posterior until R-hat < 1.01 and 400 effective draws in the worst coordinate.

    Raises
    ------
    InputError
        If fewer than 100 draws are to be kept.
    ConvergenceError
        If that is not reached in 1500 trajectories of 8 chains and ``refuse`` is set.
    """
    if kept < 100:
        raise InputError(f"{kept} draws were asked for; ask for at least 100")
    found = found or find_map(problem)
    rng = np.random.default_rng(seed)
    values, vectors = np.linalg.eigh(found.covariance)
    root = vectors * np.sqrt(np.maximum(values, 1e-12))
    w = 0.3 * rng.standard_normal((CHAINS, found.z.size))   # nearer to the MAP than Laplace, which over-shoots bends
    state = _State(w, *_potential(problem, found, root, w))
    step = _settle(problem, found, root, state, 0.1, WARM_UP, rng)[0]
    step, seen = _settle(problem, found, root, state, step, LEARNING, rng)
    # Laplace is too narrow where the posterior bends: each of its axes gets the spread that was seen along it.
    spread = np.sqrt((len(seen) * seen.var(axis=0) + PRIOR_WEIGHT) / (len(seen) + PRIOR_WEIGHT))
    root, w = root * spread, state.w / spread
    state = _State(w, *_potential(problem, found, root, w))
    step = _settle(problem, found, root, state, step, WARM_UP, rng)[0]
    history: list[np.ndarray] = []
    rates: list[float] = []
    while len(history) < MOST_TRAJECTORIES:
        for _ in range(ROUND):
            rates.append(_trajectory(problem, found, root, state, step, rng))
            history.append(found.z + state.w @ root.T)
        watched = _watched(problem, np.array(history))
        r_hat, effective = split_r_hat(watched).max(), effective_sample_size(watched).min()
        converged = r_hat < R_HAT_LIMIT and effective > FEWEST_EFFECTIVE
        if converged or (len(history) >= MOST_TRAJECTORIES and not refuse):
            every = np.concatenate(history)
            chosen = every[np.linspace(0, len(every) - 1, min(kept, len(every))).astype(int)]
            return JointSamples(problem.materials, spectra_of(problem, chosen), float(np.mean(rates)), float(r_hat),
                                float(effective), len(history), seed)
    raise ConvergenceError(f"the joint posterior has not converged after {MOST_TRAJECTORIES} trajectories: R-hat "
                           f"{r_hat:.3f}, {effective:.0f} effective draws; state a larger noise, or use Laplace's "
                           "approximation")


def _settle(problem: JointProblem, found: JointLaplace, root: np.ndarray, state: _State, step: float,
            trajectories: int, rng: np.random.Generator) -> tuple[float, np.ndarray]:
    """A step whose acceptance is as wanted, after so many trajectories, and where the chains went (n, M P)."""
    seen = []
    for _ in range(trajectories):
        rate = _trajectory(problem, found, root, state, step, rng)
        step = float(np.clip(step * np.exp(0.25 * (rate - WANTED_ACCEPTANCE)), 0.005, 1.0))
        seen.append(state.w)
    return step, np.concatenate(seen)


@dataclass
class _State:
    """Where the chains are: w (n, M P) in Laplace's units, the potential (n,) and its gradient (n, M P)."""

    w: np.ndarray
    value: np.ndarray
    gradient: np.ndarray


def _trajectory(problem: JointProblem, found: JointLaplace, root: np.ndarray, state: _State, step: float,
                rng: np.random.Generator) -> float:
    """Move every chain by one trajectory; the mean probability of acceptance."""
    size = step * rng.uniform(0.8, 1.2)
    leaps = int(np.clip(rng.uniform(0.5, 1.0) * LENGTH / size, *LEAPS))
    start = rng.standard_normal(state.w.shape)
    w, value, gradient, momentum = state.w, state.value, state.gradient, start
    for _ in range(leaps):
        momentum = momentum - size / 2 * gradient
        w = w + size * momentum
        value, gradient = _potential(problem, found, root, w)
        momentum = momentum - size / 2 * gradient
    change = state.value - value + np.sum(start**2 - momentum**2, axis=1) / 2
    change = np.where(np.isfinite(change), change, -np.inf)     # a trajectory that ran away is refused
    accepted = -rng.standard_exponential(len(w)) <= change
    state.w = np.where(accepted[:, None], w, state.w)
    state.value = np.where(accepted, value, state.value)
    state.gradient = np.where(accepted[:, None], gradient, state.gradient)
    return float(np.exp(np.minimum(change, 0)).mean())


def _potential(problem: JointProblem, found: JointLaplace, root: np.ndarray,
               w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    z = found.z + w @ root.T
    misfit, slope = misfits_and_gradients(problem, z)
    return (misfit + np.sum(z**2, axis=1)) / 2, (slope / 2 + z) @ root


def _watched(problem: JointProblem, history: np.ndarray) -> np.ndarray:
    steps, chains, size = history.shape
    spectra = spectra_of(problem, history.reshape(-1, size))
    some = np.linspace(0, spectra.shape[2] - 1, WATCHED).astype(int)
    return spectra[:, :, some].reshape(steps, chains, -1)


def split_r_hat(values: np.ndarray) -> np.ndarray:
    """R-hat (D,) of values (steps, chains, D), every chain split in halves (Gelman et al. 2013, Eq. 11.4)."""
    half = len(values) // 2
    parts = np.concatenate([values[:half], values[half:2 * half]], axis=1)
    within = parts.var(axis=0, ddof=1).mean(axis=0)
    between = parts.mean(axis=0).var(axis=0, ddof=1)
    return np.sqrt((half - 1) / half + between / np.maximum(within, 1e-300))


def effective_sample_size(values: np.ndarray) -> np.ndarray:
    """Effective number of draws (D,) of values (steps, chains, D), by Geyer's initial positive sequence."""
    steps, chains, _ = values.shape
    centred = values - values.mean(axis=(0, 1))
    spectrum = np.fft.rfft(centred, 2 * steps, axis=0)
    correlation = np.fft.irfft(np.abs(spectrum)**2, axis=0)[:steps].mean(axis=1)
    correlation /= np.maximum(correlation[0], 1e-300)
    pairs = correlation[:steps // 2 * 2].reshape(-1, 2, values.shape[2]).sum(axis=1)
    positive = np.cumprod(pairs > 0, axis=0)
    time = np.maximum(2 * np.sum(pairs * positive, axis=0) - 1, 1e-3)
    return np.minimum(steps * chains / time, steps * chains)
