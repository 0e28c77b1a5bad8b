"""States of a capture: what is unknown of it beyond Gaussian errors; what a signal says of it."""
import dataclasses

import numpy as np
import pytest
from scipy import stats

from spectrabox.measure.surfaces.surface_signals import (
    errors_by_cause,
    measurement,
    relative_errors,
)
from spectrabox.radiometry.error_model import PHOTO_NOISE, SAMPLE_PLANE, SURFACE_REFLECTION
from spectrabox.radiometry.records.spectra import (
    CaptureStates,
    SpectralMeasurement,
    SurfaceSignals,
    independent_states,
)
from spectrabox.sampling.further.more_measurements import Reading, condition, same_material
from spectrabox.sampling.prior.mixture import load_prior
from spectrabox.sampling.prior.signal_posterior import solve_posterior
from spectrabox.sampling.spectral_measurement import spline_operator, without_states
from spectrabox.sampling.summary import METAMERISM

from tests.sampling_cameras import response

GRID, RESPONSE = response()
NM = GRID.nm
RED = np.interp(NM, [400, 500, 560, 620, 700], [0.06, 0.08, 0.1, 0.35, 0.45])
KINDS, WEIGHTS = ("matt", "satin", "glossy"), np.array([0.6, 0.25, 0.15])
MEANS, DEVIATIONS = np.array([0.0032, 0.012, 0.03]), np.array([0.0024, 0.006, 0.012])


def gloss_of(means=MEANS, deviations=DEVIATIONS, weights=WEIGHTS, kinds=KINDS, bands=3):
    """A gloss of all bands alike, normal in each state."""
    return CaptureStates(("gloss",), (SURFACE_REFLECTION,), np.ones((bands, 1)), np.zeros(1), kinds,
                         np.asarray(weights), np.asarray(means)[:, None],
                         np.asarray(deviations)[:, None, None]**2)


def seen(gloss=0.0, states=None, level=0.02, noise=0.003, rows=RESPONSE):
    """A red surface of that gloss, its level known to 2 %."""
    signal = rows @ RED + gloss
    return SpectralMeasurement(GRID, rows, signal, level**2 * np.outer(signal, signal)
                               + noise**2 * np.eye(len(rows)), states)


def test_one_state_of_no_mean_is_one_more_error():
    prior = load_prior()
    state = gloss_of([0.0], [0.008], [1.0], ("any",))
    one = solve_posterior(prior, seen(states=state))
    plain = seen()
    other = solve_posterior(prior, dataclasses.replace(
        plain, noise_covariance=plain.noise_covariance + 0.008**2))
    # Round-off.
    assert one.log_evidence == pytest.approx(other.log_evidence, rel=1e-9)
    np.testing.assert_allclose(one.mean, other.mean, rtol=1e-9)
    np.testing.assert_allclose(one.band(0.95), other.band(0.95), rtol=1e-9)
    assert one.family_shares == pytest.approx(other.family_shares)


def test_a_state_cut_into_many_narrow_ones_says_the_same():
    """The posterior over a normal gloss, and over a grid of glosses each by its probability."""
    prior = load_prior()
    whole = solve_posterior(prior, seen(0.03, gloss_of([0.03], [0.012], [1.0], ("glossy",))))
    grid = np.linspace(-0.015, 0.075, 61)
    density = stats.norm.pdf(grid, 0.03, 0.012)
    cut = solve_posterior(prior, seen(0.03, gloss_of(grid, np.full(61, 0.0006),
                                                     density / density.sum(), ("glossy",) * 61)))
    spread = whole.standard_deviation.max()
    # Laplace's method: each narrow state has modes of its own, on what is a line of the whole one
    np.testing.assert_allclose(cut.mean, whole.mean, atol=0.06 * spread)
    np.testing.assert_allclose(cut.standard_deviation, whole.standard_deviation, atol=0.06 * spread)
    assert cut.log_evidence == pytest.approx(whole.log_evidence, abs=0.05)
    error = whole.states.standard_deviation[0]
    assert cut.states.mean[0] == pytest.approx(whole.states.mean[0], abs=0.3 * error)
    assert cut.states.standard_deviation[0] == pytest.approx(error, rel=0.1)


def test_draws_reproduce_the_signal_less_their_gloss():
    measured = seen(0.03, gloss_of())
    posterior = solve_posterior(load_prior(), measured)
    spectra, gloss = posterior.draws_with_variables(4000, 3)
    assert gloss.shape == (4000, 1) and gloss.min() >= 0
    left = measured.signal - spectra @ posterior.relative_response.T - gloss
    errors = np.sqrt(np.diag(measured.noise_covariance))
    # The errors of draws are those of the posterior: no wider than the noise, and near to 0.
    assert np.all(left.std(axis=0) < 1.1 * errors)
    assert np.all(np.abs(left.mean(axis=0)) < errors)
    # A draw of more gloss is of a darker surface.
    assert np.corrcoef(gloss[:, 0], spectra.mean(axis=1))[0, 1] < -0.5


def test_mean_deviation_and_gloss_in_closed_form_are_those_of_draws():
    posterior = solve_posterior(load_prior(), seen(0.02, gloss_of()))
    spectra, gloss = posterior.draws_with_variables(8000, 5)
    spread = posterior.standard_deviation
    # of 8000 draws the mean errs by 0.011 of the spread, 4.5 times of which is 1 in 100,000; the
    # closed form is of second order
    np.testing.assert_allclose(spectra.mean(axis=0), posterior.mean, atol=0.07 * spread.max())
    np.testing.assert_allclose(spectra.std(axis=0), spread, atol=0.07 * spread.max())
    lower, upper = posterior.band(0.95)
    assert np.mean((spectra >= lower) & (spectra <= upper)) == pytest.approx(0.95, abs=0.01)
    estimate = posterior.states
    # what cannot be less than 0 is cut off draw by draw, and component by component
    assert gloss.mean() == pytest.approx(estimate.mean[0], abs=0.0006)
    assert gloss.std() == pytest.approx(estimate.standard_deviation[0], rel=0.06)
    assert sum(estimate.shares.values()) == pytest.approx(1)
    assert set(estimate.shares) == set(KINDS)


def test_draws_of_several_states_are_reproducible_and_in_no_order():
    posterior = solve_posterior(load_prior(), seen(0.01, gloss_of()))
    first, again = (posterior.draws_with_variables(500, 9) for _ in range(2))
    np.testing.assert_array_equal(first[0], again[0])
    np.testing.assert_array_equal(first[1], again[1])
    assert not np.array_equal(first[0], posterior.draws(500, 10))
    halves = posterior.draws_with_variables(4000, 11)[1].reshape(2, -1)
    # Both halves are draws of one distribution: at a significance of 1e-3.
    assert stats.ks_2samp(*halves).pvalue > 1e-3
    samples = posterior.samples(500, 9, 13)
    np.testing.assert_array_equal(samples.variables, first[1])
    assert solve_posterior(load_prior(), seen()).samples(100, 1, 13).variables is None


def test_two_photos_tell_a_gloss_that_one_has_more_of():
    """The lamp moved: a gloss for each photo, alike beforehand, and a level that may be off."""
    rows = np.vstack([RESPONSE, RESPONSE])
    block = np.kron(np.eye(2), np.ones((3, 1)))
    covariances = np.array([sd**2 * np.array([[1, 0.5], [0.5, 1]]) for sd in DEVIATIONS])
    both = CaptureStates(("gloss", "gloss of the second"), (SURFACE_REFLECTION,) * 2, block,
                         np.zeros(2), KINDS, WEIGHTS, np.repeat(MEANS[:, None], 2, axis=1),
                         covariances)
    signal = rows @ RED + block @ [0.04, 0.005]
    level = signal[:, None] * block
    levels = CaptureStates(
        ("level", "level of the second"), (SAMPLE_PLANE,) * 2, level, np.full(2, -np.inf),
        ("", "first off", "second off"), np.array([0.8, 0.1, 0.1]), np.zeros((3, 2)),
        np.array([np.diag([a**2, b**2]) for a, b in ((0.02, 0.02), (0.1, 0.02), (0.02, 0.1))]))
    states = independent_states(both, levels)
    assert states.weights.sum() == pytest.approx(1)
    assert len(states.weights) == 9 and states.names[2:] == levels.names
    noise = np.diag((0.003 * signal)**2 + 0.001**2)
    found = solve_posterior(load_prior(), SpectralMeasurement(GRID, rows, signal, noise, states))
    first, second = found.states.mean[:2]
    error = found.states.standard_deviation[:2]
    assert np.all(np.abs([first - 0.04, second - 0.005]) < 2 * error)
    assert first - second == pytest.approx(0.035, abs=0.01)
    alone = solve_posterior(load_prior(), seen(0.04, gloss_of()))
    assert alone.states.mean[0] < 0.02 < 0.03 < first
    spectra, variables = found.draws_with_variables(2000, 1)
    left = signal - spectra @ found.relative_response.T - variables @ states.pattern.T
    # about as noisy as the photos: nothing else is left of the signals, but where a gloss would
    # have to be less than none
    middle = stats.norm.ppf(0.75) * np.sqrt(np.diag(noise))
    assert np.all(np.median(np.abs(left), axis=0) < 1.2 * middle)
    shares = found.variance_shares({PHOTO_NOISE: noise})
    assert {SURFACE_REFLECTION, SAMPLE_PLANE, METAMERISM, PHOTO_NOISE} == set(shares)
    assert sum(shares.values()) == pytest.approx(1)


def test_what_knows_no_states_has_their_mean_and_covariance():
    states = gloss_of()
    rng = np.random.default_rng(2)
    kind = rng.choice(3, 200_000, p=WEIGHTS)
    gloss = MEANS[kind] + DEVIATIONS[kind] * rng.standard_normal(kind.size)
    plain, whole = seen(states=states), without_states(seen(states=states))
    assert whole.states is None
    # 200,000 draws: 0.2 % of a deviation, and 0.5 % of a variance with these tails
    np.testing.assert_allclose(plain.signal - whole.signal, gloss.mean(), rtol=0.01)
    np.testing.assert_allclose(whole.noise_covariance - plain.noise_covariance, gloss.var(),
                               rtol=0.02)
    assert without_states(seen()) is not None and without_states(whole) is whole


def test_further_readings_have_no_gloss_and_pull_it_out_of_the_signal():
    states = gloss_of()
    readings = [Reading.at_wavelength(nm, float(np.interp(nm, NM, RED)), 0.002)
                for nm in (430, 480, 520, 560, 600, 640, 680)]
    more = condition(seen(0.03, states), readings)
    np.testing.assert_array_equal(more.states.pattern[3:], 0)
    found = solve_posterior(load_prior(), more).states
    assert found.mean[0] == pytest.approx(0.03, abs=3 * found.standard_deviation[0])
    assert found.standard_deviation[0] < 0.007
    assert found.shares["matt"] < 0.1
    # another photo of it errs by itself
    assert same_material([seen(0.03, states), seen(0.01, states)]).states is None
    assert same_material([seen(0.03, states)]).states is states


def test_signals_of_surfaces_carry_their_states_through_bands():
    states = gloss_of(bands=6)
    rows = np.vstack([RESPONSE, RESPONSE[::-1]])
    signal = np.vstack([rows @ RED, rows @ RED])
    signal[1, 4] = np.nan                                   # a band that is saturated
    noise = np.repeat((0.003**2 * np.eye(6))[None], 2, axis=0)
    signals = SurfaceSignals(
        ("a", "b"), (False, False), GRID, np.vstack([RED, RED]), tuple("abcdef"),
        np.repeat([0, 1], 3), rows, signal, {PHOTO_NOISE: noise}, (states, states))
    assert measurement(signals, 0).states.pattern.shape == (6, 1)
    assert measurement(signals, 1).states.pattern.shape == (5, 1)
    assert list(errors_by_cause(signals, 1)) == [PHOTO_NOISE]
    expected = np.sqrt(states.covariance[0, 0]) / signal[0]
    np.testing.assert_allclose(relative_errors(signals, 0)[SURFACE_REFLECTION], expected)


def test_a_band_that_photos_repeat_is_one_band_to_what_knows_no_states():
    """Its signal is the mean by the errors of each photo, and its error that of the mean."""
    once = seen()
    twice = SpectralMeasurement(once.grid, np.vstack([once.relative_response] * 2),
                                np.r_[once.signal, once.signal + 0.01],
                                np.diag(np.repeat([0.01, 0.02], 3) ** 2))
    operator, alone = spline_operator(twice, 9), spline_operator(once, 9)
    np.testing.assert_allclose(operator.A, alone.A)
    np.testing.assert_allclose(operator.y, once.signal + 0.01 / 5)
    np.testing.assert_allclose(operator.noise_covariance, np.eye(3) * 0.01**2 * 0.8)
    surfaces = SurfaceSignals(("one",), (False,), once.grid, np.full((1, once.grid.nm.size), 0.5),
                              tuple("RGBrgb"), np.repeat([0, 1], 3), twice.relative_response,
                              twice.signal[None],
                              {PHOTO_NOISE: twice.noise_covariance[None]})
    measured = measurement(surfaces, 0)
    np.testing.assert_allclose(measured.signal, once.signal + 0.01 / 5)
    np.testing.assert_allclose(measured.noise_covariance, np.eye(3) * 0.01**2 * 0.8)
