"""Spectra behind every pixel, and the other methods to compare with."""
import numpy as np
import pytest
from sampling_cameras import grey, response, seen, surface
from scipy import stats

from spectrabox.radiometry.bspline import basis_matrix
from spectrabox.radiometry.colour_upsampling import METHODS, observer_response, upsampled
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records import Outcome
from spectrabox.radiometry.spectra.named_spectra import test_reflectances as shipped_reflectances
from spectrabox.sampling.polytope.tilted_rejection import sample_polytope
from spectrabox.sampling.prior.mixture import PRIOR_GRID, load_prior, of_families
from spectrabox.sampling.prior.summaries import summaries
from spectrabox.sampling.prior.uplift_table import (
    build_table,
    lattice,
    outside,
    table_error,
    uplift_directly,
    uplift_pixels,
)
from spectrabox.sampling.published.baselines import baseline_spectra, greedy_draws, to_tristimulus

FAST = tuple(method for method in METHODS if method != "Meng 2015")


@pytest.fixture(scope="module")
def table():
    return build_table(load_prior(), response(3)[1], side=7)


def test_the_table_is_exact_at_its_points(table):
    signals = lattice(7)[[3, 4, 2], [3, 3, 2], [2, 3, 3]]
    mean, spread = uplift_pixels(table, signals)
    direct_mean, direct_spread = uplift_directly(load_prior(), table.relative_response, signals)
    # Single precision of the table and of the place in it, times slopes of the table of order 6.
    np.testing.assert_allclose(mean, direct_mean, atol=1e-4)
    np.testing.assert_allclose(spread, direct_spread, atol=1e-4)


@pytest.mark.parametrize("families", [(), ("paint",)])
def test_a_pixel_is_as_uncertain_as_a_signal_of_its_own(families):
    prior, noise = of_families(load_prior(), families), 0.01
    matrix = response(3)[1]
    signals = matrix @ np.array([surface(PRIOR_GRID.nm, seed) for seed in range(8)]).T
    causes = {"noise": np.einsum("kt,kl->tkl", (noise * signals)**2, np.eye(3))}
    alone = summaries(prior, matrix, signals.T, causes, 0.95)
    known = alone.outcome == Outcome.FAMILIAR
    assert known.sum() > 3
    found = uplift_directly(prior, matrix, signals.T, noise)
    for values, expected in zip(found, (alone.mean, alone.standard_deviation), strict=True):
        # the same sums
        np.testing.assert_allclose(values[known], expected[known], rtol=1e-12)


def test_greys_are_on_the_lattice_but_for_their_level():
    found = lattice(9)[:, 4, 4]
    # exp(0) is exact
    np.testing.assert_allclose(found, np.repeat(found[:, 1:2], 3, axis=1), rtol=1e-12)


def test_between_its_points_the_table_says_how_far_off_it_is(table):
    signals = np.array([table.relative_response @ surface(PRIOR_GRID.nm, seed)
                        for seed in range(10)])
    errors = table_error(table, load_prior(), signals)
    assert 0 < errors["mean"] < 0.1


def test_pixels_that_no_reflectance_gives_are_counted(table):
    assert outside(np.array([[0.1, 0.2, 1.2], [0.5, 0.5, 0.5], [-0.1, 0, 0]])).tolist() == [True,
                                                                                            False,
                                                                                            True]
    mean, _ = uplift_pixels(table, np.array([[-0.5, 0.0, 2.0]]))
    assert np.all(np.isfinite(mean))


def test_a_table_is_for_three_bands():
    with pytest.raises(InputError, match="there are 4: use `uplift_directly`"):
        build_table(load_prior(), response(4)[1])


@pytest.mark.parametrize("method", FAST)
def test_a_grey_is_recovered_grey(method):
    spectrum = upsampled(np.full(3, 0.4), PRIOR_GRID, method)
    # Otsu's greys are those of its data; the others are flat to some percent.
    assert abs(spectrum.mean() - 0.4) < 0.05
    np.testing.assert_allclose(observer_response(PRIOR_GRID) @ spectrum, 0.4, atol=0.02)


def test_baselines_of_the_observer_itself_lose_nothing():
    matrix = observer_response(PRIOR_GRID)
    signals = np.array([[0.2, 0.3, 0.1], [1.0, 1.0, 1.0]])
    # a regression of exact data
    np.testing.assert_allclose(to_tristimulus(matrix, signals), signals, atol=1e-10)
    with pytest.raises(InputError, match="2 bands give no colour"):
        to_tristimulus(matrix[:2], signals[:, :2])


def test_every_baseline_gives_a_spectrum():
    found = baseline_spectra(seen(surface(PRIOR_GRID.nm, 2)), FAST)
    assert set(found) == set(FAST)
    assert all(np.all(np.isfinite(spectrum)) for spectrum in found.values())
    with pytest.raises(InputError, match="is no method that is known"):
        upsampled(np.full(3, 0.4), PRIOR_GRID, "magic")


def test_greedy_draws_keep_the_signal_and_are_not_uniform():
    operator, basis = grey(9), basis_matrix(PRIOR_GRID.nm[::6], 9)
    draws, share = greedy_draws(operator, 5000, seed=1)
    np.testing.assert_allclose(draws @ operator.A.T, np.tile(operator.y, (len(draws), 1)),
                               atol=1e-9)
    assert 0 < share < 1
    exact = sample_polytope(operator, 5000, 2).coefficients @ basis.T
    p = [stats.ks_2samp(a, b).pvalue for a, b in zip((draws @ basis.T).T, exact.T, strict=True)]
    assert min(p) < 1e-10  # a difference that no chance explains


def test_the_shipped_sets_are_reflectances():
    for name, values in shipped_reflectances(PRIOR_GRID).items():
        assert values.shape[1] == 61, name
        assert values.min() > -0.01 and values.max() < 1.2, name
