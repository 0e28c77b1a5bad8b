import numpy as np
import pytest
from scipy.interpolate import BSpline

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import basis_matrix, knots_nm, visible_grid
from spectrabox.radiometry.interreflection import relative_operator, response_matrix, white_signal

GRID = visible_grid()


@pytest.mark.parametrize("coefficients", [4, 5, 7, 10, 21, 40])
def test_the_basis_is_a_partition_of_unity(coefficients):
    basis = basis_matrix(GRID.nm, coefficients)
    assert basis.shape == (301, coefficients)
    assert basis.min() >= 0
    # Four products of numbers up to 1 are added: a few eps.
    np.testing.assert_allclose(basis.sum(axis=1), 1, atol=1e-14)


@pytest.mark.parametrize("coefficients", [5, 9, 15])
def test_coefficients_in_the_unit_box_give_reflectance_in_it(coefficients):
    c = np.random.default_rng(3).uniform(size=(200, coefficients))
    reflectance = c @ basis_matrix(GRID.nm, coefficients).T
    # round-off of the partition of unity
    assert reflectance.min() >= 0 and reflectance.max() <= 1 + 1e-14


@pytest.mark.parametrize("coefficients", [4, 5, 11, 40])
def test_the_basis_is_that_of_scipy(coefficients):
    nm = np.linspace(400.0, 700.0, 301)
    theirs = BSpline.design_matrix(nm, knots_nm(coefficients), 3).toarray()
    # Three steps of the recursion, each of numbers up to 1, whatever order SciPy adds them in.
    np.testing.assert_allclose(basis_matrix(nm, coefficients), theirs, rtol=0, atol=1e-14)


def test_wavelengths_outside_the_basis_are_refused():
    with pytest.raises(InputError, match="splines cover 400-700 nm, and 390-700 nm are asked for"):
        basis_matrix(np.array([390.0, 700.0]), 5)


def test_too_few_coefficients_are_refused():
    with pytest.raises(InputError, match="at least 4 coefficients; 3 were asked for"):
        basis_matrix(GRID.nm, 3)


def test_the_signal_is_linear_in_reflectance_and_white_reads_one():
    sensitivities = np.array([np.exp(-0.5 * ((GRID.nm - peak) / 30) ** 2) for peak in (450, 540,
                                                                                       610)])
    light = 0.5 + 0.5 * np.sin(GRID.nm / 40) ** 2
    response = response_matrix(GRID, sensitivities, light)
    basis = basis_matrix(GRID.nm, 9)
    operator = relative_operator(response, basis)
    # sums of 301 terms: 301 eps at most
    np.testing.assert_allclose(operator @ np.ones(9), 1, atol=1e-13)
    c = np.random.default_rng(5).uniform(size=9)
    np.testing.assert_allclose(operator @ c, response @ (basis @ c) / white_signal(response),
                               rtol=1e-12)
