"""Drift of the light between two photos: found, carried into the scale, and not invented."""
import numpy as np
import pytest

from spectrabox.capture.photo.regions import region_signals
from spectrabox.radiometry.error_model import drift_covariance
from spectrabox.radiometry.errors import CheckError, ClippedPhotoError, InputError
from spectrabox.radiometry.light_scale import drift_between, scale_after_drift
from spectrabox.radiometry.records.calibration import LightScale
from spectrabox.radiometry.records.photos import LinearImage, PhotoKind

WHITE = np.array([0.5, 0.6, 0.4])
LEFT, RIGHT = [[10, 10], [30, 10], [30, 30], [10, 30]], [[50, 10], [70, 10], [70, 30], [50, 30]]
ERROR = 0.002


def photo(ratio=1.0, exposure_s=0.1, rng=None, step=1.0, **changes):
    """Two grey references, the right one half as bright, on black; ``ratio`` is the light's."""
    signal = np.zeros((40, 80, 3))
    signal[8:33, 8:33], signal[8:33, 48:73] = WHITE, WHITE / 2
    signal *= np.asarray(ratio) * exposure_s / 0.1
    variance = np.full(signal.shape, 1e-6)
    if rng is not None:
        signal = signal + 1e-3 * rng.standard_normal(signal.shape)
    parts = {"signal": signal.astype(np.float32), "variance": variance.astype(np.float32),
             "saturated": np.zeros(signal.shape, bool), "sensor_step": step,
             "exposure_s": exposure_s, "iso": 100.0, "f_number": 8.0, "kind": PhotoKind.RAW,
             "camera": "", "source": "IMG.dng", "sha256": ""}
    return LinearImage(**(parts | changes))


def drift(ratio, regions=(LEFT, RIGHT), error=ERROR, rng=None, **options):
    chart, thing = photo(rng=rng), photo(ratio, rng=rng, **options)
    return drift_between(chart, region_signals(chart, regions), thing,
                         region_signals(thing, regions), error)


def test_a_change_of_level_is_found_whatever_the_exposure():
    for exposure_s in (0.1, 0.04):
        drifts = drift(1.03, exposure_s=exposure_s)
        assert drifts.level == pytest.approx(1.03, rel=1e-6)  # single precision
        # sqrt(2) x 0.2 % over the square root of two references.
        assert drifts.level_error == pytest.approx(1.03 * ERROR, rel=1e-5)
        assert not drifts.colour_changed and "3.00% brighter" in drifts.sentence
        np.testing.assert_array_equal(drift_covariance(drifts), 0)


@pytest.mark.parametrize("setting", ["iso", "f_number"])
def test_a_setting_that_only_one_photo_states_is_not_taken_for_drift(setting):
    with pytest.raises(InputError, match=f"only one of IMG.dng and IMG.dng states its {setting}"):
        drift(1.0, **{setting: None})


def test_rounded_exposures_are_not_blamed_on_the_light_alone():
    chart, thing = photo(exposure_s=1 / 60), photo(64 / 60 * 250 / 256, exposure_s=1 / 250)
    drifts = drift_between(chart, region_signals(chart, (LEFT,)), thing,
                           region_signals(thing, (LEFT,)), ERROR)
    assert "4.17% brighter" in drifts.sentence
    assert "; 4.0% of it may be how the camera rounds" in drifts.sentence
    assert "rounds" not in drift(1.03).sentence


def test_the_scale_follows_the_light_with_its_error():
    scale = scale_after_drift(LightScale(2.0, 0.01, None, "chart photo"), drift(0.9))
    assert scale.value == pytest.approx(1.8, rel=1e-6)
    assert scale.standard_error == pytest.approx(1.8 * np.hypot(0.005, ERROR), rel=1e-5)
    assert scale_after_drift(LightScale(2.0, None, None, "given"),
                             drift(0.9)).standard_error is None


def test_a_change_of_colour_widens_the_errors():
    drifts = drift([1.05, 1.0, 1.0])
    assert drifts.colour_changed and "its colour changed by up to 3.3" in drifts.sentence
    shift = np.array([1.05, 1, 1]) / 1.05 ** (1 / 3) - 1
    np.testing.assert_allclose(drift_covariance(drifts), np.outer(shift, shift), atol=1e-8)


def test_an_image_of_half_size_is_outlined_in_pixels_of_the_photo():
    halved = photo(step=2.0)
    # single precision
    np.testing.assert_allclose(region_signals(halved, [np.array(LEFT) * 2]), [WHITE], rtol=1e-6)


def test_regions_that_cannot_be_compared_are_refused():
    one = photo()
    with pytest.raises(InputError, match="written as four corners"):
        region_signals(one, [[10, 10], [30, 10]])
    with pytest.raises(InputError, match="reference region 1 leaves the photo of 80 x 40 pixels"):
        region_signals(one, [np.array(LEFT) + 60])
    with pytest.raises(InputError, match="holds 9 pixels"):
        region_signals(one, [[[10, 10], [12, 10], [12, 12], [10, 12]]])
    with pytest.raises(ClippedPhotoError, match="reference region 2 is saturated in 100%"):
        marks = np.zeros((40, 80, 3), bool)
        marks[:, 45:] = True
        region_signals(photo(saturated=marks), (LEFT, RIGHT))
    with pytest.raises(CheckError, match="is too dark"):
        region_signals(photo(0.0), (LEFT,))
    with pytest.raises(InputError, match="names 2 references and the object photo 1"):
        drift_between(one, region_signals(one, (LEFT, RIGHT)), one, region_signals(one, (LEFT,)),
                      ERROR)
    unsaid = LinearImage(**{**vars(one), "exposure_s": None})
    with pytest.raises(InputError, match="states no exposure time"):
        drift_between(unsaid, region_signals(one, (LEFT,)), one, region_signals(one, (LEFT,)),
                      ERROR)
