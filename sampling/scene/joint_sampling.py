"""Draws from the joint posterior of all materials: randomise, then optimise, then weigh.

A picture of many pixels pins a few dozen directions down to a thousandth of the prior and leaves
the others free; through the logit and the products of reflectances the pinned directions bend.
Random walks along the bends are slow. Here every proposal is drawn from the prior along what the
picture leaves free, and along the r directions that it informs it is the solution of the randomised
optimality equations (randomise-then-optimise, Bardsley et al. 2014, in the form of Bardsley et al.
2020 for few informed directions). With J = U diag(s) V' at a mode and z = V a + rest,

    eta(a) = (1 + s^2)^-1/2 (a + s U' f(z)),   solve eta(a) = e, e ~ N(0, I_r),

proposals have the density N(eta) |det d eta / d a|, known exactly, so importance weights make the
draws exact: bends, labels and what the reduction to r directions left out. Proposals are
independent; the weights say how good they are.
"""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from spectrabox.radiometry.errors import ConvergenceError, InputError
from spectrabox.sampling.polytope.diagnostics import tail_shape
from spectrabox.sampling.prior.mixture import reflectance
from spectrabox.sampling.scene import joint_posterior

ROUND, MAX_PROPOSALS = 2000, 16_000
INFORMED = 0.01  # a singular value of the Jacobian by which a direction counts as informed
DEFENSIVE = 0.2  # of the proposals go to all labels alike, whatever is believed of them
NEWTON_STEPS, SOLVED = 20, 1e-6
BLOCK = 250
MIN_EFFECTIVE, TAIL_LIMIT = 400.0, 0.7     # of the weights (tail: Vehtari et al. 2024)


# labels (B, M), their most probable z (B, M P + Q), and the log evidence (B,) of each by Laplace
Modes = tuple[np.ndarray, np.ndarray, np.ndarray]


@dataclass(frozen=True)
class _Proposer:
    """What proposals under one choice of labels need."""

    labels: np.ndarray          # (M,)
    log_weight: float           # of the labels under the prior
    centre: np.ndarray          # (r,) a at the mode
    directions: np.ndarray      # V (M P + Q, r)
    size: np.ndarray            # s (r,)
    by_product: np.ndarray      # s U' rows (r, J, E)
    by_error: np.ndarray        # s U' added (r, Q)
    target: np.ndarray          # s U' targets (r,)
    # (P, E, r M): how s U' f moves with log of each reflectance, where nothing multiplies it
    by_wavelength: np.ndarray
    logit_directions: np.ndarray    # (M P, r)


def sample_joint(problem: joint_posterior.JointProblem, seed: int,
                 modes: Modes | None = None, kept: int = 4000,
                 effective_wanted: float = MIN_EFFECTIVE) -> tuple[np.ndarray, float, float]:
    """Draws (T, M, P) of the reflectances of all materials, all equally likely, once enough are
    effective.

    Parameters
    ----------
    problem : JointProblem
    seed : int
    modes : Modes, optional
        Of many labels; by `find_modes` if not given.
    kept : int
        T: resampled from the weighted proposals, so some are drawn more than once.
    effective_wanted : float
        Effective number of weighted proposals at which to stop: 1000 for a 95 % band.

    Returns
    -------
    spectra : (T, M, P) array
        On the prior's wavelengths.
    effective : float
        Effective number of the weighted proposals.
    tail : float
        Shape of the weights' tail: below 0.7 the effective number can be trusted.

    Raises
    ------
    InputError
        If fewer than 100 draws are to be kept.
    ConvergenceError
        If 16000 proposals do not suffice.
    """
    if kept < 100:
        raise InputError(f"{kept} draws were asked for; ask for at least 100")
    every_label, every_z, evidence = modes or find_modes(problem, SAMPLED)
    rng = np.random.default_rng(seed)
    proposers = [_proposer(problem, labels, z)
                 for labels, z in zip(every_label, every_z, strict=True)]
    belief = np.exp(evidence - evidence.max())
    counts = np.zeros(len(proposers), dtype=int)
    logits: list[np.ndarray] = []
    log_ratios: list[np.ndarray] = []
    owners: list[np.ndarray] = []
    while counts.sum() < MAX_PROPOSALS:
        new = rng.multinomial(ROUND, (1 - DEFENSIVE) * belief / belief.sum()
                              + DEFENSIVE / len(belief))
        for number in np.flatnonzero(new):
            for start in range(0, new[number], BLOCK):
                proposals, ratio = _propose(problem, proposers[number],
                                            min(BLOCK, new[number] - start), rng)
                logits.append(proposals)
                log_ratios.append(ratio)
                owners.append(np.full(len(proposals), number))
        counts += new
        owner = np.concatenate(owners)
        # of all rounds as one mixture
        log_weights = np.concatenate(log_ratios) - np.log(counts[owner])
        weights = np.exp(log_weights - log_weights.max())
        effective, tail = float(weights.sum()**2 / (weights**2).sum()), tail_shape(weights)
        if effective >= effective_wanted and tail < TAIL_LIMIT:
            break
        # what Laplace thought of the labels is corrected
        belief = np.bincount(owner, weights, len(counts))
    else:
        raise ConvergenceError(f"the joint posterior has not converged after {MAX_PROPOSALS} "
                               f"proposals: {effective:.0f} effective draws, tail of the "
                               f"weights {tail:.2f}; state a larger noise, or use each "
                               "material's own signal")
    cumulative = np.cumsum(weights) / weights.sum()
    chosen = np.searchsorted(cumulative, (np.arange(kept) + rng.random())
                             / kept).clip(max=len(weights) - 1)
    spectra = reflectance(np.concatenate(logits)[rng.permutation(chosen)])  # else mode after mode
    return spectra, effective, tail


def _proposer(problem: joint_posterior.JointProblem, labels: np.ndarray,
              z: np.ndarray) -> _Proposer:
    jacobian = joint_posterior.residual_and_jacobian(problem, labels, z)[1]
    u, size, vt = np.linalg.svd(jacobian, full_matrices=False)
    informed = size > INFORMED
    u, size, directions = u[:, informed], size[informed], vt[informed].T
    materials, wavelengths = len(labels), problem.means.shape[1]
    by_product = np.einsum("r,fr,fje->rje", size, u, problem.rows)
    weight = np.einsum("rgke,kp->per", joint_posterior.in_groups(problem, by_product),
                       problem.response)
    by_wavelength = (weight[..., None] * problem.exponents[None, :, None, :]).reshape(
        *weight.shape[:2], -1)
    logit_directions = np.concatenate(
        [problem.roots[label] @ directions[m * wavelengths:(m + 1) * wavelengths]
         for m, label in enumerate(labels)])
    assert materials * wavelengths + len(problem.logs) == z.size
    return _Proposer(labels, joint_posterior.log_weight_of(problem, labels), z @ directions,
                     directions, size, by_product, size[:, None] * (u.T @ problem.added),
                     size * (u.T @ problem.targets), by_wavelength, logit_directions)


def _propose(problem: joint_posterior.JointProblem, proposer: _Proposer, count: int,
             rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Logits (n, M, P) and log weights (n,) of proposals; those whose equations have no solution
    are left out.
    """
    scale = 1 / np.sqrt(1 + proposer.size**2)
    free = rng.standard_normal((count, len(proposer.directions)))
    free -= (free @ proposer.directions) @ proposer.directions.T
    base, base_errors = joint_posterior.logits_of(problem, proposer.labels,
                                                  free), problem.errors_of(free)
    wanted = rng.standard_normal((count, proposer.size.size))
    a = proposer.centre + scale * wanted
    eta, slope, logits, errors = _equations(problem, proposer, base, base_errors, a)
    distance = np.linalg.norm(eta - wanted, axis=1)
    step = np.ones(count)
    for _ in range(NEWTON_STEPS):
        active = np.flatnonzero(distance > SOLVED)
        if not active.size:
            break
        move = np.linalg.solve(slope[active], (wanted - eta)[active][..., None])[..., 0]
        trial = a[active] + step[active, None] * move
        new = _equations(problem, proposer, base[active], base_errors[active], trial)
        new_distance = np.linalg.norm(new[0] - wanted[active], axis=1)
        better = new_distance < distance[active]
        rows = active[better]
        a[rows], eta[rows], slope[rows], logits[rows], errors[rows] = trial[better], *(
            part[better] for part in new)
        distance[rows] = new_distance[better]
        step[rows], step[active[~better]] = 1.0, step[active[~better]] / 3
    solved = distance < 1e-3
    a, eta, slope, logits, errors = (part[solved] for part in (a, eta, slope, logits, errors))
    _, received = joint_posterior.light(problem,
                                        joint_posterior.products(problem, logits)[1], errors)
    residual = np.tensordot(received, problem.rows, axes=([1, 2], [1, 2])) \
        + errors @ problem.added.T - problem.targets
    log_weight = (proposer.log_weight - np.sum(a**2, axis=1) / 2 - np.sum(residual**2, axis=1) / 2
                  + np.sum(eta**2, axis=1) / 2 - np.linalg.slogdet(slope)[1])
    return logits, log_weight


def _equations(problem: joint_posterior.JointProblem, proposer: _Proposer, base: np.ndarray,
               base_errors: np.ndarray, a: np.ndarray) -> tuple[np.ndarray, ...]:
    """eta (n, r), d eta / d a (n, r, r), the logits (n, M, P) and the errors that multiply (n, Q)
    at a (n, r).
    """
    count, r = a.shape
    materials, wavelengths = base.shape[1:]
    logits = base + (a @ proposer.logit_directions.T).reshape(base.shape)
    error_directions = proposer.directions[materials * wavelengths:]
    errors = base_errors + a @ error_directions.T
    rho, terms = joint_posterior.products(problem, logits)
    factors, received = joint_posterior.light(problem, terms, errors)  # (n, J, E)
    scale = 1 / np.sqrt(1 + proposer.size**2)
    if not errors.shape[1]:
        explained = received.reshape(count, -1) @ proposer.by_product.reshape(r, -1).T
        moved = terms.transpose(2, 0, 1) @ proposer.by_wavelength                    # (P, n, r M)
        moved = moved.reshape(wavelengths, count, r, materials).transpose(1, 2, 3, 0)
        of_errors = 0.0
    else:
        of_columns = (received.transpose(1, 0, 2) @ proposer.by_product.transpose(1, 2, 0)
                      ).transpose(1, 2, 0)                                          # (n, r, J)
        explained = of_columns.sum(axis=2) + errors @ proposer.by_error.T
        of_errors = (of_columns @ problem.logs.T + proposer.by_error) @ error_directions
        moved = _moved(problem, proposer, terms, factors)
    moved = moved * (1 - rho)[:, None]
    eta = scale * (a + explained - proposer.target)
    slope = (moved.reshape(count * r, -1) @ proposer.logit_directions).reshape(count, r, r)
    return eta, scale[:, None] * (np.eye(r) + slope + of_errors), logits, errors


def _moved(problem: joint_posterior.JointProblem, proposer: _Proposer, terms: np.ndarray,
           factors: np.ndarray) -> np.ndarray:
    """How s U' f moves with the log of each reflectance (n, r, M, P), of products (n, E, P) and
    what multiplies the bands of each group (n, G, K).
    """
    by_product = joint_posterior.in_groups(problem, proposer.by_product)  # (r, G, K, E)
    moved = np.zeros((len(terms), len(by_product), len(problem.materials), terms.shape[2]))
    for band, response in enumerate(problem.response):
        weight = np.tensordot(factors[:, :, band], by_product[:, :, band], axes=([1], [1]))
        for m, exponents in enumerate(problem.exponents.T):
            met = exponents > 0
            moved[:, :, m] += (weight[..., met] * exponents[met]) @ terms[:, met] * response
    return moved


# ---- labels --------------------------------------------------------------------------------------
# Which component of the prior's mixture each material of a scene belongs to: the modes of the
# joint posterior.
#
# There are C^M choices of labels. Near a fit the signals are taken for linear in the logits, and
# the evidence of any labels is a Gaussian's in the space of the data. From each of the best labels
# so far one material's label is switched, until all of the best were tried. These are then fitted
# in full, twice, for where the linearisation was made matters.

Labels = tuple[int, ...]

FITTED = 4              # labels that are fitted in full on the way to the most probable spectra
# the noise is taken for larger at first: sharp likelihoods trap the fit on its way
SOFTENED = (30.0, 5.0, 1.0)
SAMPLED = 128           # labels that draws are made of, at most; they leave 5 % of the spread out
EVIDENCE_CUTOFF = 7.0   # nats below the best, by the linearised evidence


def find_modes(problem: joint_posterior.JointProblem, most: int = FITTED,
               first_guess: joint_posterior.JointProblem | None = None) -> Modes:
    """The most probable spectra of all materials, and of the labels that come near to them, the
    best first.

    Parameters
    ----------
    problem : JointProblem
    most : int
        Labels that are fitted at last.
    first_guess : JointProblem, optional
        The same scene without the errors that regions share, in whose fit the search starts. Those
        that add are in proportion to the measured signals: an error of -100 % of the light explains
        materials that are black, where a search that starts far from the signals would end.

    Raises
    ------
    ConvergenceError
        If the cost is not finite.
    """
    materials, wavelengths = len(problem.materials), problem.means.shape[1]
    start = first_guess or problem
    one_gaussian, z = np.full((1, materials), len(problem.means)
                              - 1), np.zeros((1, materials * wavelengths + len(start.logs)))
    for times in SOFTENED:
        z, evidence = joint_posterior.fit_modes(start.softened(times), one_gaussian, z)
    if first_guess is not None:
        z, evidence = joint_posterior.fit_modes(problem, one_gaussian, np.pad(
            z, ((0, 0), (0, len(problem.logs) - len(start.logs)))))
    first = _modes_around(problem, (one_gaussian, z, evidence), FITTED)
    return _joined(first, _modes_around(problem, first, most))


def near_labels(problem: joint_posterior.JointProblem, logits: np.ndarray, errors: np.ndarray,
                most: int) -> tuple[np.ndarray, np.ndarray]:
    """The best labels (B, M), at most so many, by the evidence linearised at logits (M, P) and
    errors that multiply signals (Q,), and their z (B, M P + Q).

    Parameters
    ----------
    problem : JointProblem
    logits, errors : (M, P) and (Q,) arrays
        Where the model is linearised.
    most : int
        Number of labels.
    """
    residual, jacobian, by_error = joint_posterior.residual_by_logit(problem, logits, errors)
    # what a linear camera would have seen
    seen = np.einsum("fmp,mp->f", jacobian, logits) + by_error @ errors - residual
    components, materials = len(problem.means) - 1, len(logits)
    gain = jacobian.transpose(1, 0, 2)[:, None] @ problem.roots[None, :-1]      # (M, C, F, P)
    means = np.einsum("fmp,cp->mcf", jacobian, problem.means[:-1])
    spreads = gain @ gain.transpose(0, 1, 3, 2)
    every, noise = np.arange(materials), np.eye(len(seen)) + by_error @ by_error.T

    def evidence(labels: Labels) -> tuple[float, np.ndarray]:
        chosen = list(labels)
        root = cholesky(noise + spreads[every, chosen].sum(axis=0), lower=True)
        away = solve_triangular(root, seen - means[every, chosen].sum(axis=0), lower=True)
        weight = problem.log_weights[every, chosen].sum()
        value = weight - away @ away / 2 - np.log(np.diag(root)).sum()
        return float(value), solve_triangular(root, away, lower=True, trans=1)

    tried: dict[Labels, tuple[float, np.ndarray]] = {}
    switched: set[Labels] = set()
    best: list[Labels] = [tuple(np.argmax(problem.log_weights[:, :-1], axis=1).tolist())]
    while pending := [labels for labels in best if labels not in switched]:
        around = {(*labels[:m], c, *labels[m + 1:]) for labels in pending[:1]
                  for m in range(materials)
                  for c in range(components)}
        tried |= {labels: evidence(labels) for labels in around if labels not in tried}
        switched.add(pending[0])
        best = sorted(tried, key=lambda labels: -tried[labels][0])[:most]
    best = [labels for labels in best if tried[labels][0] > tried[best[0]][0] - EVIDENCE_CUTOFF]
    z = [np.concatenate([gain[m, c].T @ tried[labels][1] for m, c in enumerate(labels)]
                        + [by_error.T @ tried[labels][1]]) for labels in best]
    return np.array(best), np.array(z)


def _modes_around(problem: joint_posterior.JointProblem, modes: Modes, most: int) -> Modes:
    """Modes of the best labels, at most so many, by the evidence linearised at the best mode."""
    labels, z, evidence = modes
    best = int(np.argmax(evidence))
    near, start = near_labels(
        problem, joint_posterior.logits_of(problem, labels[best], z[best:best + 1])[0],
        problem.errors_of(z[best]), most)
    return near, *joint_posterior.fit_modes(problem, near, start)


def _joined(first: Modes, second: Modes) -> Modes:
    """The modes of the second, and those of the first that it has not, the best first."""
    known = set(map(tuple, second[0].tolist()))
    new = np.array([tuple(labels) not in known for labels in first[0].tolist()])
    labels, z, evidence = (np.concatenate([own, other[new]])
                           for own, other in zip(second, first, strict=True))
    order = np.argsort(-evidence)
    return labels[order], z[order], evidence[order]
