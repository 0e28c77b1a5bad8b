"""What the prior's calibration promises, and what is read off it: against brute force.

Statistical tests have a significance of 1e-4 each (3.9 sigma), at fixed seeds.
"""
import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from sampling_cameras import seen
from scipy import stats
from test_posterior_laws import SMOOTH, mixture_of

from spectrabox.radiometry.grid import visible_grid
from spectrabox.sampling.evaluation.metrics import best_scale
from spectrabox.sampling.prior.calibrated_marginals import _skewed
from spectrabox.sampling.prior.mixture import PRIOR_GRID, of_families, reflectance
from spectrabox.sampling.prior.mixture_posterior import (
    MISFIT,
    USUAL_WIDTH,
    MixturePosterior,
    allowed_misfit,
    tail_growth,
    width_factors,
)
from spectrabox.sampling.prior.quantiles import stretched
from spectrabox.sampling.summary import READING_ERROR, next_measurement_nm

from benchmarks.bench_calibration_of_bands import certify
from tools.prior_calibration import (
    AT_95,
    FAMILIAR,
    SLACK,
    Judgement,
    LeftOut,
    calibrated,
    tail_of,
)
from tools.prior_training import LEVELS


def two_families():
    """A prior of two families, each of one component, whose factors are all different."""
    plain = mixture_of(PRIOR_GRID.nm, [0.5, 0.5], np.zeros((2, PRIOR_GRID.nm.size)),
                       [SMOOTH, 2 * SMOOTH])
    factors = 1 + np.arange(2.0 * LEVELS.size * PRIOR_GRID.nm.size).reshape(2, LEVELS.size, -1)
    return dataclasses.replace(plain, families=("paint", "skin"), family=np.array([0, 1]),
                               band_factors=factors, stated_factors=factors**1.5)


def test_factors_between_levels_lie_on_straight_lines():
    known = two_families()
    for index, level in enumerate(LEVELS):
        np.testing.assert_allclose(known.family_factors(level), known.band_factors[:, index],
                                   rtol=1e-12)
    for index in range(LEVELS.size - 1):
        between = known.family_factors(0.25 * LEVELS[index] + 0.75 * LEVELS[index + 1])
        np.testing.assert_allclose(between, 0.25 * known.band_factors[:, index]
                                   + 0.75 * known.band_factors[:, index + 1], rtol=1e-9)


@pytest.mark.parametrize("name, row", [("paint", 0), ("skin", 1)])
def test_bands_of_a_stated_family_are_those_that_were_calibrated_so(name, row):
    known = two_families()
    stated = of_families(known, [name])
    found = stated.band_factor(LEVELS[AT_95], np.ones((1, 1)))
    np.testing.assert_allclose(found[0], known.stated_factors[row, AT_95], rtol=1e-12)


def judgement(rng, scale, family, count=1200):
    scores = scale * np.abs(rng.standard_normal((LEVELS.size, count, PRIOR_GRID.nm.size)))
    return Judgement(0.0, scores, np.ones((LEVELS.size, PRIOR_GRID.nm.size)),
                     np.eye(2)[np.full(count, family)], rng.chisquare(3, count),
                     ("paint", "skin"))


def test_calibrated_bands_hold_what_they_state_and_no_model_is_missed_much_more_often():
    rng = np.random.default_rng(41)
    parts = [LeftOut(str(scale), name, measured, False, 1200, found, found)
             for scale, name, measured in ((0.5, "paint", True), (0.5, "skin", False),
                                           (0.6, "skin", False), (0.63, "skin", False))
             for found in (judgement(rng, scale, int(name == "skin")),)]
    known = calibrated(two_families(), parts)
    paint, skin = known.stated_factors[:, AT_95]
    held = [np.mean(part.stated.scores[AT_95] <= (paint if part.measured else skin))
            for part in parts]
    assert held[0] == pytest.approx(0.95, abs=0.002)
    # of the models the widest decides: it is missed as often as the slack allows
    assert held[3] == pytest.approx(1 - (1 + SLACK) * 0.05, abs=0.002)
    assert np.mean(held[1:]) > 0.95
    surprise = np.concatenate([part.unstated.surprise for part in parts])
    assert np.mean(surprise <= known.familiar_surprise) == pytest.approx(FAMILIAR, abs=1e-3)


def test_calibrated_bands_hold_what_they_state_where_some_wavelengths_are_harder():
    """Bands that are too narrow in the red: wider there, and no wider than needed over all."""
    rng, harder = np.random.default_rng(42), np.linspace(0.4, 0.8, PRIOR_GRID.nm.size)
    found = judgement(rng, harder, 0)
    parts = [LeftOut("one", "paint", True, False, 1200, found, found)]
    known = calibrated(dataclasses.replace(
        mixture_of(PRIOR_GRID.nm, [1.0], np.zeros((1, PRIOR_GRID.nm.size)), [SMOOTH]),
        families=("paint",)),
        [dataclasses.replace(part, unstated=dataclasses.replace(
            found, shares=np.ones((1200, 1)))) for part in parts])
    inside = found.scores[AT_95] <= known.stated_factors[0, AT_95]
    assert inside.mean() == pytest.approx(0.95, abs=2e-3)
    # tenths of wavelengths joined by straight lines, the first wider than it need be; 1200 curves
    # know a share to 0.6 %
    np.testing.assert_allclose(inside[:, 10:55].mean(axis=0), 0.95, atol=0.035)


def test_bands_widened_for_whole_curves_hold_95_per_cent_of_them():
    rng = np.random.default_rng(43)
    found = judgement(rng, 0.5, 0)
    known = calibrated(two_families(), [
        LeftOut(name, name, True, False, 1200, each, each) for name, each in (
            ("paint", found), ("skin", judgement(rng, 0.6, 1)))])
    whole = np.concatenate([np.all(part.scores[AT_95] <= known.curve_factor
                                   * known.band_factors[row, AT_95], axis=1)
                            for row, part in enumerate((found, judgement(
                                np.random.default_rng(44), 0.6, 1)))])
    # 1200 curves of the calibration and 1200 others, each share known to 0.6 %
    assert whole.mean() == pytest.approx(0.95, abs=0.02)


@pytest.mark.parametrize("tail", [0.3, 1.5])
def test_the_tail_is_the_least_at_which_unlikely_signals_of_the_worst_group_are_held(tail):
    """Scores that grow as the bands of two tails do, of which 95 % are then within them."""
    rng, known = np.random.default_rng(45), two_families()
    known = dataclasses.replace(known, familiar_surprise=5.0,
                                band_factors=np.ones_like(known.band_factors))

    def group(of_tail, count=4000):
        surprise = 5 * rng.uniform(0.6, 6, count)
        scores = np.abs(rng.standard_normal((LEVELS.size, count, PRIOR_GRID.nm.size))) \
            / stats.norm.ppf(0.975) * tail_growth(of_tail, surprise / 5)[:, None]
        return [Judgement(0.0, scores, np.ones((LEVELS.size, PRIOR_GRID.nm.size)),
                          np.ones((count, 1)), surprise, ("skin",))]

    # 4000 x 61 scores know 5 % to 0.05 %
    assert tail_of(known, [group(tail), group(tail / 2)]) == pytest.approx(tail, rel=0.05)
    assert tail_of(known, [group(tail, 10), []]) == 0        # too few to tell


@pytest.mark.parametrize("noise", [0.05, 0.2])
def test_a_certificate_refuses_as_many_signals_as_chance_lets_surprise(noise):
    """Dark truths of the prior's own, whose relative errors are those stated: chi-square of three
    bands, of which a fifth lies beyond the limit.
    """
    rng, logits = np.random.default_rng(44), np.full((1, PRIOR_GRID.nm.size), -2.2)
    spread = 0.02**2 * SMOOTH
    known = dataclasses.replace(
        mixture_of(PRIOR_GRID.nm, [1.0], logits, [spread]),
        familiar_surprise=float(stats.chi2(3).isf(0.2)))
    truths = reflectance(rng.multivariate_normal(logits[0], spread, 1000))
    found = certify(known, "dark", truths, seen(truths[0]).relative_response, noise, 1)
    # 3.9 sigma, and the 0.1 % of white that is always added
    assert found.unfamiliar == pytest.approx(0.2, abs=3.9 * np.sqrt(0.16 / 1000) + 0.01)
    assert found.coverage == pytest.approx(0.95, abs=0.03)


@pytest.mark.parametrize("error", [0.0, 5e-4, 0.004, 0.03])
def test_a_misfit_of_four_standard_errors_is_allowed_or_half_a_per_cent(error):
    covariance = np.diag(np.array([1.0, 0.5, 0.2]) * error) ** 2
    assert allowed_misfit(covariance) == pytest.approx(max(4 * error, MISFIT), rel=1e-12)


def test_a_band_of_the_usual_width_is_left_and_wider_ones_change_by_a_power():
    known = dataclasses.replace(two_families(), width_power=-0.3)
    usual = USUAL_WIDTH / (2 * stats.norm.ppf(0.975)) * np.ones((3, PRIOR_GRID.nm.size))
    found = width_factors(known, usual * np.array([[1.0], [2.0], [0.5]]))[:, 0]
    np.testing.assert_allclose(found, [1, 2**-0.3, 2**0.3], rtol=1e-6)


@pytest.mark.parametrize("size", [2e-3, 2e-2, 0.2])
def test_the_next_measurement_is_the_one_that_leaves_the_least_variance(size):
    rng, grid = np.random.default_rng(42), visible_grid(10)
    for _ in range(20):
        root = rng.standard_normal((grid.nm.size, 4)) * size * np.exp(
            -0.5 * ((grid.nm[:, None] - rng.uniform(400, 700, 4)) / 40) ** 2)
        covariance = root @ root.T
        left = [grid.weights_nm @ np.diag(
            covariance - np.outer(covariance[at], covariance[at])
            / (covariance[at, at] + READING_ERROR**2)) for at in range(grid.nm.size)]
        assert next_measurement_nm(grid, covariance) == grid.nm[np.argmin(left)]


def test_the_best_scale_leaves_the_least_squares():
    rng = np.random.default_rng(43)
    estimate, truth = rng.uniform(0.1, 0.9, (2, 40))
    scale = best_scale(estimate, truth)
    around = scale * np.array([0.98, 0.99, 1.0, 1.01, 1.02])
    squares = ((around[:, None] * estimate - truth)**2).sum(axis=1)
    assert np.argmin(squares) == 2


@pytest.mark.parametrize("skewness", [-0.2, 0.05, 0.3])
def test_a_skewed_component_has_the_moments_that_were_asked_for(skewness):
    mean, variance = np.array([[0.3, -1.2]]), np.array([[0.04, 0.5]])
    plain = MixturePosterior(np.ones((1, 1)), np.zeros((1, 1, 2)), np.ones((1, 1, 2)),
                             np.zeros((1, 1)), np.zeros((1, 1)), *np.zeros((3, 1)), np.ones(1))
    found = _skewed(plain, SimpleNamespace(component=np.array([0]), signal=np.array([0])), mean,
                    variance, skewness * variance**1.5)
    z, weights = np.polynomial.hermite_e.hermegauss(40)
    weights /= weights.sum()
    values = found.logits[0] + np.sqrt(found.variances[0]) * np.array(
        [stretched(one, found.skews[0]) for one in z])[:, 0]
    np.testing.assert_allclose(weights @ values, mean[0], rtol=1e-9)
    np.testing.assert_allclose(weights @ (values - mean[0])**2, variance[0], rtol=1e-9)
    # to first order in the skew, a third of the skewness
    np.testing.assert_allclose(weights @ (values - mean[0])**3 / variance[0]**1.5, skewness,
                               rtol=2 * skewness**2)
