"""Spectra from a photo through a traced light transport: bounded, regularised Gauss-Newton with its covariance.

The unknowns are the spline coefficients of every unknown material, in [0, 1]; where asked, the light scale and a gain
for each surface and band (light profile, pose, uneven paint) with a log-normal prior. The smoothness prior is
exp(-tau/2 |second differences|^2); it decides what the photo leaves open, and ``identifiability.py`` says what that is.
"""
from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from radiometry.interreflection import band_products, band_products_jacobian
from radiometry.records import Outcome
from reconstruct.band_system import BandSystem

SMOOTHNESS = 0.1        # tau = SMOOTHNESS (N - 3)^3: the same curvature of the spectrum for every N
BROAD = 1.0             # standard deviation of a coefficient around 0.5 by the prior, besides smoothness
START = 0.3
STEPS = 60
FINISHED = 1e-7         # relative fall of the cost of one step, twice running, that ends the fit
MOST_DAMPING = 1e12


@dataclass(frozen=True)
class SpectrumModel:
    """What the coefficients stand for, and which are free."""

    exponents: np.ndarray               # (E, M)
    response: np.ndarray                # (L, K, P) sensitivity x light x integration weight
    basis: np.ndarray                   # (P, N)
    known: dict[int, np.ndarray]        # reflectance (P,) of materials that are not looked for

    @property
    def unknown(self) -> tuple[int, ...]:
        """Indices of the materials that are looked for."""
        return tuple(m for m in range(self.exponents.shape[1]) if m not in self.known)

    def reflectances(self, coefficients: np.ndarray) -> np.ndarray:
        """All spectra (M, P) for coefficients (U, N)."""
        spectra = np.empty((self.exponents.shape[1], len(self.basis)))
        for m, reflectance in self.known.items():
            spectra[m] = reflectance
        spectra[list(self.unknown)] = coefficients @ self.basis.T
        return spectra

    def signals(self, coefficients: np.ndarray) -> np.ndarray:
        """Signal (L E, K) of every product."""
        spectra = self.reflectances(coefficients)
        return np.vstack([band_products(self.exponents, spectra, response) for response in self.response])

    def signals_and_jacobian(self, coefficients: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Signal (L E, K) and its derivative (L E, K, U N)."""
        spectra = self.reflectances(coefficients)
        parts = [band_products_jacobian(self.exponents, spectra, response, self.basis, self.unknown)
                 for response in self.response]
        jacobian = np.concatenate([part[1] for part in parts])
        return np.vstack([part[0] for part in parts]), jacobian.reshape(*jacobian.shape[:2], -1)


@dataclass(frozen=True)
class FitPriors:
    """What is taken as known besides the photo."""

    smoothness: float = SMOOTHNESS      # 0 for none
    scale: float | None = None          # light scale; None to find it, which needs a known material
    gain_error: float = 0.0             # relative standard deviation of the gain of a surface in a band; 0 for none


@dataclass(frozen=True)
class TransportFit:
    """The most probable spectra, what the photo alone says of them, and how the fit went."""

    coefficients: np.ndarray            # (U, N)
    covariance: np.ndarray              # (U N, U N) posterior, Gauss-Newton
    information: np.ndarray             # (D, D) of the photo alone: U N coefficients, then log gains with their prior
    pull: np.ndarray                    # (D,) minus half the gradient of that part of the cost
    prior_precision: np.ndarray         # (N, N) of each material
    scale: float
    gains: dict[int, np.ndarray]        # surface -> (K,)
    cost_history: np.ndarray
    outcome: Outcome
    signals: np.ndarray = field(repr=False)  # (L E, K) of the products at the solution


def smoothness_precision(coefficients: int, smoothness: float) -> np.ndarray:
    """Prior precision (N, N) of one material: small second differences over wavelength, broadly around 0.5."""
    place = _greville(coefficients)
    mean_gap = 1.0 / (coefficients - 1)
    second = np.zeros((coefficients - 2, coefficients))
    for row in range(coefficients - 2):
        left, right = np.diff(place[row:row + 3])
        second[row, row:row + 3] = np.array([1 / left, -(1 / left + 1 / right), 1 / right]) * mean_gap
    tau = smoothness * (coefficients - 3) ** 3
    return tau * second.T @ second + np.eye(coefficients) / BROAD**2


def fit_spectra(system: BandSystem, model: SpectrumModel, priors: FitPriors,
                start: np.ndarray | None = None) -> TransportFit:
    """Most probable coefficients of the unknown materials.

    Parameters
    ----------
    system : BandSystem
    model : SpectrumModel
    priors : FitPriors
    start : (U, N) array, optional
    """
    problem = _Problem(system, model, priors)
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
    """The cost in (coefficients, log gains, log scale), with its gradient and Gauss-Newton curvature."""

    def __init__(self, system: BandSystem, model: SpectrumModel, priors: FitPriors) -> None:
        self.system, self.model, self.priors = system, model, priors
        self.unknown = len(model.unknown)
        self.count = self.unknown * model.basis.shape[1]
        self.bands = system.target.shape[1]
        self.surfaces = np.unique(system.group) if priors.gain_error > 0 else np.array([], dtype=int)
        self.gains = self.surfaces.size * self.bands
        self.free_scale = priors.scale is None
        self.size = self.count + self.gains + self.free_scale
        one = smoothness_precision(model.basis.shape[1], priors.smoothness)
        self.prior = np.zeros((self.size, self.size))
        self.prior[:self.count, :self.count] = np.kron(np.eye(self.unknown), one)
        np.fill_diagonal(self.prior[self.count:, self.count:], 1 / max(priors.gain_error, 1e-9) ** 2)
        if self.free_scale:
            self.prior[-1, -1] = 0.0
        self.centre = np.where(np.arange(self.size) < self.count, 0.5, 0.0)

    def start(self, coefficients: np.ndarray | None) -> np.ndarray:
        """Flat spectra, or the given ones, and the light scale that suits them best."""
        state = np.zeros(self.size)
        state[:self.count] = START if coefficients is None else coefficients.ravel()
        if self.free_scale:
            predicted = self.system.root * (self.system.rows @ self.model.signals(self._coefficients(state)))
            state[-1] = np.log(np.sum(predicted * self.system.root * self.system.target) / np.sum(predicted**2))
        return state

    def step(self, state: np.ndarray, gradient: np.ndarray, curvature: np.ndarray, damping: float) -> np.ndarray:
        """Damped step; coefficients at a bound that the cost pushes outwards stay there, the others are clipped."""
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
        """Misfit to the photo, less the part that is Monte Carlo noise, plus the priors."""
        system, signals = self.system, self.model.signals(self._coefficients(state))
        data = system.root * (self._factor(state, system.group) * (system.rows @ signals) - system.target)
        noise = system.noise_root * self._factor(state, system.noise_group) * (system.noise @ signals)
        away = state - self.centre
        return float(np.sum(data**2) - np.sum(noise**2) + away @ self.prior @ away)

    def expand(self, state: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """Cost, half its gradient and half its Gauss-Newton curvature."""
        misfit, pull, information = self.photo(state)
        away = state - self.centre
        return (misfit + float(away @ self.prior @ away), self.prior @ away - pull,
                _no_less_than_prior(information, self.prior))

    def photo(self, state: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """The photo's part: misfit, minus half its gradient, half its curvature."""
        system = self.system
        signals, slope = self.model.signals_and_jacobian(self._coefficients(state))
        data, by_data = self._linear(state, signals, slope, system.rows, system.root, system.group)
        data = data - (system.root * system.target).ravel()
        noise, by_noise = self._linear(state, signals, slope, system.noise, system.noise_root, system.noise_group)
        return (float(data @ data - noise @ noise), by_noise.T @ noise - by_data.T @ data,
                by_data.T @ by_data - by_noise.T @ by_noise)

    def answer(self, state: np.ndarray, costs: np.ndarray, outcome: Outcome) -> TransportFit:
        _, pull, information = self.photo(state)
        covariance = np.linalg.inv(_no_less_than_prior(information, self.prior))[:self.count, :self.count]
        size = self.count + self.gains
        held = np.zeros_like(self.prior)
        held[self.count:, self.count:] = self.prior[self.count:, self.count:]
        pull, information = pull - held @ state, information + held
        gains = np.exp(state[self.count:self.count + self.gains]).reshape(-1, self.bands)
        coefficients = self._coefficients(state)
        return TransportFit(
            coefficients, covariance, information[:size, :size], pull[:size],
            self.prior[:coefficients.shape[1], :coefficients.shape[1]],
            float(np.exp(state[-1])) if self.free_scale else float(self.priors.scale or 1.0),
            dict(zip(self.surfaces.tolist(), gains, strict=True)), costs, outcome, self.model.signals(coefficients))

    def _linear(self, state: np.ndarray, signals: np.ndarray, slope: np.ndarray, rows: np.ndarray, root: np.ndarray,
                group: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Weighted prediction (Q K,) of some rows and its derivative (Q K, size)."""
        factor = root * self._factor(state, group)
        predicted = factor * (rows @ signals)
        derivative = np.zeros((*predicted.shape, self.size))
        by_coefficient = (rows @ slope.reshape(len(slope), -1)).reshape(len(rows), self.bands, self.count)
        derivative[..., :self.count] = factor[..., None] * by_coefficient
        if self.gains:
            column = self.count + np.searchsorted(self.surfaces, group)[:, None] * self.bands + np.arange(self.bands)
            np.put_along_axis(derivative, column[..., None], predicted[..., None], axis=2)
        if self.free_scale:
            derivative[..., -1] = predicted
        return predicted.ravel(), derivative.reshape(-1, self.size)

    def _coefficients(self, state: np.ndarray) -> np.ndarray:
        return state[:self.count].reshape(self.unknown, -1)

    def _factor(self, state: np.ndarray, group: np.ndarray) -> np.ndarray:
        """Scale x gain (Q, K), or a number."""
        scale = np.exp(state[-1]) if self.free_scale else np.asarray(self.priors.scale)
        if not self.gains:
            return scale
        gains = state[self.count:self.count + self.gains].reshape(-1, self.bands)
        return scale * np.exp(gains[np.searchsorted(self.surfaces, group)])


def _no_less_than_prior(information: np.ndarray, prior: np.ndarray) -> np.ndarray:
    """Information of photo and prior, where Monte Carlo noise made the photo's negative in some direction: none there.

    Without this the debiased curvature could have a wrong sign where the photo says nothing.
    """
    values, vectors = np.linalg.eigh(information)
    return (vectors * np.maximum(values, 0.0)) @ vectors.T + prior


def _greville(coefficients: int) -> np.ndarray:
    """Abscissae (N,) of the coefficients of a clamped cubic spline, 0 to 1."""
    inner = np.linspace(0, 1, coefficients - 2)
    knots = np.r_[[0.0] * 3, inner, [1.0] * 3]
    return np.array([knots[i + 1:i + 4].mean() for i in range(coefficients)])
