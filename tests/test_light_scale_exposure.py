"""The light scale carried from one exposure to another, and what the rounded settings of cameras
leave open.
"""
import numpy as np
import pytest

from spectrabox.radiometry.error_model import (
    ROUNDED_EXPOSURES,
    error_of_each_band,
    with_common_error,
)
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.light_scale import rounding_error, scale_for_photo
from spectrabox.radiometry.records.calibration import LightScale
from spectrabox.radiometry.records.photos import LinearImage, PhotoKind

SCALE = LightScale(2.0, 0.01, None, "chart photo")


def photo(exposure_s=1 / 60, iso=100.0, f_number=8.0):
    pixel = np.zeros((1, 1, 3), np.float32)
    return LinearImage(pixel, pixel, np.zeros((1, 1, 3), bool), 1.0, exposure_s, iso, f_number,
                       PhotoKind.RAW, "", "IMG.dng", "")


@pytest.mark.parametrize("changes, ratio", [
    ({"exposure_s": 1 / 30}, 2), ({"iso": 400.0}, 4), ({"f_number": 4.0}, 4),
    ({"exposure_s": 1 / 15, "iso": 50.0, "f_number": 16.0}, 0.5)])
def test_the_signal_goes_with_time_and_iso_and_the_inverse_square_of_the_f_number(changes, ratio):
    carried = scale_for_photo(SCALE, photo(), photo(**changes))
    # Round-off.
    assert (carried.value, carried.standard_error) == pytest.approx((2.0 * ratio, 0.01 * ratio),
                                                                    rel=1e-12)


# Stated and true settings of cameras whose shutter and iris move in thirds of a stop.
@pytest.mark.parametrize("before, after, true_ratio", [
    ({"exposure_s": 1 / 60}, {"exposure_s": 1 / 250}, 64 / 256),
    ({"exposure_s": 1 / 125}, {"exposure_s": 15.0}, 128 * 16),
    ({"exposure_s": 1 / 13}, {"exposure_s": 0.3}, 4.0),
    ({"f_number": 8.0}, {"f_number": 11.0}, 1 / 2),
    ({"f_number": 5.6}, {"f_number": 4.0}, 2.0),
    ({"exposure_s": 1 / 500}, {"exposure_s": 1 / 1000}, 1 / 2),
])
def test_the_rounding_of_stated_settings_is_in_the_error(before, after, true_ratio):
    carried = scale_for_photo(SCALE, photo(**before), photo(**after))
    off = carried.value / 2.0 / true_ratio - 1
    # The error is just what rounding did, to first order.
    assert carried.standard_error / carried.value == pytest.approx(np.hypot(0.005, off), rel=0.08,
                                                                   abs=1e-9)
    assert ("round the settings" in carried.source) == (abs(off) > 1e-6)


def test_half_stops_of_the_iris_are_not_taken_for_rounded_thirds():
    assert rounding_error(photo(f_number=8.0), photo(f_number=6.7)) < 0.001


@pytest.mark.parametrize("before, after",
                         [(1 / 60, 1 / 60), (0.012345, 1 / 60), (1 / 57, 1 / 23), (1 / 128,
                                                                                   1 / 512)])
def test_equal_and_exact_times_are_taken_as_stated(before, after):
    assert rounding_error(photo(before), photo(after)) == 0


@pytest.mark.parametrize("changes, message",
                         [({"iso": None}, "states its iso"), ({"f_number": None}, "its f_number"),
                          ({"exposure_s": None}, "states no exposure time")])
def test_settings_that_one_photo_does_not_state_are_asked_for(changes, message):
    with pytest.raises(InputError, match=message):
        scale_for_photo(SCALE, photo(), photo(**changes))


def test_a_common_error_adds_to_the_whole_and_not_to_that_of_each_band():
    scale = with_common_error(with_common_error(SCALE, "lamp", 0.012), "shutter", 0.009)
    # Round-off.
    assert scale.standard_error / scale.value == pytest.approx(np.hypot(0.005, 0.015), rel=1e-12)
    assert error_of_each_band(scale) == pytest.approx(0.005, rel=1e-12)
    carried = scale_for_photo(scale, photo(1 / 60), photo(1 / 250))
    assert error_of_each_band(carried) == pytest.approx(0.005, rel=1e-9)
    assert list(carried.common_errors) == ["lamp", "shutter",
                                                                ROUNDED_EXPOSURES]
