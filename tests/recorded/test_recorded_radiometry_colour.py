"""Recorded: colours, splines, grids, covariances and products of reflectances."""
import numpy as np
import pytest
from recorded_refusals import said

from spectrabox.radiometry.appearance import (
    adapted_tristimulus,
    delta_e00,
    encoded_srgb,
    reflectance_to_srgb,
    tristimulus,
    tristimulus_weights,
)
from spectrabox.radiometry.bspline import basis_matrix, knots_nm
from spectrabox.radiometry.colour_difference import ciede2000, lab_from_xyz
from spectrabox.radiometry.colour_upsampling import METHODS, observer_response, upsampled
from spectrabox.radiometry.covariance import (
    block_diagonal,
    chance_beyond,
    chi_square_beyond,
    is_covariance,
    symmetric,
)
from spectrabox.radiometry.grid import (
    grid_from_nm,
    interpolation_matrix,
    trapezoid_weights_nm,
    visible_grid,
)
from spectrabox.radiometry.interreflection import (
    band_products,
    band_products_jacobian,
    exponents_up_to,
    lower_products,
    lower_table,
    product_after,
    product_count,
    products,
    prune,
    signal,
)
from spectrabox.radiometry.published.tables import (
    CHARTS,
    COLOURS,
    LIGHTS,
    OBSERVERS,
    all_published,
    published_colours,
    published_curves,
    published_names,
)
from spectrabox.radiometry.response import relative_operator, response_matrix, white_signal
from spectrabox.radiometry.spectra.luminous import colour_matching, luminance_of, tristimulus_of

UNEVEN_NM = np.array([371.0, 402.5, 431.0, 455.0, 490.5, 522.0, 561.0, 604.0, 640.5, 699.0, 745.0])
REDDISH = 0.06 + 0.5 / (1 + np.exp((590 - UNEVEN_NM) / 23)) + 0.04 * np.sin(UNEVEN_NM / 31)
GREENISH = 0.11 + 0.37 * np.exp(-((UNEVEN_NM - 533) / 47) ** 2)


def test_colours_of_reflectances(recorded):
    nm = UNEVEN_NM
    recorded({
        "srgb": [reflectance_to_srgb(nm, each) for each in (REDDISH, GREENISH, 0.001 * GREENISH)],
        "xyz": [tristimulus(nm, each) for each in (REDDISH, GREENISH)],
        "delta e": delta_e00(nm, REDDISH, GREENISH), "small": delta_e00(nm, REDDISH,
                                                                        1.02 * REDDISH),
        "weights": tristimulus_weights(nm, "A"), "adapted": adapted_tristimulus(nm, "FL2"),
        "no light": said(lambda: tristimulus_weights(nm, "D66")),
        # over the knee of the curve, and over both ends
        "encoded": [encoded_srgb(level * np.array([0.95, 1.0, 1.09]))
                    for level in (-0.01, 0.0029, 0.0031, 0.0033, 0.2, 0.99, 1.02)]})
    # what is white under a light looks white to an eye that has adapted to it
    np.testing.assert_allclose(adapted_tristimulus(nm, "FL2").sum(axis=1),
                               tristimulus(nm, np.ones(nm.size)), rtol=1e-9)


def test_differences_of_colours(recorded):
    rng = np.random.default_rng(41)
    first = np.column_stack([rng.uniform(2, 98, 400), rng.uniform(-90, 90, (400, 2))])
    near = first + rng.normal(0, 2, first.shape)
    opposite = first * [1, -1, -1] + rng.normal(0, 0.2, first.shape)
    greys = first * [1, 0, 0]
    xyz = np.geomspace(1e-3, 1.1, 24).reshape(8, 3) * [0.9, 1, 1.2]
    recorded({"near": ciede2000(first, near), "far": ciede2000(first, first[::-1]),
              "opposite": ciede2000(first, opposite), "greys": ciede2000(greys, near),
              "two greys": ciede2000(greys, greys[::-1]),
              "lab": lab_from_xyz(xyz, np.array([0.95, 1.0, 1.09])),
              # about (6/29)^3, where the cube root becomes a line
              "dark": lab_from_xyz(np.outer([0.00880, 0.00885, 0.00886, 0.00890],
                                            [0.95, 1, 1.09]), np.array([0.96, 1.01, 1.08]))})
    np.testing.assert_allclose(ciede2000(near, first), ciede2000(first, near), rtol=1e-12)


def test_splines_and_grids(recorded):
    inside = np.array([400.0, 400.5, 433.0, 475.0, 550.0, 562.5, 601.0, 699.5, 700.0])
    recorded({
        "knots": [knots_nm(count) for count in (4, 5, 9)],
        "basis": [basis_matrix(inside, count) for count in (4, 5, 9, 12)],
        "too few": said(lambda: knots_nm(3)),
        "outside": [said(lambda nm=nm: basis_matrix(np.array([nm, 500.0]), 6).shape)
                    for nm in (399.99, 400.0, 700.0, 700.01)],
        "weights": trapezoid_weights_nm(UNEVEN_NM), "grid": grid_from_nm(UNEVEN_NM),
        "ascending": [said(lambda nm=nm: grid_from_nm(np.array(nm)).weights_nm) for nm in
                      ([400.0], [400.0, 401.0], [400.0, 400.0], [401.0, 400.0])],
        "visible": [visible_grid(step) for step in (50, 30)], "fine": visible_grid().nm.size,
        "between": interpolation_matrix(UNEVEN_NM, np.array([350.0, 402.5, 440.0, 700, 800]))})
    np.testing.assert_allclose(basis_matrix(inside, 9).sum(axis=1), 1, rtol=1e-12)


def test_covariances(recorded):
    rng = np.random.default_rng(5)
    root = rng.normal(size=(4, 4))
    whole = root @ root.T
    largest = np.abs(whole).max()
    skew, sunk = np.zeros((4, 4)), np.diag([1.0, 2.0, 3.0, 0.0])
    skew[0, 2] = largest

    def kept(off, rtol):
        return is_covariance(whole + off * skew, rtol)

    def above(low, rtol):
        return is_covariance(sunk + np.diag([0, 0, 0, -3 * low]), rtol)
    recorded({
        "asymmetry": {f"{off} {rtol}": kept(off, rtol) for rtol in (1e-10, 1e-3)
                      for off in (0.9 * rtol, 1.1 * rtol, 1.9 * rtol, -0.9 * rtol, -1.1 * rtol)},
        "negative": {f"{low} {rtol}": above(low, rtol) for rtol in (1e-10, 1e-3)
                     for low in (0.9 * rtol, 1.1 * rtol, 1.9 * rtol)},
        "by default": [is_covariance(whole + off * skew) for off in (0.9e-10, 1.1e-10)],
        "none": [is_covariance(np.array(each)) for each in
                 ([[np.nan, 0], [0, 1]], [[np.inf, 0], [0, 1]], np.zeros((0, 0)))],
        "of many": [is_covariance(np.stack([whole, each])) for each in (whole, -whole)],
        "blocks": block_diagonal(root[:1, :3], root[:2, :2], root[:3, 1:2]),
        "symmetric": symmetric(root)})


def test_chi_square(recorded):
    recorded({f"{degrees}": [chi_square_beyond(chance, degrees)
                             for chance in (0.9, 0.5, 0.05, 1e-3, 1e-8)]
              for degrees in (1, 2, 3, 4, 7, 20)})
    recorded({f"{x} of {degrees}": chance_beyond(x, degrees) for x in (0.02, 1.3, 9.0, 40.0)
              for degrees in (1, 2, 3, 6, 11)}, case="chances")


def test_responses(recorded):
    rng = np.random.default_rng(6)
    grid = grid_from_nm(UNEVEN_NM[1:10])
    curves, light = rng.uniform(0.1, 1, (3, 9)), rng.uniform(0.4, 2, 9)
    response = response_matrix(grid, curves, light)
    basis = basis_matrix(grid.nm, 5)
    recorded({"response": response, "white": white_signal(response),
              "operator": relative_operator(response, basis)})
    np.testing.assert_allclose(relative_operator(response, basis) @ np.ones(5), 1, rtol=1e-12)
    recorded({"matching": colour_matching(UNEVEN_NM),
              "beyond": colour_matching(np.array([379.9, 380.0, 780.0, 780.1])),
              "xyz": tristimulus_of(UNEVEN_NM, REDDISH),
              "luminance": luminance_of(UNEVEN_NM, GREENISH)}, case="luminous")


def test_products_of_reflectances(recorded):
    rng = np.random.default_rng(7)
    exponents = exponents_up_to(3, 4)
    reflectances = np.vstack([rng.uniform(0.05, 0.9, (2, 6)), [0.0, 0.3, 0, 0.7, 1.0, 0.2]])
    response, basis = rng.uniform(0.1, 1, (4, 6)), rng.uniform(0, 1, (6, 5))
    coefficients = rng.uniform(0, 1, (7, len(exponents))) * 0.3 ** exponents.sum(axis=1)
    values, jacobian = band_products_jacobian(exponents, reflectances, response, basis, (2, 0))
    two_lights = coefficients[:, None] * np.array([[1.0], [0.4]])
    recorded({
        "counts": [product_count(*pair) for pair in ((3, 4), (1, 7), (5, 0))],
        "exponents": exponents, "after": product_after(exponents).astype(int),
        "lower": lower_products(exponents), "kept table": lower_table(exponents),
        "products": products(exponents, reflectances),
        "bands": band_products(exponents, reflectances, response), "values": values,
        "jacobian": jacobian,
        "signal": signal(coefficients, exponents, reflectances, response),
        "lights": signal(two_lights, exponents, reflectances,
                         np.stack([response, response[::-1] ** 2]))})
    powers = np.prod(reflectances[None] ** exponents[:, :, None], axis=1)
    np.testing.assert_allclose(products(exponents, reflectances), powers, rtol=1e-12)
    np.testing.assert_allclose(
        signal(two_lights, exponents, reflectances, np.stack([response, response])),
        1.4 * signal(coefficients, exponents, reflectances, response), rtol=1e-12)


def test_pruned_products(recorded):
    rng = np.random.default_rng(8)
    exponents = exponents_up_to(3, 5)
    coefficients = rng.uniform(0, 1, (5, len(exponents))) * 0.4 ** exponents.sum(axis=1)
    coefficients[:, rng.integers(0, len(exponents), 30)] *= 1e-4
    recorded({f"{brightest} {share}": prune(exponents, coefficients, brightest, share)
              for brightest in (0.9, 0.4) for share in (0.0, 1e-4, 3e-3, 0.1, 1.0)})


@pytest.mark.parametrize("kind", [OBSERVERS, LIGHTS, CHARTS, COLOURS])
def test_published_tables(recorded, kind):
    names = published_names(kind)
    tables = all_published(kind)
    recorded({"names": names, "tables": {name: (nm.size, nm[0], nm[-1], curves.shape, curves.sum(),
                                                curves @ np.cos(np.arange(nm.size)))
                                         for name, (nm, curves) in list(tables.items())[::4]},
              "first": published_curves(kind, names[0]),
              "none": said(lambda: published_curves(kind, "nothing"))})


def test_published_colours(recorded):
    recorded(published_colours(published_names(COLOURS)[0]))


def test_upsampled_colours(recorded):
    grid = grid_from_nm(np.array([400.0, 437, 461, 512, 555, 611, 660, 700]))
    recorded({"response": observer_response(grid), "unknown": said(
        lambda: upsampled(np.ones(3), grid, "Smits 2000"))})
    # optimisers and table look-ups: their ends hang on rounding
    recorded({method: upsampled(np.array([0.31, 0.22, 0.12]), grid, method)
              for method in METHODS if method != "Jakob 2019"}, rtol=1e-4, case="methods")
