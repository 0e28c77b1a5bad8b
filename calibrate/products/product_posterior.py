"""Products of sensitivity and light behind chart photos: a mixture of Gaussians, in closed form.

With the products x_c of a component, photo by photo

    signal(i, k) = exp(level(k) + exposure + field(i)) sum_n reflectance(i, n) x_c(k, n) + glare(k)

(through a filter, reflectance x transmittance in place of reflectance) is linear in the products,
and nearly so in the rest, of which the photo itself says enough to linearise it once for all
components. All have one covariance about them, h^2 C, so that one gain moves all (an ensemble
Kalman filter's update), and what a component could not explain is its evidence. How wide the
kernels are, how far white balances depart, and how large the disagreement of patches and model is,
are unknown too: a few values each, weighed by the same evidence.
"""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from typing import Annotated

import numpy as np
from scipy.linalg import solve_triangular

from spectrabox.calibrate import chart_equations
from spectrabox.calibrate.held_out_patches import covariance_without, weights_without
from spectrabox.calibrate.prior import prior_fit
from spectrabox.calibrate.products.lamps import ProductPrior
from spectrabox.radiometry import covariance, grid, shaped

WIDTHS = ((0.01, 0.2), (0.03, 0.3), (0.1, 0.3), (0.4, 0.2))     # h^2 and its share
ERRORS = (0.002, 0.004, 0.008, 0.016, 0.032, 0.064)             # of patches against the model
STEPS = 4                   # of the linearisation
FILTER_STEPS, MAX_FILTER_STEP = 12, 0.7     # with filters: of a standard deviation of an error
NEGLIGIBLE = 1e-3           # share of a hypothesis below which it is left out
MAX_COMPONENTS, FAINT = 1000, 1e-4  # that carry the moments; weight of the last over the first


@dataclass(frozen=True, eq=False)
class LinearChart(shaped.Record):
    """Photos as linear equations: Y signals, of a component's X entries and U nuisances."""

    measured: Annotated[np.ndarray, "Y"]            # less what the linearisation point explains
    by_component: Annotated[np.ndarray, "Y X"]
    by_nuisance: Annotated[np.ndarray, "Y U"]
    nuisance_variance: Annotated[np.ndarray, "U"]   # exposure, field, glare, filter of each photo
    nuisance_mean: Annotated[np.ndarray, "U"]
    by_gain: Annotated[np.ndarray, "Y K"]           # of log gains beyond the components'


@dataclass(frozen=True, eq=False)
class Hypothesis(shaped.Record):
    """One width of the kernels, spread of gains and model error, and what follows from it."""

    width: float
    gain_sd: float
    error: chart_equations.PatchError
    share: float                                    # posterior probability
    # of the components, their exponentials summing to 1: what is negligible with a patch may be
    # all there is without it, so that logarithms are kept below what exp() can tell from 0
    log_weights: Annotated[np.ndarray, "C"]
    seen: Annotated[np.ndarray, "C Y"]              # their innovations times the inverse
    inverse: Annotated[np.ndarray, "Y Y"]           # of the innovations' covariance
    projected: Annotated[np.ndarray, "Z Y"]         # covariance beforehand of state and innovation
    gain: Annotated[np.ndarray, "Z Y"]              # Z = X + U + K: component, nuisances, gains
    covariance: Annotated[np.ndarray, "Z Z"]
    chi_square: float                               # per signal, of the components by weight

    @property
    def weights(self) -> np.ndarray:
        """Of the components (C,), summing to 1."""
        return np.exp(self.log_weights)


@dataclass(frozen=True, eq=False)
class ProductPosterior(shaped.Record):
    """The mixture over hypotheses, and what it was linearised to."""

    prior: ProductPrior
    chart: LinearChart
    hypotheses: tuple[Hypothesis, ...]              # those that are not negligible
    log_evidence: float                             # up to a constant of the photos


def posterior_of_products(photos: list[chart_equations.ChartEquations],
                          prior: ProductPrior) -> ProductPosterior:
    """Posterior of products, light and nuisances from chart photos under one light.

    Parameters
    ----------
    photos : list of ChartEquations
        Of one camera under one light, see ``fit_products`` on their ``power``.
    prior : ProductPrior
    """
    chart = _about_the_best(photos, prior)
    return _solved(photos, prior, chart, *_weighed(
        photos, prior, chart, WIDTHS, prior_fit.GAINS, ERRORS, chart_equations.COMMON_ERRORS))


def evidence_of_products(photos: list[chart_equations.ChartEquations],
                         prior: ProductPrior) -> float:
    """``log_evidence`` of ``posterior_of_products`` alone, without moments.

    Parameters
    ----------
    photos : list of ChartEquations
        Of one camera under one light, see ``fit_products`` on their ``power``.
    prior : ProductPrior
    """
    _, _, tried = _weighed(photos, prior, _about_the_best(photos, prior), WIDTHS, prior_fit.GAINS,
                           ERRORS, chart_equations.COMMON_ERRORS)
    return _shares(tried)[1]


def _about_the_best(photos: list[chart_equations.ChartEquations],
                    prior: ProductPrior) -> LinearChart:
    """The equations linearised about what explains the photos."""
    starts = chart_equations.nuisance_starts(photos)
    best = (prior.weights @ prior.components, np.zeros(starts[-1]), np.zeros(prior.bands))
    products = best[0][prior.products].reshape(prior.bands, -1)
    for photo, start in zip(photos, starts, strict=False):
        unexposed = (node_reflectances(photo, prior.nm) @ products.T
                     * np.exp(best[0][prior.balance]) * (photo.irradiance / np.pi)[:, None])
        best[1][start] = np.log(photo.signal.sum() / unexposed.sum())
    before = best[1].copy()
    ends = np.cumsum([prior.components.shape[1], best[1].size])
    filtered = any(photo.filter is not None for photo in photos)
    for _ in range(FILTER_STEPS if filtered else STEPS):
        chart = linearised(photos, prior, *best, before)
        posterior = _solved(photos, prior, chart, *_weighed(
            photos, prior, chart, WIDTHS[1:2], prior_fit.GAINS[1:2], (prior_fit.LINEARISED_AT,)))
        hypothesis = posterior.hypotheses[0]
        chosen = np.argsort(-hypothesis.weights)[:MAX_COMPONENTS]
        weights = hypothesis.weights[chosen] / hypothesis.weights[chosen].sum()
        mean = weights @ states_of_components(posterior, hypothesis, chosen)
        nuisance = mean[ends[0]:ends[1]]
        if filtered:        # exp() of a whole step to a filter that nobody measured runs away
            nuisance = best[1] + np.clip(nuisance - best[1], -MAX_FILTER_STEP, MAX_FILTER_STEP)
        best = (mean[:ends[0]], nuisance, mean[ends[1]:])
    return linearised(photos, prior, *best, before)


def linearised(photos: list[chart_equations.ChartEquations], prior: ProductPrior,
               component: np.ndarray, nuisance: np.ndarray, gains: np.ndarray,
               start: np.ndarray) -> LinearChart:
    """The equations about one state.

    Parameters
    ----------
    component : (X,) array
    nuisance : (U,) array
    gains : (K,) array
        Of the state, see ``Hypothesis``.
    start : (U,) array
        Mean of the nuisances beforehand.
    """
    bands, nodes = prior.bands, prior.nm.size
    product_now = component[prior.products].reshape(bands, nodes)
    level = component[prior.balance] + gains
    measured, by_component, by_nuisance, by_gain, variances = [], [], [], [], []
    for photo, (at, stop) in zip(photos, pairwise(chart_equations.nuisance_starts(photos)),
                                 strict=True):
        modes = photo.modes(grid.interpolation_matrix(prior.nm, grid.FINE_GRID.nm))
        of_filter = nuisance[stop - modes.shape[1]:stop]
        stated, error = node_reflectances(photo, prior.nm), modes @ of_filter
        design = stated * chart_equations.passed(error)
        patches, terms = photo.signal.shape[0], photo.field_terms.shape[1]
        exposure, field = nuisance[at], nuisance[at + 1:at + 1 + terms]
        irradiance = np.exp(exposure + photo.field_terms @ field) * photo.irradiance / np.pi
        scale = irradiance[:, None] * np.exp(level)
        signal = scale * (design @ product_now.T)
        rows = np.zeros((patches, bands, prior.components.shape[1]))
        for band in range(bands):
            rows[:, band, band * nodes:(band + 1) * nodes] = scale[:, band, None] * design
            rows[:, band, prior.balance.start + band] = signal[:, band]
        nuisances = np.zeros((patches, bands, nuisance.size))
        nuisances[:, :, at] = signal
        nuisances[:, :, at + 1:at + 1 + terms] = signal[:, :, None] * photo.field_terms[:, None]
        if photo.glare:
            nuisances[:, :, at + 1 + terms:at + 1 + terms + bands] = np.eye(bands)
        by_filter = np.einsum("ik,in,kn,nf->ikf", scale,
                              stated * chart_equations.passed_slope(error), product_now, modes,
                              optimize=True)
        nuisances[:, :, stop - modes.shape[1]:stop] = by_filter
        of_gain = signal[:, :, None] * np.eye(bands)
        offset = (signal * (level + exposure + (photo.field_terms @ field)[:, None])
                  + by_filter @ of_filter)
        measured.append((photo.signal + offset).ravel())
        by_component.append(rows.reshape(patches * bands, -1))
        by_nuisance.append(nuisances.reshape(patches * bands, -1))
        by_gain.append(of_gain.reshape(patches * bands, -1))
        variances.append(np.r_[prior_fit.EXPOSURE_SD, chart_equations.nuisance_sd(photo)]**2)
    return LinearChart(np.concatenate(measured), np.vstack(by_component), np.vstack(by_nuisance),
                       np.concatenate(variances), start, np.vstack(by_gain))


def node_reflectances(photo: chart_equations.ChartEquations, nm: np.ndarray) -> np.ndarray:
    """Reflectances (I, N), times the filter's transmittance, as seen by the mass at each node.

    Parameters
    ----------
    photo : ChartEquations
        Of I patches.
    nm : (N,) array
        Nodes of the products.
    """
    basis = grid.interpolation_matrix(nm, grid.FINE_GRID.nm)
    return np.asarray(photo.reflectances @ (basis * photo.power[:, None])
                      / (grid.FINE_GRID.weights_nm @ basis))


# width, spread of gains and error of a hypothesis; log weights (C,), squares (C,), and the
# covariance (Y, Y) without the error
Weighed = tuple[tuple[float, float, chart_equations.PatchError], np.ndarray, np.ndarray, np.ndarray]


def _weighed(photos: list[chart_equations.ChartEquations], prior: ProductPrior, chart: LinearChart,
             widths: tuple[tuple[float, float], ...], gains: tuple[tuple[float, float], ...],
             errors: tuple[float, ...], in_common: tuple[float, ...] = (0.0,)
             ) -> tuple[np.ndarray, np.ndarray, list[Weighed]]:
    """Innovations (C, Y) of the components for one linearisation, the covariance (Y, Y) of the
    signals where patches are off by 1 in each band, and all hypotheses; ``errors`` of each band by
    itself, ``in_common`` of all bands of a patch.
    """
    innovation = (chart.measured - chart.by_nuisance @ chart.nuisance_mean
                  - prior.components @ chart.by_component.T)
    spread = chart.by_component @ prior.covariance @ chart.by_component.T
    known = (chart.by_nuisance * chart.nuisance_variance) @ chart.by_nuisance.T
    of_gains = chart.by_gain @ chart.by_gain.T
    own = chart_equations.noise_of_photos(
        photos, chart_equations.PatchError(1.0)) - chart_equations.noise_of_photos(
            photos, chart_equations.PatchError(0.0))
    root = np.linalg.cholesky(own)
    volume = np.log(np.diag(root)).sum()
    pixels = [
        chart_equations.noise_of_photos(photos, chart_equations.PatchError(0.0, common))
        for common in in_common
    ]
    log_prior = np.log(prior.weights)
    scaled = solve_triangular(root, innovation.T, lower=True).T
    tried: list[Weighed] = []
    for (width, width_share), (gain, gain_share), (common, noise) in product(
            widths, gains, zip(in_common, pixels, strict=True)):
        # Q = M + error^2 L L^T for every error at once, by the eigenvectors of L^-1 M L^-T
        rest = width * spread + known + gain**2 * of_gains + noise
        values, vectors = np.linalg.eigh(solve_triangular(
            root, solve_triangular(root, rest, lower=True).T, lower=True))
        rotated = (scaled @ vectors) ** 2
        for error in errors:
            variances = np.maximum(values, 0) + error**2
            square = rotated @ (1 / variances)
            logs = (log_prior - 0.5 * square - 0.5 * np.log(variances).sum()
                    - volume + np.log(width_share * gain_share))
            tried.append(((width, gain, chart_equations.PatchError(error, common)), logs, square,
                          rest))
    return innovation, own, tried


def _shares(tried: Sequence[Weighed]) -> tuple[np.ndarray, float]:
    """Posterior probability of each hypothesis, and the log evidence of all together."""
    top = max(float(logs.max()) for _, logs, _, _ in tried)
    evidence = np.array([np.exp(logs - top).sum() for _, logs, _, _ in tried])
    return evidence / evidence.sum(), float(top + np.log(evidence.sum()))


def _solved(photos: list[chart_equations.ChartEquations], prior: ProductPrior, chart: LinearChart,
            innovation: np.ndarray, own: np.ndarray, tried: list[Weighed]) -> ProductPosterior:
    """The mixture over the hypotheses that are not negligible, as ``_weighed`` has them."""
    shares, log_evidence = _shares(tried)
    readable = sum(int(np.count_nonzero(photo.readable)) for photo in photos)
    hypotheses = []
    for ((width, gain, error), logs, square, rest), share in zip(tried, shares, strict=True):
        if share < NEGLIGIBLE:
            continue
        log_weights = logs - np.logaddexp.reduce(logs)
        inverse = np.linalg.inv(rest + error.own**2 * own)
        projected = np.vstack([width * prior.covariance @ chart.by_component.T,
                               chart.nuisance_variance[:, None] * chart.by_nuisance.T,
                               gain**2 * chart.by_gain.T])
        before = covariance.block_diagonal(width * prior.covariance,
                                           np.diag(chart.nuisance_variance),
                                           gain**2 * np.eye(prior.bands))
        kalman = projected @ inverse
        hypotheses.append(Hypothesis(
            width, gain, error, float(share), log_weights, innovation @ inverse, inverse, projected,
            kalman, before - kalman @ projected.T,
            float(np.exp(log_weights) @ square / readable)))
    return ProductPosterior(prior, chart, tuple(hypotheses), log_evidence)


def hypothesis_moments(posterior: ProductPosterior, hypothesis: Hypothesis,
                       rows: np.ndarray | None = None,
                       most: int = MAX_COMPONENTS) -> tuple[np.ndarray, np.ndarray]:
    """Mean (Z,) and covariance (Z, Z) under one hypothesis, without some rows where they are named.

    Parameters
    ----------
    posterior : ProductPosterior
    hypothesis : Hypothesis
    rows : int array or None
        Of the signals that are left out.
    most : int
        Components that carry the moments.
    """
    weights, covariance = hypothesis.weights, hypothesis.covariance
    if rows is not None:
        weights = weights_of_components(hypothesis, rows)
        covariance = covariance_without(covariance, hypothesis.gain, hypothesis.inverse, rows)
    carrying = np.argsort(-weights)[:most]
    carrying = carrying[weights[carrying] > FAINT * weights[carrying[0]]]
    states = states_of_components(posterior, hypothesis, carrying, rows)
    weights = weights[carrying] / weights[carrying].sum()
    mean = weights @ states
    away = (states - mean) * np.sqrt(weights)[:, None]
    return mean, covariance + away.T @ away


def states_of_components(posterior: ProductPosterior, hypothesis: Hypothesis, chosen: np.ndarray,
                         rows: np.ndarray | None = None) -> np.ndarray:
    """Posterior means (n, Z) of some components under one hypothesis.

    Parameters
    ----------
    posterior : ProductPosterior
    hypothesis : Hypothesis
    chosen : (n,) int array
    rows : int array or None
        Of the signals that are left out.
    """
    seen = (hypothesis.seen[chosen] if rows is None else
            weights_without(hypothesis.inverse, hypothesis.seen[chosen], rows))
    states = seen @ hypothesis.projected.T
    entries, mean = posterior.prior.components.shape[1], posterior.chart.nuisance_mean
    states[:, :entries] += posterior.prior.components[chosen]
    states[:, entries:entries + mean.size] += mean
    return np.asarray(states)


def weights_of_components(hypothesis: Hypothesis, rows: np.ndarray) -> np.ndarray:
    """Weights (C,) of the components when some rows are left out.

    Parameters
    ----------
    hypothesis : Hypothesis
    rows : int array
        Of the signals that are left out.
    """
    logs = hypothesis.log_weights + 0.5 * _surprise(hypothesis, rows)
    weights = np.exp(logs - logs.max())
    return np.asarray(weights / weights.sum())


def shares_without(hypotheses: Sequence[Hypothesis], rows: np.ndarray) -> np.ndarray:
    """Probabilities of hypotheses when some rows are left out, summing to 1.

    Parameters
    ----------
    hypotheses : sequence of Hypothesis
    rows : int array
    """
    logs = []
    for hypothesis in hypotheses:
        # the density of the rows given all others is N(error; 0, block^-1), for every component
        logs_without = hypothesis.log_weights + 0.5 * _surprise(hypothesis, rows)
        size = np.linalg.slogdet(hypothesis.inverse[np.ix_(rows, rows)])[1]
        logs.append(np.log(hypothesis.share) + np.logaddexp.reduce(logs_without) - 0.5 * size)
    shares = np.exp(np.array(logs) - np.max(logs))
    return np.asarray(shares / shares.sum())


def _surprise(hypothesis: Hypothesis, rows: np.ndarray) -> np.ndarray:
    """Chi-square (C,) of some rows as each component and the other rows predict them."""
    weighted = hypothesis.seen[:, rows]
    solved = weighted @ np.linalg.inv(hypothesis.inverse[np.ix_(rows, rows)])
    return np.asarray(np.einsum("cy,cy->c", weighted, solved))
