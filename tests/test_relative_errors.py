"""Errors that multiply a signal: against importance sampling, and in the limits where they add."""
import dataclasses

import numpy as np
import pytest
from sampling_cameras import response, seen, surface
from scipy.stats import truncnorm

from spectrabox.measure.shoot.options import Sampling
from spectrabox.measure.surfaces.surface_signals import errors_by_cause, measurement
from spectrabox.measure.surfaces.surface_spectra import sample_surfaces
from spectrabox.radiometry.error_model import (
    DISAGREEMENT,
    LIGHT_SCALE,
    PHOTO_NOISE,
    SENSITIVITIES,
    Errors,
    proportional_covariance,
    split_errors,
)
from spectrabox.radiometry.records.spectra import (
    CaptureStates,
    Outcome,
    SpectralMeasurement,
    SpectrumSamples,
    SurfaceSignals,
)
from spectrabox.sampling.prior import state_posteriors
from spectrabox.sampling.prior.calibrated_marginals import marginal_moments
from spectrabox.sampling.prior.mixture import PRIOR_GRID, drawn_reflectances, load_prior
from spectrabox.sampling.prior.mixture_posterior import (
    RelativeErrors,
    central_band,
    mean_and_spread,
    multiplying,
    needed_errors,
    posterior,
    unsaid,
)
from spectrabox.sampling.prior.signal_posterior import SignalPosterior, solve_posterior
from spectrabox.sampling.prior.state_posteriors import solve_in_states
from spectrabox.sampling.prior.uplift_table import relative_errors, uplift_signals

# blue, green, red of a dark green wall, off by the light on it, and known no better
GREEN = np.array([0.067, 0.274, 0.012])
CORRELATION = np.array([[1, 0.89, 0.86], [0.89, 1, 0.84], [0.86, 0.84, 1]])
OF_GREEN = np.outer([0.55, 0.51, 0.70], [0.55, 0.51, 0.70]) * CORRELATION


@pytest.fixture(scope="module")
def plain():
    """The shipped prior without what widens its bands: the law that importance sampling has."""
    prior = load_prior()
    return dataclasses.replace(
        prior, band_factors=np.ones_like(prior.band_factors), width_power=0.0,
        stated_factors=np.ones_like(prior.stated_factors))


@pytest.fixture(scope="module")
def surfaces(plain):
    """Reflectances (80 000, 61) that are drawn from it, in no order."""
    drawn = drawn_reflectances(plain, 80_000)
    return drawn[np.random.default_rng(1).permutation(len(drawn))]


def alike(bands, error, common=0.5):
    """Covariance of errors of one size, of which a share is common to all bands."""
    return error**2 * (common * np.ones((bands, bands)) + (1 - common) * np.eye(bands))


def off_by(truths, matrix, covariance, rng, gloss=0.0):
    factors = np.exp(rng.multivariate_normal(np.zeros(len(matrix)), covariance, len(truths)))
    return (truths @ matrix.T + gloss) * factors


def answer(prior, matrix, signals, relative, absolute=0.0, added=0.0):
    """Mean, standard deviation, 95 % band of many signals, all with the same errors."""
    bands = len(matrix)
    many = np.broadcast_to(relative, (len(signals), bands, bands))
    noise = np.broadcast_to(absolute * np.eye(bands), many.shape)
    errors = multiplying(many, np.full(bands, added), np.zeros((bands, bands)))
    mixture = posterior(prior, matrix, signals, noise, relative=errors)
    drawn, _ = marginal_moments(prior, matrix, signals, noise, mixture, errors)
    return *mean_and_spread(drawn), *central_band(drawn, 0.95), mixture


def by_importance(surfaces, matrix, signal, covariance, gloss=0.0):
    """Mean and standard deviation by weights of surfaces of the prior, and how many count."""
    off = np.log(signal / (surfaces @ matrix.T + gloss))
    weights = np.exp(-np.einsum("nk,kl,nl->n", off, np.linalg.inv(covariance), off) / 2)
    weights /= weights.sum()
    mean = weights @ surfaces
    return mean, np.sqrt(weights @ (surfaces - mean)**2), 1 / np.sum(weights**2)


@pytest.mark.parametrize("error, gloss", [(0.1, 0), (0.2, 0), (0.4, 0), (0.6, 0), (0.4, 0.03)])
def test_the_posterior_is_that_of_importance_sampling(plain, surfaces, error, gloss):
    rng, matrix = np.random.default_rng(2), response(3)[1]
    truths = surfaces[:400]
    truths = truths[(truths @ matrix.T).min(axis=1) > 0.02][:40]
    covariance = alike(3, error)
    signals = off_by(truths, matrix, covariance, rng, gloss)
    mean, spread, lower, upper, _ = answer(plain, matrix, signals - gloss, covariance, added=gloss)
    away, wide = [], []
    for number, signal in enumerate(signals):
        expected, deviation, count = by_importance(surfaces[400:], matrix, signal, covariance,
                                                   gloss)
        if count > 200:
            away.append(np.abs(mean[number] - expected).mean() / deviation.mean())
            wide.append(np.mean(spread[number] / deviation))
    assert len(away) > 15
    # of a standard deviation; importance sampling itself is off by 1 / sqrt(200) at most
    assert np.median(away) < 0.15 and abs(np.median(wide) - 1) < 0.08
    held = np.mean((lower <= truths) & (truths <= upper), axis=1)
    # wavelengths of one surface are as one, of which 40 hold 1 in 20 too few at 2.5 sigma
    assert held.mean() > 0.95 - 2.5 * (0.05 * 0.95 / 40)**0.5


@pytest.mark.parametrize("bands", [6, 9])
def test_bands_hold_where_many_bands_err_by_a_third(plain, surfaces, bands):
    rng, matrix = np.random.default_rng(3), response(bands)[1]
    truths = surfaces[:30]
    covariance = alike(bands, 0.3)
    signals = off_by(truths, matrix, covariance, rng)
    _, _, lower, upper, _ = answer(plain, matrix, signals, covariance)
    held = np.mean((lower <= truths) & (truths <= upper), axis=1)
    # 2.5 sigma of 30 surfaces; errors that add at the signal hold .72 to .82
    assert held.mean() > 0.95 - 2.5 * (0.05 * 0.95 / 30)**0.5


def test_bands_hold_where_many_bands_that_become_few_err_by_a_third(plain, surfaces):
    """Three channels under twelve narrow lamps."""
    rng, nm = np.random.default_rng(5), PRIOR_GRID.nm
    channels, lamps = (np.exp(-((nm - np.asarray(at)[:, None]) / width)**2 / 2) for at, width in (
        ((450, 540, 600), 33), (np.linspace(415, 685, 12), 13)))
    matrix = ((channels + 0.01) * lamps[:, None]).reshape(-1, nm.size)
    matrix /= matrix.sum(axis=1, keepdims=True)
    bands, truths = len(matrix), surfaces[:30]
    of_lamp = np.kron(np.eye(12), np.ones((3, 3)))
    covariance = 0.03 * (np.ones((bands, bands)) + of_lamp + np.eye(bands))
    signals = off_by(truths, matrix, covariance, rng)
    noise, held, away = 0.002, [], []
    for truth, clean in zip(truths, signals, strict=True):
        signal = np.maximum(clean + noise * rng.standard_normal(bands), 1e-4)
        # an estimate about which errors hold, far from the truth
        about = SurfaceSignals(
            ("wall",), (False,), PRIOR_GRID, np.full((1, nm.size), signal.mean()),
            tuple(map(str, range(bands))), np.repeat(np.arange(12), 3), matrix, signal[None],
            {PHOTO_NOISE: noise**2 * np.eye(bands)[None],
             DISAGREEMENT: proportional_covariance(signal, covariance)[None]})
        one = measurement(about, 0)
        assert one.signal.size < bands and one.relative_covariance is not None
        found = solve_posterior(plain, one)
        lower, upper = found.band(0.95)
        held.append(np.mean((lower <= truth) & (truth <= upper)))
        away.append(np.mean(found.mean - truth))
    # 2.5 sigma of 30 surfaces; weighted by what was read, sums hold less than half and are dark
    assert np.mean(held) > 0.95 - 2.5 * (0.05 * 0.95 / 30)**0.5
    assert abs(np.mean(away)) < 0.05


def test_a_sum_of_bands_errs_as_its_bands_do_each_by_its_share():
    signal, gain = np.array([0.2, 0.3, 0.1]), np.array([[0.5, 0.5, 0.0], [0.0, 0.2, 0.8]])
    errors = Errors(alike(3, 0.2), 1e-5 * np.eye(3))
    sums = errors.of_sums(gain, signal)
    np.testing.assert_allclose(sums.absolute, gain @ errors.absolute @ gain.T, atol=1e-9)
    shares = np.array([[0.4, 0.6, 0.0], [0.0, 3 / 7, 4 / 7]])
    np.testing.assert_allclose(sums.relative, shares @ errors.relative @ shares.T, rtol=1e-5)
    # of a difference of bands only what both share
    apart = errors.of_sums(np.array([[1.0, -0.6, 0.0]]), signal)
    assert apart.relative[0, 0] < 0.04
    total = np.array([[1.0, -0.6, 0.0]]) @ errors.total(signal) @ np.array([[1.0], [-0.6], [0.0]])
    np.testing.assert_allclose(apart.total(signal[:1] - 0.6 * signal[1:2]), total, rtol=1e-6)


@pytest.mark.parametrize("error", [0.01, 0.03])
def test_small_errors_may_as_well_add(surfaces, error):
    rng, matrix = np.random.default_rng(4), response(3)[1]
    truths, covariance = surfaces[:40], alike(3, error)
    signals = off_by(truths, matrix, covariance, rng)
    mean, spread, *_ = answer(load_prior(), matrix, signals, covariance)
    noise = proportional_covariance(signals, covariance)
    mixture = posterior(load_prior(), matrix, signals, noise)
    added, wide = mean_and_spread(marginal_moments(load_prior(), matrix, signals, noise,
                                                   mixture)[0])
    # as far as an error of that size lets a logarithm depart from a straight line
    assert np.median(np.abs(mean - added) / wide) < 2 * error
    assert abs(np.median(spread / wide) - 1) < error


def test_without_errors_that_multiply_all_is_as_without_the_word():
    one = seen(surface(PRIOR_GRID.nm, 3), 0.01)
    none = dataclasses.replace(one, relative_covariance=np.zeros((3, 3)))
    first, second = (solve_posterior(load_prior(), each) for each in (one, none))
    np.testing.assert_array_equal(first.mean, second.mean)
    np.testing.assert_array_equal(first.draws(50, 1), second.draws(50, 1))
    assert first.log_evidence == second.log_evidence


def test_errors_that_vanish_leave_the_posterior_of_those_that_add():
    matrix, signals = response(3)[1], np.array([seen(surface(PRIOR_GRID.nm, 5)).signal])
    noise = np.broadcast_to(1e-4 * np.eye(3), (1, 3, 3))
    least = multiplying(np.full((1, 3, 3), 1e-12))
    with_them = posterior(load_prior(), matrix, signals, noise, relative=least)
    without = posterior(load_prior(), matrix, signals, noise)
    # an error of 1e-6 moves nothing by more than that; modes are found to as much
    np.testing.assert_allclose(with_them.weights, without.weights, atol=1e-4)
    np.testing.assert_allclose(with_them.log_evidence, without.log_evidence, atol=1e-4)


def test_a_green_wall_that_is_off_by_half_is_not_black(plain):
    matrix = response(3)[1]
    mean, _, _, _, _ = answer(plain, matrix, GREEN[None], OF_GREEN, absolute=0.01**2)
    noise = proportional_covariance(GREEN, OF_GREEN)[None] + 0.01**2 * np.eye(3)
    black = mean_and_spread(posterior(plain, matrix, GREEN[None], noise))[0]
    green = [(each @ matrix.T)[0, 1] for each in (mean, black)]
    # within two of its standard errors, a factor of e; errors that add let it be anything
    assert abs(np.log(green[0] / GREEN[1])) < 1 < abs(np.log(green[1] / GREEN[1]))


def test_signals_of_nothing_and_of_less_have_a_posterior():
    matrix = response(3)[1]
    signals = np.array([[0.01, 0.0, -0.01], [-0.02, 0.004, 0.0]])
    mean, spread, *_, mixture = answer(load_prior(), matrix, signals, alike(3, 0.3),
                                       absolute=0.01**2)
    assert np.all(np.isfinite(mixture.log_evidence)) and np.all(np.isfinite(spread))
    # noise of 1 % lets black be a few times that
    assert mean.max() < 0.05


def test_draws_follow_the_marginal_law_and_stay_between_black_and_white():
    one = dataclasses.replace(seen(surface(PRIOR_GRID.nm, 7)), relative_covariance=alike(3, 0.4))
    one = dataclasses.replace(one, noise_covariance=proportional_covariance(
        one.signal, one.relative_covariance) + 1e-5 * np.eye(3))
    found = solve_posterior(load_prior(), one)
    drawn = found.draws(20_000, 2)
    assert drawn.min() > 0 and drawn.max() < 1
    # the law is of second order: a tenth of a deviation, and of its width
    assert np.abs(drawn.mean(axis=0) - found.mean).max() < 0.1 * found.standard_deviation.max()
    np.testing.assert_allclose(drawn.std(axis=0), found.standard_deviation, rtol=0.15)


def test_gloss_and_reflectance_are_multiplied_alike():
    """A capture that mirrors a known share of white."""
    rng, truth = np.random.default_rng(5), surface(PRIOR_GRID.nm, 4)
    matrix, covariance = response(3)[1], alike(3, 0.3)
    states = CaptureStates(("gloss",), ("surface reflection",), np.ones((3, 1)), np.zeros(1),
                           ("glossy",), np.ones(1), np.full((1, 1), 0.05), np.full((1, 1, 1), 1e-9))
    signal = off_by(truth[None], matrix, covariance, rng, 0.05)[0]
    noise = proportional_covariance(signal, covariance) + 1e-6 * np.eye(3)
    one = SpectralMeasurement(PRIOR_GRID, matrix, signal, noise, states, covariance)
    (part,), _, _ = solve_in_states(load_prior(), matrix, one)
    mean, *_ = answer(load_prior(), matrix, signal[None] - 0.05, covariance, 1e-6, 0.05)
    found = SignalPosterior(one, matrix, load_prior(), (part,), 0.0, load_prior(), (part,),
                            Outcome.FAMILIAR)
    # the gloss is certain to 3e-5
    np.testing.assert_allclose(found.mean, mean[0], atol=1e-3)
    _, variables = found.draws_with_variables(200, 1)
    np.testing.assert_allclose(variables, 0.05, atol=1e-3)


def test_two_photos_that_share_their_error_are_one_with_less_noise():
    matrix, covariance = response(3)[1], alike(3, 0.3, 1.0)
    signal = matrix @ surface(PRIOR_GRID.nm, 6) * 1.2
    state = CaptureStates(("gloss",), ("surface reflection",), np.zeros((3, 1)), np.zeros(1), ("",),
                          np.ones(1), np.zeros((1, 1)), np.full((1, 1, 1), 1e-6))
    multiplies = proportional_covariance(signal, covariance)
    once = SpectralMeasurement(PRIOR_GRID, matrix, signal, multiplies + 5e-5 * np.eye(3), state,
                               covariance)
    both = np.ones((2, 2))
    twice = SpectralMeasurement(
        PRIOR_GRID, np.vstack(2 * [matrix]), np.tile(signal, 2),
        np.kron(both, multiplies) + 1e-4 * np.eye(6), dataclasses.replace(
            state, pattern=np.zeros((6, 1))), np.kron(both, covariance))
    means = [solve_posterior(load_prior(), each).mean for each in (once, twice)]
    np.testing.assert_allclose(*means, atol=1e-4)


# ---- which errors multiply -----------------------------------------------------------------------

def test_errors_are_split_into_what_multiplies_and_what_adds():
    signal, bands = np.array([[0.3, 0.2, 0.4]]), np.ones((3, 3))
    noise = 1e-4 * np.eye(3)[None]
    causes = {PHOTO_NOISE: noise, LIGHT_SCALE: proportional_covariance(signal, 0.09 * bands),
              "a cause of one's own": 2 * noise}
    errors = split_errors(signal, causes)
    np.testing.assert_allclose(errors.relative[0], 0.09 * bands, rtol=1e-6)
    np.testing.assert_allclose(errors.absolute, 3 * noise, atol=1e-9)
    np.testing.assert_allclose(errors.total(signal), np.sum(list(causes.values()), axis=0),
                               atol=1e-15)


@pytest.mark.parametrize("signal, multiplies", [((0.3, 0.2, 0.4), True), ((0.3, 0.01, 0.4), False)])
def test_errors_of_curves_add_to_a_band_that_is_nearly_dark(signal, multiplies):
    """Every band errs by 1 % of white: the dark one by as much as it is."""
    causes = {SENSITIVITIES: 1e-4 * np.eye(3)}
    errors = split_errors(np.array(signal), causes)
    assert bool(errors.relative.any()) == multiplies
    np.testing.assert_allclose(errors.total(np.array(signal)), causes[SENSITIVITIES], atol=1e-15)


def test_no_more_multiplies_than_there_is():
    signal = np.array([0.2, 0.4])
    total = proportional_covariance(signal, 0.04 * np.ones((2, 2)))
    errors = Errors.of_total(total, signal, 0.16 * np.ones((2, 2)))
    np.testing.assert_allclose(errors.relative, 0.04, rtol=1e-6)
    assert np.linalg.eigvalsh(errors.absolute).min() > -1e-12


def signals_of(signal, relative, noise=0.01):
    """Surface signals of one surface, with an error that multiplies and noise that adds."""
    grid, matrix = response(3, 1)
    return SurfaceSignals(
        ("wall",), (False,), grid, np.full((1, grid.nm.size), 0.3), ("B", "G", "R"),
        np.zeros(3, int), matrix, np.array([signal]),
        {PHOTO_NOISE: noise**2 * np.eye(3)[None],
         DISAGREEMENT: proportional_covariance(np.array(signal), relative)[None]})


def test_a_surface_carries_what_multiplies_its_signal_and_its_budget_adds_up():
    signals = signals_of([0.2, 0.3, 0.4], alike(3, 0.3))
    one = measurement(signals, 0)
    np.testing.assert_allclose(one.relative_covariance, alike(3, 0.3), rtol=1e-6)
    found = solve_posterior(load_prior(), one)
    shares = found.variance_shares(errors_by_cause(signals, 0))
    assert sum(shares.values()) == pytest.approx(1)
    # thirty per cent of the signal are more than one of white
    assert shares[DISAGREEMENT] > 5 * shares[PHOTO_NOISE] > 0


def test_pixels_have_the_errors_of_surfaces():
    matrix, signals = response(3)[1], np.array([[0.2, 0.3, 0.4], [0.05, 0.06, 0.05]])
    mean, _, _ = uplift_signals(load_prior(), matrix, signals, relative_errors(signals, 0.4))
    for number, signal in enumerate(signals):
        relative = 0.16 * np.eye(3)
        alone = solve_posterior(load_prior(), SpectralMeasurement(
            PRIOR_GRID, matrix, signal, proportional_covariance(signal, relative), None, relative))
        # modes to 1e-6 of a logit, by a block of signals or by one of components
        np.testing.assert_allclose(mean[number], alone.mean, atol=1e-5)


# ---- what a posterior says of its own signal -----------------------------------------------------

def test_needed_errors_are_chi_square_of_what_adds_and_of_logarithms_of_what_multiplies():
    given, signals = np.array([[0.2, 0.3, 0.4]]), np.array([[0.25, 0.3, 0.3]])
    noise = np.full((1, 3), 0.02**2)[..., None] * np.eye(3)
    off = signals - given
    # with the 0.5 % of white that a mean may be off by
    assert needed_errors(given, signals, noise) == pytest.approx(
        np.sum(off**2) / (0.02**2 + 0.005**2))
    relative = RelativeErrors(0.3**2 * np.eye(3)[None], np.zeros(3), np.zeros((3, 3)))
    assert needed_errors(given, signals, 0 * noise, relative) == pytest.approx(
        np.sum(np.log(signals / given)**2) / 0.3**2, rel=1e-2)


def test_right_answers_say_their_signal_and_that_of_errors_that_add_does_not(plain, surfaces):
    rng, matrix = np.random.default_rng(6), response(3)[1]
    truths, covariance = surfaces[:200], alike(3, 0.4)
    signals = off_by(truths, matrix, covariance, rng)
    mean, *_ = answer(plain, matrix, signals, covariance)
    none, relative = np.zeros((200, 3, 3)), multiplying(np.tile(covariance, (200, 1, 1)))
    # 1 % would be five or six: 3.9 sigma
    assert np.mean(unsaid(matrix, mean, signals, none, relative) > 1) < 0.01 + 3.9 * 0.007
    noise = proportional_covariance(GREEN, OF_GREEN)[None]
    black = mean_and_spread(posterior(plain, matrix, GREEN[None], noise))[0]
    assert unsaid(matrix, black, GREEN[None], 0 * noise, multiplying(OF_GREEN[None])) > 5


def test_draws_of_all_surfaces_at_once_that_leave_a_surfaces_signal_are_not_taken():
    signals = signals_of([0.2, 0.3, 0.4], alike(3, 0.1))
    dark, light = (SpectrumSamples(PRIOR_GRID, np.full((1000, 61), level), np.full((1000, 13), 0.5),
                                   "at once", 1000.0, 0, Outcome.THROUGH_TRANSPORT, ())
                   for level in (0.01, 0.3))
    chosen = Sampling(draws=1000)
    found = sample_surfaces(signals, chosen, 0, {}, lambda done, what: None, {"wall": dark})["wall"]
    assert found.samples.outcome is Outcome.UNSAID
    assert found.lower.max() > 0.05
    kept = sample_surfaces(signals_of([0.3, 0.3, 0.3], alike(3, 0.1)), chosen, 0, {},
                           lambda done, what: None, {"wall": light})["wall"]
    assert kept.samples.outcome is Outcome.THROUGH_TRANSPORT


@pytest.mark.parametrize("mean, least", [(0.4, 0.0), (0.0, 0.0), (-0.5, 0.0), (1.0, -np.inf)])
def test_a_variable_that_cannot_be_less_is_a_truncated_normal_one(mean, least):
    """Independent: scipy.stats.truncnorm."""
    known = truncnorm((least - mean) / 0.3, np.inf, loc=mean, scale=0.3)
    estimate = state_posteriors._not_less(*(np.array([one]) for one in (mean, 0.3, least)))
    np.testing.assert_allclose(np.ravel(estimate), [known.mean(), known.std()], rtol=1e-6)
