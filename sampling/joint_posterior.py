"""All materials of a scene at once, through its light transport: MAP and Laplace.

With the transport traced once (`LightTransport`), signal_rk = sum_e T_re integral response_k prod_m rho_m^n_em is a
polynomial in the reflectances, and its likelihood costs a fraction of a millisecond. Light that has met a second
material carries products of spectra, which tell what the direct signal of either cannot.

Unknowns: z (M, P), standard normal under the prior, with logit rho_m = mean + L z_m and all P wavelengths kept, so
that nothing of the prior is truncated. Per band the noise-weighted transport is reduced to a triangle by QR, after
which the cost does not depend on the number of pixels.
"""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from radiometry.errors import ConvergenceError, InputError
from radiometry.records import LightTransport, Outcome
from sampling.logit_mixture import LogitMixture, reflectance

STEPS, STILL = 80, 1e-7     # of Levenberg-Marquardt; the relative fall of the cost that counts as standing still
LONGEST_STEP = 2.0          # in standard deviations of the prior
NEGLIGIBLE = 1e-6           # of the brightest product: dropped


@dataclass(frozen=True)
class JointProblem:
    """One scene: rows (K, E', E) and targets (K, E') in units of the noise, response (K, P), prior mean and root."""

    materials: tuple[str, ...]
    exponents: np.ndarray
    rows: np.ndarray
    targets: np.ndarray
    response: np.ndarray
    prior_mean: np.ndarray
    prior_root: np.ndarray


@dataclass(frozen=True)
class JointLaplace:
    """MAP z (M P,), its covariance (M P, M P) under Laplace's approximation, the cost there, and how it ended."""

    z: np.ndarray
    covariance: np.ndarray
    cost: float
    iterations: int
    outcome: Outcome


def gaussian_of(prior: LogitMixture) -> tuple[np.ndarray, np.ndarray]:
    """Mean (P,) and root L (P, P) of the one Gaussian with the mixture's mean and covariance."""
    mean = prior.weights @ prior.means
    away = prior.means - mean
    covariance = np.einsum("c,cpq->pq", prior.weights, prior.covariances) + (away.T * prior.weights) @ away
    values, vectors = np.linalg.eigh(covariance)
    return mean, vectors * np.sqrt(np.maximum(values, 1e-12))


def joint_problem(transport: LightTransport, response: np.ndarray, signal: np.ndarray, standard_error: np.ndarray,
                  prior: LogitMixture) -> JointProblem:
    """Prepare the likelihood of a scene.

    Parameters
    ----------
    transport : LightTransport
        R regions or pixels.
    response : (K, P)
        Sensitivity x light x integration weight on the prior's 61 wavelengths.
    signal, standard_error : (R, K)
        Measured, and its noise; a region with a NaN signal is left out.
    prior : LogitMixture
        Of every material; taken as one Gaussian in the logit.

    Raises
    ------
    InputError
        If shapes do not belong together, or an error is not positive.
    """
    regions, count = transport.coefficients.shape
    if signal.shape != (regions, len(response)) or standard_error.shape != signal.shape:
        raise InputError(f"signal {signal.shape} and standard error {standard_error.shape} must both be "
                         f"({regions}, {len(response)}): one row per region of the transport")
    used = np.all(np.isfinite(signal), axis=1)
    if not used.any() or np.any(standard_error[used] <= 0):
        raise InputError("every region that is used needs a signal and a positive standard error")
    mean, root = gaussian_of(prior)
    variance = standard_error[used]**2 + _monte_carlo_variance(transport, response, mean, used)
    rows, targets = [], []
    for band in range(len(response)):
        weight = 1 / np.sqrt(variance[:, band])
        weighted, values = transport.coefficients[used] * weight[:, None], signal[used, band] * weight
        if len(values) > count:
            orthonormal, triangle = np.linalg.qr(weighted)
            weighted, values = triangle, orthonormal.T @ values
        rows.append(weighted)
        targets.append(values)
    kept = np.abs(transport.coefficients).max(axis=0) > NEGLIGIBLE * np.abs(transport.coefficients).max()
    return JointProblem(transport.materials, transport.exponents[kept].astype(float), np.array(rows)[:, :, kept],
                        np.array(targets), response, mean, root)


def find_map(problem: JointProblem) -> JointLaplace:
    """Most probable spectra of all materials, by Levenberg-Marquardt, with Laplace's covariance.

    Raises
    ------
    ConvergenceError
        If the cost is not finite.
    """
    z = np.zeros(len(problem.materials) * problem.prior_mean.size)
    residual, jacobian = residual_and_jacobian(problem, z)
    cost, damping, outcome, iteration = float(residual @ residual + z @ z), 1e-2, Outcome.STEP_LIMIT, 0
    for iteration in range(1, STEPS + 1):  # noqa: B007  reported below
        curvature = jacobian.T @ jacobian + np.eye(z.size)
        slope = jacobian.T @ residual + z
        step = -np.linalg.solve(curvature + damping * np.diag(np.diag(curvature)), slope)
        trial = z + step * min(1.0, LONGEST_STEP / np.abs(step).max())
        trial_residual, trial_jacobian = residual_and_jacobian(problem, trial)
        trial_cost = float(trial_residual @ trial_residual + trial @ trial)
        if trial_cost < cost:
            fall = cost - trial_cost
            z, residual, jacobian, cost, damping = trial, trial_residual, trial_jacobian, trial_cost, damping / 5
            if fall < STILL * cost:
                outcome = Outcome.CONVERGED
                break
        else:
            damping *= 4
            if damping > 1e12:
                outcome = Outcome.CONVERGED
                break
    if not np.isfinite(cost):
        raise ConvergenceError("the joint fit did not reach a finite cost; check the signals and their errors")
    covariance = np.linalg.inv(jacobian.T @ jacobian + np.eye(z.size))
    return JointLaplace(z, (covariance + covariance.T) / 2, cost, iteration, outcome)


def residual_and_jacobian(problem: JointProblem, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Residual (K E',) in units of the noise and its derivative by z (K E', M P)."""
    materials, wavelengths = len(problem.materials), problem.prior_mean.size
    rho = reflectance(problem.prior_mean + z.reshape(materials, wavelengths) @ problem.prior_root.T)
    terms = np.exp(problem.exponents @ np.log(rho))
    residual = np.einsum("kfe,ke->kf", problem.rows, problem.response @ terms.T) - problem.targets
    jacobian = np.empty((*residual.shape, materials, wavelengths))
    for m in range(materials):
        slope = terms * (problem.exponents[:, m, None] * (1 - rho[m]))
        for band, row in enumerate(problem.rows):
            jacobian[band, :, m] = (row @ (slope * problem.response[band])) @ problem.prior_root
    return residual.ravel(), jacobian.reshape(residual.size, -1)


def misfits_and_gradients(problem: JointProblem, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Squared residual (n,) of many z (n, M P) at once, in units of the noise, and its gradients (n, M P)."""
    logits = problem.prior_mean + z.reshape(len(z), len(problem.materials), -1) @ problem.prior_root.T
    rho = reflectance(logits)
    terms = np.exp(problem.exponents @ -np.logaddexp(0, -logits))     # (n, E, P); log rho stays finite
    received = (terms @ problem.response.T).transpose(2, 0, 1)                          # (K, n, E)
    residual = received @ problem.rows.transpose(0, 2, 1) - problem.targets[:, None]    # (K, n, E')
    back = (2 * residual @ problem.rows).transpose(1, 2, 0)                             # (n, E, K)
    slope = problem.exponents.T @ (terms * (back @ problem.response))                   # (n, M, P)
    return np.sum(residual**2, axis=(0, 2)), ((slope * (1 - rho)) @ problem.prior_root).reshape(z.shape)


def spectra_of(problem: JointProblem, z: np.ndarray) -> np.ndarray:
    """Reflectances (n, M, P) of unknowns z (n, M P)."""
    shaped = z.reshape(len(z), len(problem.materials), -1)
    return reflectance(problem.prior_mean + shaped @ problem.prior_root.T)


def information_bits(found: JointLaplace, materials: int) -> np.ndarray:
    """Bits (M,) that the picture told about each material: -1/2 log2 det of its covariance over the prior's."""
    size = found.z.size // materials
    blocks = [found.covariance[m * size:(m + 1) * size, m * size:(m + 1) * size] for m in range(materials)]
    return np.array([-np.linalg.slogdet(block)[1] / (2 * np.log(2)) for block in blocks])


def _monte_carlo_variance(transport: LightTransport, response: np.ndarray, mean: np.ndarray,
                          used: np.ndarray) -> np.ndarray:
    """Variance (R, K) of signals from the noise of the traced coefficients, at the prior's mean spectrum."""
    if transport.covariance is None:
        return np.zeros((int(used.sum()), len(response)))
    rho = np.tile(reflectance(mean), (len(transport.materials), 1))
    received = np.exp(transport.exponents.astype(float) @ np.log(rho)) @ response.T
    return np.einsum("ek,ref,fk->rk", received, transport.covariance[used], received, optimize=True)
