"""Exact independent draws of every spectrum that fits one measurement, noise included.

The target is the posterior of c under a uniform prior on [0, 1]^N and the likelihood y = A c + N(0, R). R = 0 is
allowed: the target is then exactly uniform on the polytope {A c = y, 0 <= c <= 1}.

The algorithm. Take any theta (K,), h = A' theta, and K basic columns whose A_B is invertible; F are the others.
  1. y' ~ N(y - R theta, R): the noise-free signal, guessed;
  2. c_j with density proportional to exp(h_j c_j) on [0, 1], for j in F;
  3. c_B = A_B^-1 (y' - A_F c_F); reject unless 0 <= c_B <= 1;
  4. accept with probability exp(sum over B of (h_j c_j - max(0, h_j))), which is at most 1.

Why the accepted draws are exact. (y', c_F) determines c, with the constant Jacobian |det A_B|, so in these variables
the target density is proportional to N(y'; y, R) 1[c in the box]. The proposal density is proportional to
N(y'; y - R theta, R) exp(h_F.c_F), and completing the square in the Gaussian gives N(y'; y, R) exp(-theta.y')
exp(h_F.c_F) up to a constant; where R is singular both densities live on the same subspace through y. On the solution
theta.y' = theta.A c = h.c, so target / proposal = exp(h.c - h_F.c_F) = exp(h_B.c_B) 1[c in the box]. Step 4 is that
ratio divided by its largest value.

Nothing above uses which theta it is: theta decides the acceptance only. The maximum-entropy tilt makes A c centre on
the signal, so that the acceptance falls polynomially with N where bounding boxes collapse exponentially.
"""
from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.linalg import lu_factor, lu_solve, qr

from radiometry.errors import ConvergenceError, InputError
from radiometry.records import MeasurementOperator, Outcome, SpectrumSamples
from sampling.tilt import Tilt, max_entropy_tilt, tilt_moments

METHOD = "uniform (tilted rejection)"
FIRST_BLOCK, LARGEST_BLOCK = 4096, 65536  # proposals held in memory at once
PATIENCE = 2_000_000                      # proposals before a low acceptance is called hopeless
HOPELESS = 1e-5                           # acceptance: 1000 draws would take minutes

Propose = Callable[[int], np.ndarray]     # number of proposals -> accepted (n, N), independent and identical in law


def sample_spectra(operator: MeasurementOperator, draws: int, seed: int) -> SpectrumSamples:
    """Draw coefficients from the posterior of one measurement, independently and exactly.

    Parameters
    ----------
    operator : MeasurementOperator
        ``A`` (K, N), signal ``y`` (K,) relative to white, and its noise covariance; zeros for a hard equality.
    draws : int
        T, number of spectra wanted.
    seed : int
        Of the random generator; the same seed gives the same draws bit for bit.

    Returns
    -------
    SpectrumSamples
        With coefficients (T, N) in [0, 1]. The outcome is ``Outcome.UNREACHABLE`` where no spectrum of the class gives
        the signal without noise.

    Raises
    ------
    InputError
        For numbers that are not finite, more bands than coefficients, a noise covariance that is none, or no draws.
    CalibrationError
        If A is rank deficient.
    ConvergenceError
        If the signal is out of reach and R does not cover it, or if the acceptance is below about 1e-5.
    """
    tilt = max_entropy_tilt(operator)
    rng = np.random.default_rng(seed)
    coefficients, acceptance = collect(tilted_proposals(operator, tilt, rng), draws)
    return SpectrumSamples(coefficients, None, METHOD, acceptance, float(draws), seed,
                           Outcome.EXACT if tilt.reachable else Outcome.UNREACHABLE)


def tilted_proposals(operator: MeasurementOperator, tilt: Tilt, rng: np.random.Generator) -> Propose:
    """The steps 1 to 4 as a function of the number of proposals, which returns the accepted coefficients."""
    basic = basic_columns(operator.A, tilt.h)
    free = np.setdiff1d(np.arange(tilt.h.size), basic)
    factors = lu_factor(operator.A[:, basic])
    variances, directions = np.linalg.eigh(operator.noise_covariance)
    noise = directions * np.sqrt(np.maximum(variances, 0))  # the maximum drops round-off below 0 of a singular R
    centre = operator.y - operator.noise_covariance @ tilt.theta
    h_basic = tilt.h[basic]

    def propose(proposals: int) -> np.ndarray:
        signal = centre + rng.standard_normal((proposals, centre.size)) @ noise.T
        c_free = draw_tilted(tilt.h[free], rng.random((proposals, free.size)))
        c_basic = lu_solve(factors, (signal - c_free @ operator.A[:, free].T).T).T
        log_ratio = c_basic @ h_basic - np.maximum(h_basic, 0).sum()
        inside = np.all((c_basic >= 0) & (c_basic <= 1), axis=1)
        accepted = inside & (-rng.standard_exponential(proposals) <= log_ratio)
        c = np.empty((np.count_nonzero(accepted), tilt.h.size))
        c[:, free], c[:, basic] = c_free[accepted], c_basic[accepted]
        return c

    return propose


def draw_tilted(h: np.ndarray, uniform: np.ndarray) -> np.ndarray:
    """Inverse of the distribution function of exp(h c) on [0, 1], for h (F,) and uniform numbers (T, F) in [0, 1)."""
    # The draw is made for -|h| and mirrored, so no exponential overflows; 1e-100 stands for h = 0, where c = u.
    slope = np.maximum(np.abs(h), 1e-100)
    c = np.minimum(-np.log1p(uniform * np.expm1(-slope)) / slope, 1)
    return np.where(h > 0, 1 - c, c)


def basic_columns(A: np.ndarray, h: np.ndarray) -> np.ndarray:
    """Indices (K,) of columns that nearly maximise |det A_B| prod Z(h_j) exp(-max(0, h_j)), hence the acceptance.

    With the columns scaled by their factor this is a submatrix of largest volume: start from the pivots of a QR
    factorisation and swap while one swap gains more than 1 %.
    """
    log_z, _, _ = tilt_moments(h)
    scaled = A * np.exp(log_z - np.maximum(h, 0))
    _, _, pivots = qr(scaled, mode="economic", pivoting=True)
    basic = pivots[:len(A)].copy()
    while True:
        # Cramer: entry (i, j) is the factor by which the volume changes when column j takes the place of basic[i].
        gain = np.abs(np.linalg.solve(scaled[:, basic], scaled))
        out, column = np.unravel_index(np.argmax(gain), gain.shape)
        if gain[out, column] < 1.01:
            return np.sort(basic)
        basic[out] = column


def collect(propose: Propose, draws: int) -> tuple[np.ndarray, float]:
    """Propose until ``draws`` are accepted; return them (T, N) and the acceptance.

    Raises
    ------
    InputError
        If less than one draw is asked for.
    ConvergenceError
        If the acceptance is below about 1e-5.
    """
    if draws < 1:
        raise InputError(f"{draws} draws were asked for; ask for at least 1")
    kept: list[np.ndarray] = []
    accepted, proposals, block = 0, 0, FIRST_BLOCK
    while accepted < draws:
        kept.append(propose(block))
        accepted += len(kept[-1])
        proposals += block
        if proposals >= PATIENCE and accepted < HOPELESS * proposals:
            raise ConvergenceError(
                f"only {accepted} of {proposals} proposals were accepted; use fewer coefficients, fewer bands, "
                "or state a larger noise of the signal")
        missing = (draws - accepted) * proposals / max(accepted, 1)
        block = int(np.clip(1.1 * missing, FIRST_BLOCK, LARGEST_BLOCK))
    return np.concatenate(kept)[:draws], accepted / proposals
