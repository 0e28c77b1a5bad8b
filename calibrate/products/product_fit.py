"""Chart photos under a light that nobody measured, to what every later stage reads of a fit.

The fit of products has the form of a fit of sensitivities under a light of 1 at every wavelength:
curves, covariance, exposure, field and glare. Bands of other cameras than those of the prior are
fitted with smoothness alone, as under a known light; a lamp's narrow lines are not smooth.
"""
from __future__ import annotations

import numpy as np

from spectrabox.calibrate import chart_equations, copy_errors, held_out_patches, sensitivity
from spectrabox.calibrate.prior import camera_prior, curve_posterior, prior_fit
from spectrabox.calibrate.products import product_posterior
from spectrabox.calibrate.products.lamps import Lamps, ProductPrior, product_prior
from spectrabox.radiometry.covariance import symmetric
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.grid import interpolation_matrix
from spectrabox.radiometry.records import calibration, spectra
from spectrabox.radiometry.spectra.light_words import LIGHT_KINDS

SEED = 1                    # of the draws of cameras
WIDENING = 1.27             # of standard errors: benchmarks/bench_light_kinds.py
MAX_HYPOTHESES, MAX_COMPONENTS = 3, 200     # that a fit without a patch is computed with


def fit_products(photos: list[chart_equations.ChartEquations], cameras: camera_prior.CameraPrior,
                 lamps: Lamps, grid: spectra.WavelengthGrid, light_words: str,
                 excluded: chart_equations.ChartEquations | None = None
                 ) -> tuple[sensitivity.PriorFit, calibration.LightPosterior]:
    """Products of sensitivity and light, exposure, field and glare of chart photos under one light,
    in the form of every other fit, and what is known of the light.

    Parameters
    ----------
    photos : list of ChartEquations
        Of one camera; their ``power`` is the integration weights, times the transmittance of the
        filter of a photo that has one: a light of 1. The first has none.
    cameras : CameraPrior
    lamps : Lamps
        That the light may be.
    grid : WavelengthGrid
        Working grid, of P wavelengths.
    light_words : str
        What is known of the light.
    excluded : ChartEquations or None
        Patches of the first photo that no fit is to use.

    Raises
    ------
    CalibrationError
        If the photos hold too few patches, or two bands have the same signals.
    InputError
        If the cameras have another number of bands than the photos.
    """
    sensitivity.require_fit_for(photos, cameras)
    prior = product_prior(cameras, lamps, SEED)
    posterior = product_posterior.posterior_of_products(photos, prior)
    curves = _as_curves(posterior, photos, grid)
    without = _without_each(posterior, photos, grid, excluded)
    coefficients, covariance, peak = curve_posterior.curve_moments(curves, prior.bands)
    states = curve_posterior.photo_states(curves, photos, coefficients, peak)
    share = _prior_share(posterior, curves, covariance, grid)
    light = light_posterior(posterior, grid)
    held_out = without.predicted(np.vstack([photos[0].reflectances] if excluded is None else [
        photos[0].reflectances, excluded.reflectances]))[:len(photos[0].signal)]
    fit = sensitivity.sensitivity_fit(
        photos[0], curves.basis, coefficients, covariance, states[0].predicted, held_out, grid,
        f"{spectra.PRODUCTS}, {light_words}: mixture of cameras "
        f"({cameras.source}) and {len(lamps.names)} lamps")
    best = max(posterior.hypotheses, key=lambda hypothesis: hypothesis.share)
    chi_square = sum(h.share * h.chi_square for h in posterior.hypotheses)
    joint = sensitivity.PriorFit(fit, curves, tuple(states), (held_out, *(state.predicted
                                                             for state in states[1:])),
                     share, (), curves.model_error, float(chi_square), without,
                     copy_errors.Explained(np.exp(best.log_weights), best.seen, best.inverse))
    return joint, light


def _as_curves(posterior: product_posterior.ProductPosterior,
               photos: list[chart_equations.ChartEquations],
               grid: spectra.WavelengthGrid) -> prior_fit.CurvePosterior:
    """The posterior as one of curves under a light of 1, a component for each hypothesis."""
    prior, basis = posterior.prior, interpolation_matrix(posterior.prior.nm, grid.nm)
    mass = grid.weights_nm @ basis
    means, covariances = [], []
    for hypothesis in posterior.hypotheses:
        mean, covariance = product_posterior.hypothesis_moments(posterior, hypothesis)
        state, spread = in_curves(prior, mean, covariance, mass)
        means.append(state)
        covariances.append(spread)
    shares = np.array([hypothesis.share for hypothesis in posterior.hypotheses])
    shares /= shares.sum()
    best = posterior.hypotheses[int(np.argmax(shares))]
    error = chart_equations.mean_error(shares,
                                       [hypothesis.error for hypothesis in posterior.hypotheses])
    return prior_fit.CurvePosterior(basis, shares, np.array(means), np.array(covariances), shares,
                                    error, posterior.log_evidence, 0, best.gain_sd, best.error,
                                    WIDENING)


def in_curves(prior: ProductPrior, mean: np.ndarray, covariance: np.ndarray,
              mass: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Curves under a light of 1 and nuisances (K N + U,), widened covariance, from a state (Z,).

    Parameters
    ----------
    prior : ProductPrior
    mean : (Z,) array
        Component, nuisances, gains.
    covariance : (Z, Z) array
    mass : (N,) array
        Of each node, nm.
    """
    bands, nodes, entries = prior.bands, prior.nm.size, prior.components.shape[1]
    nuisances = mean.size - entries - bands
    # no product is negative; what varies with those that are cut off moves along, so that the
    # signals of all photos stay fitted
    mean = curve_posterior.nonnegative(mean, covariance, bands * nodes)
    product = mean[prior.products].reshape(bands, nodes)
    product = product / product.sum(axis=1, keepdims=True)
    level = np.exp(mean[prior.balance] + mean[entries + nuisances:])
    curves = level[:, None] * product / mass
    change = np.zeros((curves.size + nuisances, mean.size))
    change[:curves.size, prior.products] = np.diag(np.repeat(level, nodes) / np.tile(mass, bands))
    by_level = np.zeros((curves.size, bands))
    for band in range(bands):
        by_level[band * nodes:(band + 1) * nodes, band] = curves[band]
    change[:curves.size, prior.balance] = by_level
    change[:curves.size, entries + nuisances:] = by_level
    change[curves.size:, entries:entries + nuisances] = np.eye(nuisances)
    state = np.concatenate([curves.ravel(), mean[entries:entries + nuisances]])
    return state, symmetric(WIDENING**2 * change @ covariance @ change.T)


def _without_each(
        posterior: product_posterior.ProductPosterior, photos: list[chart_equations.ChartEquations],
        grid: spectra.WavelengthGrid,
        excluded: chart_equations.ChartEquations | None) -> held_out_patches.PatchesWithout:
    """Every patch of the first photo by the hypotheses that are likely, then the excluded."""
    prior, basis = posterior.prior, interpolation_matrix(posterior.prior.nm, grid.nm)
    mass, bands = grid.weights_nm @ basis, posterior.prior.bands
    size = bands * prior.nm.size
    likely = sorted(posterior.hypotheses, key=lambda h: -h.share)[:MAX_HYPOTHESES]
    own = size + 1 + chart_equations.nuisance_sd(photos[0]).size
    patches = []
    photo = photos[0]
    ours = [(photo, patch) for patch in range(len(photo.signal))]
    others = ([] if excluded is None
              else [(excluded, patch) for patch in range(len(excluded.signal))])
    for source, patch in ours + others:
        rows = chart_equations.rows_of_patch(photos, patch) if source is photo else None
        shares = (np.array([h.share for h in likely]) if rows is None
                  else product_posterior.shares_without(likely, rows))
        moments = [
            product_posterior.hypothesis_moments(posterior, h, rows, MAX_COMPONENTS) for h in likely
        ]
        state, spread = in_curves(
            prior, *curve_posterior.mixture_moments(shares, *zip(*moments, strict=True)), mass)
        patches.append(
            held_out_patches.patch_moments(source, patch, state[:own], spread[:own, :own], basis))
    error = chart_equations.mean_error(np.array([h.share for h in likely]),
                                       [h.error for h in likely])
    return held_out_patches.gathered([photo, *([] if excluded is None else [excluded])], basis,
                                     error, patches)


def _prior_share(posterior: product_posterior.ProductPosterior, curves: prior_fit.CurvePosterior,
                 covariance: np.ndarray, grid: spectra.WavelengthGrid) -> np.ndarray:
    """Share (K, P) of the prior's uncertainty that the photo left, of curves of largest value 1."""
    prior = posterior.prior
    mass = grid.weights_nm @ curves.basis
    level = np.exp(prior.components[:, prior.balance])
    before = prior.components[:, prior.products].reshape(len(level), prior.bands, -1)
    before = level[:, :, None] * before / mass
    before = before / before.max(axis=(1, 2), keepdims=True)
    mean = np.einsum("c,ckn->kn", prior.weights, before)
    variance = np.einsum("c,ckn->kn", prior.weights, (before - mean) ** 2) @ curves.basis.T
    after = curve_posterior.curve_variance(curves.basis, covariance, prior.bands)
    return np.clip(np.sqrt(after / np.maximum(variance, 1e-9 * variance.max())), 0, 1)


# ---- the light by itself -------------------------------------------------------------------------
# What a chart photo says of its light by itself: kinds of lamps, mean, band, and how surely.

LEVEL = 0.9
NORMAL_QUANTILE = 1.6449
# of the evidence for a kind: a photo's lamp is none of the prior's, and the best of few components
# decides. Least log loss over daylights by a model of the atmosphere and published lamps that are
# left out in turn, under cameras of makers that are left out
# (benchmarks/bench_light_kinds.py --probabilities --published)
EVIDENCE_POWER = 0.65
NARROWED = 0.75             # width of the band over the prior's: above, the photo says little


def light_posterior(posterior: product_posterior.ProductPosterior,
                    grid: spectra.WavelengthGrid) -> calibration.LightPosterior:
    """The light behind the products.

    Parameters
    ----------
    posterior : ProductPosterior
    grid : WavelengthGrid
        Working grid, of P wavelengths.
    """
    prior = posterior.prior
    basis = interpolation_matrix(prior.nm, grid.nm)
    # the lamp of each component moves with its products: one gain for all
    mean, square = np.zeros(prior.nm.size), np.zeros(prior.nm.size)
    for hypothesis in posterior.hypotheses:
        lamps = prior.components[:, prior.light] + (
            hypothesis.seen @ hypothesis.projected[prior.light].T)
        lamps = np.maximum(lamps, 0)
        own = np.maximum(np.diag(hypothesis.covariance)[prior.light], 0)
        mean += hypothesis.share * (hypothesis.weights @ lamps)
        square += hypothesis.share * (hypothesis.weights @ lamps**2 + own)
    total = sum(hypothesis.share for hypothesis in posterior.hypotheses)
    mean, square = mean / total, square / total
    shares = kind_probabilities(posterior)
    half = NORMAL_QUANTILE * np.sqrt(np.maximum(square - mean**2, 0))
    every_lamp = prior.components[:, prior.light]
    before = NORMAL_QUANTILE * np.sqrt(
        prior.weights @ (every_lamp - prior.weights @ every_lamp) ** 2)
    fine = mean @ basis.T
    scale = 1 / fine.mean()
    lower, upper = np.maximum(mean - half, 0) @ basis.T, (mean + half) @ basis.T
    return calibration.LightPosterior(grid, LIGHT_KINDS, shares, fine * scale, lower * scale,
                                      upper * scale, LEVEL, _findings(shares, half, before, mean))


def kind_probabilities(posterior: product_posterior.ProductPosterior) -> np.ndarray:
    """Probability (Q,) of each of ``LIGHT_KINDS``.

    Parameters
    ----------
    posterior : ProductPosterior
    """
    prior = posterior.prior
    kind, count = prior.lamps.kind[prior.lamp], len(LIGHT_KINDS)
    shares = sum((hypothesis.share * np.bincount(kind, hypothesis.weights, minlength=count)
                  for hypothesis in posterior.hypotheses), np.zeros(count))
    return _tempered(np.bincount(kind, prior.weights, minlength=count), shares)


def share_of_lamps(posterior: product_posterior.ProductPosterior, like: np.ndarray) -> float:
    """Probability of some lamps against all others.

    Parameters
    ----------
    posterior : ProductPosterior
    like : (L,) array
        How much each lamp of the prior is one of them, 0 to 1.
    """
    prior = posterior.prior
    each = like[prior.lamp]
    total = sum(hypothesis.share for hypothesis in posterior.hypotheses)
    after = sum(hypothesis.share * (hypothesis.weights @ each)
                for hypothesis in posterior.hypotheses) / total
    after, before = min(after, 1.0), min(prior.weights @ each, 1.0)     # round-off of all lamps
    return float(_tempered(np.array([before, 1 - before]), np.array([after, 1 - after]))[0])


def _tempered(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Probabilities by ``EVIDENCE_POWER`` of the evidence that led from one to the other."""
    shares = before**(1 - EVIDENCE_POWER) * after**EVIDENCE_POWER
    return np.asarray(shares / shares.sum())


def _findings(shares: np.ndarray, half: np.ndarray, before: np.ndarray,
              mean: np.ndarray) -> tuple[Finding, ...]:
    # where lamps of one kind were stated, their kind is no finding
    findings = [Finding("light.kind", Severity.INFO, values={
        "kinds": dict(zip(LIGHT_KINDS, shares.tolist(), strict=True))})] \
        if np.count_nonzero(shares) > 1 else []
    findings.append(Finding("light.width", Severity.INFO, values={
        "width": float(np.mean(half) / np.mean(mean)), "level": LEVEL}))
    if np.mean(half) > NARROWED * np.mean(before):
        findings.append(Finding("light.open", Severity.NOTE))
    return tuple(findings)
