"""Spectra behind every pixel, and the other methods to compare with."""
import numpy as np
import pytest
from sampling_cameras import grey, response, seen, surface
from scipy import stats

from spectrabox.radiometry.colour_science import METHODS, observer_response, upsampled
from spectrabox.radiometry.error_model import LIGHT
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import basis_matrix
from spectrabox.radiometry.records.spectra import Outcome
from spectrabox.radiometry.spectra.named_spectra import test_reflectances as shipped_reflectances
from spectrabox.sampling.polytope.tilted_rejection import sample_polytope
from spectrabox.sampling.prior import local_posteriors
from spectrabox.sampling.prior.local_posteriors import informative_bands
from spectrabox.sampling.prior.mixture import (
    PRIOR_GRID,
    load_prior,
    of_families,
    reflectance_moments,
)
from spectrabox.sampling.prior.summaries import summaries
from spectrabox.sampling.prior.uplift_table import (
    build_tables,
    interpolation,
    lattice,
    outside,
    relative_errors,
    uplift_pixels,
    uplift_signals,
)
from spectrabox.sampling.published.baselines import baseline_spectra, greedy_draws, to_tristimulus

FAST = tuple(method for method in METHODS if method != "Meng 2015")


@pytest.fixture(scope="module")
def table():
    [table], row = build_tables(load_prior(), response(3)[1], of_one_per_cent,
                                np.ones((7,) * 3, bool))
    return table, row


def of_one_per_cent(signals):
    return [relative_errors(signals, 0.01)]


def test_the_table_is_exact_at_its_points(table):
    signals = lattice(7)[[3, 4, 2], [3, 3, 2], [2, 3, 3]]
    mean, spread = uplift_pixels(*table, signals)
    exact_mean, exact_spread, _ = uplift_signals(load_prior(), response(3)[1], signals,
                                                 relative_errors(signals, 0.01))
    # Single precision of the table and of the place in it, times slopes of the table of order 6.
    np.testing.assert_allclose(mean, exact_mean, atol=1e-4)
    np.testing.assert_allclose(spread, exact_spread, atol=1e-4)


@pytest.mark.parametrize("families", [(), ("paint",)])
def test_a_pixel_is_as_uncertain_as_a_signal_of_its_own(families):
    prior, noise = of_families(load_prior(), families), 0.01
    matrix = response(3)[1]
    signals = matrix @ np.array([surface(PRIOR_GRID.nm, seed) for seed in range(8)]).T
    causes = {LIGHT: np.einsum("kt,kl->tkl", (noise * signals)**2, np.eye(3))}
    alone = summaries(prior, matrix, signals.T, causes, 0.95)
    known = alone.outcome == Outcome.FAMILIAR
    assert known.sum() > 3
    mean, spread, _ = uplift_signals(prior, matrix, signals.T, relative_errors(signals.T, noise))
    for values, expected in ((mean, alone.mean), (spread, alone.standard_deviation)):
        # the same sums, but for the round-off of what is left once what multiplies is taken off
        np.testing.assert_allclose(values[known], expected[known], rtol=1e-7)


def test_greys_are_on_the_lattice_but_for_their_level():
    found = lattice(9)[:, 4, 4]
    # exp(0) is exact
    np.testing.assert_allclose(found, np.repeat(found[:, 1:2], 3, axis=1), rtol=1e-12)


def test_between_its_points_the_table_is_near_the_direct_way(table):
    signals = np.array([response(3)[1] @ surface(PRIOR_GRID.nm, seed)
                        for seed in range(10)])
    exact, _, _ = uplift_signals(load_prior(), response(3)[1], signals,
                                 relative_errors(signals, 0.01))
    assert 0 < np.sqrt(np.mean((uplift_pixels(*table, signals)[0] - exact)**2)) < 0.1


def test_the_signals_of_a_cell_make_up_the_pixel_s_own():
    """Where no corner of the cell is brighter than white."""
    rng = np.random.default_rng(4)
    signals = rng.uniform(0.006, 0.3, (2000, 1)) * rng.uniform(0.3, 2, (2000, 3))
    again = interpolation(np.arange(21**3).reshape((21,) * 3), 21**3, signals) \
        @ lattice(21).reshape(-1, 3)
    # single floats, of which differences are taken
    np.testing.assert_allclose(again, signals, rtol=2e-5)


def test_pixels_that_no_reflectance_gives_are_counted(table):
    assert outside(np.array([[0.1, 0.2, 1.2], [0.5, 0.5, 0.5], [-0.1, 0, 0]])).tolist() == [True,
                                                                                            False,
                                                                                            True]
    mean, _ = uplift_pixels(*table, np.array([[-0.5, 0.0, 2.0]]))
    assert np.all(np.isfinite(mean))


def test_a_table_is_for_three_bands():
    with pytest.raises(InputError, match="there are 4: use `uplift_signals`"):
        build_tables(load_prior(), response(4)[1], of_one_per_cent, np.ones((7,) * 3, bool))


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
    exact = sample_polytope(operator, 5000, 2)[0] @ basis.T
    p = [stats.ks_2samp(a, b).pvalue for a, b in zip((draws @ basis.T).T, exact.T, strict=True)]
    assert min(p) < 1e-10  # a difference that no chance explains


def test_the_shipped_sets_are_reflectances():
    for name, values in shipped_reflectances(PRIOR_GRID).items():
        assert values.shape[1] == 61, name
        assert values.min() > -0.01 and values.max() < 1.2, name


# ---- many bands

def painted(count, bands, seed=0):
    """Shaded mixtures of published colours (n, 61), and their signals with 1 % of noise."""
    rng, published = np.random.default_rng(seed), np.vstack(list(
        shipped_reflectances(PRIOR_GRID).values()))
    pairs, share = rng.integers(40, size=(2, count)), rng.beta(0.15, 0.15, (count, 1))
    truth = (share * published[pairs[0]] + (1 - share) * published[pairs[1]]) \
        * rng.uniform(0.3, 1, (count, 1))
    truth = np.clip(truth, 0.004, 0.996)
    return truth, truth @ response(bands)[1].T * (1 + 0.01 * rng.standard_normal((count, bands)))


@pytest.mark.parametrize("bands", [5, 12, 36])
def test_a_pixel_of_many_bands_has_the_exact_posterior_to_a_small_share_of_its_band(
        monkeypatch, bands):
    """Spectra near some of the other signals, against the posterior of each in all its bands."""
    monkeypatch.setattr(local_posteriors, "MAX_CENTRES", 500)
    truth, signals = painted(1060, bands)
    matrix, others, own = response(bands)[1], signals[:1000], slice(1000, None)
    near = local_posteriors.local_posteriors(
        load_prior(), matrix, lambda each: [relative_errors(each, 0.01)], others, None,
        slice(None), slice(None))
    found = near.values(signals[own], None)
    mean, spread, novelty = found[:, :61], found[:, 61:-1], found[:, -1]
    errors = relative_errors(signals[own], 0.01)
    exact_mean, exact_spread, exact_novelty = uplift_signals(load_prior(), matrix, signals[own],
                                                             errors)
    # shares of a standard deviation, of which a 95 % band holds four
    off = np.abs(mean - exact_mean) / exact_spread
    assert np.sqrt(np.mean(off**2)) < 0.25 and np.median(off) < 0.1
    assert np.mean((novelty > 1) == (exact_novelty > 1)) > 0.9
    # draws that reproduce 36 signals one by one are wider than the information in these
    _, of_few, _ = uplift_signals(load_prior(), near.gain @ matrix, signals[own] @ near.gain.T,
                                  errors if len(near.gain) == bands
                                  else errors.of_sums(near.gain, signals[own]))
    ratio = spread / of_few
    assert abs(np.median(ratio) - 1) < 0.03 and np.mean(np.abs(ratio - 1) > 0.25) < 0.05

    def error(spectra):
        return np.sqrt(np.mean((spectra - truth[own])**2))

    assert error(mean) < 1.1 * error(exact_mean)
    held = np.mean(np.abs(mean - truth[own]) < 1.96 * spread)
    assert held == pytest.approx(np.mean(np.abs(exact_mean - truth[own])
                                         < 1.96 * exact_spread), abs=0.02)


def test_a_centre_has_its_own_posterior_and_strange_signals_are_novel():
    matrix, (_, signals) = response(6)[1], painted(30, 6)
    near = local_posteriors.local_posteriors(
        load_prior(), matrix, lambda each: [relative_errors(each, 0.01)], signals, None,
        slice(None), slice(None))
    mean, spread, novelty = uplift_signals(load_prior(), matrix, signals,
                                           relative_errors(signals, 0.01))
    found = near.values(signals, None)
    # single precision, and modes to 1e-4 of a logit
    np.testing.assert_allclose(found[:, :61], mean, atol=2e-4)
    np.testing.assert_allclose(found[:, 61:-1], spread, atol=2e-4)
    np.testing.assert_allclose(found[:, -1], novelty, rtol=1e-2)
    strange = signals * [1, 0.5, 1, 1.5, 1, 0.5]
    assert np.mean(near.values(strange, None)[:, -1] > 1) > 0.8


def test_errors_between_the_smallest_and_the_largest_give_spreads_between():
    matrix, (_, signals) = response(6)[1], painted(300, 6)
    signals = np.repeat(signals[:5], 60, axis=0)
    near = local_posteriors.local_posteriors(
        load_prior(), matrix, lambda each: [relative_errors(each, 0.01),
                                            relative_errors(each, 0.05)],
        signals, np.tile(np.linspace(0, 1, 60), 5), slice(None), slice(None))
    spreads = [near.values(signals[::60], np.full(5, level))[:, 61:-1].mean()
               for level in (0.0, 0.5, 1.0)]
    exact = [uplift_signals(load_prior(), matrix, signals[::60], relative_errors(
        signals[::60], noise))[1].mean() for noise in (0.01, 0.05)]
    assert spreads[0] < spreads[1] < spreads[2]
    np.testing.assert_allclose(spreads[::2], exact, rtol=0.02)


def test_bands_that_repeat_others_leave_their_signal_and_halve_its_noise():
    matrix = response(4)[1]
    covariance = reflectance_moments(load_prior())[1]
    gain, few = informative_bands(covariance, np.vstack([matrix, matrix]), 1e-4 * np.eye(8))
    assert few.shape == (4, 61)
    # the same directions: each band is the mean of its two copies, but for the floor of the noise
    np.testing.assert_allclose(gain @ np.vstack([matrix, matrix]), few, atol=1e-12)
    np.testing.assert_allclose(np.diag(gain @ gain.T), 0.5, rtol=1e-3)
