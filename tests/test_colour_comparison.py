"""Two colours beside each other: errors that both share count once, and the test is a fair one."""
import numpy as np
import pytest

from spectrabox.measure.surfaces.colour_comparison import (
    BY_CHANCE,
    LIGHTS,
    compare_colours,
    signal_difference,
)
from spectrabox.measure.surfaces.surface_signals import measurement
from spectrabox.radiometry.error_model import PHOTO_NOISE, WHITE, proportional_covariance
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.records.spectra import SurfaceSignals
from spectrabox.sampling.prior.mixture import load_prior
from spectrabox.sampling.prior.signal_posterior import solve_posterior

BANDS = np.array([np.exp(-(((FINE_GRID.nm - peak) / 35) ** 2)) for peak in (610, 540, 460)])
BANDS /= BANDS.sum(axis=1, keepdims=True)
GREY = np.full(FINE_GRID.nm.size, 0.4)


def region(reflectance, *, noise=0.002, white=0.0, error=0.0):
    """What a camera sees of a surface; ``error`` (3,) is in standard deviations of the noise."""
    signal = BANDS @ reflectance + noise * np.asarray(error)
    errors = {PHOTO_NOISE: noise**2 * np.eye(3)[None],
              WHITE: proportional_covariance(signal, np.full((3, 3), white**2))[None]}
    return SurfaceSignals(("a",), (False,), FINE_GRID, reflectance[None], ("R", "G", "B"),
                          np.zeros(3, int), BANDS, signal[None], errors)


def compared(*surfaces):
    return compare_colours(surfaces, [solve_posterior(load_prior(), measurement(one, 0))
                                      for one in surfaces])


def test_an_error_of_white_that_both_share_does_not_hide_a_difference():
    """Without noise of its own a pair differs by an unknown white only in proportion."""
    reddish = GREY + 0.02 * (FINE_GRID.nm > 580)
    alone, shared = (compared(region(GREY, white=white), region(reddish, white=white))
                     for white in (0.0, 0.05))
    assert alone.distinct and shared.distinct
    # the shared 5 % of a difference of 0.02 is 0.001, half the noise of one signal
    assert shared.difference == pytest.approx(alone.difference, rel=0.1)
    # and draws that err by one white differ less than draws that each have a white of their own
    widths = [upper - lower for _, lower, upper in (shared.delta_e(), alone.delta_e())]
    assert widths[0] < 1.3 * widths[1]
    assert np.all(shared.lab().standard_error < 1.3 * alone.lab().standard_error)


def test_two_areas_of_one_colour_are_told_apart_as_rarely_as_stated():
    rng, trials = np.random.default_rng(3), 1000
    wrong = 0
    for _ in range(trials):
        difference, limit = signal_difference(
            *(region(GREY, white=0.03, error=rng.standard_normal(3)) for _ in range(2)))
        wrong += difference > limit
    # binomial with 0.01: 10 are expected, and 3.5 standard deviations are 11
    assert abs(wrong - BY_CHANCE * trials) <= 11


def test_the_same_signal_twice_looks_alike_on_average_and_the_answer_says_so():
    both = compared(region(GREY, white=0.03), region(GREY, white=0.03))
    assert not both.distinct and "cannot tell" in both.sentence and both.difference == 0
    for light in LIGHTS:
        value, lower, upper = both.delta_e(light)
        assert value == pytest.approx(0, abs=1e-9) and lower == 0
        assert upper > 0            # what the camera does not see may differ
    np.testing.assert_array_equal(both.spectrum.value, 0)
    assert "dE00 0.0 (95 %: 0.0 to " in repr(both)
