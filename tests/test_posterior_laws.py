"""Posteriors against integration, exact linear cases, and the moments of known mixtures.

Statistical tests have a significance of 1e-4 each (3.9 sigma), at fixed seeds.
"""
import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from calibrate_cameras import GRID as FINE
from calibrate_cameras import (
    cameras,
    coarse_prior,
    daylight,
    led,
    on_grid,
    photo,
    reflectances,
    samples,
    signals,
)
from sampling_cameras import seen
from scipy import special, stats

from spectrabox.calibrate.camera_curves import curve_band, curve_draws
from spectrabox.calibrate.prior.camera_prior import matern
from spectrabox.calibrate.prior.curve_posterior import (
    curve_moments,
    curve_variance,
    mixture_moments,
    photo_states,
)
from spectrabox.calibrate.prior.learnt_prior import between_makers, build_prior
from spectrabox.calibrate.prior.prior_fit import (
    EXPOSURE_SD,
    GAINS,
    CurvePosterior,
    _designs,
    _joint_prior,
    held_out_signals,
    posterior_of_curves,
)
from spectrabox.calibrate.sensitivity import fit_sensitivities
from spectrabox.radiometry.grid import interpolation_matrix
from spectrabox.sampling.prior.mixture import PRIOR_GRID, LogitMixture, reflectance
from spectrabox.sampling.prior.mixture_posterior import (
    SIGNAL_FLOOR,
    calibrated_bands,
    mean_and_spread,
    mixture_quantile,
    posterior,
)
from spectrabox.sampling.prior.signal_posterior import sample_prior
from spectrabox.sampling.scene.joint_posterior import JointProblem, fit_modes

from tools.prior_calibration import AT_95, LeftOut, band_figures, judge
from tools.prior_training import LEVELS

SIGMAS = stats.norm.isf(0.5e-4)
SMOOTH = 0.2 + 0.8 * np.exp(-np.abs(PRIOR_GRID.nm[:, None] - PRIOR_GRID.nm) / 60)


def mixture_of(nm, weights, means, covariances, factors=1.0):
    ones = np.full((1, LEVELS.size, len(nm)), factors)
    return LogitMixture(np.asarray(nm), np.asarray(weights), np.asarray(means),
                        np.asarray(covariances), ("surface",), np.zeros(len(weights)), LEVELS,
                        ones, ones, 1.0, 1e9, 0.0, "test")


@pytest.fixture(scope="module")
def two_wavelengths():
    """A mixture on two wavelengths, what a camera of one band saw, and the exact posterior:
    logits (n, 2) of a fine grid, and the mass (2, n) of each component there.
    """
    covariance = np.array([[1.0, 0.5], [0.5, 1.0]])
    known = mixture_of([450.0, 650.0], [0.85, 0.15], [[-0.3, 0.1], [0.25, 0.3]],
                       [0.08**2 * covariance, 0.35**2 * covariance])
    response, signal, sigma = np.array([[0.7, 0.3]]), np.array([[0.503]]), 0.004
    line = np.linspace(-2.2, 2.2, 601)
    x = np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1).reshape(-1, 2)
    error = np.hypot(sigma, SIGNAL_FLOOR)
    likelihood = stats.norm.pdf(signal[0], reflectance(x) @ response[0], error)
    mass = np.array([weight * stats.multivariate_normal(mean, spread).pdf(x) * likelihood
                     for weight, mean, spread in zip(known.weights, known.means,
                                                     known.covariances, strict=True)])
    estimate = posterior(known, response, signal, np.array([[sigma**2]]))
    return estimate, x, mass / mass.sum()


def test_weights_of_a_mixture_are_those_of_integration(two_wavelengths):
    estimate, _, mass = two_wavelengths
    # Laplace's method errs by the cubic term, the squared spread of 0.35 logits, in the wide one
    np.testing.assert_allclose(estimate.weights[0], mass.sum(axis=1), atol=0.01)
    assert 0.2 < estimate.weights[0, 0] < 0.8      # neither component decides alone


def test_weights_under_an_error_common_to_all_bands_are_those_of_integration():
    """A photo's level that is known to 4 %: a component may miss the signal by as much."""
    covariance = np.array([[1.0, 0.3], [0.3, 1.0]])
    known = mixture_of([450.0, 650.0], [0.15, 0.85], [[-0.35, 0.2], [0.3, 0.55]],
                       [0.05**2 * covariance, 0.3**2 * covariance])
    response, signal = np.array([[0.8, 0.2], [0.3, 0.7]]), np.array([[0.478, 0.544]])
    noise = 0.04**2 * signal.T @ signal + 0.003**2 * np.eye(2)
    line = np.linspace(-2.0, 2.0, 801)
    x = np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1).reshape(-1, 2)
    likelihood = stats.multivariate_normal(signal[0], noise + SIGNAL_FLOOR**2 * np.eye(2)).pdf(
        reflectance(x) @ response.T)
    mass = np.array([weight * stats.multivariate_normal(mean, spread).pdf(x) @ likelihood
                     for weight, mean, spread in zip(known.weights, known.means,
                                                     known.covariances, strict=True)])
    estimate = posterior(known, response, signal, noise)
    # Laplace's method errs by the cubic term, as above
    np.testing.assert_allclose(estimate.weights[0], mass / mass.sum(), atol=0.01)
    # the case can tell: neither decides alone, and the narrow one misses by 1 % of white or more
    assert 0.2 < estimate.weights[0, 0] < 0.8
    missed = signal[0] - response @ reflectance(estimate.logits[0, 0])
    assert np.abs(missed).max() > 0.01


def test_mean_spread_and_quantiles_of_a_mixture_are_those_of_integration(two_wavelengths):
    estimate, x, mass = two_wavelengths
    density, values = mass.sum(axis=0), reflectance(x)
    mean = density @ values
    spread = np.sqrt(density @ (values - mean)**2)
    # Laplace's method: a few hundredths of the spread
    np.testing.assert_allclose(mean_and_spread(estimate)[0][0], mean, atol=0.03 * spread.max())
    np.testing.assert_allclose(mean_and_spread(estimate)[1][0], spread, rtol=0.04)
    for probability in (0.025, 0.95):
        at = mixture_quantile(estimate, probability)[0]
        below = [density[x[:, axis] <= at[axis]].sum() for axis in (0, 1)]
        np.testing.assert_allclose(below, probability, atol=0.008)


def test_evidence_of_a_scene_is_exact_where_the_logit_is_linear():
    rng = np.random.default_rng(3)
    materials, size, rows = 2, 4, 3
    roots = np.stack([scale * np.eye(size) + 0.2 * scale for scale in (1e-3, 4e-3, 2e-3)])
    means = np.array([-5e-4, 1e-3, 0.0])[:, None] * np.ones(size)
    log_weights = np.log(np.array([[0.7, 0.3, 1.0], [0.2, 0.8, 1.0]]))
    reading = rng.uniform(200, 900, (rows, 1, materials))
    response = rng.uniform(0.5, 1.5, (1, size))
    slopes = np.concatenate([reading[:, :, m] * response / 4 for m in range(materials)], axis=1)
    zero = (reading.sum(axis=2) * response.sum() / 2)[:, 0]
    targets = zero + rng.normal(0, 2, rows)
    problem = JointProblem(("a", "b"), np.eye(materials), np.ones((materials, size)), reading,
                           targets, response, log_weights, means, roots, np.zeros((0, 1)),
                           np.zeros((len(reading), 0)))
    labels = np.array([[0, 0], [1, 0], [0, 1], [1, 1]])
    _, fit = fit_modes(problem, labels, np.zeros((len(labels), materials * size)))
    exact = []
    for chosen in labels:
        covariance = np.zeros((materials * size,) * 2)
        for m, label in enumerate(chosen):
            block = slice(m * size, (m + 1) * size)
            covariance[block, block] = roots[label] @ roots[label].T
        density = stats.multivariate_normal(zero + slopes @ means[chosen].ravel(),
                                            slopes @ covariance @ slopes.T + np.eye(rows))
        exact.append(density.logpdf(targets) + log_weights[[0, 1], chosen].sum())
    # The fit stops within 0.01 nats; the curvature of the logit is of the order of 1e-3 of it.
    np.testing.assert_allclose(fit - fit[0], np.array(exact) - exact[0], atol=0.02)


def a_posterior(rng, apart, spread, exposure):
    """A mixture of two on two bands of three nodes and a log exposure that goes against them."""
    basis, centre = np.eye(3), np.array([0.3, 0.6, 0.2, 0.5, 1.2, 0.4])
    covariances = []
    for _ in range(2):
        mixing = rng.normal(0, spread, (7, 7))
        mixing[6] *= exposure / spread
        mixing[6] -= 0.8 * mixing[4]
        covariances.append(mixing @ mixing.T)
    step = apart * np.array([1.0, -0.5, 0.3, 0.5, -0.2, 0.4, 0.0])
    means = np.array([np.r_[centre, 0.1] - 0.4 * step, np.r_[centre, 0.1] + 0.6 * step])
    return CurvePosterior(basis, np.array([0.6, 0.4]), means, np.array(covariances), np.ones(1),
                          0.01, 0.0, 0, 0.05, 0.01, 1.0)


def states_of(made, rng, count):
    return np.concatenate([rng.multivariate_normal(mean, covariance, round(count * weight))
                           for weight, mean, covariance in zip(
                               made.weights, made.means, made.covariances, strict=True)])


def test_moments_of_curves_are_those_of_draws_of_the_mixture():
    rng = np.random.default_rng(5)
    fit = a_posterior(rng, 0.02, 0.004, 0.01)
    _, covariance, _ = curve_moments(fit, 2)
    drawn = states_of(fit, rng, 60_000)[:, :6]
    # the largest value is that of the fifth; a linear scaling, exact to spreads of 1 %
    shares = np.delete(drawn / drawn[:, 4:5], 4, axis=1)
    kept = np.delete(np.arange(6), 4)
    covariance = covariance[np.ix_(kept, kept)]
    sizes = np.sqrt(np.diag(covariance))
    # a covariance of 60 000 draws is known to 1 / sqrt(60 000) of the variances, times a few
    np.testing.assert_allclose(np.cov(shares.T) / np.outer(sizes, sizes),
                               covariance / np.outer(sizes, sizes), atol=0.04)


def test_error_of_the_white_signal_is_that_of_draws_with_their_exposure():
    rng = np.random.default_rng(6)
    fit = a_posterior(rng, 0.01, 0.004, 0.01)
    power = np.array([1.0, 2.0, 0.5])
    chart = dataclasses.replace(
        photo(np.ones((4, 2)), np.ones(FINE.nm.size), np.ones((4, FINE.nm.size))),
        power=power, reflectances=np.ones((4, 3)))
    coefficients, _, peak = curve_moments(fit, 2)
    state = photo_states(fit, [chart], coefficients, peak)[0]
    drawn = states_of(fit, rng, 60_000)
    white = np.exp(drawn[:, 6:]) * (drawn[:, :6].reshape(-1, 2, 3) @ power)
    variance = white.var(axis=0)
    # linear in errors of 1 %; 60 000 draws know a standard deviation to 0.3 %
    assert state.scale_error / state.scale == pytest.approx(
        np.sqrt(variance.sum() / (white.mean(axis=0)**2).sum()), rel=0.03)
    np.testing.assert_allclose(np.sqrt(np.diag(state.white.covariance)[:2]),
                               np.sqrt(variance) / white.mean(axis=0), rtol=0.03)


def one_family(**changes):
    prior = coarse_prior()
    alone = dataclasses.replace(prior, weights=np.ones(1), means=prior.means[-1:], level=[2],
                                members=("all",))
    return dataclasses.replace(alone, **changes)


@pytest.fixture(scope="module")
def chart_photo():
    surfaces = reflectances()
    signal = signals(on_grid(cameras(1, 40)[0]), led(), surfaces)
    signal = signal * (1 + 0.01 * np.random.default_rng(41).standard_normal(signal.shape))
    return photo(signal, led(), surfaces, 0.01)


def test_families_that_a_photo_cannot_tell_keep_their_weights(chart_photo):
    alike = one_family(weights=np.array([0.85, 0.15]), level=[2, 2], members=("a", "b"),
                       means=np.repeat(coarse_prior().means[-1:], 2, axis=0))
    result = posterior_of_curves([chart_photo], alike, FINE, model_errors=(0.01,))
    # the second is linearised where the first ended: the same to a hundredth of a nat
    np.testing.assert_allclose(result.families, [0.85, 0.15], atol=0.005)


def test_widening_multiplies_every_standard_error_of_the_curves(chart_photo):
    narrow, wide = (one_family(widening=np.array([1.0, 1.0, factor])) for factor in (1.0, 1.7))
    curves, without = [], []
    for known in (narrow, wide):
        result = posterior_of_curves([chart_photo], known, FINE, model_errors=(0.01,))
        curves.append(result.covariances[np.argmax(result.weights)])
        without.append(held_out_signals([chart_photo], known, FINE, result)[2].covariance)
    for one, other in (curves, without):
        # round-off of sums of 200 terms
        np.testing.assert_allclose(other, 1.7**2 * one, rtol=1e-8, atol=1e-12 * np.abs(one).max())


def test_a_prior_from_few_makers_holds_the_next_maker_nine_times_in_ten():
    makers = tuple(f"maker{i} one" for i in range(6))
    states = np.random.default_rng(7).standard_normal((7, 20_000))
    middle, rows = between_makers(states[:6], makers)
    widening = build_prior(FINE.nm[::5], cameras(6, 2), makers, source="",
                           licence="").widening[-1]
    spread = widening * np.sqrt((rows**2).sum(axis=0))
    inside = np.abs(states[6] - middle) < stats.norm.ppf(0.95) * spread
    # Student's interval is exact for normal states
    assert abs(inside.mean() - 0.9) < SIGMAS * np.sqrt(0.09 / inside.size)


def test_cameras_alike_of_one_maker_count_as_one():
    states = np.random.default_rng(8).standard_normal((5, 12))
    names = tuple(f"maker{i} one" for i in range(5))
    alone, rows = between_makers(states, names)
    again, more = between_makers(np.vstack([states, states[:1], states[:1]]),
                                 (*names, "maker0 two", "maker0 three"))
    # round-off of sums of seven terms
    np.testing.assert_allclose(again, alone, atol=1e-14)
    effective = 1 / (3 * (1 / 15)**2 + 4 * 0.2**2)      # weights of seven cameras, squared

    def factor(makers):
        return makers / (makers - 1) * (1 + 1 / makers)
    np.testing.assert_allclose(more.T @ more / factor(effective), rows.T @ rows / factor(5),
                               atol=1e-13)


def test_the_90_per_cent_band_of_curves_holds_90_per_cent_of_draws():
    fit = a_posterior(np.random.default_rng(9), 0.02, 0.02, 0.01)
    sensitivity = SimpleNamespace(curves=np.ones((2, 3)), standard_error=np.full((2, 3), 0.02))
    fitted = SimpleNamespace(prior_fit=SimpleNamespace(posterior=fit),
                             calibration=SimpleNamespace(sensitivity=sensitivity))
    draws = curve_draws(fitted)
    lower, upper = curve_band(fitted, draws)
    share = ((draws > lower) & (draws < upper)).mean(axis=0)
    # quantiles of the same draws: one of 1000 either side; the peak is 1 in every draw
    np.testing.assert_allclose(share[share > 0], 0.9, atol=0.002)
    assert (share > 0).sum() >= 5
    fitted.prior_fit = None
    lower, upper = curve_band(fitted, curve_draws(fitted))
    held = stats.norm.cdf((upper - 1) / 0.02) - stats.norm.cdf((lower - 1) / 0.02)
    np.testing.assert_allclose(held, 0.9, atol=1e-4)    # the quantile is given to four places


@pytest.mark.parametrize("method", ["paper", "nonnegative"])
def test_the_errors_of_spline_curves_do_not_hang_on_the_exposure(method):
    surfaces, light = reflectances(), daylight()
    signal = signals(on_grid(cameras(1, 44)[0]), light, surfaces)
    signal = signal * (1 + 0.01 * np.random.default_rng(45).standard_normal(signal.shape))
    one, ten = (fit_sensitivities(samples(factor * signal, 0.01), surfaces, light,
                                  np.full(24, np.pi), FINE, method=method)[0]
                for factor in (1.0, 10.0))
    # round-off times the square of the condition number
    np.testing.assert_allclose(ten.covariance, one.covariance, rtol=1e-5,
                               atol=1e-9 * np.abs(one.covariance).max())
    np.testing.assert_allclose(one.standard_error**2,
                               curve_variance(one.basis, one.covariance, 3),
                               atol=1e-9 * one.standard_error.max()**2)


@pytest.mark.parametrize("factor", [1.0, 1.6])
def test_the_calibrated_band_holds_95_per_cent_of_draws(factor):
    measured = seen(np.full(61, 0.5), 0.002)
    known = mixture_of(PRIOR_GRID.nm, [1.0], np.zeros((1, 61)), [0.15**2 * SMOOTH], factor)
    mixture = posterior(known, measured.relative_response, measured.signal[None],
                        measured.noise_covariance)
    _, [(lower, upper)] = calibrated_bands(known, mixture, (0.95,))
    drawn = sample_prior(measured, 8000, 3, prior=known).spectra
    inside = ((drawn > lower) & (drawn < upper)).mean(axis=1)
    # draws reproduce their signal, which moves those of a band that is widened by a hundredth
    assert abs(inside.mean() - 0.95) < 0.008


def test_a_certificate_says_what_the_calibrated_bands_do():
    measured, rng = seen(np.full(61, 0.5)), np.random.default_rng(11)
    plain = mixture_of(PRIOR_GRID.nm, [1.0], np.zeros((1, 61)), [0.3**2 * SMOOTH])
    truth = reflectance(rng.multivariate_normal(np.zeros(61), 0.6**2 * SMOOTH, 60))
    judgement = judge(plain, measured.relative_response, truth)
    part = LeftOut("a", "surface", True, False, len(truth), judgement, judgement)
    factors = np.ones((1, LEVELS.size, 61))
    factors[:, AT_95] = np.linspace(1.2, 1.7, 61)
    known = dataclasses.replace(plain, band_factors=factors, stated_factors=1.1 * factors)
    response, signal = measured.relative_response, truth @ measured.relative_response.T
    for kind, of_kind in (("unstated", known), ("stated", dataclasses.replace(
            known, band_factors=known.stated_factors))):
        mixture = posterior(of_kind, response, signal, np.zeros((3, 3)))
        _, [(lower, upper)] = calibrated_bands(of_kind, mixture, (0.95,))
        held, width = band_figures(known, part, kind)
        # bands are cut at 0 and 1, which no truth is beyond
        assert held == pytest.approx(np.mean((truth >= lower) & (truth <= upper)), abs=1e-12)
        assert width == pytest.approx(np.mean(upper - lower), rel=1e-3)


def test_moments_of_mixed_posteriors_are_those_of_their_draws():
    rng = np.random.default_rng(51)
    shares = np.array([2.0, 1.0, 5.0])          # of any sum
    means = 2 * rng.standard_normal((3, 2))
    spreads = [root @ root.T for root in rng.standard_normal((3, 2, 2))]
    mean, covariance = mixture_moments(shares, means, spreads)
    counts = (shares * 50_000).astype(int)
    draws = np.vstack([rng.multivariate_normal(one, spread, count)
                       for one, spread, count in zip(means, spreads, counts, strict=True)])
    size = np.sqrt(np.diag(covariance))
    # 400 000 draws know a mean to 0.16 % of a deviation and a variance to 0.4 %, or less
    np.testing.assert_allclose(mean, draws.mean(axis=0), atol=SIGMAS * 0.0016 * size.max())
    np.testing.assert_allclose(covariance / np.outer(size, size),
                               np.cov(draws, rowvar=False) / np.outer(size, size), atol=0.012)


@pytest.mark.parametrize("length_nm", [15.0, 80.0])
@pytest.mark.parametrize("smoothness", [1.5, 2.5])
def test_matern_kernels_are_those_of_rasmussen_and_williams(smoothness, length_nm):
    """Eq. 4.14, with the modified Bessel function."""
    nm = FINE.nm[::20]
    distance = np.sqrt(2 * smoothness) * np.abs(nm[:, None] - nm) / length_nm
    apart = distance > 0
    expected = np.ones(distance.shape)
    expected[apart] = (2**(1 - smoothness) / special.gamma(smoothness)
                       * distance[apart]**smoothness * special.kv(smoothness, distance[apart]))
    np.testing.assert_allclose(matern(nm, length_nm, smoothness), expected, rtol=1e-10)


def test_gains_that_a_photo_cannot_tell_keep_their_shares(chart_photo):
    known = one_family(weights=np.array([1.0]), level=[2], members=("a",),
                       means=coarse_prior().means[-1:])
    result = posterior_of_curves([chart_photo], known, FINE, model_errors=(50.0,))
    # patches that may be off by fifty times tell nothing
    np.testing.assert_allclose(result.weights.reshape(len(GAINS), -1).sum(axis=1),
                               [share for _, share in GAINS], atol=0.01)


def test_a_prior_is_that_of_cameras_whose_white_signal_is_one_whatever_their_gains():
    """Draws of cameras and gains, each divided by what it makes of white, against the Gaussian that
    the fit begins with: what all bands have in common is the exposure's.
    """
    known, light, surfaces = coarse_prior(), led(), reflectances()
    chart = photo(np.full((24, 3), 0.3), light, surfaces, 0.01)
    basis = interpolation_matrix(known.nm, FINE.nm)
    designs = _designs([chart], basis)
    spread, gain_sd = 1e-4 * known.covariances()[known.level[-1]], 0.01
    family = len(known.weights) - 1
    prior, start = _joint_prior(known, spread, family, gain_sd, [chart], designs)
    rng, size = np.random.default_rng(52), known.means.shape[1]
    states = rng.multivariate_normal(known.means[family], spread, 30_000)
    curves = known.curves(states) * np.repeat(
        np.exp(gain_sd * rng.standard_normal((30_000, 3))), size // 3, axis=1)
    whole = np.tile(designs[0].matrix.sum(axis=0), 3)
    whole = whole / (whole @ (known.weights @ known.curves(known.means)))
    drawn = known.state(curves / (curves @ whole)[:, None])
    sigma = np.sqrt(np.diag(prior)[:size])
    np.testing.assert_allclose(start[:size], drawn.mean(axis=0), atol=0.03 * sigma.max())
    # 30 000 draws know a variance to 0.8 %, a correlation to 0.6 %; 3 % of curvature
    np.testing.assert_allclose(np.cov(drawn, rowvar=False) / np.outer(sigma, sigma),
                               prior[:size, :size] / np.outer(sigma, sigma), atol=0.06)


def test_exposures_that_are_tied_differ_beforehand_by_what_ties_them():
    """Three photos: of each the level is unknown, of two their ratio is known to 1 and 2 %."""
    known, light, surfaces = coarse_prior(), led(), reflectances()
    shots = [photo(np.full((24, 3), level), light, surfaces, 0.01, relative_exposure_sd=tie)
             for level, tie in ((0.3, None), (0.6, 0.01), (0.2, 0.02), (0.1, None))]
    designs = _designs(shots, interpolation_matrix(known.nm, FINE.nm))
    covariance, start = _joint_prior(known, known.covariances()[-1], len(known.weights) - 1, 0.05,
                                     shots, designs)
    at = covariance.shape[0] - len(shots) + np.arange(len(shots))    # no field, no glare
    exposures = covariance[np.ix_(at, at)]

    def apart(one, other):
        return np.sqrt(exposures[one, one] + exposures[other, other] - 2 * exposures[one, other])
    assert apart(0, 1) == pytest.approx(0.01) and apart(0, 2) == pytest.approx(0.02)
    assert apart(1, 2) == pytest.approx(np.hypot(0.01, 0.02))
    # nothing is known of any level, nor of the free photo beside the others
    np.testing.assert_allclose(np.sqrt(np.diag(exposures)), EXPOSURE_SD, rtol=1e-4)
    assert apart(0, 3) == pytest.approx(np.sqrt(2) * EXPOSURE_SD)
    assert start[at[0]] == start[at[1]] == start[at[2]] != start[at[3]]


def test_draws_take_a_noisy_signal_as_far_back_to_the_prior_as_bayes_does():
    """One Gaussian of small spread about grey: the exact linear answer, signal and noise alike."""
    spread = 0.1**2 * SMOOTH
    known = mixture_of(PRIOR_GRID.nm, [1.0], np.zeros((1, 61)), [spread])
    truth = reflectance(0.25 * np.ones(61))
    measured = dataclasses.replace(seen(truth), noise_covariance=0.03**2 * np.eye(3))
    drawn = sample_prior(measured, 8000, 4, prior=known).spectra @ measured.relative_response.T
    jacobian = 0.25 * measured.relative_response        # slope of the logit at grey
    of_signal = jacobian @ spread @ jacobian.T
    gain = of_signal @ np.linalg.inv(of_signal + measured.noise_covariance)
    middle = np.full(3, 0.5)
    expected = middle + gain @ (measured.signal - middle)
    covariance = of_signal - gain @ of_signal
    size = np.sqrt(np.diag(covariance))
    # 8000 draws know a mean to 1.1 % of a deviation, a variance to 1.6 %; the floor of the noise
    # and the bend of the logit a few per cent
    np.testing.assert_allclose(drawn.mean(axis=0), expected, atol=0.08 * size.max())
    np.testing.assert_allclose(np.cov(drawn, rowvar=False) / np.outer(size, size),
                               covariance / np.outer(size, size), atol=0.1)
    # the test can tell: the signal lies deviations away from where the prior takes it
    assert np.all(measured.signal - expected > 0.5 * size)
