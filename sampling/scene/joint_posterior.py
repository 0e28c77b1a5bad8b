"""All materials of a scene at once, through its light transport: likelihood, modes, Laplace.

With the transport traced once (`RegionTransport`), signal_rk = sum_e T_re integral response_k
prod_m rho_m^n_em is a polynomial in the reflectances, and its likelihood costs a fraction of a
millisecond. Light that was reflected by a second material carries products of spectra, which tell
what the direct signal of either cannot. ``response`` here is that of the photo, light scale
included: its rows sum to the white signal of each band, not to 1.

Unknowns: a component of the prior's mixture for every material (labels, M), and z (M P,), standard
normal, with logit rho_m = mean of its component + root of its covariance @ z_m: all P wavelengths
are kept, nothing of the prior is truncated. The noise-weighted transport is reduced to the few rows
that rise above the noise, after which the cost does not depend on the number of pixels.
`joint_sampling.py` chooses the labels.

Errors that regions share and that add to their signals are among the noise. Those that multiply
them (`error_model.split_errors`) are Q more unknowns e, standard normal, which follow z: of a light
that is off by half, black is no answer. Every group of regions on which they are alike has rows of
its own,

    signal_rk = exp(sum_q logs_qgk e_q) (sum_e T_re ...) + sum_q common_qrk e_q + noise
"""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import solve_triangular

from spectrabox.radiometry.errors import ConvergenceError, InputError
from spectrabox.radiometry.records import scenes
from spectrabox.sampling.prior import mixture

# of Levenberg-Marquardt; the fall of the cost, in nats, at which it has converged
STEPS, COST_TOLERANCE = 60, 1e-2
MAX_STEP = 3.0          # in standard deviations of the prior
NEGLIGIBLE = 1e-6           # of the brightest product: dropped
# a row of the transport whose signals scatter by less under the prior, in units of noise
BELOW_NOISE = 0.05
LEVEL = 0.95                # whose calibrated factors widen the components
SCENES = 300                # drawn from the prior to find those rows


@dataclass(frozen=True)
class JointProblem:
    """One scene: rows (F, J, E) and targets (F,) in units of the noise, response (K, P), and the
    prior's parts.

    The J columns are the bands of each group of regions on which the errors that multiply signals
    are alike, group after group; of one group without such errors.

    ``materials`` and ``exponents`` (E, M) are those of the unknown materials; ``known`` (E, P) is
    the product of the known reflectances encountered. ``means`` (C + 1, P) and ``roots`` (C + 1, P,
    P): the last is the one Gaussian with the mixture's moments, and roots are as much wider as the
    components' families are calibrated to be. ``log_weights`` (M, C + 1) are -inf for components
    that a material cannot have, its family being stated. ``logs`` (Q, J) is what one standard
    deviation of each error that multiplies adds to the logarithm of the light, ``added`` (F, Q)
    what it adds to the rows besides.
    """

    materials: tuple[str, ...]
    exponents: np.ndarray
    known: np.ndarray
    rows: np.ndarray
    targets: np.ndarray
    response: np.ndarray
    log_weights: np.ndarray
    means: np.ndarray
    roots: np.ndarray
    logs: np.ndarray
    added: np.ndarray

    @property
    def groups(self) -> tuple[int, int]:
        """G and K: groups of regions and bands, of which columns J there are."""
        return self.rows.shape[1] // len(self.response), len(self.response)

    def errors_of(self, z: np.ndarray) -> np.ndarray:
        """The errors that multiply signals (..., Q), of unknowns (..., M P + Q)."""
        return np.asarray(z[..., z.shape[-1] - len(self.logs):])

    def softened(self, times: float) -> JointProblem:
        """The problem with so many times the noise."""
        return replace(self, rows=self.rows / times, targets=self.targets / times,
                       added=self.added / times)


def gaussian_of(prior: mixture.LogitMixture) -> tuple[np.ndarray, np.ndarray]:
    """Mean (P,) and root L (P, P) of the one Gaussian with the mixture's mean and covariance.

    Parameters
    ----------
    prior : LogitMixture
    """
    mean = prior.weights @ prior.means
    away = prior.means - mean
    covariance = np.einsum("c,cpq->pq", prior.weights, prior.covariances) + (away.T
                                                                             * prior.weights) @ away
    return mean, np.linalg.cholesky(covariance)


def joint_problem(regions: scenes.RegionTransport, response: np.ndarray,
                  prior: mixture.LogitMixture,
                  common: np.ndarray | None = None, known: Mapping[str, np.ndarray] | None = None,
                  families: Mapping[str, Sequence[str]] | None = None,
                  logs: np.ndarray | None = None) -> JointProblem:
    """Prepare the likelihood of a scene.

    Seven parameters: all but the prior, the known materials and the families are the likelihood.

    Parameters
    ----------
    regions : RegionTransport
        R regions or pixels; one with a NaN signal is left out.
    response : (K, P)
        Sensitivity x light x integration weight on the prior's 61 wavelengths.
    prior : LogitMixture
        Of every material.
    common : (Q, R, K), optional
        What one standard deviation of each error shared by regions or bands adds to the signals:
        light scale, sensitivities, what photo and model disagree by on a surface.
    known : mapping, optional
        Reflectance (P,) of materials that are not asked for, by name.
    families : mapping, optional
        Families stated for a material, by name.
    logs : (Q, R, K), optional
        What one standard deviation of each of these errors adds to the logarithm of the light
        besides; the same on many regions. None: no error multiplies.

    Raises
    ------
    InputError
        If shapes do not belong together, an error is not positive, or a family is not known.
    """
    signal, standard_error, coefficients = \
        regions.signal, regions.standard_error, regions.coefficients
    if signal.shape[1] != len(response):
        raise InputError(f"signal {signal.shape} and standard error {standard_error.shape} must "
                         f"both be ({len(signal)}, {len(response)}): one row per region of the "
                         "transport")
    shared = np.zeros((0, *signal.shape)) if common is None else common
    multiply = np.zeros(shared.shape) if logs is None else logs
    if shared.shape[1:] != signal.shape or multiply.shape != shared.shape:
        raise InputError(f"the common errors {shared.shape}, and what multiplies of them "
                         f"{multiply.shape}, must be (Q, {len(signal)}, {len(response)}): what one "
                         "standard deviation of each does to every signal")
    used = np.all(np.isfinite(signal), axis=1)
    if not used.any() or not np.all(standard_error[used] > 0):
        raise InputError("every region that is used needs a signal and a positive standard error")
    mean, root = gaussian_of(prior)
    kept = np.abs(coefficients).max(axis=0) > NEGLIGIBLE * np.abs(coefficients).max()
    weight = 1 / standard_error[used]
    explicit = multiply.any(axis=(1, 2))
    # (G, Q, K), and the group of each region
    of_groups, group = np.unique(np.moveaxis(multiply[explicit][:, used], 1, 0), axis=0,
                                 return_inverse=True)
    rows, targets, added = _whitened(coefficients[used][:, kept], signal[used], weight,
                                     shared[~explicit][:, used], shared[explicit][:, used],
                                     group.ravel())
    exponents, given = regions.exponents[kept].astype(float), known or {}
    unknown = [m for m, name in enumerate(regions.materials) if name not in given]
    factor = np.prod([np.maximum(given[name], 1e-6)**exponents[:, m, None]
                      for m, name in enumerate(regions.materials) if name in given]
                     or [np.ones((len(exponents), mean.size))], axis=0)
    names = tuple(regions.materials[m] for m in unknown)
    stated = [tuple((families or {}).get(name, ())) for name in names]
    whole = JointProblem(names, exponents[:, unknown], factor, rows, targets, response,
                         *_components(prior, stated, mean, root),
                         np.moveaxis(of_groups, 1, 0).reshape(-1, rows.shape[1]), added)
    return _above_noise(whole)


def _components(prior: mixture.LogitMixture, stated: Sequence[tuple[str, ...]], mean: np.ndarray,
                root: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Log weights (M, C + 1), means and roots of the components of all materials' priors, and the
    one Gaussian of mean and root.
    """
    priors = {families: mixture.of_families(prior, families) for families in dict.fromkeys(stated)}
    weights = [np.concatenate([one.weights if families == mine else np.zeros(one.weights.size)
                               for families, one in priors.items()] + [np.ones(1)])
               for mine in stated]
    roots = [one.family_factors(LEVEL)[np.asarray(one.family, dtype=int), :, None]
             * np.linalg.cholesky(one.covariances) for one in priors.values()]
    with np.errstate(divide="ignore"):
        log_weights = np.log(weights)
    return (log_weights, np.vstack([*(one.means for one in priors.values()), mean]),
            np.concatenate([*roots, root[None]]))


def fit_modes(problem: JointProblem, labels: np.ndarray,
              z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Most probable z (B, M P + Q) given labels (B, M), by Levenberg-Marquardt, and the log
    evidence (B,) of each by Laplace.

    Parameters
    ----------
    problem : JointProblem
    labels : (B, M) int array
        Components of the prior.
    z : (B, M P + Q) array
        Starts.

    Raises
    ------
    ConvergenceError
        If a cost is not finite.
    """
    modes = [_fit_mode(problem, chosen, start) for chosen, start in zip(labels, z, strict=True)]
    z, evidence = (np.array(part) for part in zip(*modes, strict=True))
    return z, evidence


def residual_and_jacobian(problem: JointProblem, labels: np.ndarray,
                          z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Residual (F,) in units of the noise and its derivative by z (F, M P + Q), for labels (M,).

    Parameters
    ----------
    problem : JointProblem
    labels : (M,) int array
        Component of the prior for each material.
    z : (M P + Q,) array
    """
    residual, by_logit, by_error = residual_by_logit(
        problem, logits_of(problem, labels, z[None])[0], problem.errors_of(z))
    jacobian = np.concatenate([by_logit[:, m] @ problem.roots[label] for m,
                               label in enumerate(labels)] + [by_error], axis=1)
    return residual, jacobian


def residual_by_logit(problem: JointProblem, logits: np.ndarray, errors: np.ndarray
                      ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Residual (F,), and its derivatives by the logits (F, M, P) and the errors that multiply
    signals (F, Q).

    Parameters
    ----------
    problem : JointProblem
    logits : (M, P) array
    errors : (Q,) array
        In their standard deviations.
    """
    rho, terms = products(problem, logits[None])
    factors, received = light(problem, terms, errors[None])
    residual = np.einsum("fje,je->f", problem.rows, received[0]) + problem.added @ errors \
        - problem.targets
    by_band = np.einsum("fgke,gk->kfe", in_groups(problem, problem.rows), factors[0])
    slopes = [(by_band * problem.exponents[:, m]) @ terms[0]
              for m in range(len(problem.materials))]   # each (K, F, P)
    by_logit = np.stack([np.einsum("kfp,kp->fp", slope, problem.response) for slope in slopes],
                        axis=1)
    by_error = np.einsum("fje,je->fj", problem.rows, received[0]) @ problem.logs.T + problem.added
    return residual, by_logit * (1 - rho[0]), by_error


def in_groups(problem: JointProblem, rows: np.ndarray) -> np.ndarray:
    """Rows (r, J, E) as those of each group of regions and band (r, G, K, E)."""
    return rows.reshape(len(rows), *problem.groups, rows.shape[2])


def light(problem: JointProblem, terms: np.ndarray, errors: np.ndarray
          ) -> tuple[np.ndarray, np.ndarray]:
    """What multiplies the bands of each group (n, G, K), and the light of each product of
    reflectances there (n, J, E), of products (n, E, P) and errors (n, Q).
    """
    received = (terms @ problem.response.T).transpose(0, 2, 1)                      # (n, K, E)
    factors = np.exp(errors @ problem.logs).reshape(len(errors), *problem.groups)
    if not errors.shape[1]:
        return factors, received
    return factors, (factors[..., None] * received[:, None]).reshape(
        len(errors), received.shape[1] * factors.shape[1], received.shape[2])


def products(problem: JointProblem, logits: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Reflectances (n, M, P) of logits (n, M, P), and the products (n, E, P), known reflectances
    among them.

    Parameters
    ----------
    problem : JointProblem
    logits : (n, M, P) array
    """
    terms = np.exp(problem.exponents @ -np.logaddexp(0, -logits))   # log rho stays finite
    return mixture.reflectance(logits), terms * problem.known


def logits_of(problem: JointProblem, labels: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Logits (n, M, P) of unknowns z (n, M P + Q) under labels (M,).

    Parameters
    ----------
    problem : JointProblem
    labels : (M,) int array
        Component of the prior for each material.
    z : (n, M P + Q) array
    """
    wavelengths = len(problem.materials) * problem.means.shape[1]
    shaped = z[:, :wavelengths].reshape(len(z), len(problem.materials), -1)
    return np.stack([problem.means[label] + shaped[:, m] @ problem.roots[label].T for m,
                     label in enumerate(labels)], axis=1)


def log_weight_of(problem: JointProblem, labels: np.ndarray) -> float:
    """Log of the prior probability of labels (M,).

    Parameters
    ----------
    problem : JointProblem
    labels : (M,) int array
        Component of the prior for each material.
    """
    return float(problem.log_weights[np.arange(len(labels)), labels].sum())


def _fit_mode(problem: JointProblem, labels: np.ndarray,
              z: np.ndarray) -> tuple[np.ndarray, float]:
    """z at the mode, and log evidence. The algebra is in the space of the F rows."""
    residual, jacobian = residual_and_jacobian(problem, labels, z)
    cost, damping = float(residual @ residual + z @ z) / 2, 1e-3
    values, vectors = np.linalg.eigh(jacobian @ jacobian.T)
    for _ in range(STEPS):
        # Woodbury: (J'J + a I)^-1 v = (v - J' (J J' + a I)^-1 J v) / a; a step towards a lower
        # cost.
        slope, a = jacobian.T @ residual + z, 1 + damping
        step = -(slope - jacobian.T
                 @ (vectors @ ((vectors.T @ (jacobian @ slope)) / (values + a)))) / a
        trial = z + step * min(1.0, MAX_STEP / max(float(np.abs(step).max()), 1e-12))
        trial_residual, trial_jacobian = residual_and_jacobian(problem, labels, trial)
        trial_cost = float(trial_residual @ trial_residual + trial @ trial) / 2
        fall = cost - trial_cost
        if fall > 0:
            z, residual, jacobian = trial, trial_residual, trial_jacobian
            cost, damping = trial_cost, damping / 10
            values, vectors = np.linalg.eigh(jacobian @ jacobian.T)
        else:
            damping = max(10 * damping, 1e-3)
        if 0 <= fall < COST_TOLERANCE or damping > 1e10:
            break
    if not np.isfinite(cost):
        raise ConvergenceError("the joint fit did not reach a finite cost; check the signals and "
                               "their errors")
    evidence = log_weight_of(problem, labels) - cost - np.log1p(np.maximum(values, 0)).sum() / 2
    return z, evidence


def _whitened(coefficients: np.ndarray, signal: np.ndarray, weight: np.ndarray,
              common: np.ndarray, explicit: np.ndarray, group: np.ndarray
              ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows (Q', J, E), targets (Q',), and what explicit errors add to the rows (Q', Q), with the
    likelihood of all regions, up to a constant.

    Per band and group of regions the weighted transport and shared errors are reduced to a triangle
    (QR); what the regions say beyond their span is the same for all spectra. Then the bands are
    whitened together.
    """
    bands, count = weight.shape[1], coefficients.shape[1]
    triangles, reduced = [], []
    for number in range(int(group.max()) + 1):
        mine = group == number
        for band in range(bands):
            both = np.hstack([coefficients[mine], common[:, mine, band].T,
                              explicit[:, mine, band].T]) * weight[mine, band, None]
            orthonormal, triangle = np.linalg.qr(both)
            triangles.append(triangle)
            reduced.append(orthonormal.T @ (signal[mine, band] * weight[mine, band]))
    whole, targets = np.concatenate(triangles), np.concatenate(reduced)
    rows = np.zeros((len(whole), len(triangles), count))
    ends = np.cumsum([len(triangle) for triangle in triangles])
    for column, (end, triangle) in enumerate(zip(ends, triangles, strict=True)):
        rows[end - len(triangle):end, column] = triangle[:, :count]
    error, added = np.split(whole[:, count:], [len(common)], axis=1)
    if not error.shape[1]:
        return rows, targets, added
    together = np.hstack([rows.reshape(len(rows), len(triangles) * count), added,
                          targets[:, None]])
    white = solve_triangular(np.linalg.cholesky(np.eye(len(rows)) + error @ error.T), together,
                             lower=True)
    size = len(triangles) * count
    return white[:, :size].reshape(rows.shape), white[:, -1], white[:, size:-1]


def _above_noise(problem: JointProblem) -> JointProblem:
    """The problem with the rows along which the signals of scenes drawn from the prior rise above
    the noise.
    """
    rng = np.random.default_rng(0)
    labels = np.array([rng.choice(len(problem.means) - 1, SCENES, p=np.exp(log_weights[:-1]))
                       for log_weights in problem.log_weights], dtype=int).reshape(-1, SCENES).T
    z = rng.standard_normal((*labels.shape, problem.means.shape[1]))
    logits = problem.means[labels] + (problem.roots[labels] @ z[..., None])[..., 0]
    errors = rng.standard_normal((SCENES, len(problem.logs)))
    _, received = light(problem, products(problem, logits)[1], errors)
    seen = received.reshape(SCENES, -1) @ problem.rows.reshape(len(problem.rows), -1).T \
        + errors @ problem.added.T
    _, size, directions = np.linalg.svd((seen - seen.mean(axis=0)) / np.sqrt(SCENES),
                                        full_matrices=False)
    kept = directions[size > BELOW_NOISE]
    return replace(problem, rows=np.einsum("gf,fke->gke", kept, problem.rows),
                   targets=kept @ problem.targets, added=kept @ problem.added)
