"""Spectra from photos through their traced light transports: bounded, regularised Gauss-Newton with
its covariance.

The unknowns are the spline coefficients of every unknown material, in [0, 1], shared by all photos;
and of each photo its light scale, where that is asked for, and the nuisances of ``photo_terms.py``.
The prior on spectra decides what the photos leave open, and ``identifiability.py`` says what that
is.
"""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spectrabox.radiometry.records import Outcome
from spectrabox.reconstruct.fit.band_system import BandSystem
from spectrabox.reconstruct.fit.photo_terms import Nuisances, PhotoTerms, SpectrumModel, ViewFit

__all__ = ["FitPriors", "Nuisances", "SpectrumModel", "SpectrumPrior", "TransportFit", "fit_photos",
           "fit_spectra", "learnt_prior", "smooth_prior", "smoothness_precision"]

SMOOTHNESS = 0.1        # tau = SMOOTHNESS (N - 3)^3: the same curvature of the spectrum for every N
BROAD = 1.0  # standard deviation of a coefficient around 0.5 by the prior, besides smoothness
UNEXPLAINED = 0.01      # standard deviation of a coefficient that no learnt spectrum explains
START = 0.3
STEPS = 60
FINISHED = 1e-7         # relative fall of the cost of one step, twice running, that ends the fit
MOST_DAMPING = 1e12


@dataclass(frozen=True, eq=False)
class SpectrumPrior:
    """Gaussian prior of the coefficients of one material."""

    mean: np.ndarray                    # (N,)
    precision: np.ndarray               # (N, N)


@dataclass(frozen=True)
class FitPriors(Nuisances):
    """What is taken as known besides the pixels of one photo."""

    smoothness: float = SMOOTHNESS      # 0 for none; not used where ``learnt`` is given
    learnt: SpectrumPrior | None = None

    def spectrum(self, coefficients: int) -> SpectrumPrior:
        """Of the spectra: the learnt one, or small second differences over wavelength."""
        return self.learnt or smooth_prior(coefficients, self.smoothness)


@dataclass(frozen=True)
class TransportFit:
    """The most probable spectra, what the photos alone say of them, and how the fit went.

    D = U N coefficients, then the nuisances of photo after photo, each photo's free log scale after
    them.
    """

    coefficients: np.ndarray            # (U, N)
    covariance: np.ndarray              # (U N, U N) posterior, Gauss-Newton
    information: np.ndarray  # (D, D) of the photos alone, and of the priors of the nuisances
    pull: np.ndarray                    # (D,) minus half the gradient of that part of the cost
    # (D,) bool: surface gains and light scales, whose errors later stages add
    told_apart: np.ndarray
    prior_precision: np.ndarray         # (N, N) of each material
    views: tuple[ViewFit, ...]
    cost_history: np.ndarray
    outcome: Outcome

    @property
    def scale(self) -> float:
        """Light scale of the first photo."""
        return self.views[0].scale

    @property
    def gains(self) -> dict[int, np.ndarray]:
        """Gains (K,) of the first photo's surfaces."""
        return self.views[0].gains

    @property
    def signals(self) -> np.ndarray:
        """Signal (L E, K) of the first photo's products at the solution."""
        return self.views[0].signals


def smooth_prior(coefficients: int, smoothness: float) -> SpectrumPrior:
    """exp(-tau/2 |second differences|^2), broadly around 0.5."""
    return SpectrumPrior(np.full(coefficients, 0.5), smoothness_precision(coefficients, smoothness))


def learnt_prior(basis: np.ndarray, mean: np.ndarray, covariance: np.ndarray) -> SpectrumPrior:
    """Prior of the coefficients from mean (P,) and covariance (P, P) of reflectances at the
    wavelengths of the basis.

    Parameters
    ----------
    basis : (P, N) array
    """
    to_coefficients = np.linalg.pinv(basis)
    spread = to_coefficients @ covariance @ to_coefficients.T + UNEXPLAINED**2 * np.eye(
        basis.shape[1])
    return SpectrumPrior(to_coefficients @ mean, np.linalg.inv(spread))


def smoothness_precision(coefficients: int, smoothness: float) -> np.ndarray:
    """Prior precision (N, N) of one material: small second differences over wavelength, broadly
    around 0.5.
    """
    place = _greville(coefficients)
    mean_gap = 1.0 / (coefficients - 1)
    second = np.zeros((coefficients - 2, coefficients))
    for row in range(coefficients - 2):
        left, right = np.diff(place[row:row + 3])
        second[row, row:row + 3] = np.array([1 / left, -(1 / left + 1 / right),
                                             1 / right]) * mean_gap
    tau = smoothness * (coefficients - 3) ** 3
    return tau * second.T @ second + np.eye(coefficients) / BROAD**2


def fit_spectra(system: BandSystem, model: SpectrumModel, priors: FitPriors,
                start: np.ndarray | None = None) -> TransportFit:
    """Most probable coefficients (U, N) of the unknown materials of one photo, from ``start`` or
    flat spectra.
    """
    return fit_photos([PhotoTerms(system, model, priors)], [tuple(range(len(model.unknown)))],
                      priors.spectrum(model.basis.shape[1]), start)


def fit_photos(photos: Sequence[PhotoTerms], places: Sequence[tuple[int, ...]],
               prior: SpectrumPrior,
               start: np.ndarray | None = None) -> TransportFit:
    """Most probable coefficients of the materials that the photos share.

    Parameters
    ----------
    photos : V photos
    places : for each photo, which of the U materials each of its unknown materials is
    prior : SpectrumPrior
        The same for every material.
    start : (U, N) array, optional
    """
    problem = _Problem(photos, places, prior)
    state = problem.start(start)
    cost, gradient, curvature = problem.expand(state)
    damping, costs, calm, outcome = 1e-3, [cost], 0, Outcome.STEP_LIMIT
    for _ in range(STEPS):
        while damping < MOST_DAMPING:
            trial = problem.step(state, gradient, curvature, damping)
            if (trial_cost := problem.cost(trial)) <= cost:
                break
            damping *= 5
        else:
            outcome = Outcome.CONVERGED  # no step however short lowers the cost
            break
        calm = calm + 1 if cost - trial_cost <= FINISHED * max(abs(cost), 1.0) else 0
        state, damping = trial, max(damping / 5, 1e-9)
        cost, gradient, curvature = problem.expand(state)
        costs.append(cost)
        if calm == 2:
            outcome = Outcome.CONVERGED
            break
    return problem.answer(state, np.array(costs), outcome)


class _Problem:
    """The cost of all photos and priors, with its gradient and Gauss-Newton curvature."""

    def __init__(self, photos: Sequence[PhotoTerms], places: Sequence[tuple[int, ...]],
                 prior: SpectrumPrior) -> None:
        self.photos, self.one = photos, prior
        self.unknown = max((place for mine in places for place in mine), default=-1) + 1
        names = prior.mean.size
        self.count = self.unknown * names
        self.index, end = [], self.count     # of each photo's state in the whole state
        for photo, mine in zip(photos, places, strict=True):
            own = [place * names + number for place in mine for number in range(names)]
            extra = photo.size - photo.count
            self.index.append(np.r_[own, np.arange(end, end + extra)].astype(int))
            end += extra
        self.size = end
        self.prior = np.zeros((end, end))
        self.prior[:self.count, :self.count] = np.kron(np.eye(self.unknown), prior.precision)
        for photo, index in zip(photos, self.index, strict=True):
            self.prior[np.ix_(index[photo.count:], index[photo.count:])] = photo.prior
        self.centre = np.zeros(end)
        self.centre[:self.count] = np.tile(prior.mean, self.unknown)

    def start(self, coefficients: np.ndarray | None) -> np.ndarray:
        """Flat spectra, or the given ones, and the light scales that suit them best."""
        state = np.zeros(self.size)
        state[:self.count] = START if coefficients is None else coefficients.ravel()
        for photo, index in zip(self.photos, self.index, strict=True):
            if photo.nuisances.scale is None:
                state[index[photo.free_scale]] = photo.start_scale(state[index])
        return state

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
        """Misfit to the photos, less the part that is Monte Carlo noise, plus the priors."""
        away = state - self.centre
        return (sum(photo.misfit(state[index]) for photo, index in zip(self.photos, self.index,
                                                                       strict=True))
                + float(away @ self.prior @ away))

    def expand(self, state: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """Cost, half its gradient and half its Gauss-Newton curvature."""
        misfit, pull, information = self.photo_part(state)
        away = state - self.centre
        return (misfit + float(away @ self.prior @ away), self.prior @ away - pull,
                _no_less_than_prior(information, self.prior))

    def photo_part(self, state: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """What the photos say: misfit, minus half its gradient, half its curvature."""
        misfit, pull, information = 0.0, np.zeros(self.size), np.zeros((self.size, self.size))
        for photo, index in zip(self.photos, self.index, strict=True):
            part = photo.expand(state[index])
            misfit += part[0]
            pull[index] += part[1]
            information[np.ix_(index, index)] += part[2]
        return misfit, pull, information

    def answer(self, state: np.ndarray, costs: np.ndarray, outcome: Outcome) -> TransportFit:
        _, pull, information = self.photo_part(state)
        covariance = np.linalg.inv(_no_less_than_prior(information, self.prior))
        held = np.zeros_like(self.prior)
        held[self.count:, self.count:] = self.prior[self.count:, self.count:]
        apart = np.zeros(self.size, dtype=bool)
        for photo, index in zip(self.photos, self.index, strict=True):
            apart[index[photo.gain]] = apart[index[photo.free_scale]] = True
        return TransportFit(
            state[:self.count].reshape(self.unknown, -1), covariance[:self.count, :self.count],
            information + held, pull - held @ state, apart, self.one.precision,
            tuple(photo.view(state[index], covariance[np.ix_(index, index)])
                  for photo, index in zip(self.photos, self.index, strict=True)), costs, outcome)


def _no_less_than_prior(information: np.ndarray, prior: np.ndarray) -> np.ndarray:
    """Information of photo and prior, where Monte Carlo noise made the photo's negative in some
    direction: none there.

    Without this the debiased curvature could have a wrong sign where the photo says nothing.
    """
    values, vectors = np.linalg.eigh(information)
    return (vectors * np.maximum(values, 0.0)) @ vectors.T + prior


def _greville(coefficients: int) -> np.ndarray:
    """Abscissae (N,) of the coefficients of a clamped cubic spline, 0 to 1."""
    inner = np.linspace(0, 1, coefficients - 2)
    knots = np.r_[[0.0] * 3, inner, [1.0] * 3]
    return np.array([knots[i + 1:i + 4].mean() for i in range(coefficients)])
