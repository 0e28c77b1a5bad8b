"""Null directions of the camera: laws of the singular value decomposition, and cameras with blind
bands.
"""
import numpy as np
import pytest

from spectrabox.radiometry.errors import CalibrationError
from spectrabox.sampling.polytope.tilt import null_space
from spectrabox.sampling.spectral_measurement import MeasurementOperator

EPS = np.finfo(float).eps


def operator(A):
    return MeasurementOperator(A, np.full(len(A), 0.5), np.zeros((len(A), len(A))))


@pytest.mark.parametrize("bands, coefficients",
                         [(1, 4), (3, 5), (3, 7), (3, 20), (8, 20), (4, 4), (5, 3)])
def test_the_camera_cannot_see_a_null_direction(bands, coefficients):
    A = np.random.default_rng(7).uniform(size=(bands, coefficients))
    directions = null_space(operator(A))
    assert directions.shape == (coefficients, coefficients - min(bands, coefficients))
    # The SVD is backward stable: error is a few eps times |A|, so 50 eps |A| cannot hide a bug.
    np.testing.assert_allclose(A @ directions, 0, atol=50 * EPS * np.linalg.norm(A, 2))


@pytest.mark.parametrize("bands, coefficients", [(3, 7), (8, 20)])
def test_null_directions_are_orthonormal_and_with_the_rows_span_everything(bands, coefficients):
    A = np.random.default_rng(3).uniform(size=(bands, coefficients))
    directions = null_space(operator(A))
    # Products of orthonormal vectors of length N are good to about N eps.
    np.testing.assert_allclose(directions.T @ directions, np.eye(coefficients - bands),
                               atol=10 * coefficients * EPS)
    assert np.linalg.matrix_rank(np.vstack([A, directions.T])) == coefficients


def test_scaling_a_camera_leaves_what_it_cannot_see():
    A = np.random.default_rng(5).uniform(size=(3, 9))
    first = null_space(operator(A))
    second = null_space(operator(np.diag([2.0, 5.0, 0.1]) @ A))
    # Projectors are compared, as a basis may rotate; the rows span a well-conditioned space: 1e3
    # eps.
    np.testing.assert_allclose(first @ first.T, second @ second.T, atol=1e3 * EPS)


def test_two_channels_that_respond_alike_are_an_error():
    A = np.random.default_rng(1).uniform(size=(3, 7))
    A[2] = 2 * A[1]
    with pytest.raises(CalibrationError,
                       match="3 camera channels carry only 2 independent responses"):
        null_space(operator(A))


def test_a_camera_that_sees_nothing_has_rank_zero():
    with pytest.raises(CalibrationError, match="carry only 0 independent responses"):
        null_space(operator(np.zeros((3, 7))))
