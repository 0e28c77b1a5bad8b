"""The polynomial of interreflections against closed forms: geometric series, finite differences,
permutation.
"""
from __future__ import annotations

import math

import numpy as np
import pytest

from spectrabox.radiometry.interreflection import (
    band_products_jacobian,
    encountered,
    exponents_up_to,
    lower_products,
    product_after,
    product_count,
    products,
    pruned,
    signal,
)

SIZES = [(1, 1), (1, 6), (3, 6), (5, 4)]  # materials, bounces
EPS = np.finfo(float).eps


@pytest.mark.parametrize("materials, bounces", SIZES)
def test_there_is_one_product_for_every_way_to_share_the_bounces(materials, bounces):
    exponents = exponents_up_to(materials, bounces)
    assert len(exponents) == product_count(materials, bounces) == math.comb(materials + bounces,
                                                                            materials)
    assert len(np.unique(exponents, axis=0)) == len(exponents)
    assert exponents.sum(axis=1).max() == bounces and not exponents[0].any()
    assert np.all(np.diff(exponents.sum(axis=1)) >= 0)


@pytest.mark.parametrize("materials, bounces", SIZES)
def test_a_reflection_more_and_a_reflection_less_undo_each_other(materials, bounces):
    exponents = exponents_up_to(materials, bounces)
    following, lower = product_after(exponents), lower_products(exponents)
    for m in range(materials):
        for number in np.flatnonzero(following[:-1, m] < len(exponents)):
            assert lower[following[number, m], m] == number
    # What is dropped stays dropped: a path may not come back to a product that it has passed.
    assert np.all(following[-1] == len(exponents))


@pytest.mark.parametrize("materials, bounces", SIZES)
def test_a_product_is_the_product_of_its_powers(materials, bounces):
    exponents = exponents_up_to(materials, bounces)
    reflectances = np.random.default_rng(1).uniform(0, 1, (materials, 7))
    reflectances[0, 0] = 0.0
    expected = np.prod(reflectances[None] ** exponents[:, :, None], axis=1)
    # One rounding per factor, in either form.
    np.testing.assert_allclose(products(exponents, reflectances), expected,
                               rtol=2 * (bounces + 1) * EPS)


def test_a_white_furnace_is_a_geometric_series():
    """Inside a closed sphere of reflectance rho every bounce brings rho times the one before."""
    bounces, rho = 40, np.array([[0.0, 0.3, 0.7]])
    exponents = exponents_up_to(1, bounces)
    response = np.array([[1.0, 2.0, 0.5]])
    radiance = products(exponents, rho).sum(axis=0)
    # Round-off of a sum of 41 terms of at most 1.
    np.testing.assert_allclose(radiance, (1 - rho[0] ** (bounces + 1)) / (1 - rho[0]),
                               rtol=100 * EPS)
    total = signal(np.ones((1, len(exponents))), exponents, rho, response)
    np.testing.assert_allclose(total, (radiance @ response.T)[None], rtol=100 * EPS)


def test_the_derivative_is_that_of_the_signal():
    rng = np.random.default_rng(2)
    exponents = exponents_up_to(3, 4)
    basis = rng.uniform(size=(9, 4))
    basis /= basis.sum(axis=1, keepdims=True)
    coefficients = rng.uniform(0.1, 0.9, (3, 4))
    response = rng.uniform(size=(2, 9))
    _, jacobian = band_products_jacobian(exponents, coefficients @ basis.T, response, basis, (0, 2))
    step = 1e-6
    for place, m in enumerate((0, 2)):
        for n in range(4):
            moved = [coefficients.copy(), coefficients.copy()]
            moved[0][m, n] += step
            moved[1][m, n] -= step
            up, down = (products(exponents, c @ basis.T) @ response.T for c in moved)
            # Central differences: step^2 times a third derivative of at most 4 * 3 * 2 * 9, and
            # round-off eps / step.
            np.testing.assert_allclose(jacobian[:, :, place, n], (up - down) / (2 * step),
                                       atol=1e-9 + 300 * step**2)


def test_the_derivative_exists_where_a_material_is_black():
    exponents = exponents_up_to(2, 3)
    _, jacobian = band_products_jacobian(exponents, np.zeros((2, 3)), np.ones((1, 3)), np.eye(3),
                                         (0, 1))
    first = (exponents.sum(axis=1) == 1)
    assert np.all(np.isfinite(jacobian)) and not jacobian[~first].any() and jacobian[first].any()


def test_the_names_of_the_materials_do_not_matter():
    rng = np.random.default_rng(3)
    exponents = exponents_up_to(3, 4)
    reflectances, response = rng.uniform(size=(3, 5)), rng.uniform(size=(2, 5))
    transport = rng.uniform(size=(6, len(exponents)))
    order = [2, 0, 1]
    rows = {tuple(row): number for number, row in enumerate(exponents[:, order].tolist())}
    renamed = transport[:, [rows[tuple(row)] for row in exponents.tolist()]]
    # Sums of 35 positive terms in another order.
    np.testing.assert_allclose(signal(renamed, exponents, reflectances[order], response),
                               signal(transport, exponents, reflectances, response), rtol=100 * EPS)


def test_lights_add():
    rng = np.random.default_rng(4)
    exponents = exponents_up_to(2, 3)
    transport = rng.uniform(size=(5, 2, len(exponents)))
    reflectances, response = rng.uniform(size=(2, 4)), rng.uniform(size=(2, 3, 4))
    apart = sum(signal(transport[:, light], exponents, reflectances, response[light])
                for light in range(2))
    np.testing.assert_allclose(signal(transport, exponents, reflectances, response), apart,
                               rtol=100 * EPS)


@pytest.mark.parametrize("share", [0.0, 1e-4, 1e-2, 0.3])
def test_pruning_never_loses_more_than_it_says(share):
    rng = np.random.default_rng(5)
    exponents = exponents_up_to(3, 6)
    transport = rng.uniform(size=len(exponents)) * 0.4 ** exponents.sum(axis=1)
    kept = pruned(exponents, transport, brightest=0.9, share=share)
    names = {tuple(row) for row in kept.tolist()}
    among = np.array([tuple(row) in names for row in exponents.tolist()])
    for spectrum in (np.full((3, 1), 0.9), np.array([[0.9], [0.5], [0.1]])):
        values = transport * products(exponents, spectrum)[:, 0]
        # the bound is met at most at the reflectance that it is stated for; round-off of a sum
        whole = (transport * 0.9 ** exponents.sum(axis=1)).sum()
        assert values[~among].sum() <= share * whole * (1 + 1e-12)
    lower = lower_products(kept)
    # every kept product is reached through kept ones
    assert ((lower < len(kept)) == (kept > 0)).all()
    assert np.all(np.diff(kept.sum(axis=1)) >= 0)


def test_products_are_made_as_paths_meet_them_in_any_order():
    met = np.array([[0, 1, 2], [1, 0, 3], [2, 2, 3], [3, 3, 3]])    # 3: the path has ended
    contributions = np.array([[1, 2, 4, 8], [16, 32, 64, 0], [128, 0, 256, 0], [512, 0, 0, 0.0]])
    exponents, sums = encountered(met, contributions, 3)
    expected = {(0, 0, 0): 1 + 16 + 128 + 512, (1, 0, 0): 2, (0, 1, 0): 32, (0, 0, 1): 0,
                (1, 1, 0): 4 + 64, (0, 0, 2): 256, (1, 1, 1): 8}
    assert dict(zip(map(tuple, exponents.tolist()), sums, strict=True)) == expected
    assert not exponents[0].any() and np.all(np.diff(exponents.sum(axis=1)) >= 0)
