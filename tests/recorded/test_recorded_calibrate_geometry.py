"""Recorded: lenses, boards, poses, undistorted photos, COLMAP models and where they lie."""
import dataclasses
import json

import numpy as np
import pytest
from colmap_views import CAMERAS, PLACES, pixels, write_model
from geometry_views import BOARD, TILTS, seen, view
from uneven_charts import sizes

from spectrabox.calibrate.geometry import model_in_scene as tie
from spectrabox.calibrate.geometry import pose as posing
from spectrabox.calibrate.geometry import projection
from spectrabox.calibrate.geometry.board import Board, in_scene, read_board, read_points
from spectrabox.calibrate.geometry.colmap_model import for_photo, read_colmap
from spectrabox.calibrate.geometry.lens import Lens, camera_position, mitsuba_sensor, pinhole
from spectrabox.calibrate.geometry.lens_files import lens_facts, read_lens, write_lens
from spectrabox.calibrate.geometry.model_in_scene import model_in_scene, pose_in_scene
from spectrabox.radiometry.errors import CheckError, InputError
from spectrabox.radiometry.records import LinearImage, PhotoKind

SEARCHED = 1e-4     # where a search stops
BENT = Lens(600, 440, np.array([[655.0, 0, 311.3], [0, 661.0, 208.9], [0, 0, 1]]),
            np.array([-0.11, 0.04, 0.0012, -0.0021, 0.007]), np.array([4.0, 3.1, 2.2, 1.7]),
            np.array([0.01, 0.02, 0.0004, 0.0003, 0.03]), 0.31, "given")
TURN, SHIFT = (np.pi - 0.13, 0.07, -0.04), (0.03, 0.14, 0.92)
PLACES_M = np.array([[x * (1 + 0.1 * z), y, z] for x in (-0.24, 0.21) for y in (0.0, 0.31)
                     for z in (-0.37, -0.1, 0.0)])


def said(call, *arguments, **more):
    try:
        return call(*arguments, **more)
    except (CheckError, InputError) as error:
        return f"{type(error).__name__}: {error}"


def clicks(noise_px=0.4, lens=BENT, seed=5, places=PLACES_M):
    return seen(places, TURN, SHIFT, np.random.default_rng(seed), noise_px, lens)


def of_pose(pose):
    return {"pose": pose, "errors": sizes(pose.covariance), "seen": camera_position(pose)}


def test_a_lens_and_its_file(recorded, tmp_path):
    write_lens(tmp_path / "lens.json", BENT)
    read = read_lens(tmp_path / "lens.json")
    recorded({"facts": lens_facts(BENT), "read": read, "pinhole": pinhole(BENT),
              "text": (tmp_path / "lens.json").read_text(encoding="utf-8")})
    assert lens_facts(read) == lens_facts(BENT)


def test_what_is_no_lens_file_is_refused(recorded, tmp_path):
    facts, table = lens_facts(BENT), {}
    changes = {"format": "spectrabox lens 2", "width": 3.5, "matrix": [[1, 2, 3]],
               "distortion": [0.1] * 4, "standard_error": [1] * 5, "rms_px": "none", "more": 1}
    files = {name: json.dumps(facts | {name: value}) for name, value in changes.items()}
    rows = facts["matrix"]
    for name, value in (("distortion", [0.1] * 6), ("standard_error", [1] * 3),
                        ("distortion_error", [0.1] * 4), ("distortion_error", [0.1] * 6),
                        ("matrix", [*rows, rows[0]]), ("matrix", [[650, 0], *rows[1:]]),
                        ("matrix", [[650, 0, 300, 1], *rows[1:]])):
        files[f"{name} of {len(value)}, {len(str(value))}"] = json.dumps(facts | {name: value})
    for axis in (0, 1):
        for focal in (0.0, -5.0, 1e-9):
            matrix = [list(row) for row in facts["matrix"]]
            matrix[axis][axis] = focal
            files[f"focal {axis} {focal}"] = json.dumps(facts | {"matrix": matrix})
    for name, text in (files | {"words": "words"}).items():
        (tmp_path / "lens.json").write_text(text, encoding="utf-8")
        table[name] = said(lambda: read_lens(tmp_path / "lens.json").matrix)
    table["missing"] = said(read_lens, tmp_path / "none.json").replace(str(tmp_path), "")
    recorded(table)


def test_a_camera_as_the_renderer_has_it(recorded):
    pose = posing.pose_from_points(PLACES_M, clicks(), BENT)
    sensor = mitsuba_sensor(BENT, pose)
    recorded(sensor, rtol=SEARCHED)
    np.testing.assert_allclose(sensor["to_world"][:3, 3], camera_position(pose)[0], atol=1e-9)


BOARD_TEXT = "columns = 9\nrows = 7\nsquare = 3.5\nmarker = 2.25\n"
POSED = "origin = [1, 2.5, 3]\nright = [0, 0, -2]\ndown = [{tilt}, -1.5, 0]\n"


def test_boards_as_their_files_describe_them(recorded, tmp_path):
    table = {}
    for name, text in {
            "plain": BOARD_TEXT, "posed": BOARD_TEXT + POSED.format(tilt=0),
            "all": BOARD_TEXT + 'dictionary = "DICT_4X4_50"\nlegacy = true\n',
            "few columns": BOARD_TEXT.replace("columns = 9", "columns = 2"),
            "three": BOARD_TEXT.replace("columns = 9", "columns = 3"),
            "marker 0": BOARD_TEXT.replace("2.25", "0"),
            "marker as square": BOARD_TEXT.replace("2.25", "3.5"),
            "marker nearly": BOARD_TEXT.replace("2.25", "3.49"),
            "in part": BOARD_TEXT + "origin = [1, 2, 3]\nright = [1, 0, 0]\n",
            "no length": BOARD_TEXT + "origin = [1, 2, 3]\nright = [1, 0, 0]\ndown = [0, 0, 0]\n",
            "words": "words", "unknown": BOARD_TEXT + "colour = 1\n",
            **{f"origin {origin}": BOARD_TEXT + POSED.format(tilt=0).replace(
                "[1, 2.5, 3]", origin) for origin in ("[1, 2]", "[1, 2, 3, 4]")}}.items():
        (tmp_path / "board.toml").write_text(text, encoding="utf-8")
        table[name] = said(read_board, tmp_path / "board.toml")
    for tilt in (0.00098, 0.00102, -0.00102):   # radians, as right is along z
        text = BOARD_TEXT + ("origin = [0, 0, 0]\nright = [2, 0, 0]\n"
                             f"down = [{1.5 * tilt}, 1.5, 0]\n")
        (tmp_path / "board.toml").write_text(text, encoding="utf-8")
        table[f"askew by {tilt}"] = said(read_board, tmp_path / "board.toml")
    flat = np.array([[3.5, 7.0, 0.0], [1.0, 0.25, 0.0]])
    table["in scene"] = in_scene(table["posed"], flat, "board.toml")
    table["nowhere"] = said(in_scene, table["plain"], flat, "board.toml")
    recorded(table)
    np.testing.assert_allclose(table["in scene"], [[1, -4.5, -0.5], [1, 2.25, 2]], atol=1e-12)


def test_points_of_a_scene_and_of_a_photo(recorded, tmp_path):
    table = {}
    for name, text in {
            "two": "[points.a]\nscene = [1, 2, 3]\npx = [4, 5.5]\n[points.'b c']\n"
                   "scene = [-1, 0.5, 2]\npx = [7, 8]\n",
            "one px": "[points.a]\nscene = [1, 2, 3]\npx = [4]\n",
            "four": "[points.a]\nscene = [1, 2, 3, 4]\npx = [4, 5]\n",
            "none": "[points]\n", "short": "[points.a]\nscene = [1, 2]\npx = [4, 5]\n",
            "long": "[points.a]\nscene = [1, 2, 3]\npx = [4, 5, 6]\n"}.items():
        (tmp_path / "points.toml").write_text(text, encoding="utf-8")
        table[name] = said(read_points, tmp_path / "points.toml")
    recorded(table)


def test_boards_drawn_and_found(recorded):
    table = {"not known": said(projection.board_picture, Board(9, 7, 3, 2, "DICT_9X9"), 10),
             "no name": said(projection.board_picture, Board(9, 7, 3, 2, "Board"), 10)}
    for columns in (14, 15):            # of 7 rows: 49 markers and 52
        table[f"{columns} columns"] = said(
            lambda of: projection.board_picture(Board(of, 7, 3, 2, "DICT_4X4_50"), 16).shape,
            columns)
    for legacy in (False, True):
        board = Board(5, 4, 0.03, 0.021, "DICT_4X4_50", legacy)
        picture = projection.board_picture(board, 41)
        table[f"legacy {legacy}"] = picture
        table[f"found {legacy}"] = [np.round(part, 1) for part in
                                    projection.find_board(board, picture)]
        for kept in (130, 172):
            part = picture.copy()
            part[kept:] = 255
            table[f"{legacy}, {kept} rows"] = said(
                lambda shown, of: len(projection.find_board(of, shown)[0]), part, board)
    table["white"] = said(projection.find_board, BOARD, np.full((200, 300), 255, np.uint8))
    recorded(table)


def test_a_lens_from_views(recorded):
    rng = np.random.default_rng(9)
    views = [view(tilt, rng) for tilt in TILTS]
    uneven = [(places[:count], points[:count]) for (places, points), count in zip(
        views, (48, 40, 48, 33, 48, 44), strict=True)]
    recorded({"lens": projection.lens_from_views(uneven, 640, 480, "six views"),
              "default": projection.lens_from_views(views[:4], 640, 480)[0].source}, rtol=1e-3)


def test_views_that_leave_a_lens_open_are_refused(recorded, monkeypatch):
    views = [view(tilt, np.random.default_rng(9)) for tilt in TILTS]
    table = {count: said(lambda some: projection.lens_from_views(some, 640, 480)[0].width,
                         views[:count]) for count in (2, 3)}

    def calibrated(rms, error, degrees):
        turns = [np.zeros(3), np.radians([degrees, 0, 0]), np.radians([degrees / 3, 0, 0])]
        matrix = np.array([[700.0, 0, 320], [0, 710.0, 240], [0, 0, 1]])
        monkeypatch.setattr(projection.cv2, "calibrateCameraExtended", lambda *_: (
            rms, matrix, np.arange(14.0) / 100, turns, [], np.arange(18.0) + 700 * error, [],
            np.array([0.3, rms, 0.2])))
        return said(projection.lens_from_views, views[:3], 640, 480, "stated")

    for rms in (1.98, 2.02, np.inf, np.nan):
        table[f"rms {rms}"] = calibrated(rms, 0.01, 30)
    for error in (0.0198, 0.0202, np.nan):
        table[f"focal error {error}"] = calibrated(1.0, error, 30)
    for degrees in (9.9, 10.1):
        table[f"{degrees} degrees"] = calibrated(1.0, 0.01, degrees)
    recorded(table)


def image(height, width, step=1.0, seed=3):
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[0:height, 0:width]
    signal = np.stack([x / 70 + y / 310, 1 - x / 200, 0.3 + 0.2 * np.sin(x / 5 + y / 7)], axis=-1)
    variance = rng.uniform(1e-6, 3e-6, signal.shape)
    saturated = rng.uniform(size=signal.shape) > 0.999
    return LinearImage(signal.astype(np.float32), variance.astype(np.float32), saturated, step,
                       0.1, 200.0, 4.0, PhotoKind.RAW, "camera", "IMG_7.dng", "abc")


SMALL = dataclasses.replace(BENT, width=66, height=46, matrix=np.array(
    [[58.0, 0, 34.1], [0, 60.5, 21.2], [0, 0, 1]]))


@pytest.mark.parametrize("step", [1.0, 2.0])
def test_a_photo_without_its_distortion(recorded, step):
    photo = image(round(46 / step), round(66 / step), step)
    straight = projection.undistorted(photo, SMALL)
    # maps in steps of 1/32 pixel; OpenCV rounds them as the processor does
    recorded(straight, rtol=1e-4)


def test_photos_of_another_size_than_the_lens_are_refused(recorded):
    recorded({f"{height} {width} {step}": said(
        lambda *size: projection.undistorted(image(*size), SMALL).source, height, width, step)
        for height, width, step in ((46, 66, 1), (45, 66, 1), (46, 67, 1), (47, 66, 1),
                                    (46, 65, 1), (22, 33, 2), (23, 32, 2), (22.0, 32, 2.02))
        if height == int(height)} | {"lower": said(
            lambda: projection.undistorted(image(23, 34, 2.0), SMALL).source)})


def test_rays_pixels_and_turns(recorded):
    rng = np.random.default_rng(6)
    points = rng.uniform(40, 400, (5, 2))
    rays = projection.image_rays(points, BENT)
    places = rays * rng.uniform(0.5, 3, (5, 1))
    parameters = np.r_[0.1, -0.2, 0.3, 0.05, -0.02, 0.7]
    table = {"rays": rays, "turn": projection.rotation_matrix(np.array([0.3, -0.2, 0.9])),
             "projected": projection.projected(places, parameters, BENT),
             "step": projection._at_step(BENT.matrix, 2.5),
             "poses": sorted(projection.likely_poses(PLACES_M, clicks(), BENT), key=str),
             "plane": len(projection.likely_poses(PLACES_M[:6] * [0, 1, 1], clicks(), BENT))}
    for thin in (9.7e-4, 1.03e-3):
        flat = PLACES_M * [1, 1, 0] + np.random.default_rng(3).permutation(12)[:, None] * [
            0, 0, thin * 0.0655]
        table[f"spread {thin}"] = projection.spread(flat)
    recorded(table, rtol=SEARCHED)
    back = projection.projected(rays, np.zeros(6), BENT)[0]
    np.testing.assert_allclose(back, points, atol=0.02)    # of OpenCV's five iterations


def test_an_overlay_of_points_and_edges(recorded):
    rng = np.random.default_rng(8)
    picture = rng.integers(0, 200, (90, 131, 3)).astype(np.uint8)
    given, seen_px = rng.uniform(10, 250, (2, 4, 2)) * [1, 0.6]
    lines = rng.uniform(0, 260, (3, 2, 2))
    lines[2, 1] = [1e9, -1e9]
    large = np.repeat(np.repeat(picture, 18, axis=0), 18, axis=1)
    recorded({"plain": projection.points_overlay(picture, given, seen_px, 2.0),
              "lines": projection.points_overlay(picture, given, seen_px, 2.0, lines),
              "large": projection.points_overlay(large, 9 * given, 9 * seen_px, 1.0)[::9, ::9]},
             rtol=1e-3)     # a pixel on an edge


# ---- poses ---------------------------------------------------------------------------------------

def test_poses_with_their_errors(recorded):
    sharp = dataclasses.replace(BENT, standard_error=np.zeros(4))
    plain = posing.lens_of_focal_length(611.0, 600, 440)
    pose, lens = posing.pose_and_focal_length(PLACES_M, clicks(lens=plain), 600, 440)
    recorded({"lens": plain, "stated": of_pose(posing.pose_from_points(PLACES_M, clicks(), BENT)),
              "sharp": of_pose(posing.pose_from_points(PLACES_M, clicks(), sharp)),
              "free": of_pose(pose), "focal": lens}, rtol=SEARCHED)


def test_points_that_give_no_pose_are_refused(recorded, monkeypatch):
    table, plain = {}, posing.lens_of_focal_length(611.0, 600, 440)
    bent = clicks()

    def posed(*arguments, **more):
        found = said(posing.pose_from_points, *arguments, **more)
        return found if isinstance(found, str) else "a pose"

    def free(*arguments, **more):
        found = said(posing.pose_and_focal_length, *arguments, **more)
        return found if isinstance(found, str) else "a pose"

    for count in (5, 6):
        table[f"{count} points"] = posed(PLACES_M[3:3 + count], bent[3:3 + count], BENT)
    line = np.outer(np.linspace(0, 0.3, 8), [1.0, 0.5, 0.2])
    for off in (0.8, 1.25):
        bowed = line + np.outer((-1.0) ** np.arange(8), [0.0, 1.0, -2.5]) * off * 1e-4 / 2.44
        table[f"line off by {off}"] = (projection.spread(bowed)[1],
                                       posed(bowed, clicks(0.0, places=bowed), BENT))
    for corner in ((-0.49, 0), (-0.51, 0), (0, -0.51), (599.49, 0), (599.51, 0), (0, 439.51)):
        moved = bent.copy()
        moved[4] = np.where(np.array(corner) == 0, moved[4], corner)
        table[f"at {corner}"] = posed(PLACES_M, moved, BENT)[:60]
    for noise in (2.0, 2.7, 2.76):      # of which 0.5 % of the width are allowed
        table[f"noise {noise}"] = posed(PLACES_M, clicks(noise), BENT)
    for shift in (60.0, 4.0):
        wrong = bent.copy()
        wrong[7] += [shift, -shift]
        for names in ((), tuple("abcdefghijkl")):
            table[f"point off by {shift} {names[:1]}"] = posed(PLACES_M, wrong, BENT, names)
    table["mirrored"] = posed(PLACES_M, [599, 0] + bent * [-1, 1], BENT)
    table["any order"] = posed(PLACES_M, np.random.default_rng(2).permutation(bent), BENT)
    table["any order, free"] = free(PLACES_M, np.random.default_rng(2).permutation(bent), 600, 440)
    flat = np.array([[x, y, 0.0] for x in (-0.2, 0.02, 0.2) for y in (-0.1, 0.12)])
    frontal = seen(flat, (np.pi, 0, 0), (0, 0, 0.9), np.random.default_rng(1), lens=plain)
    table["flat, free"] = free(flat, frontal, 600, 440).partition("open by")[0]
    for depth in (0.088, 0.094, 0.5):
        shallow = PLACES_M * [1, 1, depth]
        shown = clicks(0.5, plain, places=shallow)
        table[f"shallow by {depth}, free"] = said(
            lambda *seen_so: posing.pose_and_focal_length(*seen_so, 600, 440)[1].standard_error,
            shallow, shown)
    table["exact, free"] = posing.pose_and_focal_length(
        PLACES_M, clicks(1e-6, plain), 600, 440)[1].standard_error
    tiny = 0.05 * flat
    table["turned over"] = posed(tiny, seen(tiny, (0.3, 0, 0), (0, 0, 1.5), np.random.default_rng(
        1), 0.3, plain), plain)
    monkeypatch.setattr(posing, "likely_poses", lambda *_: [])
    table["no start"] = posed(PLACES_M, bent, BENT)
    table["no start, free"] = free(PLACES_M, bent, 600, 440)
    recorded(table, rtol=1e-3)


def test_limits_of_a_pose(recorded):
    lens = posing.lens_of_focal_length(611.0, 600, 440)
    table = {f"rms {share}": posing._explains(9 * (share * 600) ** 2, 9, lens)
             for share in (0.00495, 0.00505, np.inf)}
    best = np.r_[TURN, SHIFT]
    for turn in (0.02, 0.03, 0.04):
        for more in (8.8, 9.2):         # standard errors squared
            for squares in (2.0, 1e-9):
                noise = max(squares / 18, 0.05**2)
                second = np.r_[TURN[0] + turn, best[1:]]
                table[f"{turn} {more} {squares}"] = said(posing._require_one, [
                    (best, 1.0, squares), (second, 1.0, squares + more * noise)], 12)
    recorded(table)


# ---- COLMAP models -------------------------------------------------------------------------------

@pytest.mark.parametrize("model", CAMERAS)
def test_models_as_colmap_writes_them(recorded, tmp_path, model):
    write_model(tmp_path, model)
    images = read_colmap(tmp_path)
    lens = images["box.jpg"].lens
    wide = dataclasses.replace(lens, standard_error=np.array([3.0, 2.0, 1.0, 0.5]), rms_px=0.7)
    recorded({"images": images, "larger": for_photo(wide, 936, 624, "box.jpg"),
              "other shape": [said(lambda size: for_photo(wide, size, 624, "box.jpg").width, width)
                              for width in (934, 935, 936, 937)]})


def test_files_that_are_no_model_are_refused(recorded, tmp_path):
    write_model(tmp_path / "good")
    cameras, images = ((tmp_path / "good" / name).read_text(encoding="utf-8")
                       for name in ("cameras.txt", "images.txt"))
    row = images.splitlines()[2]
    words = row.split()
    table = {}
    changes = {
        "camera words": (cameras + "8 PINHOLE 30\n", images),
        "camera model": (cameras.replace("OPENCV", "FISHEYE"), images),
        "parameters": (cameras.replace("462.0 ", ""), images),
        "no number": (cameras.replace("462.0", "wide"), images),
        "not finite": (cameras.replace("462.0", "inf"), images),
        "size 0": (cameras.replace("312", "0"), images),
        "focal length": (cameras.replace("462.0", "-462.0"), images),
        "no picture": (cameras, "# nothing\n"),
        "picture words": (cameras, " ".join(words[:9]) + "\n\n"),
        "other camera": (cameras, row.replace(" 7 box", " 8 box") + "\n\n")}
    for factor in (0.9989, 0.9991, 1.0009, 1.0011):
        turned = [str(factor * float(word)) for word in words[1:5]]
        changes[f"length {factor}"] = (cameras, " ".join([words[0], *turned, *words[5:]]) + "\n\n")
    for name, (of_cameras, of_images) in changes.items():
        (tmp_path / "cameras.txt").write_text(of_cameras, encoding="utf-8")
        (tmp_path / "images.txt").write_text(of_images, encoding="utf-8")
        found = said(read_colmap, tmp_path)
        table[name] = found.replace(str(tmp_path), "") if isinstance(found, str) else found
    (tmp_path / "images.txt").unlink()
    table["missing"] = said(read_colmap, tmp_path).replace(str(tmp_path), "")
    (tmp_path / "images.bin").write_bytes(b"")
    table["binary"] = said(read_colmap, tmp_path).replace(str(tmp_path), "")
    (tmp_path / "images.txt").write_bytes(b"\xff\xfe\xfd")
    table["bytes"] = said(read_colmap, tmp_path).replace(str(tmp_path), "")
    recorded(table)


POINTS = {"a": (-150.0, 20.0, -300.0), "b": (160.0, 10.0, -310.0), "c": (-140.0, 290.0, -290.0),
          "d": (150.0, 300.0, -280.0), "e": (-60.0, 90.0, -120.0), "f": (70.0, 40.0, -60.0)}


def marks(noise_px=0.4, pictures=tuple(PLACES), seed=7, but=()):
    """Marked points of each picture, of which each picture lacks another one."""
    rng, made = np.random.default_rng(seed), {}
    for number, picture in enumerate(pictures):
        names = [name for index, name in enumerate(POINTS) if index != number and name not in but]
        shown = pixels("OPENCV", picture, [POINTS[name] for name in names])
        shown = shown + noise_px * rng.standard_normal(shown.shape)
        made[picture] = dict(zip(names, [tuple(px) for px in shown.tolist()], strict=True))
    return made


@pytest.fixture
def images(tmp_path):
    write_model(tmp_path)
    return read_colmap(tmp_path)


def test_a_model_tied_to_the_scene(recorded, images):
    found = model_in_scene(images, marks(), POINTS)
    sharp = model_in_scene(images, marks(1e-6), POINTS)
    recorded({"model": found, "errors": sizes(found.covariance), "sharp": sizes(sharp.covariance),
              "poses": [of_pose(pose_in_scene(image, found)) for image in images.values()]},
             rtol=SEARCHED)
    assert found.scale == pytest.approx(137, rel=0.02)


def test_marks_that_tie_no_model_are_refused(recorded, images):
    def tied(marked, positions=POINTS, of=images):
        found = said(model_in_scene, of, marked, positions)
        return found if isinstance(found, str) else "tied"

    table = {f"but {but}": tied(marks(but=but)) for but in (("a", "b", "c", "d"), ("e", "f"))}
    line = {name: (10.0 * index, 20.0 * index, -5.0 * index) for index, name in enumerate(POINTS)}
    table["on a line"] = tied(marks(), line)
    for corner in ((-0.49, 5.0), (-0.51, 5.0), (311.51, 5.0), (5.0, -0.51), (5.0, 207.51)):
        moved = marks()
        moved["left.jpg"]["a"] = corner
        table[f"at {corner}"] = tied(moved)[:70]
    wrong = marks()
    wrong["left.jpg"]["d"] = (20.0, 30.0)
    table["one wrong"] = tied(wrong)
    table["of four"] = tied({name: {point: px for point, px in points.items() if point in "acdf"}
                             for name, points in wrong.items()})
    swapped = {**POINTS, "a": POINTS["b"], "b": POINTS["a"], "c": POINTS["d"], "d": POINTS["c"]}
    table["left and right"] = tied(marks(), swapped)
    for noise in (1.41, 1.45):          # of which 0.5 % of the width are allowed
        table[f"noise {noise}"] = tied(marks(noise))
    lens = dataclasses.replace(images["box.jpg"].lens, distortion=np.zeros(5))
    for degrees in (0.98, 1.02):
        pose = np.eye(4)
        pose[0, 3] = -10 * np.tan(np.radians(degrees))
        pair = {"one": tie.ModelImage("one", lens, np.eye(4)),
                "two": tie.ModelImage("two", lens, pose)}
        middle = lens.matrix[:2, 2]
        at = middle + np.array([lens.matrix[0, 0] * pose[0, 3] / 10, 0])
        table[f"{degrees} degrees apart"] = said(
            tie._triangulated, "a", {"one": tuple(middle), "two": tuple(at)}, pair)
    recorded(table, rtol=1e-3)


def test_parts_of_a_similarity(recorded):
    rng = np.random.default_rng(11)
    scene, step = rng.standard_normal((5, 3)), 0.1 * np.arange(1.0, 8.0)
    mirrored = scene * [1, 1, -1] + 0.01 * rng.standard_normal((5, 3))
    start = tie._umeyama(0.3 * scene[:, [1, 2, 0]] + [1, 2, 3], scene)
    recorded({"turned": start, "mirrored": tie._umeyama(mirrored, scene),
              "parts": tie._parts(start, step), "steps": tie._sizes(scene[0], 3.3),
              "far": tie._sizes(7 * scene[0], 0.1), "at": tie._sizes(np.zeros(3), 0.0)})
    assert start[0] == pytest.approx(1 / 0.3)
    assert np.linalg.det(start[1]) == pytest.approx(1)
