"""The maximum-entropy tilt: its moments against quadrature, its optimality, and signals at and
beyond the edge.
"""
import numpy as np
import pytest
from sampling_cameras import camera, measurement
from scipy.integrate import quad

from spectrabox.radiometry.errors import ConvergenceError, InputError
from spectrabox.sampling.polytope.tilt import (
    GRADIENT_ATOL,
    SERIES_BELOW,
    max_entropy_tilt,
    tilt_moments,
)
from spectrabox.sampling.spectral_measurement import MeasurementOperator


@pytest.mark.parametrize("h",
                         [-300.0, -8.0, -0.3, -0.011, -0.009, 0.0, 1e-5, 0.009, 0.011, 2.0, 40.0])
def test_moments_agree_with_quadrature(h):
    top = max(h, 0.0)
    integral, first = (quad(lambda c, p=p: c**p * np.exp(h * c - top), 0, 1, epsabs=1e-13,
                            points=[1e-3, 0.999])[0]
                       for p in (0, 1))
    mean = first / integral
    second = quad(lambda c: (c - mean)**2 * np.exp(h * c - top), 0, 1, epsabs=1e-13,
                  points=[1e-3, 0.999])[0]
    # Quadrature is good to 1e-12; the closed forms lose eps / h^2 by cancellation, at most 3e-12 at
    # the switch.
    np.testing.assert_allclose(tilt_moments(np.array(h)),
                               [np.log(integral) + top, mean, second / integral], atol=2e-11)


@pytest.mark.parametrize("sign", [-1, 1])
def test_series_and_closed_form_meet_where_they_switch(sign):
    below, above = (tilt_moments(np.array(sign * SERIES_BELOW * (1 + shift)))
                    for shift in (-1e-9, 1e-9))
    # The next terms of the series, h^4 / 2880, h^5 / 30240 and h^4 / 6048 at h = 0.01, are under
    # 4e-12; eps / h^2 too.
    np.testing.assert_allclose(np.array(below), np.array(above), atol=2e-11)


def means(operator):
    """Means (N,) of the coefficients under the tilt."""
    return tilt_moments(max_entropy_tilt(operator)[0] @ operator.A)[1]


def gradient(operator):
    """Largest of F by theta. The stopping rule is of whitened rows: |A| is 1 as every row of A sums
    to 1.
    """
    theta, _ = max_entropy_tilt(operator)
    return np.abs(operator.A @ means(operator) - operator.y
                  + operator.noise_covariance @ theta).max()


@pytest.mark.parametrize("coefficients, bands", [(4, 4), (5, 3), (9, 3), (21, 3), (13, 6)])
@pytest.mark.parametrize("error", [0.0, 1e-3, 0.05])
def test_means_reproduce_the_signal_up_to_the_noise(coefficients, bands, error):
    A = camera(coefficients, bands)
    operator = measurement(A, A @ np.random.default_rng(2).uniform(0.1, 0.9, coefficients), error)
    assert max_entropy_tilt(operator)[1]
    c = means(operator)
    assert np.all((c > 0) & (c < 1))
    assert gradient(operator) < GRADIENT_ATOL


def test_the_negative_of_a_signal_has_the_negative_tilt():
    A = camera(9)
    y = A @ np.random.default_rng(4).uniform(size=9)
    positive, negative = means(measurement(A, y)), means(measurement(A, 1 - y))
    # Both stop at a gradient under 1e-10; the smallest singular value of the Hessian here is above
    # 1e-4.
    np.testing.assert_allclose(negative, 1 - positive, atol=1e-6)


@pytest.mark.parametrize("coefficients", [5, 9, 21])
@pytest.mark.parametrize("error", [1e-4, 0.01, 0.1])
def test_noise_gives_every_signal_a_tilt(coefficients, error):
    operator = measurement(camera(coefficients), np.array([0.1, 1.2, -0.1]), error)
    assert not max_entropy_tilt(operator)[1]
    assert gradient(operator) < GRADIENT_ATOL


def test_a_signal_out_of_reach_without_noise_is_an_error():
    match = (r"no 7 coefficients between 0 and 1 give the signal \(0\.1, 0\.9, 1\.2\); state "
             r"the noise")
    with pytest.raises(ConvergenceError, match=match):
        max_entropy_tilt(measurement(camera(7), np.array([0.1, 0.9, 1.2])))


@pytest.mark.parametrize("reflectance", [0.0, 1.0])
def test_perfect_black_and_white_without_noise_are_on_the_edge(reflectance):
    A = camera(7)
    with pytest.raises(ConvergenceError, match="lies on the edge of what reflectances between 0 "
                       "and 1 can give"):
        max_entropy_tilt(measurement(A, A @ np.full(7, reflectance)))
    assert max_entropy_tilt(measurement(A, A @ np.full(7, reflectance), 1e-3))[1]


@pytest.mark.parametrize("field", ["A", "y", "noise_covariance"])
def test_numbers_that_are_not_finite_are_an_error(field):
    fields = {"A": camera(7), "y": np.full(3, 0.5), "noise_covariance": np.eye(3)}
    fields[field] = fields[field].copy()
    fields[field].flat[0] = np.nan
    with pytest.raises(InputError, match=f"{field} of the measurement holds numbers that are not "
                       "finite"):
        max_entropy_tilt(MeasurementOperator(**fields))


def test_more_bands_than_coefficients_are_an_error():
    with pytest.raises(InputError, match="8 bands over-determine 5 coefficients: nothing is left "
                       "to sample"):
        max_entropy_tilt(measurement(camera(5, 8), np.full(8, 0.5)))


@pytest.mark.parametrize("covariance",
                         [-np.eye(3), np.triu(np.ones((3, 3))), np.ones((3, 3)) - 0.5 * np.eye(3)])
def test_a_covariance_that_is_none_is_an_error(covariance):
    with pytest.raises(InputError, match="not symmetric positive semi-definite"):
        max_entropy_tilt(MeasurementOperator(camera(7), np.full(3, 0.5), covariance))


def test_a_covariance_of_lower_rank_is_allowed():
    operator = MeasurementOperator(camera(7), np.full(3, 0.4), 1e-4 * np.ones((3, 3)))
    assert gradient(operator) < GRADIENT_ATOL
