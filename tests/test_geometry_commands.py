"""The camera's geometry from photo to scene: what Mitsuba renders lies where the lens and the pose
say.
"""
import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from geometry_views import SHIFT, TILTS, TRUE, seen
from test_calibrate_pose import CORNERS, TURN
from test_calibrate_pose import SHIFT as BOX_SHIFT
from typer.testing import CliRunner

from spectrabox.calibrate.geometry import projection
from spectrabox.calibrate.geometry.board import read_board
from spectrabox.calibrate.geometry.lens import (
    Lens,
    Pose,
    mitsuba_sensor,
    pinhole,
    read_lens,
    write_lens,
)
from spectrabox.calibrate.geometry.pose import lens_of_focal_length
from spectrabox.calibrate.geometry.projection import board_picture
from spectrabox.capture.photo.image_files import read_linear_file
from spectrabox.capture.photo.image_writers import write_exr
from spectrabox.radiometry.errors import InputError
from spectrabox.reconstruct.rendering.renderer import load_scene, start_mitsuba
from spectrabox.reconstruct.scene.edit_scene import scene_with_camera
from spectrabox.session.cli import app

BOARD = "columns = 9\nrows = 7\nsquare = 0.03\nmarker = 0.022\n"
SCENE = """<scene version="3.0.0">
    <!-- measured by hand -->
    <default name="wide" value="640"/>
    <integrator type="path"/>
    <sensor type="perspective" id="camera">
        <float name="fov" value="20"/><string name="fov_axis" value="smaller"/>
        <transform name="to_world"><lookat origin="0,0,9" target="0,0,0" up="0,1,0"/></transform>
        <film type="hdrfilm"><integer name="width" value="$wide"/>
        <integer name="height" value="480"/>
            <rfilter type="box"/></film>
        <sampler type="multijitter"/>
    </sensor>
    <emitter type="constant" id="sky"/>
</scene>
"""


def call(*arguments, code=0):
    outcome = CliRunner().invoke(app, ["geometry", *(str(argument) for argument in arguments)])
    if outcome.exception is not None and not isinstance(outcome.exception, SystemExit):
        raise outcome.exception
    assert outcome.exit_code == code, outcome.output
    return outcome


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "board.toml").write_text(BOARD, encoding="utf-8")
    (tmp_path / "scene.xml").write_text(SCENE, encoding="utf-8")
    write_lens(tmp_path / "lens.json", TRUE)
    return tmp_path


def bent_photo(folder: Path, tilt, name="photo.exr", shift=SHIFT):
    """The board as the bent lens sees it, on grey."""
    picture = board_picture(read_board(folder / "board.toml"), 100).astype(np.float32) / 255
    picture = cv2.GaussianBlur(picture, (0, 0), 1)
    y, x = np.mgrid[0:480, 0:640].astype(float)
    rays = cv2.undistortPoints(np.stack([x, y], axis=-1).reshape(-1, 1, 2), TRUE.matrix,
                               TRUE.distortion)
    turn = cv2.Rodrigues(np.array(tilt))[0]
    plane = np.linalg.inv(np.column_stack([turn[:, :2], shift]))  # from rays to places on the board
    across, down, depth = plane @ np.column_stack([rays.reshape(-1, 2), np.ones(x.size)]).T
    drawn = (np.stack([across, down]) / depth / 0.03 * 100
             + 49.5).reshape(2, 480, 640).astype(np.float32)
    grey = cv2.remap(picture, *drawn, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT,
                     borderValue=0.5)
    write_exr(folder / name, np.repeat(0.05 + 0.8 * grey[..., None], 3, axis=2), ["R", "G", "B"],
              0.1)
    return folder / name


def points_file(folder, points, places=CORNERS):
    text = "".join(f"[points.p{number}]\nscene = {place.tolist()}\npx = {point.tolist()}\n"
                   for number, (place, point) in enumerate(zip(places, points, strict=True)))
    (folder / "points.toml").write_text(text, encoding="utf-8")
    return folder / "points.toml"


def camera_of(path):
    """The camera of a scene file as Mitsuba loads it: matrix (4, 4)."""
    import mitsuba as mi
    return np.array(mi.traverse(load_scene(path.read_text(encoding="utf-8")))[
                        "camera.to_world"].matrix).reshape(4, 4)


def test_mitsuba_shows_points_where_lens_and_pose_put_them(folder):
    import mitsuba as mi
    start_mitsuba("cpu")
    lens = Lens(640, 480, np.array([[700.0, 0, 342.3], [0, 700, 217.9], [0, 0, 1]]), np.zeros(5),
                np.zeros(4), np.zeros(5), 0.0, "given")
    world_to_camera = np.eye(4)
    world_to_camera[:3, :3], world_to_camera[:3, 3] = cv2.Rodrigues(np.array(TURN))[0], BOX_SHIFT
    pose = Pose(world_to_camera, np.zeros((6, 6)), np.zeros((1, 2)), 0.0)
    balls = "".join(f'<shape type="sphere"><point name="center" value="{x}, {y}, {z}"/><float '
                    'name="radius" value="0.004"/><emitter type="area"/></shape>'
                    for x, y, z in CORNERS)
    (folder / "scene.xml").write_text(SCENE.replace('<emitter type="constant" id="sky"/>', balls),
                                      encoding="utf-8")
    text = scene_with_camera(folder / "scene.xml", mitsuba_sensor(lens, pose), (640, 480), folder)
    image = np.array(mi.render(load_scene(text), spp=16)).sum(axis=2)
    assert np.mean(image > 0) < 0.01
    y, x = np.mgrid[0:480, 0:640]
    for place in seen(CORNERS, TURN, BOX_SHIFT, lens=lens):
        near = image * (np.hypot(x - place[0], y - place[1]) < 12)
        centroid = np.array([(near * x).sum(), (near * y).sum()]) / near.sum()
        # A sphere of 6 pixels is seen off by 6^2 / 700 / 4 = 0.01 at most; the rest is noise of the
        # rim.
        np.testing.assert_allclose(centroid, place, atol=0.05)


def test_the_scene_keeps_what_is_not_the_camera(folder):
    camera = {"to_world": np.eye(4), "fov": 40.0, "fov_axis": "x", "principal_point_offset_x": 0.0,
              "principal_point_offset_y": 0.0}
    text = scene_with_camera(folder / "scene.xml", camera, (640, 480), folder)
    assert "<!-- measured by hand -->" in text and 'value="$wide"' in text and "lookat" not in text
    assert 'value="smaller"' not in text and '<emitter type="constant" id="sky" />' in text
    other = scene_with_camera(folder / "scene.xml", camera, (600, 480), folder)
    assert 'name="width" value="600"' in other and 'name="height" value="480"' in other


def test_board_photos_give_the_lens_and_the_camera_its_place(folder):
    start_mitsuba("cpu")
    photos = [bent_photo(folder, tilt, f"view{number}.exr") for number, tilt in enumerate(TILTS)]
    facts = json.loads(call("lens", *photos, "--board", folder / "board.toml", "--out",
                            folder / "found.json", "--overlay", folder / "shown", "--json").stdout)
    lens = read_lens(folder / "found.json")
    assert facts["rms_px"] < 0.3 and len(facts["views"]) == 6 and (
        folder / "shown" / "view5.png").is_file()
    # Corners of a drawn board are found to about 0.1 pixel; OpenCV's own errors do not know of the
    # drawing's.
    np.testing.assert_allclose(lens.matrix, TRUE.matrix, atol=5)
    placed = folder / "board.toml"
    placed.write_text(BOARD + "origin = [0, 1, 2]\nright = [1, 0, 0]\ndown = [0, -1, 0]\n",
                      encoding="utf-8")
    facts = json.loads(call("pose", photos[1], "--scene", folder / "scene.xml", "--board", placed,
                            "--lens", folder / "lens.json", "--out", folder / "posed.xml",
                            "--overlay", folder / "seen.png", "--json").stdout)
    board_to_world = np.array([[1.0, 0, 0, 0], [0, -1, 0, 1], [0, 0, -1, 2], [0, 0, 0, 1]])
    board_to_camera = np.eye(4)
    board_to_camera[:3, :3], board_to_camera[:3, 3] = cv2.Rodrigues(np.array(TILTS[1]))[0], SHIFT
    truth = board_to_world @ np.linalg.inv(board_to_camera)
    # Half a metre away, 0.1 pixel in 700 along 48 corners: well under a millimetre.
    np.testing.assert_allclose(facts["position"], truth[:3, 3], atol=1e-3)
    np.testing.assert_allclose(camera_of(folder / "posed.xml")[:3, 3], truth[:3, 3], atol=1e-3)
    np.testing.assert_allclose(camera_of(folder / "posed.xml")[:3, 2], truth[:3, 2], atol=2e-3)
    assert (folder / "seen.png").is_file() and not facts["in_one_plane"]


def test_box_corners_give_the_pose_without_a_lens(folder):
    lens = lens_of_focal_length(700.0, 640, 480)
    points = points_file(folder, seen(CORNERS, TURN, BOX_SHIFT, np.random.default_rng(1), 0.3,
                                      lens))
    photo = bent_photo(folder, TILTS[0])
    outcome = call("pose", photo, "--scene", folder / "scene.xml", "--points", points, "--out",
                   folder / "posed.xml")
    assert "8 points, rms 0." in outcome.stdout and "focal length 69" in outcome.stdout.replace(
        "70", "69")
    assert "principal point in the middle and no distortion are assumed" in outcome.stdout
    assert (folder / "scene.xml").read_text(encoding="utf-8") == SCENE


def test_the_overlay_shows_marked_points_and_where_the_pose_has_them(folder, monkeypatch):
    lens = lens_of_focal_length(700.0, 640, 480)
    true, marked = (seen(CORNERS, TURN, BOX_SHIFT, np.random.default_rng(1), noise, lens)
                    for noise in (0.0, 0.3))
    drawn = []
    monkeypatch.setattr(projection, "points_overlay",
                        lambda picture, *points: drawn.extend(points) or picture)
    call("pose", bent_photo(folder, TILTS[0]), "--scene", folder / "scene.xml", "--points",
         points_file(folder, marked), "--out", folder / "posed.xml", "--overlay",
         folder / "seen.png")
    np.testing.assert_allclose(drawn[0], marked, atol=1e-3)
    # a fit of 7 numbers to 16 takes away two thirds of their scatter
    assert np.sum((drawn[1] - true)**2) < np.sum((marked - true)**2)


def test_undistorting_a_photo_writes_a_linear_one(folder):
    photo = bent_photo(folder, TILTS[0])
    facts = json.loads(call("undistort", photo, "--lens", folder / "lens.json", "--out",
                            folder / "straight.exr", "--json").stdout)
    straight = read_linear_file(folder / "straight.exr")
    assert straight.signal.shape == (480, 640, 3) and straight.exposure_s == pytest.approx(0.1)
    # a barrel bends the corners inwards
    assert facts["outside_fraction"] == 0 and np.all(straight.variance > 0)
    write_lens(folder / "cushion.json", Lens(**{**vars(TRUE), "distortion": -TRUE.distortion}))
    facts = json.loads(call("undistort", photo, "--lens", folder / "cushion.json", "--out",
                            folder / "cushion.exr", "--json").stdout)
    assert 0.01 < facts["outside_fraction"] < 0.2
    flat = Lens(640, 480, pinhole(TRUE), np.zeros(5), np.zeros(4), np.zeros(5), 0.0, "")
    write_lens(folder / "flat.json", flat)
    again = json.loads(call("undistort", photo, "--lens", folder / "flat.json", "--out",
                            folder / "same.exr",
                            "--json").stdout)
    assert again["outside_fraction"] == 0
    np.testing.assert_array_equal(read_linear_file(folder / "same.exr").signal,
                                  read_linear_file(photo).signal)


def test_a_lens_file_comes_back_whole(tmp_path):
    write_lens(tmp_path / "lens.json", TRUE)
    lens = read_lens(tmp_path / "lens.json")
    assert all(np.array_equal(getattr(lens, name), value) for name, value in vars(TRUE).items())


@pytest.mark.parametrize("change, sentence", [
                             (lambda text: text[:40], "is no lens file"),
                             (lambda text: text.replace("lens 1", "lens 7"), "format is"),
                             (lambda text: text.replace('"rms_px"', '"rms"'),
                              "rms_px is missing"),
                             (lambda text: text.replace("700.0", "-700.0"),
                              "its focal length is not positive"),
                             (lambda text: text.replace("-0.12,", ""),
                              "distortion is .*; 5 numbers in brackets")])
def test_a_broken_lens_file_is_refused(tmp_path, change, sentence):
    write_lens(tmp_path / "lens.json", TRUE)
    (tmp_path / "lens.json").write_text(
        change((tmp_path / "lens.json").read_text(encoding="utf-8")), encoding="utf-8")
    with pytest.raises(InputError, match=sentence):
        read_lens(tmp_path / "lens.json")
    with pytest.raises(InputError, match="cannot be read"):
        read_lens(tmp_path / "none.json")


def test_what_is_wrong_is_said_and_nothing_is_written(folder):
    photo = bent_photo(folder, TILTS[0])
    scene, board, out = folder / "scene.xml", folder / "board.toml", folder / "out.xml"
    assert "exists already" in call("pose", photo, "--scene", scene, "--board", board, "--out",
                                    scene, code=3).stderr
    assert "give either --points or --board" in call("pose", photo, "--scene", scene, "--out", out,
                                                     code=2).stderr
    shown = call("pose", photo, "--scene", scene, "--board", board, "--lens", folder / "lens.json",
                 "--out", out, code=3)
    assert "does not say where the board lies in the scene" in shown.stderr
    blank = folder / "blank.exr"
    write_exr(blank, np.full((480, 640, 3), 0.4), ["R", "G", "B"], 0.1)
    shown = call("lens", photo, blank, blank, "--board", board, "--out", folder / "none.json",
                 code=4)
    assert "blank.exr is left out: 0 corners" in shown.stderr
    small = folder / "small.exr"
    write_exr(small, np.full((48, 64, 3), 0.4), ["R", "G", "B"], 0.1)
    points = points_file(folder, seen(CORNERS, TURN, BOX_SHIFT))
    shown = call("pose", small, "--scene", scene, "--points", points, "--lens",
                 folder / "lens.json", "--out", out, code=3)
    assert "has 64 x 48 pixels, the lens was calibrated at 640 x 480" in shown.stderr
    assert "0 of 3 photos show the board" in call("lens", blank, blank, blank, "--board", board,
                                                  "--out", folder / "none.json", code=4).stderr
    assert not out.exists() and not (folder / "none.json").exists()


def test_inputs_are_not_written_over(folder):
    photo = bent_photo(folder, TILTS[0])
    before = photo.read_bytes()
    shown = call("undistort", photo, "--lens", folder / "lens.json", "-o", photo, "--force", code=3)
    assert "is an input of this command" in shown.stderr and photo.read_bytes() == before


def test_a_board_goes_into_a_new_folder_and_needs_markers_enough(folder):
    board = folder / "board.toml"
    call("board", "--board", board, "-o", folder / "new" / "board.png")
    assert (folder / "new" / "board.png").is_file()
    board.write_text(BOARD.replace("columns = 9", "columns = 60"), encoding="utf-8")
    answer = call("board", "--board", board, "-o", folder / "large.png", code=3)
    assert "60 x 7 squares needs 210 markers and DICT_5X5_100 holds 100" in answer.stderr


@pytest.mark.parametrize("before, after, sentence", [
                             ('type="perspective"', 'type="thinlens"',
                              "the sensor is of type 'thinlens'"),
                             ("sensor", "sensors", "has no <sensor>"),
                             ("</scene>", "", "not well-formed"),
                             ('<emitter type="constant" id="sky"/>', '<shape type="obj"><string '
                              'name="filename" value="a.obj"/></shape>',
                              "write the copy into")])
def test_a_scene_that_cannot_take_the_camera_is_refused(folder, tmp_path_factory, before, after,
                                                        sentence):
    (folder / "scene.xml").write_text(SCENE.replace(before, after), encoding="utf-8")
    with pytest.raises(InputError, match=sentence):
        scene_with_camera(folder / "scene.xml", {}, (640, 480), tmp_path_factory.mktemp("other"))
