"""Draws from the exact posterior: constraints, closed forms, plain rejection as reference,
calibration on average.

Statistical tests have a significance of 1e-4 over each test (Bonferroni), at fixed seeds.
"""
import numpy as np
import pytest
from sampling_cameras import camera, grey, measurement
from scipy import stats
from scipy.optimize import linprog, lsq_linear

from spectrabox.radiometry.errors import CalibrationError, ConvergenceError, InputError
from spectrabox.radiometry.grid import basis_matrix
from spectrabox.radiometry.records.spectra import Outcome
from spectrabox.sampling.polytope.tilt import max_entropy_tilt, null_space, tilt_moments
from spectrabox.sampling.polytope.tilted_rejection import (
    collect,
    draw_tilted,
    sample_polytope,
    tilted_proposals,
)
from spectrabox.sampling.published.per_axis_box import axis_intervals, sample_per_axis
from spectrabox.sampling.spectral_measurement import MeasurementOperator

SIGNIFICANCE = 1e-4
NM = np.linspace(400, 700, 31)


def assert_same_law(first, second):
    """Two-sample Kolmogorov-Smirnov in every column, Bonferroni-corrected."""
    p = np.array([stats.ks_2samp(a, b).pvalue for a, b in zip(first.T, second.T, strict=True)])
    assert p.min() > SIGNIFICANCE / len(p)


def assert_mean_and_covariance(c, mean, covariance):
    """Z-tests of every mean and every product about the known mean, Bonferroni-corrected."""
    centred = c - mean
    products = np.einsum("ti,tj->tij", centred, centred).reshape(len(c), -1)
    values, expected = np.hstack([c, products]), np.r_[mean, covariance.ravel()]
    z = (values.mean(axis=0) - expected) / (values.std(axis=0) / np.sqrt(len(c)))
    assert np.abs(z).max() < stats.norm.isf(SIGNIFICANCE / 2 / z.size)


def means(operator):
    """Coefficients that give the signal, those of the tilt in the mean."""
    return tilt_moments(max_entropy_tilt(operator)[0] @ operator.A)[1]


def draws_from_bounding_box(operator, draws, rng):
    """Uniform draws of {A c = y, 0 <= c <= 1}: uniform in the bounding box of the null coordinates,
    then filtered.
    """
    start, Z = means(operator), null_space(operator)
    low, high = ([sign * linprog(sign * z, A_eq=operator.A, b_eq=operator.y, bounds=(0, 1)).fun
                  - z @ start
                  for z in Z.T] for sign in (1, -1))
    kept = np.empty((0, len(Z)))
    while len(kept) < draws:
        c = start + rng.uniform(low, high, (20_000, Z.shape[1])) @ Z.T
        kept = np.vstack([kept, c[np.all((c >= 0) & (c <= 1), axis=1)]])
    return kept[:draws]


def draws_by_likelihood(operator, draws, rng):
    """Draws of the posterior: c uniform in the box, accepted with the Gaussian likelihood."""
    precision = np.linalg.inv(operator.noise_covariance)
    kept = np.empty((0, operator.A.shape[1]))
    while len(kept) < draws:
        c = rng.uniform(size=(200_000, operator.A.shape[1]))
        distance = c @ operator.A.T - operator.y
        chi_square = np.einsum("tk,kl,tl->t", distance, precision, distance)
        kept = np.vstack([kept, c[-2 * np.log1p(-rng.random(len(c))) > chi_square]])
    return kept[:draws]


@pytest.mark.parametrize("coefficients, bands",
                         [(4, 4), (5, 3), (7, 3), (9, 3), (21, 3), (31, 3), (13, 5), (21, 6)])
def test_draws_without_noise_reproduce_the_signal_inside_the_box(coefficients, bands):
    operator = grey(coefficients, bands=bands)
    samples, _, outcome = sample_polytope(operator, 500, seed=1)
    assert samples.shape == (500, coefficients)
    assert samples.min() >= 0
    assert samples.max() <= 1
    # One K x K solve with numbers of order 1 and a condition number under 1e3.
    np.testing.assert_allclose(samples @ operator.A.T, np.tile(operator.y, (500, 1)), atol=1e-12)
    assert outcome is Outcome.EXACT


@pytest.mark.parametrize("error", [0.0, 0.02])
def test_a_seed_gives_the_same_draws_bit_for_bit(error):
    operator = grey(9, error)
    first, same, other = (sample_polytope(operator, 300, seed)[0] for seed in (5, 5, 6))
    np.testing.assert_array_equal(first, same)
    assert not np.any(first == other)


@pytest.mark.parametrize("signal_seed", [8, 9, 10])
def test_draws_without_noise_follow_the_law_of_plain_rejection(signal_seed):
    operator = grey(5, seed=signal_seed)
    basis = basis_matrix(NM, 5)
    reference = draws_from_bounding_box(operator, 10_000, np.random.default_rng(2))
    assert_same_law(sample_polytope(operator, 10_000, seed=3)[0] @ basis.T, reference @ basis.T)


SIGNALS_WITH_NOISE = {
    "within reach": (np.array([0.4, 0.5, 0.6]), 0.04 * np.eye(3)),
    "dark": (np.array([0.03, 0.05, 0.02]), 0.01 * np.eye(3)),
    "correlated noise": (np.array([0.3, 0.4, 0.6]),
                         0.02 * (np.ones((3, 3)) + np.diag([0.3, 1, 2]))),
    "out of reach": (np.array([0.2, 1.05, 0.3]), 0.05 * np.eye(3)),
    }


@pytest.mark.parametrize("case", SIGNALS_WITH_NOISE)
def test_draws_with_noise_follow_the_law_of_plain_rejection(case):
    operator = MeasurementOperator(camera(5), *SIGNALS_WITH_NOISE[case])
    basis = basis_matrix(NM, 5)
    reference = draws_by_likelihood(operator, 5_000, np.random.default_rng(2))
    samples, _, _ = sample_polytope(operator, 5_000, seed=3)
    assert_same_law(samples @ basis.T, reference @ basis.T)
    assert_same_law(samples @ operator.A.T, reference @ operator.A.T)


@pytest.mark.parametrize("error", [0.0, 0.02])
@pytest.mark.parametrize("shift", [np.zeros(3), np.array([3.0, -2.0, 1.0])])
def test_the_law_does_not_depend_on_the_tilt(error, shift):
    operator = grey(7, error)
    best, _ = max_entropy_tilt(operator)
    other = best + shift if shift.any() else np.zeros(3)
    first, second = (collect(tilted_proposals(operator, theta, np.random.default_rng(seed)),
                             4_000)[0]
                     for seed, theta in enumerate((best, other)))
    assert_same_law(first, second)


@pytest.mark.parametrize("total", [0.2, 0.7, 1.0])
@pytest.mark.parametrize("coefficients", [2, 4, 9])
def test_draws_on_a_simplex_have_the_moments_of_dirichlet(total, coefficients):
    A = np.full((1, coefficients), 1 / coefficients)
    c, _, _ = sample_polytope(measurement(A, np.array([total / coefficients])), 20_000, seed=4)
    # For a sum s <= 1 the upper limits never bind and c / s is Dirichlet(1, ..., 1).
    covariance = total**2 * (np.eye(coefficients) - 1 / coefficients) / (coefficients
                                                                         * (coefficients + 1))
    assert_mean_and_covariance(c, np.full(coefficients, total / coefficients), covariance)


@pytest.mark.parametrize("error", [1e-6, 0.02, 0.3, 5.0])
def test_a_camera_of_single_coefficients_gives_truncated_normals(error):
    y = np.array([0.1, 1 + 3 * error, 0.8])
    c, _, _ = sample_polytope(measurement(np.eye(3, 5), y, error), 5_000, seed=6)
    laws = [stats.truncnorm(-value / error, (1 - value) / error, value,
                            error) for value in y] + [stats.uniform()] * 2
    p = [stats.kstest(column, law.cdf).pvalue for column, law in zip(c.T, laws, strict=True)]
    assert min(p) > SIGNIFICANCE / len(p)


@pytest.mark.parametrize("coefficients", [5, 9, 21])
@pytest.mark.parametrize("error", [1e-4, 1e-2])
@pytest.mark.parametrize("y", [(1.0, 1.0, 1.0), (0.1, 1.2, 0.1), (-0.05, 0.0, 0.02)])
def test_signals_at_and_beyond_the_edge_are_drawn_at_a_good_rate(coefficients, error, y):
    operator = measurement(camera(coefficients), np.array(y), error)
    _, acceptance, outcome = sample_polytope(operator, 500, seed=1)
    # Below 1 % a thousand draws take tens of ms; 2 % is the smallest that was measured.
    assert acceptance > 0.01
    assert outcome is (Outcome.EXACT if y[0] == 1.0 else Outcome.UNREACHABLE)


@pytest.mark.parametrize("h", [-2000.0, -5.0, 0.0, 1e-9, 0.7, 30.0, 2000.0])
def test_tilted_coordinates_follow_their_density(h):
    u = np.random.default_rng(3).random((5_000, 1))
    c = draw_tilted(np.array([h]), u)[:, 0]
    assert np.all((c >= 0) & (c <= 1))
    a = max(abs(h), 1e-12)
    mirrored = 1 - c if h > 0 else c
    assert stats.kstest(mirrored, lambda x: np.expm1(-a * x) / np.expm1(-a)).pvalue > SIGNIFICANCE


def test_a_hopeless_acceptance_is_an_error():
    with pytest.raises(ConvergenceError,
                       match=r"only 0 of 2\d* proposals were accepted; use fewer coefficients"):
        collect(lambda proposals: np.empty((0, 7)), 10)


@pytest.mark.parametrize("draws", [0, -3])
def test_asking_for_no_draws_is_an_error(draws):
    with pytest.raises(InputError, match=f"{draws} draws were asked for; ask for at least 1"):
        sample_polytope(grey(7), draws, seed=0)


def test_errors_of_the_measurement_reach_the_caller():
    A = camera(7)
    with pytest.raises(ConvergenceError, match="no 7 coefficients between 0 and 1 give the signal"):
        sample_polytope(measurement(A, np.array([0.1, 1.2, 0.1])), 10, seed=0)
    with pytest.raises(InputError, match="not symmetric positive semi-definite"):
        sample_polytope(MeasurementOperator(A, np.full(3, 0.5), -np.eye(3)), 10, seed=0)
    with pytest.raises(CalibrationError, match="only 2 independent responses"):
        sample_polytope(measurement(A[[0, 1, 1]], np.full(3, 0.5)), 10, seed=0)


# ---- the sampler as published, for comparison ----------------------------------------------------

def test_the_published_sampler_keeps_the_signal_but_understates_the_spread():
    operator = grey(9)
    basis = basis_matrix(NM, 9)
    c0 = lsq_linear(operator.A, operator.y, bounds=(0, 1), tol=1e-12).x
    published, outcome = sample_per_axis(operator, c0, 5_000, seed=1)
    exact, _, _ = sample_polytope(operator, 5_000, seed=1)
    # Round-off of c0 + Z z, with numbers of order 1 and a c0 good to 1e-8.
    np.testing.assert_allclose(published @ operator.A.T, np.tile(operator.y, (5_000, 1)),
                               atol=1e-8)
    spread = (published @ basis.T).std(axis=0) / (exact @ basis.T).std(axis=0)
    # One-sided: standard deviations of 5000 draws are good to 1 %, the shortfall near the box's
    # corners is far more.
    assert spread.min() < 0.9
    assert outcome is Outcome.CONVERGED


def test_the_published_intervals_end_where_a_coefficient_reaches_zero_or_one():
    operator = grey(7)
    start, directions = means(operator), null_space(operator)
    for ends in axis_intervals(start, directions):
        at_ends = start[:, None] + directions * ends
        distance = np.minimum(np.abs(at_ends), np.abs(1 - at_ends)).min(axis=0)
        # one product and one sum of numbers of order 1
        np.testing.assert_allclose(distance, 0, atol=1e-14)
        assert np.all((at_ends > -1e-14) & (at_ends < 1 + 1e-14))


def test_the_published_sampler_refuses_a_start_outside_the_box():
    with pytest.raises(InputError,
                       match=r"c0 runs from -0\.1 to 0\.5; the method needs a start within 0 to 1"):
        sample_per_axis(grey(7), np.r_[-0.1, np.full(6, 0.5)], 10, seed=0)
    with pytest.raises(InputError, match=r"c0 has shape \(6,\); \(7,\) is needed"):
        sample_per_axis(grey(7), np.full(6, 0.5), 10, seed=0)


def test_the_published_sampler_says_when_its_start_is_not_the_signal():
    assert sample_per_axis(grey(7), np.full(7, 0.5), 10, seed=0)[1] is Outcome.UNREACHABLE
