"""Pixels are areas: where their centres lie, and what stretching them does to their noise."""
import cv2
import numpy as np
import pytest
from test_calibrate_geometry import photo

from spectrabox.calibrate.geometry.lens import Lens
from spectrabox.calibrate.geometry.projection import undistorted
from spectrabox.capture.chart.patches import image_from_sensor, pixels_inside, sample_patches
from spectrabox.capture.photo.black_level import masked_black
from spectrabox.capture.photo.preview import bin_image
from spectrabox.radiometry.records.photos import ChartDetection

QUAD = np.array([[12.2, 10.7], [71.3, 14.1], [66.9, 59.6], [15.4, 55.2]])


def sensor_image(step):
    """A picture whose signal is the place on the sensor, averaged over pixels of that step."""
    y, x = np.mgrid[:96, :96].astype(float)
    whole = photo(np.stack([x, y, np.ones(x.shape)], axis=-1))
    return whole if step == 1 else bin_image(whole, 96 // step, 96 // step)


@pytest.mark.parametrize("step", [1, 2, 3, 4])
def test_a_pixel_lies_where_its_samples_lie_on_the_sensor(step):
    """Of a photo of places: every pixel reads its own place, and a patch the places of its own."""
    image = sensor_image(step)
    row, column = np.mgrid[:96 // step, :96 // step]
    # means of whole numbers up to 95, in single precision
    atol = 95 * 2**-22
    np.testing.assert_allclose(image_from_sensor(image.signal[..., :2], step),
                               np.stack([column, row], axis=-1), atol=atol)
    y, x = pixels_inside(QUAD, step, *image.signal.shape[:2])
    inside = cv2.pointPolygonTest
    expected = [(r, c) for r, c in np.ndindex(*image.signal.shape[:2])
                if inside(QUAD.astype(np.float32),
                          tuple(image.signal[r, c, :2].astype(float)), False) >= 0]
    assert sorted(zip(y.tolist(), x.tolist(), strict=True)) == expected
    found = sample_patches(image, ChartDetection(QUAD[None], 1.0, False, ""))
    seen = image.signal[y, x].mean(axis=0)
    # float32 sums of some thousand numbers
    np.testing.assert_allclose(found.mean[0], seen, rtol=1e-5)


def test_noise_where_a_lens_stretches_the_picture_is_that_of_blocks_there():
    """A pixel stretched over twice the area tells half as much of a block: middle and corners."""
    matrix = np.array([[300.0, 0, 159.5], [0, 300.0, 119.5], [0, 0, 1]])
    lens = Lens(320, 240, matrix, np.array([-0.25, 0.03, 0, 0, 0]), np.zeros(4), np.zeros(5), 0.0,
                "given")
    rng, sigma = np.random.default_rng(33), 0.02
    noisy = [undistorted(photo(1 + sigma * rng.standard_normal((240, 320, 3)),
                               np.full((240, 320, 3), sigma**2)), lens) for _ in range(60)]
    y, x = np.mgrid[:240, :320]
    away = np.hypot(x - 159.5, y - 119.5).reshape(12, 20, 16, 20).mean(axis=(1, 3))

    def blocks(values):
        return values.astype(float).reshape(12, 20, 16, 20, 3).mean(axis=(1, 3))

    shown = ~blocks(noisy[0].saturated).any(axis=-1)
    stated = blocks(noisy[0].variance) / 400
    scatter = np.mean([(blocks(one.signal) - 1) ** 2 for one in noisy], axis=0)
    ratios, areas = [], []
    for low, high in ((0, 60), (60, 110), (110, 200)):
        zone = shown & (away >= low) & (away < high)
        ratios.append(scatter[zone].mean() / stated[zone].mean())
        areas.append(stated[zone].mean() / sigma**2 * 400)
    # 60 photos of 20 blocks and more, in three bands: 2.4 % known at worst, and shared rims
    np.testing.assert_allclose(ratios, 1, atol=0.09)
    # the test can tell: the lens shrinks the corners by more than that
    assert areas[2] / areas[0] > 1 + 2 * 0.09, areas


def test_a_half_size_photo_is_straightened_as_the_binned_whole_one_is():
    lens = Lens(320, 240, np.array([[300.0, 0, 150.0], [0, 300.0, 128.0], [0, 0, 1]]),
                np.array([-0.2, 0, 0, 0, 0]), np.zeros(4), np.zeros(5), 0.0, "given")
    y, x = np.mgrid[:240, :320].astype(float)
    whole = photo(np.stack([x, y, np.ones(x.shape)], axis=-1))
    half = bin_image(whole, 160, 120)
    first, last = bin_image(undistorted(whole, lens), 160, 120), undistorted(half, lens)
    shown = ~(first.saturated | last.saturated).any(axis=-1)
    # places in pixels of the sensor: maps in steps of 1/32 of a pixel of two, and its bend
    np.testing.assert_allclose(last.signal[shown], first.signal[shown], atol=0.1)
    assert shown.mean() > 0.9


@pytest.mark.parametrize("origin", [(0, 0), (5, 0), (0, 7), (9, 11)])
@pytest.mark.parametrize("area", [(0, 0, 96, 9), (1, 0, 90, 11), (0, 3, 8, 120), (3, 5, 10, 119)])
def test_masked_pixels_tell_the_black_level_of_their_own_place_in_the_tile(origin, area):
    """Whatever parity the active area and the masked area begin with."""
    levels = np.array([[510.0, 512.5, 514.0], [509.0, 520.0, 501.0]])
    y, x = np.mgrid[:100, :121]
    whole = levels[(y - origin[0]) % 2, (x - origin[1]) % 3]
    np.testing.assert_array_equal(masked_black(whole, (area, (40, 50, 80, 90)), origin, (2, 3)),
                                  levels)
