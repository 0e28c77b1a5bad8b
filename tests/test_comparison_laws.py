"""Surfaces compared: bands that repeat each other, metamers, pairs of draws, by known answers."""
from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from spectrabox.measure.surfaces import colour_comparison
from spectrabox.measure.surfaces.colour_comparison import (
    ColourComparison,
    apart_nm,
    independent_bands,
    metamer_pair,
    signal_difference,
    under_lights,
)
from spectrabox.radiometry import appearance
from spectrabox.radiometry.error_model import LIGHT_FIELD, PHOTO_NOISE, SURFACE_REFLECTION, WHITE
from spectrabox.radiometry.errors import CheckError
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.records.spectra import (
    CaptureStates,
    Outcome,
    SpectrumSamples,
    SurfaceSignals,
)
from spectrabox.sampling.prior.mixture import PRIOR_GRID

NM = FINE_GRID.nm


def bell(peak, width=30.0):
    curve = np.exp(-(((NM - peak) / width) ** 2) / 2)
    return curve / curve.sum()


THREE = np.array([bell(610), bell(540), bell(460)])


def surface(signal, causes, states=()):
    """A surface of given signals (J,) and covariances (J, J) by cause."""
    signal = np.asarray(signal, float)
    return SurfaceSignals(("a",), (False,), FINE_GRID, np.full((1, NM.size), 0.4), ("R", "G", "B"),
                          np.zeros(signal.size, int), THREE[:signal.size], signal[None],
                          {cause: np.asarray(each)[None] for cause, each in causes.items()}, states)


def gloss(mean, variance, bands):
    return CaptureStates(("gloss",), (SURFACE_REFLECTION,), np.ones((bands, 1)), np.zeros(1),
                         ("",), np.ones(1), np.array([[mean]]), np.array([[[variance]]]))


# ---- bands that repeat each other

def test_bands_that_no_sum_of_others_gives_are_all_kept_as_they_are():
    order, gain = independent_bands(THREE, 1e-4 * np.eye(3))
    assert order.tolist() == [0, 1, 2]
    np.testing.assert_array_equal(gain, np.eye(3))


def test_a_dark_camera_keeps_its_bands():
    order, gain = independent_bands(np.zeros((2, NM.size)), np.eye(2))
    assert order.tolist() == [0, 1]
    np.testing.assert_array_equal(gain, np.eye(2))


def test_of_a_band_seen_twice_the_mean_counts_by_inverse_variances():
    response = np.array([bell(610), bell(460), bell(610)])
    covariance = np.diag([4e-4, 1e-4, 1e-4])
    order, gain = independent_bands(response, covariance)
    assert order.tolist() == [0, 1]         # in order, whichever was taken first
    np.testing.assert_allclose(gain, [[0.2, 0, 0.8], [0, 1, 0]], atol=1e-9)


def test_sums_of_bands_give_the_signals_of_the_bands_that_are_left():
    rng = np.random.default_rng(2)
    response = rng.uniform(0.1, 1, (7, 3)) @ THREE
    noise = np.diag(rng.uniform(1, 3, 7) * 1e-6)
    order, gain = independent_bands(response, noise)
    assert len(order) == 3 and np.all(np.diff(order) > 0)
    reflectance = rng.uniform(size=NM.size)
    np.testing.assert_allclose(gain @ response @ reflectance, response[order] @ reflectance,
                               rtol=1e-8)
    # generalised least squares: errors of what is estimated are (A' C^-1 A)^-1
    sums = np.linalg.lstsq(response[order].T, response.T, rcond=None)[0].T
    np.testing.assert_allclose(gain @ noise @ gain.T,
                               np.linalg.inv(sums.T @ np.linalg.inv(noise) @ sums), rtol=1e-6)


def narrow(apart):
    """A band and another that differs from it by a share of its length, across all others."""
    across = bell(460) - bell(610) * (bell(460) @ bell(610)) / (bell(610) @ bell(610))
    length = np.linalg.norm(bell(610))
    return np.array([bell(610), bell(610) + apart * length * across / np.linalg.norm(across)])


@pytest.mark.parametrize("apart, kept", [(0.015, 1), (0.025, 2)])
def test_a_band_counts_from_a_fiftieth_that_no_other_has(apart, kept):
    assert len(independent_bands(narrow(apart), 1e-6 * np.eye(2))[0]) == kept


def test_what_a_sum_leaves_out_of_a_band_is_an_error_of_it():
    response, noise = narrow(0.015), 1e-3
    order, gain = independent_bands(response, noise**2 * np.eye(2))
    sums = response @ response[order[0]] / (response[order[0]] @ response[order[0]])
    # reflectances vary by 0.2 over 50 nm
    missed = 0.2 * 50**0.5 * np.linalg.norm(response - np.outer(sums, response[order[0]]), axis=1)
    weights = sums / (noise**2 + missed**2)
    np.testing.assert_allclose(gain[0], weights / (weights @ sums), rtol=1e-9)
    assert 0 < gain[0].min() / gain[0].max() < 0.9


# ---- metamers

def samples(along, base=0.4, scale=0.1, shape=None):
    shape = np.sin(2 * np.pi * (PRIOR_GRID.nm - 400) / 300) if shape is None else shape
    return held(base + scale * np.outer(along, shape))


def held(drawn):
    """Draws (T, 61), whose coefficients are their numbers."""
    return SpectrumSamples(PRIOR_GRID, drawn, np.arange(len(drawn))[:, None], "m", 1.0, 0,
                           Outcome.EXACT, (), np.zeros((len(drawn), 1)))


def test_metamers_are_the_draws_at_the_ends_of_their_main_difference():
    along = np.linspace(-1, 1, 401)
    found = metamer_pair(samples(along))
    values = np.sort((found.spectra[:, 15] - 0.4) / 0.1 / np.sin(np.pi / 2))
    np.testing.assert_allclose(values, [-0.95, 0.95], atol=0.006)
    # where they differ most: at the crest or the trough of the wave
    assert apart_nm(found) in (475, 625)
    # with the coefficients of the same draws
    np.testing.assert_allclose(along[found.coefficients[:, 0].astype(int)],
                               (found.spectra[:, 15] - 0.4) / 0.1, atol=1e-9)


def test_the_main_difference_is_that_over_wavelength_not_over_samples():
    """Ends of the grid weigh half: a difference there alone is smaller than one in the middle."""
    ends, middle = np.zeros((2, 61))
    ends[[0, -1]], middle[30] = 0.075, 0.09     # squares 0.0056 + 0.0056 halved, and 0.0081
    signs = np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]])
    spectra = 0.5 + signs @ np.array([ends, middle])
    assert apart_nm(metamer_pair(held(spectra))) == PRIOR_GRID.nm[30]


def test_metamers_differ_under_each_light_as_their_spectra_do():
    found = metamer_pair(samples(np.linspace(-1, 1, 41)))
    srgb, differences = under_lights(found)
    for light, difference, colours in zip(colour_comparison.LIGHTS, differences, srgb, strict=True):
        labs = [appearance.reflectance_to_lab(PRIOR_GRID.nm, one, light) for one in found.spectra]
        assert difference == pytest.approx(float(appearance.ciede2000(*labs)), rel=1e-6)
        adapted = appearance.adapted_tristimulus(PRIOR_GRID.nm, light)
        np.testing.assert_allclose(colours, [appearance.encoded_srgb(adapted @ one)
                                             for one in found.spectra], atol=1e-9)


def test_metamers_are_reflectances():
    found = metamer_pair(samples(np.linspace(-1, 1, 41), base=0.5, scale=0.8))
    assert found.spectra.min() == 0 and found.spectra.max() == 1


# ---- two surfaces beside each other

def comparison(difference=3.0, limit=2.0, spread=0.02):
    rng = np.random.default_rng(4)
    nm = PRIOR_GRID.nm
    means = np.array([0.3 + 0.2 * (nm > 600), np.full(nm.size, 0.4)])
    draws = means[:, None] + spread * rng.standard_normal((2, 500, 1)) * np.ones(nm.size)
    return ColourComparison(nm, means, draws, difference, limit)


def test_the_first_less_the_second_with_the_spread_of_pairs():
    both = comparison()
    np.testing.assert_allclose(both.spectrum.value, -0.1 + 0.2 * (both.nm > 600), atol=1e-12)
    apart = both.draws[0, :, 0] - both.draws[1, :, 0]
    np.testing.assert_allclose(both.spectrum.standard_error, apart.std(), rtol=1e-9)
    for light in ("D65", "A"):
        of_means = [appearance.reflectance_to_lab(both.nm, one, light) for one in both.means]
        np.testing.assert_allclose(both.lab(light).value, of_means[0] - of_means[1], atol=1e-6)
        drawn = [np.array([appearance.reflectance_to_lab(both.nm, one, light) for one in each[:50]])
                 for each in both.draws]
        few = ColourComparison(both.nm, both.means, both.draws[:, :50], 3.0, 2.0)
        np.testing.assert_allclose(few.lab(light).standard_error,
                                   (drawn[0] - drawn[1]).std(axis=0), rtol=1e-5)
        differences = appearance.ciede2000(*drawn)
        value, lower, upper = few.delta_e(light)
        assert value == pytest.approx(float(appearance.ciede2000(*of_means)), rel=1e-6)
        assert (lower, upper) == pytest.approx(tuple(np.quantile(differences, [0.025, 0.975])),
                                               rel=1e-5)


@pytest.mark.parametrize("difference, distinct", [(2.01, True), (2.0, False), (1.0, False)])
def test_colours_are_told_apart_beyond_the_limit_alone(difference, distinct):
    both = comparison(difference)
    assert both.distinct is distinct
    assert (both.finding.code == "colours.distinct") is distinct
    assert both.finding.values == {"value": difference, "needed": 2.0}
    assert (both.delta_e().lower > 0) is distinct and both.delta_e().upper > 0


def test_a_surface_is_shown_as_it_looks_under_a_light_to_an_adapted_eye():
    white = ColourComparison(PRIOR_GRID.nm, np.array([np.ones(61), np.full(61, 0.2)]),
                             np.ones((2, 3, 61)), 1.0, 2.0)
    for light in colour_comparison.LIGHTS:
        first, second = white.srgb(light)
        np.testing.assert_allclose(first, 1, atol=2e-3)
        np.testing.assert_allclose(second, appearance.encode_srgb(np.full(3, 0.2)), atol=2e-3)
    shown = comparison().srgb("A")
    assert shown[0, 0] > shown[1, 0] and shown[0, 2] < shown[1, 2]


def test_the_difference_of_signals_is_in_their_common_standard_errors():
    own, white = np.diag([1e-4, 4e-4, 9e-4]), 0.05
    causes = {PHOTO_NOISE: own, WHITE: np.zeros((3, 3))}
    first, second = surface([0.4, 0.4, 0.4], causes), surface([0.44, 0.4, 0.37], causes)
    squared = 0.04**2 / 2e-4 + 0.03**2 / 18e-4
    assert signal_difference(first, second) == pytest.approx(
        (squared**0.5, stats.chi2.ppf(0.99, 3) ** 0.5))
    # an error that both share is none of a difference, one of each place is one of both
    for cause, left in ((WHITE, 0.0), (LIGHT_FIELD, 2.0)):
        common = white**2 * np.full((3, 3), 0.4 * 0.4)
        alike = [surface(signal, {PHOTO_NOISE: own, cause: common})
                 for signal in ([0.4, 0.4, 0.4], [0.44, 0.4, 0.37])]
        covariance = 2 * own + left * common
        apart = np.array([-0.04, 0, 0.03])
        assert signal_difference(*alike)[0] == pytest.approx(
            np.sqrt(apart @ np.linalg.solve(covariance, apart)), rel=1e-6)


def test_bands_that_do_not_show_both_do_not_count():
    causes = {PHOTO_NOISE: 1e-4 * np.eye(3)}
    first = surface([0.4, np.nan, 0.4], causes)
    second = surface([0.43, 0.9, 0.4], causes)
    assert signal_difference(first, second) == pytest.approx(
        (0.03 / 2e-4**0.5, stats.chi2.ppf(0.99, 2) ** 0.5))
    with pytest.raises(CheckError, match="no band shows both"):
        signal_difference(first, surface([np.nan, 0.4, np.nan], causes))


def test_a_gloss_that_each_has_of_its_own_may_be_the_difference():
    causes = {PHOTO_NOISE: 1e-4 * np.eye(3)}
    shining = surface([0.45, 0.45, 0.45], causes, (gloss(0.05, 4e-4, 3),))
    matt = surface([0.4, 0.4, 0.4], causes)
    assert signal_difference(shining, matt)[0] == pytest.approx(0, abs=1e-9)
    assert signal_difference(matt, shining)[0] == pytest.approx(0, abs=1e-9)
    plain = surface([0.42, 0.4, 0.4], causes, (gloss(0.0, 4e-4, 3), gloss(0.0, 1e-4, 3)))
    covariance, apart = 2e-4 * np.eye(3) + 5e-4, np.array([0.02, 0, 0])
    assert signal_difference(plain, matt)[0] == pytest.approx(
        np.sqrt(apart @ np.linalg.solve(covariance, apart)))


def test_pairs_of_draws_have_the_errors_that_both_share():
    """Draws of two errors, each by its own distribution, paired as their common one has them."""
    rng = np.random.default_rng(8)
    variances, shared = (4.0, 1.0), 1.2
    covariance = np.array([[variances[0], shared], [shared, variances[1]]])
    first, second = (np.sqrt(each) * rng.standard_normal((1000, 1)) for each in variances)
    chosen = colour_comparison._pairs(first, second, covariance, np.random.default_rng(0))
    found = np.cov(first[chosen[0], 0], second[chosen[1], 0])
    # 2,000 pairs of 1,000 draws each: a standard error of 3 to 4 % of each variance
    np.testing.assert_allclose(found, covariance, rtol=0.15)
    alone = colour_comparison._pairs(first, second, np.diag(variances), np.random.default_rng(0))
    assert abs(np.corrcoef(first[alone[0], 0], second[alone[1], 0])[0, 1]) < 0.08
