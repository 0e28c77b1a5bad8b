"""Laws of light scales and drifts: exposures as cameras round them, and errors that bands share.

Statistical tests have a significance of 1e-4 each (3.9 sigma), at fixed seeds.
"""
import dataclasses
import itertools

import numpy as np
import pytest
from small_captures import photo

from spectrabox.radiometry.error_model import error_of_each_band, with_common_error
from spectrabox.radiometry.light_scale import (
    exposure_ratio,
    rounding_error,
    scale_from_signals,
)
from spectrabox.radiometry.records.calibration import LightScale

# what a camera states, and what it does: thirds of a stop from 1 s and from f/1
TIMES_S = ((1 / 60, 2.0**-6), (1 / 125, 2.0**-7), (1 / 15, 2.0**-4), (1 / 100, 2 ** (-20 / 3)))
APERTURES = ((8.0, 8.0), (11.0, 2**3.5), (5.6, 2**2.5), (9.0, 2 ** (19 / 6)))


def test_rounding_is_what_stated_settings_miss_of_the_true_ratio():
    """Time and aperture may round the same way or against each other."""
    errors = []
    for (before_s, true_before), (after_s, true_after) in itertools.product(TIMES_S, TIMES_S):
        for (wide, true_wide), (narrow, true_narrow) in itertools.product(APERTURES, APERTURES):
            before = photo(exposure_s=before_s, f_number=wide)
            after = photo(exposure_s=after_s, f_number=narrow)
            true = true_after / true_before * (true_wide / true_narrow)**2
            missed = exposure_ratio(before, after) / true
            errors.append(max(missed, 1 / missed) - 1)
            # said in stops of what is stated, or of what is true
            assert rounding_error(before, after) in (
                pytest.approx(abs(missed - 1), abs=2e-4), pytest.approx(abs(1 / missed - 1),
                                                                        abs=2e-4))
    assert max(errors) > 0.1       # the test can tell: some add up


def test_what_all_bands_share_of_an_error_is_taken_off_as_it_was_put_on():
    alone = LightScale(3.0, 0.06, None, "chart")
    both = with_common_error(with_common_error(alone, "drift", 0.05), "lamp", 0.03)
    assert both.standard_error == pytest.approx(3.0 * np.sqrt(0.02**2 + 0.05**2 + 0.03**2))
    assert error_of_each_band(both) == pytest.approx(0.02)
    only = dataclasses.replace(both, standard_error=3.0 * np.hypot(0.05, 0.03))
    assert error_of_each_band(only) == pytest.approx(0, abs=1e-7)      # root of round-off


@pytest.mark.parametrize("regions", [2, 3, 8])
def test_a_scale_from_few_regions_errs_as_it_says(regions):
    """Regions that are brighter than predicted in all bands: the bands count as one signal."""
    rng = np.random.default_rng(2)
    predicted = rng.uniform(0.2, 1.0, (regions, 3))
    scales = [scale_from_signals(2 * predicted * np.exp(0.05 * rng.standard_normal((regions, 1))),
                                 predicted, 1e-4, "") for _ in range(4000)]
    values = np.array([scale.value for scale in scales])
    stated = np.array([scale.standard_error for scale in scales])
    # mean squares: 4000 times one degree of freedom know them to 2.2 %; the largest of two scatters
    # where the bands' own is the smaller one
    assert np.mean(stated**2) / values.var() == pytest.approx(1.02, abs=0.12)


@pytest.mark.parametrize("bands", [2, 3, 6])
def test_a_scale_from_one_region_errs_by_the_scatter_of_its_bands(bands):
    rng, predicted = np.random.default_rng(3), np.linspace(0.3, 0.9, bands)[None]
    scales = [scale_from_signals(2 * predicted * np.exp(0.05 * rng.standard_normal((1, bands))),
                                 predicted, 1e-4, "") for _ in range(4000)]
    values = np.array([scale.value for scale in scales])
    stated = np.array([scale.standard_error for scale in scales])
    # 4000 times one degree of freedom know a variance to 3.5 %
    assert np.mean(stated**2) / values.var() == pytest.approx(1, abs=0.15)
