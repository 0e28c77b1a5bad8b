"""The camera's place from known points: recovered, with errors that hold, and refused where points
do not tell.
"""
import cv2
import numpy as np
import pytest
from geometry_views import TILTS, TRUE, seen, view

from spectrabox.calibrate.geometry.board import Board, in_scene, read_board, read_points
from spectrabox.calibrate.geometry.lens import Lens
from spectrabox.calibrate.geometry.pose import (
    lens_of_focal_length,
    pose_and_focal_length,
    pose_from_points,
)
from spectrabox.radiometry.errors import CheckError, InputError

# of an open box
CORNERS = np.array([[x, y, z] for x in (-0.24, 0.24) for y in (0.0, 0.33) for z in (-0.4, 0.0)])
TURN, SHIFT = (np.pi - 0.1, 0.05, -0.02), (0.02, 0.15, 0.9)  # seen from +z, y up
PLAIN = lens_of_focal_length(700.0, 640, 480)


def box_view(rng=None, noise_px=0.3, lens=TRUE):
    return CORNERS, seen(CORNERS, TURN, SHIFT, rng, noise_px, lens)


def true_place(turn=TURN, shift=SHIFT):
    rotation = cv2.Rodrigues(np.array(turn))[0]
    return -rotation.T @ shift, rotation[2]


def test_the_pose_comes_back_from_exact_points():
    for places, points, turn, shift in ((*view(TILTS[1]), TILTS[1], (-0.12, -0.1, 0.5)),
                                        (*box_view(), TURN, SHIFT)):
        pose = pose_from_points(places, points, TRUE)
        # Gauss-Newton's own stop
        np.testing.assert_allclose(pose.world_to_camera[:3, 3], shift, atol=1e-6)
        np.testing.assert_allclose(pose.world_to_camera[:3, :3], cv2.Rodrigues(np.array(turn))[0],
                                   atol=1e-6)


def test_the_focal_length_comes_back_with_the_pose():
    pose, lens = pose_and_focal_length(*box_view(lens=PLAIN), 640, 480)
    assert lens.matrix[0, 0] == pytest.approx(700, rel=1e-6)  # Gauss-Newton's own stop
    np.testing.assert_allclose(pose.position, true_place()[0], atol=1e-6)


@pytest.mark.parametrize("free_focal", [False, True])
def test_the_stated_errors_are_the_scatter_of_repeated_clicks(free_focal):
    rng, poses = np.random.default_rng(4), []
    for _ in range(100):
        places, points = box_view(rng, lens=PLAIN)
        if free_focal:
            pose, lens = pose_and_focal_length(places, points, 640, 480)
            focal = lens.matrix[0, 0], lens.standard_error[0]
        else:
            pose = pose_from_points(places, points, PLAIN)
            focal = 700.0, 1.0
        poses.append((pose.position, pose.position_standard_error, pose.direction,
                      pose.direction_standard_error_deg, *focal))
    position, error, direction, angle, focal, focal_error = (np.array(column)
                                                             for column in zip(*poses, strict=True))
    # 100 draws of three numbers know a standard deviation to 4 to 7 %: 4 sigma.
    assert np.mean(error**2, axis=0) ** 0.5 / position.std(axis=0) == pytest.approx(1, abs=0.28)
    np.testing.assert_allclose(np.mean(position, axis=0), true_place()[0],
                               atol=5 * position.std() / np.sqrt(100))
    turned = np.degrees(np.linalg.norm(direction - true_place()[1], axis=1))
    assert np.sqrt(np.mean(angle**2) / np.mean(turned**2)) == pytest.approx(1, abs=0.28)
    if free_focal:
        assert np.sqrt(np.mean(focal_error**2)) / focal.std() == pytest.approx(1, abs=0.28)


def test_an_uncertain_lens_widens_the_pose():
    places, points = box_view(np.random.default_rng(1))
    known = pose_from_points(places, points, TRUE).position_standard_error
    unsure = Lens(**{**vars(TRUE), "standard_error": np.array([20.0, 20, 5, 5])})
    # 20 of 700 pixels of focal length are 3 % of the distance of 0.9.
    wider = pose_from_points(places, points, unsure).position_standard_error
    assert known.max() < 0.01 < wider.max()


def test_points_that_do_not_tell_are_refused():
    with pytest.raises(InputError, match="4 points cannot determine a pose"):
        pose_from_points(*(array[:4] for array in box_view()), TRUE)
    line = np.outer(np.linspace(0, 0.3, 7), [1.0, 0.5, 0])
    with pytest.raises(InputError, match="the 7 points lie on one line"):
        pose_from_points(line, seen(line, TURN, SHIFT), TRUE)
    places, points = box_view()
    with pytest.raises(InputError, match="8 of the points lie outside the photo of 640 x 480"):
        pose_from_points(places, points + 1000, TRUE)
    flat = np.array([[x, y, 0.0] for x in (-0.2, 0, 0.2) for y in (-0.1, 0.1)])
    with pytest.raises(CheckError,
                       match=r"cannot be told from the distance; they lie in one plane.*--lens"):
        pose_and_focal_length(flat, seen(flat, (np.pi, 0, 0), (0, 0, 0.9), np.random.default_rng(1),
                                         lens=PLAIN), 640, 480)


def test_a_small_plane_that_may_be_turned_over_is_refused():
    tiny = 0.01 * np.array([[x, y, 0.0] for x in (-1, 0, 1) for y in (-1, 1)])
    points = seen(tiny, (0.3, 0, 0), (0, 0, 1.5), np.random.default_rng(1), 0.3, PLAIN)
    with pytest.raises(CheckError, match="two poses of the camera explain the points equally well"):
        pose_from_points(tiny, points, PLAIN)


def test_what_is_wrong_with_points_is_said():
    places, points = box_view()
    with pytest.raises(CheckError, match="no pose of the camera explains the points"):
        pose_from_points(places, np.random.default_rng(1).permutation(points), TRUE)
    mirrored = points * [-1, 1] + [639, 0]
    with pytest.raises(CheckError, match="with left and right exchanged they fit"):
        pose_from_points(places, mirrored, PLAIN)
    wrong = points.copy()
    wrong[3] += 60
    with pytest.raises(CheckError, match="without point 'd' the others fit: correct it"):
        pose_from_points(places, wrong, TRUE, names="abcdefgh")
    with pytest.raises(CheckError, match="without point number 4 the others fit"):
        pose_and_focal_length(places, wrong, 640, 480)


def test_a_board_lies_where_its_file_says(tmp_path):
    path = tmp_path / "board.toml"
    path.write_text('columns = 9\nrows = 7\nsquare = 3\nmarker = 2.2\norigin = [1, 2, 3]\nright = '
                    '[0, 0, -2]\ndown = [0, -1, 0]\n', encoding="utf-8")
    board = read_board(path)
    assert (board.columns, board.rows, board.square,
            board.dictionary) == (9, 7, 3.0, "DICT_5X5_100")
    np.testing.assert_allclose(in_scene(board, np.array([[3.0, 6.0, 0.0]]), "b"), [[1, -4, 0]],
                               atol=1e-12)
    with pytest.raises(InputError, match="does not say where the board lies"):
        in_scene(Board(columns=9, rows=7, square=3, marker=2), np.zeros((1, 3)), "board.toml")


@pytest.mark.parametrize("text, sentence", [
                             ("columns = 9\nrows = 7\nsquare = 3\nmarker = 4",
                              "the marker must lie inside its square"),
                             ("columns = 9\nrows = 2\nsquare = 3\nmarker = 2",
                              "rows is 2; 3 or more is needed"),
                             ("colums = 9", "unknown key 'colums'"),
                             ("columns = 9\nrows = 7\nsquare = 3\nmarker = 2\norigin = [0, 0]",
                              "3 numbers in brackets"),
                             ("columns = 9\nrows = 7\nsquare = 3\nmarker = 2\norigin = "
                              "[0,0,0]\nright = [1,0,0]\ndown = [1,1,0]", "right angle"),
                             ("columns = 9\nrows = 7\nsquare = '3'\nmarker = 2",
                              "square is '3'; a number is needed"),
                             ("columns = ", "is not valid TOML")])
def test_a_board_file_that_cannot_be_right_is_refused(tmp_path, text, sentence):
    path = tmp_path / "board.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=sentence):
        read_board(path)


@pytest.mark.parametrize("text, sentence", [
                             ("", r"the table \[points.NAME\] is missing"),
                             ("[points.a]\nscene = [1, 2, 3]", "points.a.px is missing"),
                             ("[points.a]\nscene = [1, 2]\npx = [1, 2]", "points.a.scene is"),
                             ("[points.a]\nscene = [1, 2, nan]\npx = [1, 2]",
                              "a number is needed")])
def test_a_points_file_that_cannot_be_right_is_refused(tmp_path, text, sentence):
    path = tmp_path / "points.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=sentence):
        read_points(path)
    with pytest.raises(InputError, match="cannot be read"):
        read_points(tmp_path / "none.toml")
