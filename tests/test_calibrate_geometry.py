"""Geometry: lens and pose come back from projected points, and undoing the distortion undoes it."""
import cv2
import numpy as np
import pytest

from calibrate.geometry import (
    Lens,
    charuco_board,
    find_board,
    lens_from_views,
    mitsuba_sensor,
    pinhole,
    pose_from_points,
    undistorted,
)
from radiometry.errors import CheckError, InputError

TRUE = Lens(640, 480, np.array([[700.0, 0, 325], [0, 702.0, 236], [0, 0, 1]]),
            np.array([-0.12, 0.05, 0.001, -0.001, 0]), np.zeros(4), 0.0)
BOARD = charuco_board(9, 7, 0.03, 0.022)


def view(tilt, rng=None):
    places = np.asarray(BOARD.getChessboardCorners(), dtype=float).reshape(-1, 3)
    points, _ = cv2.projectPoints(places, np.array(tilt), np.array([-0.12, -0.1, 0.5]), TRUE.matrix, TRUE.distortion)
    noise = 0 if rng is None else 0.05 * rng.standard_normal((len(places), 2))
    return places, points.reshape(-1, 2) + noise


TILTS = ((0.3, 0.0, 0.0), (-0.3, 0.2, 0.1), (0.1, 0.4, -0.2), (0.2, -0.4, 0.0), (0.0, 0.0, 0.3), (-0.2, -0.2, -0.1))


def test_the_lens_comes_back_from_exact_views():
    found = lens_from_views([view(tilt) for tilt in TILTS], 640, 480)
    # Points are handed to OpenCV in single precision: 1e-7 x 640 pixels, times the condition of six views.
    np.testing.assert_allclose(found.matrix, TRUE.matrix, atol=0.05)
    assert found.rms_px < 1e-3


def test_the_stated_errors_of_the_lens_cover_the_truth():
    rng = np.random.default_rng(3)
    found = lens_from_views([view(tilt, rng) for tilt in TILTS], 640, 480)
    truth = np.array([700.0, 702.0, 325.0, 236.0])
    given = found.matrix[[0, 1, 0, 1], [0, 1, 2, 2]]
    # Four normal numbers: all within 4 standard errors at a significance of 3e-4.
    assert np.all(np.abs(given - truth) < 4 * found.standard_error)


def test_the_pose_comes_back_from_exact_points():
    places, points = view(TILTS[1])
    pose = pose_from_points(places, points, TRUE)
    np.testing.assert_allclose(pose.world_to_camera[:3, 3], [-0.12, -0.1, 0.5], atol=1e-6)  # Gauss-Newton's own stop
    np.testing.assert_allclose(cv2.Rodrigues(pose.world_to_camera[:3, :3])[0].ravel(), TILTS[1], atol=1e-6)


def test_the_board_is_found_in_its_own_picture():
    picture = BOARD.generateImage((900, 700), marginSize=20)
    places, points = find_board(BOARD, picture)
    assert len(places) == 8 * 6
    # A frontal picture: pixels are an affine function of metres; the squares are drawn on whole pixels.
    affine, *_ = np.linalg.lstsq(np.c_[places[:, :2], np.ones(len(places))], points, rcond=None)
    np.testing.assert_allclose(np.c_[places[:, :2], np.ones(len(places))] @ affine, points, atol=0.6)


def test_undistorting_straightens_what_the_lens_bent():
    y, x = np.mgrid[0:480, 0:640].astype(float)
    pixels = np.stack([x, y], axis=-1).reshape(-1, 1, 2)
    ideal = cv2.undistortPoints(pixels, TRUE.matrix, TRUE.distortion, P=pinhole(TRUE)).reshape(480, 640, 2)
    photo = np.stack([ideal[..., 0], ideal[..., 1], np.ones((480, 640))], axis=-1)  # a scene whose signal is its place
    straight = undistorted(photo, TRUE)
    inside = np.isfinite(straight).all(axis=-1)
    # Linear interpolation of a smooth map, and single precision maps in steps of 1/32 pixel.
    np.testing.assert_allclose(straight[inside][:, 0], x[inside], atol=0.05)
    np.testing.assert_allclose(straight[inside][:, 1], y[inside], atol=0.05)
    assert inside.mean() > 0.9


def test_the_sensor_looks_where_the_camera_looks():
    pose = pose_from_points(*view(TILTS[0]), TRUE)
    sensor = mitsuba_sensor(TRUE, pose)
    centre = np.linalg.inv(pose.world_to_camera)[:3, 3]
    np.testing.assert_allclose(sensor["to_world"][:3, 3], centre, atol=1e-12)
    np.testing.assert_allclose(sensor["to_world"][:3, 2], pose.world_to_camera[2, :3], atol=1e-12)  # both look along z
    assert np.linalg.det(sensor["to_world"][:3, :3]) == pytest.approx(1)
    assert sensor["fov"] == pytest.approx(np.degrees(2 * np.arctan(320 / 700)))


def test_too_little_is_refused():
    with pytest.raises(InputError, match="2 views of the board cannot determine a lens"):
        lens_from_views([view(tilt) for tilt in TILTS[:2]], 640, 480)
    with pytest.raises(InputError, match="4 points cannot determine a pose"):
        pose_from_points(*(array[:4] for array in view(TILTS[0])), TRUE)
    with pytest.raises(CheckError, match="0 corners of the ChArUco board"):
        find_board(BOARD, np.full((200, 300), 128, np.uint8))
    with pytest.raises(InputError, match="use photos of one size"):
        undistorted(np.ones((10, 10, 3)), TRUE)


def test_shuffled_points_have_no_pose():
    places, points = view(TILTS[0])
    with pytest.raises(CheckError, match="no place of the camera explains the points"):
        pose_from_points(places, np.random.default_rng(1).permutation(points), TRUE)
