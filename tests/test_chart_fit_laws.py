"""Laws of chart fits: priors of what is unknown, changes of variables, light beyond the chart.

Statistical tests have a significance of 1e-4 each (3.9 sigma), at fixed seeds.
"""
import dataclasses

import numpy as np
import pytest
from calibrate_cameras import (
    GRID,
    coarse_prior,
    daylight,
    on_grid,
    photo,
    reflectances,
    samples,
    signals,
)
from calibrate_cameras import cameras as simulated
from scipy import stats
from test_calibrate_products import small_prior

from spectrabox.calibrate import light_field
from spectrabox.calibrate.chart_equations import (
    FIELD_SD,
    GLARE_SD,
    PatchError,
    chart_equations,
    field_terms,
    noise_covariance,
    nuisance_sd,
)
from spectrabox.calibrate.held_out_patches import patch_moments
from spectrabox.calibrate.light_error import light_difference
from spectrabox.calibrate.prior.prior_fit import (
    EXPOSURE_SD,
    _designs,
    _in_curves,
    _joint_prior,
    _whole,
)
from spectrabox.calibrate.products.product_fit import WIDENING, in_curves
from spectrabox.calibrate.products.product_posterior import linearised
from spectrabox.calibrate.sensitivity import CHART_ERROR, _patch_sigma, fit_sensitivities
from spectrabox.radiometry.chart import CLASSIC
from spectrabox.radiometry.covariance import symmetric
from spectrabox.radiometry.grid import interpolation_matrix
from spectrabox.radiometry.records.calibration import ChartWhite
from spectrabox.radiometry.records.photos import PatchSamples

POSITIONS = CLASSIC.centres_uv


@pytest.mark.parametrize("change, difference", [(0.0, 0.0), (0.06, 0.06)])
def test_photos_of_a_chart_differ_by_their_light_not_by_exposure_or_field(change, difference):
    rng = np.random.default_rng(5)
    first = rng.uniform(0.1, 0.9, (24, 3))
    # exposure and a field that falls off; then a tint, one band up and one down
    other = 0.3 * first * np.exp(field_terms(POSITIONS) @ [0.1, -0.05, 0.02, 0, 0.03])[:, None]
    other = other * np.exp([change, 0, -change])

    def samples_of(signal, seed):
        noise = 0.002 * signal
        covariance = (noise**2)[:, :, None] * np.eye(3)
        return PatchSamples(signal + noise * np.random.default_rng(seed).standard_normal((24, 3)),
                            covariance, np.ones(24), 0 * signal, 0 * signal)

    found = light_difference(samples_of(first, 1), samples_of(other, 2), POSITIONS)
    # standard deviation of (1, 0, -1) is 1; noise of 0.3 % is taken off within 0.1 %
    assert found == pytest.approx(difference, abs=0.001)


def shot(glare=True, **more):
    surfaces = reflectances()
    return photo(signals(on_grid(simulated(1, 3)[0]), daylight(), surfaces), daylight(), surfaces,
                 0.01, field_terms(POSITIONS), glare, **more)


# ---- the field over a chart ----------------------------------------------------------------------

def test_a_field_over_the_chart_leaves_its_mean_and_its_terms_are_of_one_size():
    terms = field_terms(POSITIONS)
    np.testing.assert_allclose(terms.mean(axis=0), 0, atol=1e-14)       # of numbers near 1
    np.testing.assert_allclose(terms.std(axis=0), 1, rtol=1e-12)
    # quadratics of the place
    coefficients = np.linalg.lstsq(quadratic(POSITIONS), terms, rcond=None)[0]
    np.testing.assert_allclose(quadratic(POSITIONS) @ coefficients, terms, rtol=1e-9, atol=1e-9)


def quadratic(at):
    x, y = at.T
    return np.column_stack([np.ones(len(at)), x, y, x**2, y**2, x * y])


def test_what_is_unknown_of_a_photo_has_the_standard_deviations_that_are_stated():
    chart = shot()
    expected = np.r_[np.full(5, FIELD_SD), GLARE_SD * chart.signal.max(axis=0)]
    np.testing.assert_allclose(nuisance_sd(chart), expected, rtol=1e-12)
    known = small_prior()
    nuisance = np.zeros(9)
    system = linearised([chart], known, known.components[0], nuisance, np.zeros(3), nuisance)
    np.testing.assert_allclose(np.sqrt(system.nuisance_variance), np.r_[EXPOSURE_SD, expected],
                               rtol=1e-12)


def test_bands_that_see_the_same_wavelengths_err_alike_of_a_patch():
    rng = np.random.default_rng(71)
    signal = rng.uniform(0.1, 0.9, (24, 3))[:, [0, 1, 2, 0]] * [1, 2, 0.5, 3]     # the first again
    nothing = np.zeros(signal.shape)
    chart = chart_equations(
        PatchSamples(signal, np.zeros((24, 4, 4)), np.ones(24), nothing, nothing),
        np.ones((24, GRID.nm.size)), np.ones(GRID.nm.size), np.ones(24), GRID)
    relative = noise_covariance(chart, PatchError(0.01))[5] / 0.01**2
    size = np.sqrt(np.diag(relative))
    correlation = relative / np.outer(size, size)
    np.testing.assert_allclose(correlation[0], [1, 0, 0, 1], atol=1e-3)
    # what all bands have in common is as before
    whole = noise_covariance(chart, PatchError(0.01, 0.02))[5] - noise_covariance(
        chart, PatchError(0.01))[5]
    np.testing.assert_allclose(whole, 0.02**2 * np.outer(signal[5], signal[5]), rtol=1e-9)


def test_the_first_photos_exposure_is_unknown_whatever_is_said_of_it():
    known, spread = coarse_prior(), coarse_prior().covariances()[-1]
    means = []
    for tie in (None, 0.01):
        shots = [shot(relative_exposure_sd=tie), shot(relative_exposure_sd=0.02)]
        designs = _designs(shots, interpolation_matrix(known.nm, GRID.nm))
        means.append(_joint_prior(known, spread, len(known.weights) - 1, 0.05, shots, designs)[0])
    np.testing.assert_array_equal(*means)


def test_departures_of_cameras_have_the_standard_deviations_that_are_stated():
    known = dataclasses.replace(coarse_prior(), floor=None, jitter_sd=0.0,
                                within=np.zeros((63, 1)), between=np.zeros((63, 1)))
    mean, top = known.means[-1], known.means.max()
    for column, expected in ((0, np.full(63, 0.03 * top)), (2, 0.03 * mean), (4, 0.03 * mean)):
        departures = np.zeros((1, 6))
        departures[0, [1, 3, 5]], departures[0, column] = 30.0, 0.03
        only = dataclasses.replace(known, departures=departures, shares=np.ones((1, 2)),
                                   widening=np.ones(1), level=np.zeros(len(known.weights), int))
        covariance = only.covariances()[0]
        np.testing.assert_allclose(np.sqrt(np.diag(covariance)), np.abs(expected), rtol=1e-9)
        # what all bands have in common is fully correlated between them, the others not at all
        between = covariance[0, 21] / np.sqrt(covariance[0, 0] * covariance[21, 21])
        assert between == pytest.approx(float(column == 4), abs=1e-9)


# ---- changes of variables ------------------------------------------------------------------------

def test_the_exposure_makes_up_for_the_scale_of_the_curves():
    known, rng = coarse_prior(), np.random.default_rng(51)
    mean = np.r_[known.state(np.maximum(known.curves(known.means[0]), 0.05)), 0.7, np.zeros(8),
                 0.4, -0.3]
    root = 1e-3 * rng.standard_normal((mean.size, mean.size))
    chart = shot(light_terms=rng.standard_normal((GRID.nm.size, 2)))
    designs = _designs([chart], interpolation_matrix(known.nm, GRID.nm))
    whole = _whole(designs, known)
    moved, covariance = _in_curves(known, mean, root @ root.T, designs, [chart])
    size = whole.size
    light = np.tile(chart.light_terms[::15], (3, 1))
    assert whole @ moved[:size] == pytest.approx(1)
    np.testing.assert_allclose(np.exp(moved[size]) * moved[:size], np.exp(
        0.7 + light @ mean[-2:]) * known.curves(mean[:size]), rtol=1e-12)
    # signals, of which curves and exposure are two factors, err as they did before
    step = 1e-6
    signal = lambda state: (state[size] + np.log(known.curves(state[:size]))      # noqa: E731
                            + light @ state[-2:])
    slope = np.array([(signal(mean + step * unit) - signal(mean - step * unit)) / (2 * step)
                      for unit in np.eye(mean.size)]).T
    after = np.hstack([np.diag(1 / moved[:size]), np.ones((size, 1)), np.zeros((size, 10))])
    np.testing.assert_allclose(after @ covariance @ after.T, slope @ (root @ root.T) @ slope.T,
                               rtol=1e-5, atol=1e-9)


def test_errors_of_products_in_curves_are_those_of_differences_widened():
    known, rng = small_prior(), np.random.default_rng(52)
    entries, bands, nodes = known.components.shape[1], known.bands, known.nm.size
    mean = np.r_[known.components[0], np.zeros(4), np.zeros(bands)]
    product = rng.uniform(0.5, 1.5, (bands, nodes))
    mean[known.products] = (product / product.sum(axis=1, keepdims=True)).ravel()
    # errors of level, gains and nuisances: products keep their sum
    free = np.r_[known.balance, entries:mean.size]
    size, none, mass = 1e-3 * rng.uniform(1, 2, free.size), np.zeros((mean.size,) * 2), 5.0
    step, slopes = 1e-5, []
    for unit in np.eye(mean.size)[free]:
        ahead, behind = (in_curves(known, mean + sign * step * unit, none,
                                   np.full(nodes, mass))[0] for sign in (1, -1))
        slopes.append((ahead - behind) / (2 * step))
    expected = (np.array(slopes).T * size**2) @ np.array(slopes)
    none[free, free] = size**2
    state, covariance = in_curves(known, mean, none, np.full(nodes, mass))
    np.testing.assert_allclose(covariance, WIDENING**2 * expected,
                               atol=1e-6 * np.abs(expected).max())
    # each curve under a light of 1 makes of white what its level says
    level = np.exp(mean[known.balance])
    np.testing.assert_allclose(state[:bands * nodes].reshape(bands, -1).sum(axis=1) * mass, level)


@pytest.mark.parametrize("glare", [False, True])
def test_the_covariance_of_a_left_out_patch_is_that_of_draws(glare):
    rng, chart, bands, nodes = np.random.default_rng(53), shot(glare), 3, 4
    size = bands * nodes
    state = np.r_[rng.uniform(0.5, 1, size), 0.1, rng.normal(0, 0.1, 5)]
    scale = np.r_[np.full(size, 1e-3), 0.01, np.full(5, 0.003)]
    if glare:       # half of what the patch reads
        state, scale = np.r_[state, 0.5 * chart.signal[7]], np.r_[scale, np.full(3, 1e-9)]
    rows, offset, covariance = patch_moments(chart, 7, state, np.diag(scale**2),
                                             np.zeros((chart.power.size, nodes)))
    draws = state + scale * rng.standard_normal((40_000, state.size))
    read = chart.signal[7] - (state[-3:] if glare else 0)
    np.testing.assert_allclose(offset, chart.signal[7] - read, rtol=1e-12)
    brightness = draws[:, size] + draws[:, size + 1:size + 6] @ chart.field_terms[7]
    middle = state[size] + state[size + 1:size + 6] @ chart.field_terms[7]
    expected = np.var(read * np.exp(brightness - middle)[:, None], axis=0)
    # 40 000 draws know a variance to 0.7 %
    np.testing.assert_allclose(np.diag(covariance)[size:], expected, rtol=0.03)
    np.testing.assert_allclose(rows.ravel(), np.exp(middle) * state[:size], rtol=1e-12)


# ---- errors of splines ---------------------------------------------------------------------------

def test_a_patch_without_noise_is_known_as_well_as_its_reference():
    bright = samples(np.full((24, 3), 0.4) * np.r_[np.ones(12), 0.8 * np.ones(12)][:, None])
    sigma = _patch_sigma(bright)
    assert np.all(sigma >= CHART_ERROR * bright.mean) and np.all(sigma < 0.1 * bright.mean)


def test_bands_listed_twice_tell_the_light_scale_no_better_and_no_worse():
    surfaces, light = reflectances(), daylight()
    signal = signals(on_grid(simulated(1, 44)[0]), light, surfaces)
    rng, errors = np.random.default_rng(45), {3: [], 6: []}
    for _ in range(8):
        noisy = np.tile(signal, 2) * (1 + 0.01 * rng.standard_normal((24, 6)))
        for bands, estimate in errors.items():
            estimate.append(fit_sensitivities(samples(noisy[:, :bands], 0.01), surfaces, light,
                                              np.full(24, np.pi), GRID,
                                              method="nonnegative")[1].standard_error)
    # eight photos of 24 patches know a deviation to 5 %
    assert np.mean(errors[6]) == pytest.approx(np.mean(errors[3]), rel=0.2)


# ---- light beyond the chart ----------------------------------------------------------------------

def test_one_lamp_gives_the_inverse_square_of_its_distance_times_the_cosine(monkeypatch):
    """E ~ h / r^3 of a lamp at height h: E^(-2/3) is a quadratic of the place."""
    for name in ("MAX_DIRECTED", "MAX_AMBIENT"):
        monkeypatch.setattr(light_field, name, 0.0)
    line = np.linspace(0, 1, 6)[:, None] * np.array([[1.0, 0.7]])
    field = light_field._lamplight(line, len(line), 3.0, np.random.default_rng(54))
    third = np.abs(np.diff(np.exp(-2 / 3 * field), 3, axis=1)).max(axis=1)
    # in half of the arrangements there is one lamp: round-off of numbers near 1
    share = np.mean(third < 1e-12)
    assert abs(share - 0.5) < 3.9 * 0.5 / np.sqrt(len(field))


def arrangements(rng, places):
    """Fields of Gaussian terms at the patches, and at places of which the terms tell a part."""
    terms = rng.multivariate_normal(0.1 * np.arange(5), 0.03**2 * (np.eye(5) + 0.5), 20_000)
    slope = rng.standard_normal((places, 5))
    elsewhere = terms @ slope.T + 0.02 * rng.standard_normal((20_000, places)) + 0.3
    return terms, elsewhere


# all arrangements count alike, and by the chart's likelihood as far as a tenth of them is left:
# then moments are those of at least 2000 draws, off by at most 3.9 / sqrt(2000) of their spread
@pytest.mark.parametrize("left, off", [(1.0, 0.0), (0.1, 0.09)])
def test_light_given_a_chart_is_that_of_conditioning_one_gaussian(monkeypatch, left, off):
    monkeypatch.setattr(light_field, "MIN_LEFT", left)
    rng, bands, places = np.random.default_rng(55), 2, 3
    size = 2 * bands + 5
    root = rng.standard_normal((size, 2 * size)) / np.sqrt(2 * size)
    likelihood = 1e4 * root @ root.T        # of log level, terms, glare, by the patches alone
    own = slice(bands, bands + 5)
    before = np.zeros((size, size))
    before[own, own] = np.eye(5) / FIELD_SD**2
    covariance = np.linalg.inv(likelihood + before)
    # where shares count, terms as the arrangements have them: no draws tell the moments far out
    of_terms = 0.1 * rng.standard_normal(5) if left == 1 else arrangements(rng, 1)[0][0]
    best = np.r_[np.zeros(bands), of_terms, np.array([0.01, 0.02])]
    mean = covariance @ likelihood @ best
    # level is told relative to the fit's, as its own corrections are
    white = ChartWhite(np.ones(bands), mean[own], mean[bands + 5:], symmetric(covariance))
    design = field_terms(POSITIONS)
    project = np.linalg.pinv(design)
    centre, information = light_field._likelihood(white)
    estimates = []
    for seed in (1, 2):
        terms, elsewhere = arrangements(np.random.default_rng(seed), places)
        evidence, moved, spread = light_field._given_the_chart(
            white, project, centre, information, terms @ design.T, elsewhere)
        m, S = terms.mean(axis=0), np.cov(terms, rowvar=False)
        joint = np.cov(np.hstack([terms, elsewhere]), rowvar=False)
        prior = np.zeros((size, size))
        prior[own, own] = np.linalg.inv(S)
        exact = np.linalg.inv(likelihood + prior)
        state = exact @ (likelihood @ best + prior @ np.r_[np.zeros(bands), m,
                                                            np.zeros(bands)])
        gain = joint[5:, :5] @ np.linalg.inv(S)
        rest = joint[5:, 5:] - gain @ joint[:5, 5:]
        carry = np.zeros((2 * bands + places, size))
        carry[:bands, :bands] = carry[bands:2 * bands, bands + 5:] = np.eye(bands)
        carry[2 * bands:, own] = gain
        expected = carry @ exact @ carry.T
        expected[2 * bands:, 2 * bands:] += rest
        # a sum of squares over 19 994 in place of 19 999
        sd = np.sqrt(np.diag(expected))
        np.testing.assert_allclose(spread / np.outer(sd, sd), expected / np.outer(sd, sd),
                                   rtol=1e-3, atol=1e-4 + 2 * off)
        moved_to = np.r_[state[bands + 5:], elsewhere.mean(axis=0) + gain @ (state[own] - m)]
        np.testing.assert_allclose((moved[bands:] - moved_to) / sd[bands:], 0, atol=1e-4 + off)
        # the patches' own say of the terms, level and glare unknown
        others = [0, 1, 7, 8]
        informed = likelihood[own, own] - likelihood[own][:, others] @ np.linalg.solve(
            likelihood[np.ix_(others, others)], likelihood[others][:, own])
        exact_log = stats.multivariate_normal(m, S + np.linalg.inv(informed)).logpdf(best[own])
        estimates.append((evidence, exact_log))
    (one, exact_one), (other, exact_other) = estimates
    assert one - other == pytest.approx(exact_one - exact_other, abs=1e-4 + 2 * off)
