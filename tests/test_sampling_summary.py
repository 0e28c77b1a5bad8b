"""Mean, spread, band and bounds of draws against their definitions, and where the next reading
helps most.
"""
from dataclasses import replace

import numpy as np
import pytest
import sampling_cameras
from scipy import stats

from spectrabox.radiometry.bspline import basis_matrix
from spectrabox.radiometry.errors import ConvergenceError, InputError
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.records import MeasurementOperator, Outcome, SpectrumSamples
from spectrabox.sampling.polytope.bounds import reflectance_bounds
from spectrabox.sampling.polytope.tilted_rejection import sample_spectra
from spectrabox.sampling.summary import next_measurement_nm, summarise

GRID = visible_grid(1)
BASIS = basis_matrix(GRID.nm, 7)


def grey(error=0.01):
    A = sampling_cameras.camera(7)
    return MeasurementOperator(A, A @ np.random.default_rng(8).uniform(0.1, 0.9, 7),
                               error**2 * np.eye(3))


@pytest.fixture(scope="module")
def samples():
    return sample_spectra(grey(), 2_000, seed=1)


def test_mean_and_spread_are_those_of_the_spectra(samples):
    summary = summarise(samples, grey(), GRID, BASIS)
    spectra = samples.coefficients @ BASIS.T
    # Two ways to add 2000 products of order 1: 2000 eps is 5e-13.
    np.testing.assert_allclose(summary.mean, spectra.mean(axis=0), atol=1e-12)
    np.testing.assert_allclose(summary.standard_deviation, spectra.std(axis=0, ddof=0), atol=1e-10)


@pytest.mark.parametrize("level", [0.5, 0.95])
def test_the_band_leaves_equal_tails(samples, level):
    summary = summarise(samples, grey(), GRID, BASIS, level)
    spectra = samples.coefficients @ BASIS.T
    # Quantiles interpolate between neighbours: the count is off by at most one of 2000.
    np.testing.assert_allclose((spectra < summary.lower).mean(axis=0), (1 - level) / 2, atol=1e-3)
    np.testing.assert_allclose((spectra > summary.upper).mean(axis=0), (1 - level) / 2, atol=1e-3)
    assert summary.level == level


def test_weights_count_draws_as_often_as_they_say(samples):
    counts = np.random.default_rng(3).integers(1, 4, 2_000)
    weighted = replace(samples, weights=counts / counts.sum())
    repeated = replace(samples, coefficients=np.repeat(samples.coefficients, counts, axis=0))
    first, second = (summarise(some, grey(), GRID, BASIS) for some in (weighted, repeated))
    np.testing.assert_allclose(first.mean, second.mean, atol=1e-12)  # 4000 eps
    np.testing.assert_allclose(first.standard_deviation, second.standard_deviation, atol=1e-10)
    # The weighted quantile is a draw, the other interpolates between two: they differ by the gap in
    # the tails.
    np.testing.assert_allclose(first.lower, second.lower, atol=0.01)
    np.testing.assert_allclose(first.upper, second.upper, atol=0.01)


def test_bounds_are_exact_at_every_fifth_nanometre(samples):
    summary = summarise(samples, grey(), GRID, BASIS)
    lower, upper = reflectance_bounds(grey(), BASIS[::5])
    np.testing.assert_array_equal(summary.bound_lower[::5], lower)
    np.testing.assert_array_equal(summary.bound_upper[::5], upper)
    between_lower, between_upper = reflectance_bounds(grey(), BASIS[2:300:25])
    # The curves bend where the extreme spectrum changes; at a bend of 0.016 per nm, linear
    # interpolation over 5 nm is off by 5 x 0.016 / 4.
    np.testing.assert_allclose(summary.bound_lower[2:300:25], between_lower, atol=0.02)
    np.testing.assert_allclose(summary.bound_upper[2:300:25], between_upper, atol=0.02)


def test_a_coarse_grid_of_its_own_is_used_whole(samples):
    grid = visible_grid(25)
    summary = summarise(samples, grey(), grid, basis_matrix(grid.nm, 7))
    np.testing.assert_array_equal(summary.bound_lower,
                                  reflectance_bounds(grey(), basis_matrix(grid.nm, 7))[0])


def test_the_band_lies_within_the_bounds(samples):
    summary = summarise(samples, grey(), GRID, BASIS)
    # 0.1 % of white: interpolation of the bounds between their wavelengths.
    assert np.all(summary.lower > summary.bound_lower - 1e-3)
    assert np.all(summary.upper < summary.bound_upper + 1e-3)


def test_the_next_reading_goes_where_conditioning_on_it_helps_most(samples):
    covariance = np.cov(samples.coefficients @ BASIS.T, rowvar=False, ddof=0)
    best = next_measurement_nm(GRID, covariance)
    candidates = np.arange(0, 301, 10)
    left = []
    for index in candidates:
        gain = covariance[:, index] / (covariance[index, index] + 0.005**2)
        left.append(GRID.weights_nm @ np.diag(covariance - np.outer(gain, covariance[index])))
    assert abs(best - GRID.nm[candidates[np.argmin(left)]]) <= 10


def test_the_next_reading_is_where_the_only_doubt_lies():
    direction = np.exp(-0.5 * ((GRID.nm - 640) / 8)**2)
    # a grid step
    assert next_measurement_nm(GRID, 0.01 * np.outer(direction, direction)) == pytest.approx(640,
                                                                                             abs=1)


def test_the_reading_it_asks_for_narrows_real_draws():
    operator = grey(error=0.01)
    samples = sample_spectra(operator, 2_000, seed=1)
    summary = summarise(samples, operator, GRID, BASIS)
    row = basis_matrix(np.array([summary.next_measurement_nm]), 7)
    noise = np.diag([1e-4, 1e-4, 1e-4, 0.005**2])
    reading = np.interp(summary.next_measurement_nm, GRID.nm, summary.mean)
    more = MeasurementOperator(np.vstack([operator.A, row]), np.r_[operator.y, reading], noise)
    after = summarise(sample_spectra(more, 2_000, seed=2), more, GRID, BASIS)
    # One-sided at 1e-4: variances of 2000 draws are good to about 3 %, so a fall of 20 % cannot be
    # chance.
    allowed = 0.8 + stats.norm.isf(1e-4) * 0.03
    before = GRID.weights_nm @ summary.standard_deviation**2
    assert GRID.weights_nm @ after.standard_deviation**2 < allowed * before


def test_the_conditions_are_named(samples):
    text = summarise(samples, grey(), GRID, BASIS).conditional_on
    for part in ("basis of 7 functions", "between 0 and 1", "noise of 1, 1, 1 % of white",
                 "uniform"):
        assert part in text
    without_noise = sample_spectra(grey(0.0), 1_000, seed=1)
    assert "a signal without noise" in summarise(without_noise, grey(0.0), GRID,
                                                 BASIS).conditional_on
    assert summarise(samples, grey(), GRID, BASIS,
                     conditional_on="My words.").conditional_on == "My words."


def test_a_signal_out_of_reach_is_named():
    operator = MeasurementOperator(sampling_cameras.camera(7), np.array([0.1, 1.2, 0.1]),
                                   1e-4 * np.eye(3))
    summary = summarise(sample_spectra(operator, 1_000, seed=1), operator, GRID, BASIS)
    assert Outcome.UNREACHABLE.value in summary.conditional_on
    assert "No spectrum fits within the noise: the bounds allow" in summary.conditional_on


@pytest.mark.parametrize("level, needed", [(0.95, 1000), (0.9, 500), (0.5, 100), (0.99, 5000)])
def test_too_few_draws_for_a_band_are_an_error(samples, level, needed):
    few = replace(samples, effective_samples=needed - 1.0)
    match = (f"a {100 * level:g} % band needs {needed} effective draws and there are "
             f"{needed - 1}; draw more")
    with pytest.raises(ConvergenceError, match=match):
        summarise(few, grey(), GRID, BASIS, level)
    assert summarise(replace(samples, effective_samples=float(needed)), grey(), GRID, BASIS,
                     level).level == level


def test_a_basis_that_is_not_on_the_grid_is_an_error(samples):
    with pytest.raises(InputError, match=r"the basis has shape \(61, 7\); \(301, 7\) is needed"):
        summarise(samples, grey(), GRID, BASIS[::5])


def test_a_level_that_is_no_probability_is_an_error(samples):
    with pytest.raises(InputError, match=r"a level of 1\.5 was asked for"):
        summarise(samples, grey(), GRID, BASIS, level=1.5)


def test_one_certain_spectrum_has_no_spread():
    A = np.eye(7)
    operator = MeasurementOperator(A, np.linspace(0.2, 0.8, 7), np.zeros((7, 7)))
    point = SpectrumSamples(np.tile(operator.y, (1000, 1)), None, "given", 1.0, 1000.0, 0,
                            Outcome.EXACT)
    summary = summarise(point, operator, GRID, BASIS)
    np.testing.assert_allclose(summary.standard_deviation, 0, atol=1e-7)  # the root of 1e-15
    # the solver's tolerance
    np.testing.assert_allclose(summary.bound_upper - summary.bound_lower, 0, atol=1e-6)
