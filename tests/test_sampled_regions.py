"""Regions that somebody outlined in a photo: which pixels are theirs, and what these say."""
from __future__ import annotations

import numpy as np
import pytest
from matplotlib.path import Path

from spectrabox.capture.photo import regions
from spectrabox.radiometry.errors import ClippedPhotoError, InputError

from tests.cornell_problem import photo_of

SIZE = (60, 80)
SQUARE = [[10, 20], [40, 20], [40, 45], [10, 45]]
INSIDE = (slice(20, 45), slice(10, 40))         # its pixels; of its edges, left and top are in
VARIANCE = 1e-6


def photo(signal, saturated=None):
    return photo_of(signal, np.full(signal.shape, VARIANCE), saturated)


def plain(bands=3, level=0.4):
    return np.full((*SIZE, bands), level) * np.linspace(1, 0.5, bands)


def outlined(seed, corners):
    """Any outline, which may cross itself, with no corner or edge in the middle of a pixel."""
    return np.random.default_rng(seed).uniform(3, 50, (corners, 2)) + 0.0137


@pytest.mark.parametrize("corners", [3, 4, 7])
@pytest.mark.parametrize("seed", range(5))
def test_pixels_of_an_outline_are_those_of_an_independent_library(seed, corners):
    outline = outlined(seed, corners)
    y, x = np.mgrid[:SIZE[0], :SIZE[1]]
    inside = regions.inside_polygon(outline, x, y)
    rows, columns = regions.pixels_in_polygon(outline, *SIZE)
    by_pixel = np.zeros(SIZE, bool)
    by_pixel[rows, columns] = True
    np.testing.assert_array_equal(by_pixel, inside)
    if corners == 3:        # Matplotlib winds where an outline crosses itself
        expected = Path(outline).contains_points(np.c_[x.ravel(), y.ravel()]).reshape(SIZE)
        np.testing.assert_array_equal(inside, expected)


def test_pixels_beyond_the_picture_are_none():
    rows, columns = regions.pixels_in_polygon(np.array([[-9.5, 50.5], [9.5, 50.5], [9.5, 90],
                                                        [-9.5, 90]]), *SIZE)
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (51, 59, 0, 9)
    assert rows.size == 9 * 10


def test_the_mean_is_of_every_pixel_inside_and_errs_by_their_noise():
    signal = plain()
    signal[INSIDE] *= np.random.default_rng(1).uniform(0.5, 1.5, (25, 30, 1))
    found = regions.sample_regions(photo(signal), {"a": SQUARE})
    np.testing.assert_allclose(found.mean[0], signal[INSIDE].mean(axis=(0, 1)), rtol=1e-6)
    np.testing.assert_allclose(found.covariance_of_mean[0], VARIANCE / 750 * np.eye(3), rtol=1e-4)
    assert found.names == ("a",) and found.pixels.tolist() == [750]


@pytest.mark.parametrize("slope", [(0.004, 0.0), (0.0, 0.004), (-0.002, 0.003)])
def test_light_that_falls_off_evenly_is_no_unevenness(slope):
    y, x = np.mgrid[:SIZE[0], :SIZE[1]]
    light = 0.5 + slope[0] * (x - 25) + slope[1] * (y - 32)
    found = regions.sample_regions(photo(light[..., None] * [1.0, 0.7, 0.4]), {"a": SQUARE})
    np.testing.assert_allclose(found.scatter, 0, atol=1e-4)


def test_unevenness_is_what_pixels_scatter_beyond_noise_in_each_band():
    signal = plain()
    checks = (np.indices(SIZE).sum(axis=0) % 2 - 0.5) * 2
    amount = np.array([0.02, 0.05, 0.0])
    signal = signal * (1 + checks[..., None] * amount)
    found = regions.sample_regions(photo(signal), {"a": SQUARE})
    level = plain()[0, 0]
    expected = np.sqrt(np.maximum((amount * level) ** 2 - VARIANCE, 0)) / level
    np.testing.assert_allclose(found.scatter[0], expected, rtol=2e-3, atol=1e-6)


def test_coordinates_are_those_of_the_whole_photo():
    signal = plain()
    signal[INSIDE] *= 2
    binned = photo(signal)
    half = type(binned)(**{**vars(binned), "sensor_step": 2.0})
    outline = (np.array(SQUARE) + 0.5) * 2 - 0.5
    found = regions.sample_regions(half, {"a": outline})
    np.testing.assert_allclose(found.mean[0], 2 * plain()[0, 0], rtol=1e-6)
    assert found.pixels.tolist() == [750]
    # light is looked up at points of the photo as it was
    np.testing.assert_allclose(found.points_px[0].mean(axis=0), outline.mean(axis=0))


def test_light_is_looked_up_all_over_a_region():
    rectangle = regions.sample_regions(photo(plain()), {"a": SQUARE}).points_px[0]
    x, y = (10 + 30 * (np.arange(5) + 0.5) / 5, 20 + 25 * (np.arange(5) + 0.5) / 5)
    np.testing.assert_allclose(np.unique(rectangle[:, 0]), x)
    np.testing.assert_allclose(np.unique(rectangle[:, 1]), y)
    corner = [[5, 5], [45, 5], [45, 15], [15, 15], [15, 45], [5, 45]]       # an L
    bent = regions.sample_regions(photo(plain()), {"a": corner}).points_px[0]
    assert bent.shape == (25, 2)
    inside = [point for point in bent if Path(np.array(corner)).contains_point(point, radius=1e-6)]
    grid = {(x, y) for x in (9, 17, 25, 33, 41) for y in (9, 17, 25, 33, 41) if x < 15 or y < 15}
    assert {tuple(np.round(point, 9)) for point in inside} == grid
    others = [point for point in bent if tuple(np.round(point, 9)) not in grid]
    np.testing.assert_allclose(others, np.tile(np.mean(sorted(grid), axis=0), (16, 1)))


def clipped(share, bands, count=3):
    """Pixels (H, W, K) of which a share within the square is saturated in some bands."""
    saturated = np.zeros((*SIZE, count), bool)
    part = np.zeros(750, bool)
    part[:round(share * 750)] = True
    for band in bands:
        saturated[INSIDE][..., band] = part.reshape(25, 30)
    return saturated


@pytest.mark.parametrize("bands", [(0,), (2,), (0, 1, 2)])
def test_a_region_is_refused_where_more_than_a_hundredth_is_saturated_in_any_band(bands):
    regions.sample_regions(photo(plain(), clipped(0.009, bands)), {"a": SQUARE})
    with pytest.raises(ClippedPhotoError, match="'a' is saturated in 3% of its pixels"):
        regions.sample_regions(photo(plain(), clipped(0.03, bands)), {"a": SQUARE})


@pytest.mark.parametrize("how", ["without_clipped", "known", "many bands"])
def test_bands_that_are_saturated_are_named_where_others_tell(how):
    count = 5 if how == "many bands" else 3
    saturated = clipped(0.03, (0, 2), count)
    saturated[INSIDE][..., 1] = clipped(0.009, (1,), count)[INSIDE][..., 1]
    found = regions.sample_regions(photo(plain(count), saturated), {"a": SQUARE},
                                   without_clipped=how == "without_clipped",
                                   known=["a"] if how == "known" else [])
    assert found.clipped[0].tolist() == [True, False, True, False, False][:count]


def test_a_region_that_is_saturated_in_all_bands_tells_nothing_and_only_a_known_one_may_be():
    saturated = clipped(0.5, range(3))
    found = regions.sample_regions(photo(plain(), saturated), {"a": SQUARE}, known=["a"])
    assert found.clipped[0].all() and found.edges == {}
    with pytest.raises(ClippedPhotoError, match="saturated in 50% of its pixels"):
        regions.sample_regions(photo(plain(), saturated), {"a": SQUARE}, without_clipped=True)
    with pytest.raises(ClippedPhotoError):      # another being known is no reason
        regions.sample_regions(photo(plain(), saturated), {"a": SQUARE}, known=["b"])


@pytest.mark.parametrize("outline, words", [
    ([[10, 20], [80, 20], [80, 40], [10, 40]], "leaves the photo of 80 x 60 pixels"),
    ([[-1, 20], [20, 20], [20, 40], [-1, 40]], "leaves the photo"),
    ([[10, 20], [20, 20], [20, 60], [10, 60]], "leaves the photo"),
    ([[10, 20], [12.9, 20], [12.9, 24.9], [10, 24.9]], "holds 15 pixels, 16 are needed")])
def test_a_region_lies_in_the_photo_and_holds_sixteen_pixels(outline, words):
    with pytest.raises(InputError, match=words):
        regions.sample_regions(photo(plain()), {"a": outline})


def test_an_edge_is_told_of_the_region_that_it_crosses():
    signal = plain()
    signal[:, 25:] *= 0.8
    even = [[45, 20], [70, 20], [70, 45], [45, 45]]
    noise = np.sqrt(VARIANCE) * np.random.default_rng(3).standard_normal(signal.shape)
    found = regions.sample_regions(photo(signal + noise), {"even": even, "crossed": SQUARE})
    assert set(found.edges) == {"crossed"}
