"""Which component of the prior's mixture each material of a scene belongs to: the modes of the
joint posterior.

There are C^M choices of labels. Near a fit the signals are taken for linear in the logits, and the
evidence of any labels is a Gaussian's in the space of the data. From each of the best labels so far
one material's label is switched, until all of the best were tried. These are then fitted in full,
twice, for where the linearisation was made matters.
"""
from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from spectrabox.sampling.scene.joint_posterior import (
    JointProblem,
    Modes,
    fit_modes,
    logits_of,
    residual_by_logit,
)

Labels = tuple[int, ...]

FITTED = 4              # labels that are fitted in full on the way to the most probable spectra
# the noise is taken for larger at first: sharp likelihoods trap the fit on its way
SOFTENED = (30.0, 5.0, 1.0)
SAMPLED = 128           # labels that draws are made of, at most; they leave 5 % of the spread out
EVIDENCE_CUTOFF = 7.0   # nats below the best, by the linearised evidence


def find_modes(problem: JointProblem, most: int = FITTED,
               first_guess: JointProblem | None = None) -> Modes:
    """The most probable spectra of all materials, and of the labels that come near to them, the
    best first.

    Parameters
    ----------
    problem : JointProblem
    most : int
        Labels that are fitted at last.
    first_guess : JointProblem, optional
        The same scene without the errors that regions share, in whose fit the search starts. They
        are in proportion to the measured signals: an error of -100 % of the light explains
        materials that are black, where a search that starts far from the signals would end.

    Raises
    ------
    ConvergenceError
        If the cost is not finite.
    """
    materials, wavelengths = len(problem.materials), problem.means.shape[1]
    one_gaussian, z = np.full((1, materials), len(problem.means)
                              - 1), np.zeros((1, materials * wavelengths))
    for times in SOFTENED:
        start = first_guess or problem
        softened = replace(start, rows=start.rows / times, targets=start.targets / times)
        rough = fit_modes(softened, one_gaussian, z)
        z = rough.z
    if first_guess is not None:
        rough = fit_modes(problem, one_gaussian, z)
    first = fit_modes(problem, *near_labels(problem, _logits_of_best(problem, rough), FITTED))
    second = fit_modes(problem, *near_labels(problem, _logits_of_best(problem, first), most))
    return _joined(first, second)


def near_labels(problem: JointProblem, logits: np.ndarray,
                most: int) -> tuple[np.ndarray, np.ndarray]:
    """The best labels (B, M), at most so many, by the evidence linearised at logits (M, P), and
    their z (B, M P).

    Parameters
    ----------
    problem : JointProblem
    logits : (M, P) array
        Where the model is linearised.
    most : int
        Number of labels.
    """
    residual, jacobian = residual_by_logit(problem, logits)
    # what a linear camera would have seen
    seen = np.einsum("fmp,mp->f", jacobian, logits) - residual
    components, materials = len(problem.means) - 1, len(logits)
    gain = jacobian.transpose(1, 0, 2)[:, None] @ problem.roots[None, :-1]      # (M, C, F, P)
    means = np.einsum("fmp,cp->mcf", jacobian, problem.means[:-1])
    spreads = gain @ gain.transpose(0, 1, 3, 2)
    every = np.arange(materials)

    def evidence(labels: Labels) -> tuple[float, np.ndarray]:
        chosen = list(labels)
        root = cholesky(np.eye(len(seen)) + spreads[every, chosen].sum(axis=0), lower=True)
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
    z = [np.concatenate([gain[m, c].T @ tried[labels][1] for m, c in enumerate(labels)])
         for labels in best]
    return np.array(best), np.array(z)


def _logits_of_best(problem: JointProblem, modes: Modes) -> np.ndarray:
    best = int(np.argmax(modes.evidence))
    return logits_of(problem, modes.labels[best], modes.z[best:best + 1])[0]


def _joined(first: Modes, second: Modes) -> Modes:
    """The modes of the second, and those of the first that it has not, the best first."""
    known = set(map(tuple, second.labels.tolist()))
    new = np.array([tuple(labels) not in known for labels in first.labels.tolist()])
    labels, z = np.vstack([second.labels, first.labels[new]]), np.vstack([second.z, first.z[new]])
    evidence = np.concatenate([second.evidence, first.evidence[new]])
    order = np.argsort(-evidence)
    return Modes(labels[order], z[order], evidence[order], second.outcome)
