"""Exact independent draws of every spectrum that fits one measurement, noise included.

The target is the posterior of c under a uniform prior on [0, 1]^N and the likelihood y = A c + N(0,
R). R = 0 is allowed: the target is then exactly uniform on the polytope {A c = y, 0 <= c <= 1}.

Write R = L L' and the noise as L e with e ~ N(0, I): the unknowns are x = (c, e), and [A L] x = y
holds exactly. The target is then the law of x under uniform c and normal e, given [A L] x = y.

The algorithm. Take any theta (K,), (h, g) = [A L]' theta, and K basic columns of [A L] that are
invertible; F are the others. Every coordinate has a tilted density f_j: exp(h_j c_j) on [0, 1], or
exp(g_k e_k - e_k^2 / 2), which is N(g_k, 1).
  1. draw x_j with density proportional to f_j, for j in F;
  2. solve [A L]_B x_B = y - [A L]_F x_F;
  3. accept with probability prod over B of f_j(x_j) / max f_j, which is 0 for a coefficient outside
     [0, 1].

Why the accepted draws are exact. x_F determines x, with the constant Jacobian 1 / |det [A L]_B|. On
the solutions h.c + g.e = theta.[A L] x = theta.y is constant, so there the target density, 1[0 <= c
<= 1] exp(-|e|^2 / 2), is proportional to the product of f_j over all j. The proposal density is the
product over F. Their ratio is the product over B, and step 3 divides it by its largest value.

Where all basic columns belong to A, this reads: guess the noise-free signal y' ~ N(y - R theta, R),
draw c_F, solve c_B = A_B^-1 (y' - A_F c_F), reject outside the box, accept with probability exp(sum
over B of h_j c_j - max(0, h_j)). Where they all belong to L: draw c tilted, accept with the
Gaussian likelihood of its signal about y - R theta. Signals within reach use the first, signals out
of reach by many standard errors the second or a mixture.

Nothing above uses which theta it is: theta decides the acceptance only. The maximum-entropy tilt
centres the draws on the signal, so that the acceptance falls polynomially with N where bounding
boxes collapse exponentially.
"""
from __future__ import annotations

from collections.abc import Callable

import numpy as np

from spectrabox.radiometry.errors import ConvergenceError, InputError
from spectrabox.radiometry.records.spectra import Outcome
from spectrabox.sampling.polytope.tilt import max_entropy_tilt, tilt_moments
from spectrabox.sampling.spectral_measurement import MeasurementOperator

METHOD = "uniform (tilted rejection)"
# proposals at once: larger arrays leave the cache and take twice as long
MIN_BLOCK, MAX_BLOCK = 1024, 4096
PATIENCE = 2_000_000    # proposals before a low acceptance is called hopeless
HOPELESS = 1e-5         # acceptance: 1000 draws would take half a minute

# number of proposals -> accepted (n, N), independent and identical in law
Propose = Callable[[int], np.ndarray]


def sample_polytope(operator: MeasurementOperator, draws: int,
                    seed: int) -> tuple[np.ndarray, float, Outcome]:
    """Coefficients drawn from the posterior of one measurement, independently and exactly.

    Parameters
    ----------
    operator : MeasurementOperator
        ``A`` (K, N), signal ``y`` (K,) relative to white, and its noise covariance; zeros for a
        hard equality.
    draws : int
        T, number of draws wanted.
    seed : int
        Of the random generator; the same seed gives the same draws bit for bit.

    Returns
    -------
    coefficients : (T, N) array
        In [0, 1], all equally likely.
    acceptance : float
        Share of the proposals that were kept.
    outcome : Outcome
        ``Outcome.UNREACHABLE`` where no spectrum of the class gives the signal without noise.

    Raises
    ------
    InputError
        For numbers that are not finite, more bands than coefficients, a noise covariance that is
        none, or no draws.
    CalibrationError
        If A is rank deficient.
    ConvergenceError
        If the signal is out of reach and R does not cover it, or if the acceptance is below about
        1e-5.
    """
    theta, reachable = max_entropy_tilt(operator)
    rng = np.random.default_rng(seed)
    coefficients, acceptance = collect(tilted_proposals(operator, theta, rng), draws)
    return coefficients, acceptance, Outcome.EXACT if reachable else Outcome.UNREACHABLE


def tilted_proposals(operator: MeasurementOperator, theta: np.ndarray,
                     rng: np.random.Generator) -> Propose:
    """The steps 1 to 3 as a function of the number of proposals, which returns the accepted
    coefficients.

    Parameters
    ----------
    operator : MeasurementOperator
        ``A`` (K, N), signal ``y`` (K,) relative to white, and its noise covariance (K, K).
    theta : (K,) array
        Of the tilt; the law of the draws does not depend on it.
    rng : numpy.random.Generator
    """
    coefficients = operator.A.shape[1]
    columns = np.hstack([operator.A, noise_columns(operator.noise_covariance)])
    slopes = theta @ columns
    basic = basic_columns(columns, slopes, coefficients)
    inverse = np.linalg.inv(columns[:, basic])    # of nearly largest volume, so well conditioned
    is_free = np.isin(np.arange(slopes.size), basic, invert=True)
    free_c, free_e = np.flatnonzero(is_free[:coefficients]), coefficients + np.flatnonzero(
        is_free[coefficients:])
    basic_c, basic_e = basic[basic < coefficients], basic[basic >= coefficients]

    def propose(proposals: int) -> np.ndarray:
        x = np.empty((proposals, slopes.size))
        x[:, free_c] = draw_tilted(slopes[free_c], rng.random((proposals, free_c.size)))
        x[:, free_e] = slopes[free_e] + rng.standard_normal((proposals, free_e.size))
        x[:, basic] = (operator.y - x[:, is_free] @ columns[:, is_free].T) @ inverse.T
        c = x[:, basic_c]
        log_ratio = (c @ slopes[basic_c] - np.maximum(slopes[basic_c], 0).sum()
                     - ((x[:, basic_e] - slopes[basic_e])**2).sum(axis=1) / 2)
        inside = np.all((c >= 0) & (c <= 1), axis=1)
        return x[inside & (-rng.standard_exponential(proposals) <= log_ratio), :coefficients]

    return propose


def noise_columns(covariance: np.ndarray) -> np.ndarray:
    """L (K, r) with L L' equal to the covariance (K, K) of rank r; no columns where there is no
    noise.

    Parameters
    ----------
    covariance : (K, K) array
    """
    variances, directions = np.linalg.eigh(covariance)
    return (directions * np.sqrt(np.maximum(variances, 0)))[:, variances > 0]


def draw_tilted(h: np.ndarray, uniform: np.ndarray) -> np.ndarray:
    """Inverse of the distribution function of exp(h c) on [0, 1], for h (F,) and uniform numbers
    (T, F) in [0, 1).

    Parameters
    ----------
    h : (F,) array
        Slopes.
    uniform : (T, F) array
        Uniform numbers in [0, 1).
    """
    # The draw is made for -|h| and mirrored, so no exponential overflows; 1e-100 stands for h = 0,
    # where c = u.
    slope = np.maximum(np.abs(h), 1e-100)
    c = uniform * np.expm1(-slope)
    np.log1p(c, out=c)
    c *= -1 / slope
    np.minimum(c, 1, out=c)
    np.subtract(1, c, out=c, where=h > 0)
    return np.asarray(c)


def basic_columns(columns: np.ndarray, slopes: np.ndarray, coefficients: int) -> np.ndarray:
    """Indices (K,) that nearly maximise |det columns_B| prod over B of (integral of f_j / max f_j):
    the acceptance.

    The factor is Z(h_j) exp(-max(0, h_j)) for a coefficient and sqrt(2 pi) for a noise coordinate.
    With the columns scaled by it this is a submatrix of largest volume: start from the pivots of a
    QR factorisation and swap while one swap gains more than 1 %.

    Parameters
    ----------
    columns : (K, N + r) array
        [A L].
    slopes : (N + r,) array
        theta' [A L].
    coefficients : int
        N.
    """
    from scipy.linalg import qr

    h = slopes[:coefficients]
    log_z, _, _ = tilt_moments(h)
    scaled = columns * np.sqrt(2 * np.pi)
    scaled[:, :coefficients] = columns[:, :coefficients] * np.exp(log_z - np.maximum(h, 0))
    _, _, pivots = qr(scaled, mode="economic", pivoting=True)
    basic = pivots[:len(columns)].copy()
    while True:
        # Cramer: entry (i, j) is the factor by which the volume changes when column j takes the
        # place of basic[i].
        gain = np.abs(np.linalg.solve(scaled[:, basic], scaled))
        out, column = np.unravel_index(np.argmax(gain), gain.shape)
        if gain[out, column] < 1.01:
            return np.sort(basic)
        basic[out] = column


def collect(propose: Propose, draws: int) -> tuple[np.ndarray, float]:
    """Propose until ``draws`` are accepted; return them (T, N) and the acceptance.

    Parameters
    ----------
    propose : function
        From a number of proposals to those accepted (n, N).
    draws : int
        T, at least 1.

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
    accepted, proposals, block = 0, 0, MIN_BLOCK
    while accepted < draws:
        kept.append(propose(block))
        accepted += len(kept[-1])
        proposals += block
        if proposals >= PATIENCE and accepted < HOPELESS * proposals:
            raise ConvergenceError(
                f"only {accepted} of {proposals} proposals were accepted; use fewer coefficients, "
                "fewer bands, or state a larger noise of the signal")
        missing = (draws - accepted) * proposals / max(accepted, 1)
        block = int(np.clip(1.1 * missing, MIN_BLOCK, MAX_BLOCK))
    return np.concatenate(kept)[:draws], accepted / proposals
