"""Cameras out of a COLMAP model: read as it is written, tied to the scene by marked corners."""
import json
import re

import numpy as np
import pytest
from colmap_views import CAMERAS, PLACES, SCALE, as_opencv, pixels, world_to_camera, write_model
from small_captures import records_of, work
from test_box_scene import as_toml, template_box
from typer.testing import CliRunner

from spectrabox.calibrate.geometry.colmap_model import for_photo, read_colmap
from spectrabox.calibrate.geometry.model_in_scene import model_in_scene, pose_in_scene
from spectrabox.measure.scene.box_camera import box_camera, box_text, lens_of, scene_of
from spectrabox.measure.shoot.captures import box_photo, stated_scene
from spectrabox.measure.steps import pictures as scene_picture
from spectrabox.radiometry.errors import CheckError, InputError
from spectrabox.session.box.box_overlay import corners_in_photo
from spectrabox.session.cli import app
from spectrabox.session.config.session_file import read_session, try_read_session
from spectrabox.session.config.template import TEMPLATES
from spectrabox.session.store.keys import InputFiles, step_keys

CORNERS = template_box().corner_positions()
TIES = ("back bottom left", "back bottom right", "back top left", "back top right",
        "block front top left", "block front bottom left", "block front top right")


def stated_photo(config, view=None):
    return box_photo(config, config.inputs, view)


def marks(model="OPENCV", rng=None, noise_px=0.0, pictures=PLACES):
    places = [CORNERS[name] for name in TIES]
    noise = np.zeros((len(TIES), 2)) if rng is None else None
    return {picture: dict(zip(TIES, [tuple(px) for px in (
        pixels(model, picture, places)
        + (noise if rng is None else noise_px * rng.standard_normal((len(TIES), 2)))).tolist()],
        strict=True)) for picture in pictures}


@pytest.mark.parametrize("model", CAMERAS)
def test_a_model_is_read_as_colmap_writes_it(tmp_path, model):
    write_model(tmp_path, model)
    images = read_colmap(tmp_path)
    assert list(images) == list(PLACES)         # a name with a space, a picture without points
    matrix, distortion = as_opencv(model)
    for lens, from_model in images.values():
        np.testing.assert_allclose(lens.matrix, matrix, atol=1e-12)
        np.testing.assert_allclose(lens.distortion, distortion, atol=1e-12)
        turn = from_model[:3, :3]
        # written with 17 digits
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(turn) > 0


@pytest.mark.parametrize("model", CAMERAS)
def test_exact_marks_give_back_the_cameras(tmp_path, model):
    write_model(tmp_path, model)
    images = read_colmap(tmp_path)
    estimate = model_in_scene(images, marks(model), CORNERS)
    assert estimate.scale == pytest.approx(1 / SCALE, rel=1e-7)
    assert estimate.rms_px < 1e-5 and max(estimate.distances.values()) < 1e-4
    for name, (at, target) in PLACES.items():
        pose = pose_in_scene(images[name][1], estimate)
        turn, shift = world_to_camera(at, target)
        np.testing.assert_allclose(pose.world_to_camera[:3, :3], turn, atol=1e-7)
        np.testing.assert_allclose(pose.world_to_camera[:3, 3], shift, atol=1e-4)


def test_the_stated_errors_are_the_scatter_of_repetitions(tmp_path):
    write_model(tmp_path)
    images, rng = read_colmap(tmp_path), np.random.default_rng(5)
    _, from_model = images["box.jpg"]
    places, squares, scales = [], [], []
    for _ in range(100):
        estimate = model_in_scene(images, marks(rng=rng, noise_px=0.4), CORNERS)
        camera = pose_in_scene(from_model, estimate)
        places.append(camera.position - np.array(PLACES["box.jpg"][0]))
        squares.append((places[-1] / camera.position_standard_error) ** 2)
        scales.append((estimate.scale - 1 / SCALE) / estimate.scale_error)
    # the mean of 100 squares of standard normals scatters by sqrt(2 / 100) = 0.14, a little more
    # since the noise is estimated with 35 degrees of freedom: 3.2 of that are allowed
    assert np.mean(squares, axis=0) == pytest.approx(1, abs=0.46)
    assert np.mean(np.square(scales)) == pytest.approx(1, abs=0.46)
    assert np.abs(np.mean(places, axis=0)).max() < 1.0      # mm


def test_a_smaller_copy_of_the_photo_has_the_same_view(tmp_path):
    write_model(tmp_path)
    lens, _ = read_colmap(tmp_path)["box.jpg"]
    larger = for_photo(lens, 3120, 2080, "box.jpg")
    np.testing.assert_allclose(larger.matrix[:2, 2], (lens.matrix[:2, 2] + 0.5) * 10 - 0.5)
    assert larger.matrix[0, 0] == pytest.approx(10 * lens.matrix[0, 0])
    with pytest.raises(InputError, match=r"another shape.*without cropping"):
        for_photo(lens, 3120, 2000, "box.jpg")


@pytest.mark.parametrize(("file", "change", "message"), [
    ("cameras.txt", lambda text: text.replace("OPENCV", "FULL_OPENCV"), "FULL_OPENCV is not known"),
    ("cameras.txt", lambda text: text.replace(" -0.002", ""), "has 8 parameters, not 7"),
    ("cameras.txt", lambda text: text.replace("312 208", "312 0"), "must be positive"),
    ("cameras.txt", lambda text: text.replace("460.0", "wide"), "not all numbers"),
    ("images.txt", lambda text: text.replace(" 7 box", " 8 box"), "has no camera 8"),
    ("images.txt", lambda text: re.sub(r"\n1 \S+", "\n1 5.0", text), "the quaternion's length"),
    ("images.txt", lambda text: "# Image list\n", "holds no picture; export the model as text"),
    ("images.txt", lambda text: "1 1 0 0 0\n\n", "a picture has an id"),
])
def test_a_damaged_model_is_refused_with_its_line(tmp_path, file, change, message):
    write_model(tmp_path)
    before = (tmp_path / file).read_text(encoding="utf-8")
    assert before != change(before)
    (tmp_path / file).write_text(change(before), encoding="utf-8")
    with pytest.raises(InputError, match=message):
        read_colmap(tmp_path)


def test_a_binary_model_is_sent_back_to_be_exported(tmp_path):
    (tmp_path / "cameras.bin").write_bytes(b"\0")
    with pytest.raises(InputError, match=r"its binary form is there; .*model_converter"):
        read_colmap(tmp_path)


def test_marks_that_cannot_tie_the_model_are_refused(tmp_path):
    write_model(tmp_path)
    images, every = read_colmap(tmp_path), marks()
    once = {"box.jpg": every["box.jpg"], "left.jpg": {TIES[0]: every["left.jpg"][TIES[0]]}}
    with pytest.raises(InputError, match="1 points are marked in two pictures"):
        model_in_scene(images, once, CORNERS)
    straight = {**CORNERS, TIES[0]: (0, 0, 0), TIES[1]: (1, 0, 0), TIES[2]: (2, 0, 0)}
    line = {picture: dict(list(points.items())[:3]) for picture, points in every.items()}
    with pytest.raises(InputError, match="on one line"):
        model_in_scene(images, line, straight)
    outside = {**every, "box.jpg": {**every["box.jpg"], TIES[0]: (3120.0, 40.0)}}
    with pytest.raises(InputError, match=r"outside box.jpg of 312 x 208 pixels as COLMAP saw it"):
        model_in_scene(images, outside, CORNERS)
    same = dict(images) | {"left.jpg": images["box.jpg"]}
    two = {"box.jpg": every["box.jpg"], "left.jpg": every["box.jpg"]}
    with pytest.raises(CheckError, match="from nearly the same place"):
        model_in_scene(same, two, CORNERS)


def test_the_corner_that_was_mismarked_is_named(tmp_path):
    write_model(tmp_path)
    wrong = marks()
    x, y = wrong["left.jpg"]["block front top left"]
    wrong["left.jpg"]["block front top left"] = (x + 40, y)
    with pytest.raises(CheckError, match="without 'block front top left' the others fit"):
        model_in_scene(read_colmap(tmp_path), wrong, CORNERS)
    other = {"block front top left": "block front top right",
             "block front top right": "block front top left",
             "back top left": "back top right", "back top right": "back top left",
             "back bottom left": "back bottom right", "back bottom right": "back bottom left"}
    swapped = {picture: {other[name]: px for name, px in points.items() if name in other}
               for picture, points in marks().items()}
    with pytest.raises(CheckError, match="left and right are not exchanged"):
        model_in_scene(read_colmap(tmp_path), swapped, CORNERS)


def test_a_plane_marked_as_in_a_mirror_would_put_the_camera_behind_the_wall(captured):
    """Four corners of a wall fit as well with left and right exchanged, from behind."""
    back = {name: px for name, px in corners_in_photo(read_session(with_model(captured))).items()
            if name.startswith("back")}
    swapped = {name.replace("left", "*").replace("right", "left").replace("*", "right"): px
               for name, px in back.items()}
    ties = {"box.jpg": swapped, "left.jpg": {
        name: tuple(pixels("OPENCV", "left.jpg", [CORNERS[
            name.replace("left", "*").replace("right", "left").replace("*", "right")]])[0].tolist())
        for name in swapped}}
    with pytest.raises(CheckError, match="behind the back wall"):
        box_camera(stated_photo(read_session(with_model(captured, ties=ties))))


# ---- in a session --------------------------------------------------------------------------------

def with_model(folder, view="", camera='image = "box.jpg"', ties=None):
    """A session of the template's box whose first camera is of the model, in ``folder``."""
    write_model(folder / "colmap")
    text = (TEMPLATES / "box.toml").read_text(encoding="utf-8")
    for key in ("at_mm = [0, 165, 690]", "look_at_mm = [0, 165, 0]", "fov_deg = 37.3"):
        assert text.count(f"\n{key} ") == 1
        text = text.replace(f"\n{key} ", "\n# ")
    tables = "".join(f"{json.dumps(picture)} = {as_toml(points)}\n"
                     for picture, points in (ties or marks()).items())
    text = text.replace("[scene.box.camera]\n", f"[scene.box.camera]\n{camera}\n", 1)
    text = text.replace("[scene.box.chart]", '[scene.box.colmap]\nfolder = "colmap"\n\n'
                        f"[scene.box.colmap.corners_px]\n{tables}\n[scene.box.chart]", 1)
    text = text.replace("[materials.white]", f"{view}\n[materials.white]", 1)
    (folder / "session.toml").write_text(text, encoding="utf-8")
    return folder


def test_a_session_takes_its_camera_from_the_model(captured):
    config = read_session(with_model(captured))
    camera = box_camera(stated_photo(config))
    assert camera.how == "COLMAP"
    np.testing.assert_allclose(camera.at_mm, PLACES["box.jpg"][0], atol=1e-3)
    seen = corners_in_photo(config)
    for name, px in marks()["box.jpg"].items():
        np.testing.assert_allclose(seen[name], px, atol=1e-4)
    lens = lens_of(config.capture().views[0])
    np.testing.assert_allclose(lens.matrix, as_opencv("OPENCV")[0], atol=1e-9)
    assert "<sensor" in box_text(stated_photo(config))


def test_a_picture_is_undistorted_by_the_lens_of_the_model(captured, monkeypatch):
    class Undistorted(Exception):
        """Ends the stage."""

    def undistorted(_, lens):
        raise Undistorted(lens.matrix.tolist())
    monkeypatch.setattr(scene_picture, "undistorted", undistorted)
    capture = read_session(with_model(captured, view="[picture]\n")).capture()
    with pytest.raises(Undistorted) as ended:
        scene_picture.traced_photo(capture, records_of(), work(capture))
    np.testing.assert_allclose(ended.value.args[0], as_opencv("OPENCV")[0], atol=1e-9)


def test_every_view_may_have_a_camera_of_its_own(captured):
    import shutil
    shutil.copy(captured / "photos" / "box.dng", captured / "photos" / "left.dng")
    shutil.copy(captured / "photos" / "box.dng", captured / "photos" / "warm.dng")
    view = ('[views.left]\nphoto = "photos/left.dng"\n[views.left.camera]\nimage = "left.jpg"\n'
            '[views.warm]\nphoto = "photos/warm.dng"\n')
    answer = CliRunner().invoke(app, ["geometry", "box", str(with_model(captured, view)), "--json"])
    assert answer.exit_code == 0, answer.output
    facts = json.loads(answer.output)
    names = [name.rsplit("/", 1)[-1] for name in facts["files"]]
    # the warm view was taken by the first camera
    assert names == ["scene.xml", "scene-left.xml", "chart-scene.xml", "box.png", "box-left.png"]
    for name, picture in (("photo", "box.jpg"), ("left", "left.jpg")):
        np.testing.assert_allclose(facts["views"][name]["at_mm"], PLACES[picture][0], atol=1e-3)
        assert max(facts["views"][name]["residuals_px"].values()) < 1e-3
    assert facts["views"]["left"]["colmap"]["mm_per_unit"] == pytest.approx(137, rel=1e-5)
    config = read_session(captured)
    texts = {each.name: box_text(stated_photo(config, each)) for each in config.all_views}
    assert texts["warm"] == texts[""] != texts["left"]
    plain = CliRunner().invoke(app, ["geometry", "box", str(captured)])
    assert "COLMAP model: 137" in plain.output.replace("\n", " ")
    assert "left: camera at -280.0" in plain.output


def test_a_view_may_have_a_measured_camera_or_one_from_corners(captured):
    corners = as_toml({name: list(px) for name, px in marks("PINHOLE")["left.jpg"].items()})
    view = ('[views.left]\nphoto = "photos/box.dng"\n[views.left.camera]\n'
            f"corners_px = {corners}\n"
            '[views.up]\nphoto = "photos/box.dng"\n[views.up.camera]\nat_mm = [0, 300, 600]\n'
            "look_at_mm = [0, 100, -100]\nfov_deg = 40\n")
    config = read_session(with_model(captured, view))
    _, left, up = config.all_views
    camera = box_camera(stated_photo(config, left))
    assert camera.how == "corners"
    np.testing.assert_allclose(camera.at_mm, PLACES["left.jpg"][0], rtol=0.02)
    assert box_camera(stated_photo(config, up)).how == "measured"
    np.testing.assert_allclose(box_camera(stated_photo(config, up)).at_mm, (0, 300, 600), atol=1e-9)
    scenes = [scene_of(stated_scene(config, config.inputs, each)) for each in config.all_views]
    assert len({scene.surfaces == scenes[0].surfaces for scene in scenes}) == 1
    assert 'origin="0, 300, 600"' in box_text(stated_photo(config, up))


@pytest.mark.parametrize(("view", "change", "message"), [
    ("", ('image = "box.jpg"', 'image = "box.jpg"\nfov_deg = 30'), "image and fov_deg"),
    ("", ('[scene.box.colmap]\nfolder = "colmap"\n', ""), "folder"),
    ("", ('"left.jpg" = { "back bottom left"', '"left.jpg" = { "back bottom lift"'),
     "corners_px names 'back bottom lift'"),
    ("", ("[materials.white]", '[camera]\nlens = "lens.json"\n[materials.white]'),
     "the COLMAP model has its own"),
    ('[views.x]\nphoto = "photos/box.dng"\n[views.x.camera]\nat_mm = [0, 0, 1]\n', None,
     "lacks look_at_mm, fov_deg"),
    ('[views.x]\nphoto = "photos/box.dng"\nscene = "scene/box.xml"\n[views.x.camera]\n'
     'image = "left.jpg"\n', None, "this view's scene is a file"),
])
def test_cameras_that_contradict_are_said_in_a_sentence(captured, view, change, message):
    with_model(captured, view)
    if change is not None:
        text = (captured / "session.toml").read_text(encoding="utf-8")
        assert change[0] in text
        (captured / "session.toml").write_text(text.replace(*change), encoding="utf-8")
    problems = try_read_session(captured)[1]
    assert any(message in problem for problem in problems), problems


@pytest.mark.parametrize(("spoil", "message"), [
    (lambda folder: (folder / "colmap" / "images.txt").unlink(), "images.txt is missing"),
    (lambda folder: with_model(folder, camera='image = "bax.jpg"'), "no picture 'bax.jpg'"),
])
def test_check_says_what_is_wrong_with_the_model(captured, spoil, message):
    with_model(captured)
    spoil(captured)
    checked = CliRunner().invoke(app, ["check", str(captured)])
    assert checked.exit_code != 0 and "Traceback" not in checked.output
    assert message in " ".join(checked.output.split())


def test_another_model_makes_photo_and_reconstruction_stale_and_a_comment_nothing(captured):
    def keys_now():
        config = read_session(captured)
        return step_keys(config.capture(), InputFiles(config))

    def changed(one, other):
        return {name for name in one if {**one[name], "stages": {}} != {**other[name],
                                                                        "stages": {}}}
    with_model(captured)
    before = keys_now()
    images = captured / "colmap" / "images.txt"
    text = images.read_text(encoding="utf-8")
    images.write_text(text + "# another day\n", encoding="utf-8")
    assert keys_now() == before
    (own,) = re.findall(r"\n1 (.*) 7 box.jpg", text)
    pose = own.split()
    pose[-1] = repr(float(pose[-1]) + 1e-3)                 # 0.1 mm of the camera's place
    images.write_text(text.replace(own, " ".join(pose)), encoding="utf-8")
    assert changed(before, keys_now()) == {"reconstruct"}
    images.write_text(text, encoding="utf-8")
    cameras = captured / "colmap" / "cameras.txt"
    cameras.write_text(cameras.read_text(encoding="utf-8").replace("-0.08", "-0.0801"),
                       encoding="utf-8")
    # by whose lens the photo is undistorted
    assert changed(before, keys_now()) == {"photo", "reconstruct"}
