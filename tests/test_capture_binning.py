import numpy as np
import pytest

from spectrabox.capture.photo.preview import area_weights, bin_image, render_size
from spectrabox.radiometry.records.photos import LinearImage, PhotoKind

SIZES = [(10, 6), (7, 5), (3, 3), (24, 17), (1, 1)]


def image(signal, variance=None, saturated=None):
    signal = np.asarray(signal, np.float32)
    return LinearImage(
        signal=signal, variance=np.ones_like(signal) if variance is None else variance,
        saturated=np.zeros(signal.shape, bool) if saturated is None else saturated, sensor_step=2.0,
        exposure_s=None, iso=None, f_number=None, kind=PhotoKind.RAW, camera="", source="photo",
        sha256="")


@pytest.mark.parametrize("width, height", SIZES)
def test_a_constant_stays_constant(width, height):
    binned = bin_image(image(np.full((17, 24, 3), 0.3)), width, height)
    assert binned.signal.shape == (height, width, 3)
    # Weights and sums in single precision: 24 terms of eps.
    np.testing.assert_allclose(binned.signal, 0.3, rtol=24 * np.finfo(np.float32).eps)


@pytest.mark.parametrize("width, height", SIZES)
def test_the_total_is_conserved(width, height):
    photo = image(np.random.default_rng(1).uniform(size=(17, 24, 3)))
    binned = bin_image(photo, width, height)
    # Round-off of single precision over 17 + 24 terms.
    np.testing.assert_allclose(binned.signal.mean(axis=(0, 1)), photo.signal.mean(axis=(0, 1)),
                               rtol=41 * np.finfo(np.float32).eps)


def test_whole_blocks_give_plain_means_and_variances_of_the_mean():
    rng = np.random.default_rng(2)
    signal, variance = rng.uniform(size=(2, 12, 20, 3)).astype(np.float32)
    binned = bin_image(image(signal, variance), 5, 4)
    # Round-off of single precision over 3 + 4 terms, twice.
    rtol = 14 * np.finfo(np.float32).eps
    np.testing.assert_allclose(binned.signal, signal.reshape(4, 3, 5, 4, 3).mean(axis=(1, 3)),
                               rtol=rtol)
    np.testing.assert_allclose(binned.variance, variance.reshape(4, 3, 5, 4, 3).mean(axis=(1, 3))
                               / 12, rtol=rtol)
    assert binned.sensor_step == 8.0


def test_the_stated_variance_is_that_of_repeated_photos():
    rng = np.random.default_rng(3)
    photos = [bin_image(image(rng.normal(size=(17, 23, 3))), 6, 5) for _ in range(400)]
    scatter = np.var([photo.signal for photo in photos], axis=0, ddof=1)
    # 90 chi-square variables of 399 degrees of freedom, each with relative sigma 0.071; their mean
    # within 4 sigma.
    assert np.mean(scatter / photos[0].variance) == pytest.approx(1, abs=4 * 0.071 / np.sqrt(90))


def test_a_pixel_is_saturated_where_any_contributor_is():
    saturated = np.zeros((9, 9, 3), bool)
    saturated[4, 4, 1] = True
    binned = bin_image(image(np.zeros((9, 9, 3)), saturated=saturated), 2, 3)
    expected = np.zeros((3, 2, 3), bool)
    expected[1, :, 1] = True  # the middle column of nine belongs half to either of two
    np.testing.assert_array_equal(binned.saturated, expected)


@pytest.mark.parametrize("source, target", [(9, 2), (10, 5), (7, 7), (3, 8)])
def test_weights_are_means_over_the_target_pixel(source, target):
    weights = area_weights(source, target)
    # Round-off of at most ``source`` terms.
    np.testing.assert_allclose(weights.sum(axis=1), 1, atol=source * np.finfo(float).eps)
    np.testing.assert_allclose(weights.sum(axis=0), target / source,
                               atol=source * np.finfo(float).eps)


@pytest.mark.parametrize("photo, target, expected",
                         [((6000, 4000), 96, (96, 64)), ((6000, 4000), 100, (99, 66)), ((750, 422),
                                                                                        128,
                                                                                        (128, 72)),
                          ((100, 100), 64, (64, 64))])
def test_the_render_takes_the_nearest_aspect(photo, target, expected):
    assert render_size(*photo, target) == expected


@pytest.mark.parametrize("width, height", [(4032, 3024), (6016, 4016), (422, 750), (1999, 777)])
def test_the_render_is_near_the_wanted_width_and_within_a_pixel_of_the_aspect(width, height):
    w, h = render_size(width, height, 128)
    assert 96 <= w <= 160
    # The height is rounded to a whole pixel.
    assert abs(w * height / width - h) <= 0.5
