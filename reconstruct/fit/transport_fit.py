"""Spectra from views through their traced light transports, with covariance.

Bounded, regularised Gauss-Newton. The unknowns are the spline coefficients of every unknown
material, in [0, 1], shared by all views; and of each view its light scale, where that is asked for,
and the nuisances of ``view_terms.py``. The prior on spectra decides what the photos leave open, and
``identifiability.py`` says what that is.
"""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spectrabox.radiometry.covariance import block_diagonal
from spectrabox.radiometry.records.spectra import Outcome
from spectrabox.reconstruct.fit.spectrum_prior import SpectrumPrior
from spectrabox.reconstruct.fit.view_terms import ViewFit, ViewTerms

START = 0.3
STEPS = 60
FINISHED = 1e-7         # relative fall of the cost of one step, twice running, that ends the fit
MAX_DAMPING = 1e12


@dataclass(frozen=True, eq=False)
class TransportFit:
    """The most probable spectra, the information of the photos alone, and how the fit went.

    D = U N coefficients, then the nuisances of view after view, each view's free log scale after
    them.
    """

    coefficients: np.ndarray            # (U, N)
    covariance: np.ndarray              # (U N, U N) posterior, Gauss-Newton
    information: np.ndarray  # (D, D) of the photos alone, and of the priors of the nuisances
    pull: np.ndarray                    # (D,) minus half the gradient of that part of the cost
    # (D,) bool: surface gains and light scales, whose errors later stages add
    added_later: np.ndarray
    prior_precision: np.ndarray         # (U, N, N)
    views: tuple[ViewFit, ...]
    cost_history: np.ndarray
    outcome: Outcome


def fit_views(views: Sequence[ViewTerms], materials: Sequence[tuple[int, ...]],
              priors: Sequence[SpectrumPrior], start: np.ndarray | None = None) -> TransportFit:
    """Most probable coefficients of the materials that the views share.

    Parameters
    ----------
    views : V views
    materials : for each view, which of the U materials each of its unknown materials is
    priors : U of SpectrumPrior
    start : (U, N) array, optional
        Flat spectra where it is left out.
    """
    cost_of = _Cost(views, materials, priors)
    state = np.zeros(cost_of.size)
    state[:cost_of.count] = START if start is None else start.ravel()
    for view, index in zip(views, cost_of.index, strict=True):
        if view.nuisances.scale is None:
            state[index[view.free_scale]] = view.start_scale(state[index])
    cost, gradient, curvature = cost_of.expand(state)
    damping, costs, calm, outcome = 1e-3, [cost], 0, Outcome.STEP_LIMIT
    for _ in range(STEPS):
        while damping < MAX_DAMPING:
            trial = cost_of.step(state, gradient, curvature, damping)
            if (trial_cost := cost_of.cost(trial)) <= cost:
                break
            damping *= 5
        else:
            outcome = Outcome.CONVERGED  # no step however short lowers the cost
            break
        calm = calm + 1 if cost - trial_cost <= FINISHED * max(abs(cost), 1.0) else 0
        state, damping = trial, max(damping / 5, 1e-9)
        cost, gradient, curvature = cost_of.expand(state)
        costs.append(cost)
        if calm == 2:
            outcome = Outcome.CONVERGED
            break
    return cost_of.answer(state, np.array(costs), outcome)


class _Cost:
    """The cost of all views and priors, with its gradient and Gauss-Newton curvature."""

    def __init__(self, views: Sequence[ViewTerms], materials: Sequence[tuple[int, ...]],
                 priors: Sequence[SpectrumPrior]) -> None:
        self.views, self.spectra, self.unknown = views, priors, len(priors)
        coefficients = priors[0].mean.size
        self.count = self.unknown * coefficients
        self.index, end = [], self.count     # of each view's state in the whole state
        for view, indices in zip(views, materials, strict=True):
            own = [index * coefficients + number for index in indices
                   for number in range(coefficients)]
            extra = view.size - view.count
            self.index.append(np.r_[own, np.arange(end, end + extra)].astype(int))
            end += extra
        self.size = end
        self.prior = np.zeros((end, end))
        self.prior[:self.count, :self.count] = block_diagonal(
            *(prior.precision for prior in priors))
        for view, index in zip(views, self.index, strict=True):
            self.prior[np.ix_(index[view.count:], index[view.count:])] = view.prior
        self.centre = np.zeros(end)
        self.centre[:self.count] = np.concatenate([prior.mean for prior in priors])

    def step(self, state: np.ndarray, gradient: np.ndarray, curvature: np.ndarray,
             damping: float) -> np.ndarray:
        """Damped step; coefficients at a bound that the cost pushes outwards stay there, the others
        are clipped.
        """
        bounded = np.arange(state.size) < self.count
        held = bounded & (((state <= 0) & (gradient > 0)) | ((state >= 1) & (gradient < 0)))
        free = np.flatnonzero(~held)
        matrix = curvature[np.ix_(free, free)]
        move = np.zeros_like(state)
        move[free] = -np.linalg.solve(matrix + damping * np.diag(np.diag(matrix)), gradient[free])
        trial = state + move
        trial[:self.count] = np.clip(trial[:self.count], 0.0, 1.0)
        return trial

    def cost(self, state: np.ndarray) -> float:
        """Misfit to the views, less the part that is Monte Carlo noise, plus the priors."""
        away = state - self.centre
        misfit = sum(view.misfit(state[index])
                     for view, index in zip(self.views, self.index, strict=True))
        return misfit + float(away @ self.prior @ away)

    def expand(self, state: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """Cost, half its gradient and half its Gauss-Newton curvature."""
        misfit, pull, information = self.views_part(state)
        away = state - self.centre
        return (misfit + float(away @ self.prior @ away), self.prior @ away - pull,
                _no_less_than_prior(information, self.prior))

    def views_part(self, state: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """Misfit to the views, minus half its gradient, half its Gauss-Newton curvature."""
        misfit, pull, information = 0.0, np.zeros(self.size), np.zeros((self.size, self.size))
        for view, index in zip(self.views, self.index, strict=True):
            part = view.expand(state[index])
            misfit += part[0]
            pull[index] += part[1]
            information[np.ix_(index, index)] += part[2]
        return misfit, pull, information

    def answer(self, state: np.ndarray, costs: np.ndarray, outcome: Outcome) -> TransportFit:
        """The fit at its last state."""
        _, pull, information = self.views_part(state)
        covariance = np.linalg.inv(_no_less_than_prior(information, self.prior))
        held = np.zeros_like(self.prior)
        held[self.count:, self.count:] = self.prior[self.count:, self.count:]
        added_later = np.zeros(self.size, dtype=bool)
        for view, index in zip(self.views, self.index, strict=True):
            added_later[index[view.gain]] = added_later[index[view.free_scale]] = True
        return TransportFit(
            state[:self.count].reshape(self.unknown, -1), covariance[:self.count, :self.count],
            information + held, pull - held @ state, added_later,
            np.array([prior.precision for prior in self.spectra]),
            tuple(view.solution(state[index], covariance[np.ix_(index, index)])
                  for view, index in zip(self.views, self.index, strict=True)), costs, outcome)


def _no_less_than_prior(information: np.ndarray, prior: np.ndarray) -> np.ndarray:
    """Information of photo and prior, where Monte Carlo noise made the photo's negative in some
    direction: none there.

    Without this the debiased curvature could have a wrong sign where the photo holds no
    information.
    """
    values, vectors = np.linalg.eigh(information)
    return (vectors * np.maximum(values, 0.0)) @ vectors.T + prior
