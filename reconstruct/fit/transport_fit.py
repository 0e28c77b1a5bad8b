"""Spectra from views through their traced light transports, with covariance, and what the photos
determine of them.

Bounded, regularised Gauss-Newton. The unknowns are the spline coefficients of every unknown
material, in [0, 1], shared by all views; and of each view its light scale, where that is asked for,
and the nuisances of ``view_terms.py``. The prior on spectra decides what the photos leave open, and
``identifiability`` says what that is.
"""


from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from spectrabox.radiometry.covariance import block_diagonal
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.grid import basis_matrix, interpolation_matrix
from spectrabox.radiometry.records import scenes
from spectrabox.radiometry.records.spectra import Outcome, WavelengthGrid
from spectrabox.reconstruct.fit import view_terms
from spectrabox.reconstruct.scene.surfaces import region_means
from spectrabox.reconstruct.settings import SPECTRUM_PRIORS, InversionSettings
from spectrabox.reconstruct.tracer.transport import TracedTransport
from spectrabox.reconstruct.view import PhotoView, unknown_materials

LAMP_SHARE = 1e-3  # of a region's light straight from a lamp: above, its edge runs through a pixel
ROBUST_ROUNDS = 2        # times that pixels beyond HUBER sigma are weighed anew
DOUBTED = 0.5  # weight of a region in the robust fit below which the samplers leave it out


@dataclass(frozen=True, eq=False)
class TracedView:
    """One view with its light transport by R regions, and the weight of each region."""

    view: PhotoView
    traced: TracedTransport
    region: np.ndarray              # (H, W)
    group: np.ndarray               # (R,) surface of each region
    nuisances: view_terms.Nuisances
    # by which the view's photo and light scale are tied
    known_light: scenes.KnownLight | None = None

    @cached_property
    def measured(self) -> np.ndarray:
        """Signal (R, K)."""
        return region_means(self.view.measured, self.region)

    @cached_property
    def variance(self) -> np.ndarray:
        """Variance (R, K) of the signal against the rendering."""
        pixels = np.bincount(self.region[self.region >= 0])
        rendering = smoothed_variance(self.traced.relative_variance, self.group, pixels)
        return self.photo_variance + rendering[:, None] * self.measured**2

    @cached_property
    def photo_variance(self) -> np.ndarray:
        """Variance (R, K) of the signal against a rendering without noise."""
        pixels = np.bincount(self.region[self.region >= 0])
        return np.asarray(region_means(self.view.variance, self.region) / pixels[:, None]
                          + self.nuisances.block_error**2 * self.measured**2)

    @cached_property
    def weight(self) -> np.ndarray:
        """Inverse variance (R, K), 0 for the regions that see a lamp."""
        return np.where(shows_lamp(self.traced)[:, None], 0.0, 1 / self.variance)

    def terms(self, coefficients: int, trust: np.ndarray | None = None) -> view_terms.ViewTerms:
        """The view's part of the cost.

        Parameters
        ----------
        coefficients : int
            N of every spectrum.
        trust : (R, 1) array, optional
            Factor on the weight of each region, 0 to 1.
        """
        weight = self.weight if trust is None else trust * self.weight
        system = view_terms.compress(self.traced.coefficients, self.measured, weight, self.group,
                          self.traced.deviations)
        view, responses = self.view, self.view.responses
        known = {index: material.reflectance
                 for index, material in enumerate(view.scene_materials)
                 if material.reflectance is not None}
        # a response for each light that was traced separately
        model = view_terms.SpectrumModel(self.traced.exponents,
                              responses if self.traced.passes.shape[2] > 1 else responses[:1],
                              view.basis(coefficients), known)
        return view_terms.ViewTerms(system, model, self.nuisances)

    def trust(self, fit: view_terms.ViewFit) -> np.ndarray:
        """Huber weight (R, 1) of each region at the solution, in (0, 1].

        Parameters
        ----------
        fit : ViewFit
            Of this view.
        """
        gain = np.array([fit.gains.get(surface, np.ones(self.measured.shape[1]))
                         for surface in self.group.tolist()])
        predicted = fit.scale * gain * (self.traced.coefficients @ fit.signals)
        return view_terms.huber_weight(self.measured - predicted, np.sqrt(self.variance))

    def regions(self, fit: view_terms.ViewFit) -> scenes.RegionTransport | None:
        """The regions as the samplers of a whole scene take them.

        None where lights were traced separately, since their spectra differ.

        Parameters
        ----------
        fit : ViewFit
            Of this view; regions that it weighs below ``DOUBTED`` are left out.
        """
        traced = self.traced
        if traced.passes.shape[2] > 1:
            return None
        seen = self.weight.max(axis=1) > 0
        weight = np.where(seen, self.trust(fit).min(axis=1), 0.0)
        names = tuple(material.name for material in self.view.scene_materials)
        material = np.array([names.index(name) for name in self.view.surface_materials])[self.group]
        return scenes.RegionTransport(
            names, np.array(traced.exponents), np.array(traced.coefficients),
            np.where(weight[:, None] >= DOUBTED, self.measured, np.nan), np.sqrt(self.variance),
            np.array(self.group), material, self.nuisances.surface_error,
            self.nuisances.brightness_error)


def fit_traced(views: Sequence[TracedView], priors: Sequence[tuple[np.ndarray, np.ndarray]],
               start: np.ndarray | None = None) -> TransportFit:
    """Most probable spectra of all views, fitted robustly.

    Regions that no spectrum explains lose weight round by round. Regions that see the lamp count
    nothing.

    Parameters
    ----------
    views : V views
    priors : U of (mean (N,), precision (N, N))
        Of the coefficients of each material, in the order of ``unknown_materials``.
    start : (U, N) array, optional
        Coefficients from which the fit sets out.
    """
    bsdfs = [material.bsdf for material in unknown_materials([view.view for view in views])]
    materials = [tuple(bsdfs.index(material.bsdf) for material in view.view.unknown)
                 for view in views]
    count = priors[0][0].size
    fit = fit_views([view.terms(count) for view in views], materials, priors, start)
    for _ in range(ROBUST_ROUNDS):
        terms = [view.terms(count, view.trust(solution))
                 for view, solution in zip(views, fit.views, strict=True)]
        fit = fit_views(terms, materials, priors, fit.coefficients)
    return fit


def shows_lamp(traced: TracedTransport) -> np.ndarray:
    """Regions (R,) bool that show a lamp.

    Parameters
    ----------
    traced : TracedTransport
    """
    coefficients = traced.coefficients
    direct = coefficients[:, ::len(traced.exponents)].sum(axis=1)
    return np.asarray(direct > LAMP_SHARE * coefficients.sum(axis=1))


def smoothed_variance(relative_variance: np.ndarray, group: np.ndarray,
                      pixels: np.ndarray) -> np.ndarray:
    """Monte Carlo variance (R,) of each region, half its own and half its surface's.

    Few passes know it only roughly. Regions differ in size, so what they share is the variance of
    one pixel's paths.

    Parameters
    ----------
    relative_variance : (R,) array
    group : (R,) int
        Surface of each region.
    pixels : (R,) int
        Of each region.
    """
    of_pixel = relative_variance * pixels
    pooled = np.bincount(group, of_pixel) / np.maximum(np.bincount(group), 1)
    return 0.5 * (of_pixel + pooled[group]) / pixels


# ---- gaussian priors on the spectra, which decide what the photos leave open ---------------------

BROAD = 1.0  # standard deviation of a coefficient around 0.5 by the prior, besides smoothness
UNEXPLAINED = 0.01      # standard deviation of a coefficient that no learnt spectrum explains


def spectrum_prior(settings: InversionSettings, grid: WavelengthGrid,
                   of_family: scenes.LearntSpectra | None = None
                   ) -> tuple[np.ndarray, np.ndarray]:
    """Mean (N,) and precision (N, N) of the coefficients of an unknown material before the photo is
    seen, as the settings choose them.

    Parameters
    ----------
    settings : InversionSettings
        Of which ``spectrum_prior``, ``smoothness``, ``coefficients`` and ``learnt`` count.
    grid : WavelengthGrid
        P wavelengths, on which a learnt prior is interpolated.
    of_family : LearntSpectra, optional
        In place of ``learnt``, where the material's family of surfaces is stated.

    Raises
    ------
    InputError
        If the settings name an unknown prior, or a learnt one without its data.
    """
    if settings.spectrum_prior not in SPECTRUM_PRIORS:
        raise InputError(f"there is no prior on spectra {settings.spectrum_prior!r}; "
                         f"use one of {', '.join(SPECTRUM_PRIORS)}")
    if settings.spectrum_prior != "learnt":
        return smooth_prior(settings.coefficients,
                            settings.smoothness if settings.spectrum_prior == "smooth" else 0.0)
    learnt = of_family or settings.learnt
    if learnt is None:
        raise InputError("a learnt prior on spectra needs the mean and covariance of measured "
                         "reflectances: give them, or choose the prior \"smooth\"")
    between = interpolation_matrix(learnt.nm, grid.nm)
    return learnt_prior(basis_matrix(grid.nm, settings.coefficients), between @ learnt.mean,
                        between @ learnt.covariance @ between.T)


def smooth_prior(coefficients: int, smoothness: float) -> tuple[np.ndarray, np.ndarray]:
    """Mean and precision of N coefficients with small second differences, broadly around 0.5.

    exp(-tau/2 |second differences|^2) with tau = smoothness (N - 3)^3: the same curvature of the
    spectrum for every N. Second differences are divided by the gaps of the Greville abscissae, so
    that a straight spectrum has none.

    Parameters
    ----------
    coefficients : int
        N, 4 or more.
    smoothness : float
        0 leaves the broad prior alone.
    """
    position = greville_abscissae(coefficients)
    mean_gap = 1.0 / (coefficients - 1)
    second = np.zeros((coefficients - 2, coefficients))
    for row in range(coefficients - 2):
        left, right = np.diff(position[row:row + 3])
        second[row, row:row + 3] = np.array([1 / left, -(1 / left + 1 / right),
                                             1 / right]) * mean_gap
    tau = smoothness * (coefficients - 3) ** 3
    return (np.full(coefficients, 0.5),
            tau * second.T @ second + np.eye(coefficients) / BROAD**2)


def learnt_prior(basis: np.ndarray, mean: np.ndarray,
                 covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and precision of the coefficients by mean and covariance of measured reflectances.

    Parameters
    ----------
    basis : (P, N) array
    mean : (P,) array
        At the wavelengths of the basis.
    covariance : (P, P) array
    """
    to_coefficients = np.linalg.pinv(basis)
    spread = to_coefficients @ covariance @ to_coefficients.T + UNEXPLAINED**2 * np.eye(
        basis.shape[1])
    return to_coefficients @ mean, np.linalg.inv(spread)


def greville_abscissae(coefficients: int) -> np.ndarray:
    """Abscissae (N,) of the coefficients of a clamped cubic spline, 0 to 1."""
    inner = np.linspace(0, 1, coefficients - 2)
    knots = np.r_[[0.0] * 3, inner, [1.0] * 3]
    return np.array([knots[i + 1:i + 4].mean() for i in range(coefficients)])


# ---- spectra from views through their traced light transports, with covariance -------------------

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
    views: tuple[view_terms.ViewFit, ...]
    cost_history: np.ndarray
    outcome: Outcome


def fit_views(views: Sequence[view_terms.ViewTerms], materials: Sequence[tuple[int, ...]],
              priors: Sequence[tuple[np.ndarray, np.ndarray]],
              start: np.ndarray | None = None) -> TransportFit:
    """Most probable coefficients of the materials that the views share.

    Parameters
    ----------
    views : V views
    materials : for each view, which of the U materials each of its unknown materials is
    priors : U of (mean, precision)
    start : (U, N) array, optional
        Flat spectra where it is left out.
    """
    cost_of = _Cost(views, materials, priors)
    state = np.zeros(cost_of.size)
    state[:cost_of.count] = START if start is None else start.ravel()
    for view, index in zip(views, cost_of.index, strict=True):
        if view.scale_is_free:
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

    def __init__(self, views: Sequence[view_terms.ViewTerms], materials: Sequence[tuple[int, ...]],
                 priors: Sequence[tuple[np.ndarray, np.ndarray]]) -> None:
        means, self.precisions = (np.array(each) for each in zip(*priors, strict=True))
        self.views = views
        self.unknown, coefficients = means.shape
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
        self.prior[:self.count, :self.count] = block_diagonal(*self.precisions)
        for view, index in zip(views, self.index, strict=True):
            self.prior[np.ix_(index[view.count:], index[view.count:])] = view.prior
        self.centre = np.zeros(end)
        self.centre[:self.count] = means.ravel()

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
            information + held, pull - held @ state, added_later, self.precisions,
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


# ---- identifiability -----------------------------------------------------------------------------

# standard deviation, in coefficients, of the directions that the camera cannot see directly
HIDDEN_ERROR = 0.25
MIN_SINGULAR = 1e-6     # of the largest singular value: below, bands repeat each other
# information of the photo over that of the prior, above which a direction is the photo's
MIN_RATIO = 1.0


def band_signals(fit: TransportFit, operator: np.ndarray,
                 names: int) -> tuple[np.ndarray, np.ndarray]:
    """Signals of the unknown materials that the photo, not the prior on spectra, gives.

    One more Gauss-Newton step from the solution with the prior on the spectra taken off: free in
    what the bands see of each material, and only loosely held (``HIDDEN_ERROR``) in what they do
    not; gains move along. The covariance is that of photo noise and Monte Carlo noise, and of gains
    of lights and band mixing; gains of surfaces and the light scale are taken as exact: later
    stages add their errors (``TransportFit.added_later``).

    Parameters
    ----------
    fit : TransportFit
    operator : (K, N) array
        Relative signal of the coefficients; bands of several photos may stand in it one below the
        other.
    names : int
        Number U of unknown materials.

    Returns
    -------
    signals : (U, K) array
        Relative to white.
    covariances : (U, K, K) array
    """
    count = operator.shape[1]
    left, singular, vt = np.linalg.svd(operator)
    seen_of_each = int(np.count_nonzero(singular > MIN_SINGULAR * singular[0]))
    size = names * count
    turn = np.eye(len(fit.information))
    turn[:size, :size] = np.kron(np.eye(names), vt.T)
    hidden = np.zeros(len(turn))
    hidden[:size] = np.tile(np.arange(count) >= seen_of_each, names) / HIDDEN_ERROR**2
    information = turn.T @ fit.information @ turn + np.diag(hidden)
    information += 1e-12 * np.trace(information) * np.eye(len(information))
    move = np.linalg.solve(information, turn.T @ fit.pull)
    within = ~fit.added_later
    covariance = np.linalg.inv(information[np.ix_(within, within)])
    to_signal = left[:, :seen_of_each] * singular[:seen_of_each]
    signals, covariances = [], []
    for index in range(names):
        seen = slice(index * count, index * count + seen_of_each)
        signals.append(operator @ fit.coefficients[index] + to_signal @ move[seen])
        covariances.append(to_signal @ covariance[seen, seen] @ to_signal.T)
    return np.array(signals), np.array(covariances)


def identifiability(fit: TransportFit) -> np.ndarray:
    """Information (U, N) of the photo over that of the prior along each direction of the
    coefficients of a material, the best determined first, all else being unknown as well.

    Other materials and all nuisances are marginalised.
    """
    materials, count = fit.coefficients.shape
    size = materials * count
    cross = fit.information[:size, size:]
    # nuisances marginalised; then, material by material, all others
    photo = fit.information[:size, :size] - cross @ np.linalg.pinv(
        fit.information[size:, size:], hermitian=True) @ cross.T
    posterior = np.linalg.inv(photo + block_diagonal(*fit.prior_precision))
    ratios = np.empty((materials, count))
    for index, prior in enumerate(fit.prior_precision):
        own = slice(index * count, (index + 1) * count)
        root = np.linalg.cholesky(prior)
        information = np.linalg.inv(posterior[own, own]) - prior
        whitened = np.linalg.solve(root, np.linalg.solve(root, information).T)
        ratios[index] = np.linalg.eigvalsh((whitened + whitened.T) / 2)[::-1]
    return np.maximum(ratios, 0.0)


def determined(materials: Sequence[str], ratios: np.ndarray,
               operator: np.ndarray) -> tuple[Finding, ...]:
    """How much of the spectrum of each material is measured, and how much assumed.

    As many directions as the camera has bands, at most, are read off the surface itself; only light
    from other surfaces determines more.

    Parameters
    ----------
    materials : U names
    ratios : (U, N) array
        As of ``identifiability``.
    operator : (K, N) array
        Relative signal of the coefficients.
    """
    found = []
    for name, ratio in zip(materials, ratios, strict=True):
        by_photo = int(np.count_nonzero(ratio > MIN_RATIO))
        by_colour = min(by_photo, int(np.linalg.matrix_rank(operator)))
        found.append(Finding("fit.determined", Severity.INFO, name, {
            "coefficients": ratio.size, "by_photo": by_photo, "by_colour": by_colour,
            "by_interreflection": by_photo - by_colour, "by_prior": ratio.size - by_photo}))
    return tuple(found)
