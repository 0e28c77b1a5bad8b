"""Lens and undistorted photos: the lens comes back from projected points, and undoing the
distortion undoes it.
"""
import cv2
import numpy as np
import pytest
from geometry_views import BOARD, TILTS, TRUE, view

from spectrabox.calibrate.geometry.lens import pinhole
from spectrabox.calibrate.geometry.projection import (
    board_picture,
    find_board,
    lens_from_views,
    points_overlay,
    undistorted,
)
from spectrabox.radiometry.errors import CheckError, InputError
from spectrabox.radiometry.records.photos import LinearImage, PhotoKind


def photo(signal, variance=None, step=1.0):
    variance = np.full(signal.shape, 1e-6) if variance is None else variance
    return LinearImage(signal.astype(np.float32), variance.astype(np.float32),
                       np.zeros(signal.shape, bool), step, 0.1, 100.0, 4.0, PhotoKind.RAW, "camera",
                       "IMG_1.dng", "")


def test_the_lens_comes_back_from_exact_views():
    lens, by_view = lens_from_views([view(tilt) for tilt in TILTS], 640, 480)
    # Points are handed to OpenCV in single precision: 1e-7 x 640 pixels, times the condition of six
    # views.
    np.testing.assert_allclose(lens.matrix, TRUE.matrix, atol=0.05)
    assert lens.rms_px < 1e-3 and by_view.shape == (6,)


def test_the_stated_errors_of_the_lens_cover_the_truth():
    rng = np.random.default_rng(3)
    lens, _ = lens_from_views([view(tilt, rng) for tilt in TILTS], 640, 480)
    given = lens.matrix[[0, 1, 0, 1], [0, 1, 2, 2]]
    # Nine normal numbers: all within 4 standard errors at a significance of 6e-4.
    assert np.all(np.abs(given - [700.0, 702.0, 325.0, 236.0]) < 4 * lens.standard_error)
    assert np.all(np.abs(lens.distortion - TRUE.distortion) < 4 * lens.distortion_error)


def test_the_board_is_found_in_its_own_picture():
    places, points = find_board(BOARD, board_picture(BOARD, 80))
    assert len(places) == 8 * 6
    # A frontal picture: a square is 80 pixels, half a square of margin, drawn on whole pixels.
    np.testing.assert_allclose(points, places[:, :2] / BOARD.square * 80 + 39.5, atol=0.6)


def test_undistorting_straightens_what_the_lens_bent():
    y, x = np.mgrid[0:480, 0:640].astype(float)
    pixels = np.stack([x, y], axis=-1).reshape(-1, 1, 2)
    ideal = cv2.undistortPoints(pixels, TRUE.matrix, TRUE.distortion,
                                P=pinhole(TRUE)).reshape(480, 640, 2)
    # a scene whose signal is its place
    bent = np.stack([ideal[..., 0], ideal[..., 1], np.ones((480, 640))], axis=-1)
    straight = undistorted(photo(bent), TRUE)
    shown = ~straight.saturated.any(axis=-1)
    # Linear interpolation of a smooth map, and maps in steps of 1/32 pixel.
    np.testing.assert_allclose(straight.signal[shown][:, 0], x[shown], atol=0.05)
    np.testing.assert_allclose(straight.signal[shown][:, 1], y[shown], atol=0.05)
    assert shown.mean() > 0.9 and straight.source == "IMG_1.dng, undistorted"
    assert straight.iso == 100.0


def test_a_half_size_image_is_bent_back_like_the_whole_photo():
    # centres of 2 x 2 blocks in pixels of the photo
    y, x = np.mgrid[0:240, 0:320].astype(float) * 2 + 0.5
    pixels = np.stack([x, y], axis=-1).reshape(-1, 1, 2)
    ideal = cv2.undistortPoints(pixels, TRUE.matrix, TRUE.distortion,
                                P=pinhole(TRUE)).reshape(240, 320, 2)
    straight = undistorted(photo(np.concatenate([ideal, np.ones((240, 320, 1))], axis=-1),
                                 step=2.0), TRUE)
    shown = ~straight.saturated.any(axis=-1)
    # as above, pixels twice as large
    np.testing.assert_allclose(straight.signal[shown][:, 0], x[shown], atol=0.1)


def test_the_variance_of_a_block_mean_is_right_after_undistorting():
    rng = np.random.default_rng(5)
    spread = 0.01 * (1 + np.indices((480, 640, 3))[1] / 640)
    noisy = [undistorted(photo(1 + spread * rng.standard_normal(spread.shape), spread**2),
                         TRUE) for _ in range(12)]

    def blocks(image):
        return image[40:440, 40:600].reshape(20, 20, 28, 20, 3).mean(axis=(1, 3))

    stated = blocks(noisy[0].variance.astype(float)) / 400
    scatter = np.mean([(blocks(one.signal.astype(float)) - 1) ** 2 for one in noisy], axis=0)
    # 12 x 1680 squares of normal numbers: their mean is known to 1 %; 3 of that. Blocks share their
    # rims: 1 % more.
    assert np.mean(scatter / stated) == pytest.approx(1, abs=0.04)


def test_saturated_pixels_and_the_outside_stay_marked():
    signal = np.full((480, 640, 3), 0.5)
    image = photo(signal)
    marks = np.zeros(signal.shape, bool)
    marks[100, 200, 1] = True
    image = LinearImage(**{**vars(image), "saturated": marks})
    straight = undistorted(image, TRUE)
    where = cv2.undistortPoints(np.array([[[200.0, 100.0]]]), TRUE.matrix, TRUE.distortion,
                                P=pinhole(TRUE))[0, 0]
    x, y = np.rint(where).astype(int)
    assert straight.saturated[y, x,
                              1] and not straight.saturated[y, x, 0] and not straight.saturated[
        240, 320].any()
    assert np.all(straight.variance > 0)


def test_the_overlay_shows_points_where_they_are():
    picture = points_overlay(np.zeros((100, 200, 3), np.uint8), np.array([[21.0, 41.0]]),
                             np.array([[301.0, 161.0]]), 2.0)
    rows, columns = np.nonzero(picture[..., 1] > 150)
    assert picture.shape == (100, 200, 3)
    assert abs(rows.mean() - 20.25) < 1 and abs(columns.mean() - 10.25) < 1  # drawn on whole pixels
    rows, columns = np.nonzero(picture[..., 0] > 150)
    assert abs(rows.mean() - 80.25) < 1 and abs(columns.mean() - 150.25) < 1


def test_too_little_is_refused():
    with pytest.raises(InputError, match="2 views of the board cannot determine a lens"):
        lens_from_views([view(tilt) for tilt in TILTS[:2]], 640, 480)
    with pytest.raises(CheckError, match="0 corners of the ChArUco board are seen, and 0 of its "
                       "markers"):
        find_board(BOARD, np.full((200, 300), 128, np.uint8))
    with pytest.raises(CheckError, match="do not mirror the photo"):
        find_board(BOARD, board_picture(BOARD, 40)[:, ::-1].copy())
    with pytest.raises(InputError, match="use whole photos of the same camera"):
        undistorted(photo(np.ones((10, 10, 3))), TRUE)


def test_views_that_tell_nothing_are_refused():
    rng = np.random.default_rng(2)
    with pytest.raises(CheckError, match="leave the focal length open"):
        lens_from_views([view((0.0, 0.0, 0.1 * turn), rng) for turn in range(4)], 640, 480)
    other = view(TILTS[1])
    with pytest.raises(CheckError, match="no lens explains the views"):
        lens_from_views([view(TILTS[0]), (other[0], rng.permutation(other[1])), view(TILTS[2])],
                        640, 480)
