"""What the transport's Monte Carlo noise adds to a fit is taken off, and a scale errs as stated.

Statistical tests have a significance of 1e-4 (3.9 sigma), at fixed seeds.
"""
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import linalg
from test_reconstruct_fit import BASIS, COUNT, GROUP, REGIONS, case, fit_spectra, model, transport

from spectrabox.reconstruct.fit.transport_fit import HIDDEN_ERROR, TracedView, band_signals
from spectrabox.reconstruct.fit.view_terms import Nuisances, ViewTerms, compress
from spectrabox.reconstruct.scene.surfaces import region_means
from spectrabox.reconstruct.tracer.transport import TracedTransport, joined

SIGMAS = 3.9
PASSES, NOISE = 4, 0.3


def test_noise_of_the_transport_is_taken_off_cost_pull_and_information():
    """Errors in the variables: rows that err by e have sums of squares larger by those of e."""
    rng = np.random.default_rng(31)
    rows, truth = transport(rng), rng.uniform(0.2, 0.7, (2, COUNT))
    measured = 1.05 * rows @ model().signals(truth)
    weight = np.full_like(measured, 1e4)
    nuisances = Nuisances(scale=1.0, surface_error=0.05)
    state = np.append(truth.ravel(), np.zeros(6))   # spectra, and gains of two surfaces

    def expanded(mean, deviations):
        system = compress(mean, measured, weight, GROUP, deviations)
        cost, pull, information = ViewTerms(system, model(), nuisances).expand(state)
        return np.concatenate([[cost], pull, information.ravel()])

    clean, plain, estimates = expanded(rows, None), [], []
    for _ in range(300):
        passes = rows * (1 + NOISE * rng.standard_normal((PASSES, REGIONS, 1)))
        mean = passes.mean(axis=0)
        plain.append(expanded(mean, None))
        estimates.append(expanded(mean, (passes - mean) / np.sqrt(PASSES * (PASSES - 1))))
    error = np.std(estimates, axis=0, ddof=1) / np.sqrt(len(estimates))
    added = np.mean(plain, axis=0) - clean
    # a hundredth of a surface's noise may be left on
    allowed = SIGMAS * error + 0.02 * np.abs(added)
    off = np.abs(np.mean(estimates, axis=0) - clean)
    assert np.all(off <= allowed + 1e-9 * np.abs(clean).max())
    # the test can tell: what is taken off is far more than what is allowed
    information = slice(1 + state.size, None)
    informed = added[information] > 4 * allowed[information]
    assert np.count_nonzero(informed) >= 40 and added[0] > 4 * allowed[0]


@pytest.mark.parametrize("scale", [0.2, 3.7])
def test_the_stated_error_of_a_scale_is_that_of_repeated_photos(scale):
    rng = np.random.default_rng(32)
    rows, clean, _, truth = case(seed=7)
    clean = scale * clean
    known = model({0: truth[0] @ BASIS.T})
    fits = []
    for _ in range(60):
        measured = clean * (1 + 0.02 * rng.standard_normal(clean.shape))
        system = compress(rows, measured, 1 / (0.02 * clean) ** 2, GROUP)
        fits.append(fit_spectra(system, known).views[0])
    estimate, stated = (np.array([getattr(fit, name) for fit in fits])
                        for name in ("scale", "scale_error"))
    # 59 degrees of freedom know a deviation to 9 %
    assert estimate.std(ddof=1) / stated.mean() == pytest.approx(1, abs=SIGMAS * 0.092)


def test_deviations_of_passes_are_those_of_their_mean():
    """Four traces that err by 0.1 each have a mean that errs by 0.05."""
    rng = np.random.default_rng(34)
    passes = 1 + 0.1 * rng.standard_normal((PASSES, 20_000, 1, 1))
    traced = TracedTransport(np.zeros((1, 1), int), passes, 16, 0.0)
    variance = np.sum(traced.deviations**2, axis=0).mean()
    # 60 000 degrees of freedom know a variance to 0.6 %
    assert variance == pytest.approx(0.1**2 / PASSES, rel=0.025)
    assert np.var(traced.coefficients) == pytest.approx(0.1**2 / PASSES, rel=0.04)


def test_two_traces_together_are_one_of_as_many_paths():
    """Paths of a long trace cut in two: each part counts by its paths."""
    rng = np.random.default_rng(35)
    paths = rng.uniform(0.5, 1.5, (PASSES, 64, REGIONS, 1, 2))

    def traced(part):
        return TracedTransport(np.zeros((2, 1), int), part.mean(axis=1).astype(np.float32),
                               PASSES * part.shape[1], 0.0)
    whole, parts = traced(paths), joined(traced(paths[:, :16]), traced(paths[:, 16:]))
    assert parts.spp == whole.spp
    np.testing.assert_allclose(parts.passes, whole.passes, rtol=1e-5)       # single precision


@pytest.mark.parametrize("block_error", [0.0, 0.04])
def test_the_variance_of_a_region_is_that_of_repeated_photos(block_error):
    rng, region = np.random.default_rng(36), np.repeat(np.arange(4), [3, 6, 9, 18]).reshape(6, 6)
    clean = np.array([0.2, 0.5, 1.0, 2.0])[region][..., None] * np.array([1.0, 0.3])
    variance = 1e-4 * (1 + clean)
    block = 1 + block_error * rng.standard_normal((4000, 4, 2))
    means = [region_means(clean * scale[region] + np.sqrt(variance)
                          * rng.standard_normal(clean.shape), region) for scale in block]
    seen = TracedView(SimpleNamespace(measured=clean, variance=variance), None, region,
                      np.arange(4), Nuisances(scale=1.0, block_error=block_error))
    # 4000 photos know a variance to 2.2 %
    np.testing.assert_allclose(seen.photo_variance / np.var(means, axis=0), 1, atol=0.09)


def test_nuisances_are_held_by_the_errors_that_are_stated():
    """The cost of a nuisance that is off by its stated error is one squared deviation."""
    rows, clean, weight, _ = case()
    stated = Nuisances(scale=1.0, surface_error=0.03, brightness_error=0.05, light_error=0.02,
                       mixing_error=0.07)
    terms = ViewTerms(compress(rows, clean, weight, GROUP), model(), stated)
    prior = np.linalg.inv(terms.prior)
    gains, bands = terms.gain.stop - terms.gain.start, terms.bands
    same = np.kron(np.eye(gains // bands), np.ones((bands, bands)))
    np.testing.assert_allclose(prior[:gains, :gains], 0.03**2 * np.eye(gains) + 0.05**2 * same,
                               atol=1e-12)
    expected = np.r_[np.full(terms.lights, 0.02**2), np.full(bands**2, 0.07**2)]
    np.testing.assert_allclose(prior[gains:, gains:], np.diag(expected), atol=1e-12)


def test_what_the_bands_cannot_see_is_held_loosely():
    """Photo and loose hold as rows of one system of least squares."""
    rng, names = np.random.default_rng(37), 2
    operator = rng.uniform(0, 1, (3, COUNT))
    rows = rng.standard_normal((5, names * COUNT))      # fewer than unknowns
    target, start = rng.standard_normal(5), rng.uniform(0.2, 0.8, (names, COUNT))
    fit = SimpleNamespace(coefficients=start, information=rows.T @ rows, pull=rows.T @ target,
                          added_later=np.zeros(names * COUNT, bool))
    signals, covariances = band_signals(fit, operator, names)
    hidden = np.kron(np.eye(names), linalg.null_space(operator).T) / HIDDEN_ERROR
    both = np.vstack([rows, hidden])
    # a ridge of 1e-12 of the trace is added
    information = both.T @ both + 1e-12 * np.trace(both.T @ both) * np.eye(names * COUNT)
    covariance = np.linalg.inv(information)
    move = (covariance @ rows.T @ target).reshape(names, COUNT)
    for index in range(names):
        own = slice(index * COUNT, (index + 1) * COUNT)
        np.testing.assert_allclose(signals[index], operator @ (start[index] + move[index]),
                                   rtol=1e-4)
        expected = operator @ covariance[own, own] @ operator.T
        np.testing.assert_allclose(covariances[index], expected, rtol=1e-3,
                                   atol=1e-4 * np.abs(expected).max())
