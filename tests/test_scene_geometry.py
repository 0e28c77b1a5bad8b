"""What of camera and lamp was estimated: kept with the scene, shown by the report."""
import json
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from report_example import example_session, with_found
from test_box_scene import FAR, rewritten, template_box
from test_colmap import with_model
from typer.testing import CliRunner

from spectrabox.measure.scene.geometry import scene_geometry
from spectrabox.radiometry.records.scenes import MarkedView, Placement
from spectrabox.reconstruct.scene.box_scene import box_xml, chart_xml
from spectrabox.reconstruct.scene.edit_scene import (
    Refinement,
    refinements,
    scene_with_camera,
    scene_with_light_moved,
)
from spectrabox.reconstruct.scene.scene_file import read_scene, scene_of_text
from spectrabox.session.box.box_overlay import corners_in_photo
from spectrabox.session.cli import app
from spectrabox.session.config.session_file import read_session
from spectrabox.session.report.page import render_report, write_report
from spectrabox.session.store.record_files import pack, unpack

SCENE = """<scene version="3.0.0">
    <!-- measured by hand -->
    <sensor type="perspective" id="camera"/>
    <emitter type="point" id="bulb"><point name="position" x="5" y="27" z="38"/></emitter>
    <bsdf type="diffuse" id="white"/><shape type="rectangle" id="wall"><ref id="white"/></shape>
</scene>"""
CAMERA = {"to_world": np.eye(4), "fov": 40.0, "fov_axis": "x", "principal_point_offset_x": 0.0,
          "principal_point_offset_y": 0.0}


def moved(name="bulb", by=(1.0, -2.0, 0.5)):
    return Refinement(what="light", name=name, how="moved -- to explain", moved=by,
                      standard_error=(0.1, 0.2, 0.3))


def placed(x):
    return Refinement(what="camera", name="of the photo", how="found", place=(x, 0, 0),
                      standard_error=(1, 1, 1))


def test_a_scene_carries_what_was_estimated_of_it(tmp_path):
    path = tmp_path / "scene.xml"
    path.write_text(SCENE, encoding="utf-8")
    for new, write in ((placed(1), lambda new: scene_with_camera(path, CAMERA, (8, 6), tmp_path,
                                                                 new)),
                       (moved(), lambda new: scene_with_light_moved(
                            path, 0, np.array(new.moved), tmp_path, new)),
                       (moved(by=(0.5, 0.0, 0.0)), lambda new: scene_with_light_moved(
                            path, 0, np.array(new.moved), tmp_path, new)),
                       (placed(2), lambda new: scene_with_camera(path, CAMERA, (8, 6), tmp_path,
                                                                 new))):
        path.write_text(write(new), encoding="utf-8")
    # the camera of the last pose, and every move of the light
    assert refinements(path) == (moved(), moved(by=(0.5, 0.0, 0.0)), placed(2))
    text = path.read_text(encoding="utf-8")
    assert "<!-- measured by hand -->" in text
    assert ET.fromstring(text).find("emitter/point").get("value") == "6.5, 25, 38.5"
    assert read_scene(path).light_ids == ("bulb",)


def test_a_comment_that_is_no_estimate_is_passed_over(tmp_path):
    path = tmp_path / "scene.xml"
    text = SCENE.replace("measured by hand", 'spectrabox estimated: {"what": 3}')
    path.write_text(text.replace("</scene>", "<!-- spectrabox estimated: not JSON --></scene>"),
                    encoding="utf-8")
    assert refinements(path) == ()


def test_a_lamp_that_was_moved_shines_from_there_in_both_scenes():
    box = template_box(lamp={"at_mm": [50, 270, 380], "size_mm": [60, 40],
                             "look_at_mm": [0, 100, -200]},
                       chart={"at_mm": [90, 170, -360], "look_at_mm": [90, 170, 0]})
    there = template_box(lamp={"at_mm": [53, 268, 380.5], "size_mm": [60, 40],
                               "look_at_mm": [3, 98, -199.5]},
                         chart={"at_mm": [90, 170, -360], "look_at_mm": [90, 170, 0]})
    lamp = box.lamp.model_copy(update={"moved_mm": (3.0, -2.0, 0.5)})
    after = box.model_copy(update={"lamp": lamp})
    assert box_xml(after, (60, 40)) == box_xml(there, (60, 40)) != box_xml(box, (60, 40))
    assert chart_xml(after, after.chart) == chart_xml(there, there.chart)


def session_with_corners(captured):
    corners = {name: list(px) for name, px in corners_in_photo(rewritten(captured, **FAR)).items()
               if not name.startswith(("block", "grey_card"))}
    x, y = corners["front top left"]
    config = rewritten(captured, corners_px=corners | {"front top left": [x + 0.5, y]})
    text = (config.folder / "session.toml").read_text(encoding="utf-8")
    (config.folder / "session.toml").write_text(text.replace(
        "radius_mm = 8 ", "moved_mm = [2, -1, 5]\nmoved_error_mm = [1, 1, 2]\nradius_mm = 8 "),
        encoding="utf-8")
    return read_session(config.folder)


def test_a_box_says_where_camera_and_lamp_were_stated_and_found(captured):
    (lamp, camera), views = scene_geometry(session_with_corners(captured).capture())
    assert lamp.what == "lamp" and camera.what == "camera" and camera.stated is None
    np.testing.assert_array_equal(lamp.stated, [50, 270, 380])
    np.testing.assert_array_equal(lamp.place, [52, 269, 385])
    np.testing.assert_array_equal(lamp.standard_error, [1, 1, 2])
    np.testing.assert_allclose(camera.place, FAR["at_mm"], rtol=0.05)
    assert np.all(camera.standard_error > 0)
    assert "8 marked corners" in camera.how and "degrees" in camera.how
    view, = views
    # twelve each of the box, the block in it and the grey card
    assert view.edges.shape == (36, 2, 2) and len(view.corners) == 8
    # half a pixel of 312 was added to one mark; the camera follows it in part
    worst = view.corners[int(np.argmax(view.residuals_px))]
    assert worst == "front top left" and 0.05 < view.residuals_px.max() < 0.5
    np.testing.assert_allclose(np.linalg.norm((view.marked - view.seen) * [312, 208], axis=1),
                               view.residuals_px, rtol=1e-6)


def test_a_measured_box_has_nothing_that_moved(captured):
    assert scene_geometry(rewritten(captured, **FAR).capture()) == ((), ())


def test_cameras_of_a_model_are_said_for_every_view(captured):
    view = ('[views.left]\nphoto = "photos/box.dng"\n[views.left.camera]\nimage = "left.jpg"\n')
    placements, views = scene_geometry(read_session(with_model(captured, view)).capture())
    assert [one.what for one in placements] == ["camera", "camera of “left”"]
    assert all("from COLMAP, tied to the box by 21 marks" in one.how for one in placements)
    assert [one.name for one in views] == ["", "left"]
    for marked in views:
        # bent by the lens in the photo, straight in what is shown
        np.testing.assert_allclose(marked.marked, marked.seen, atol=1e-5)


def test_a_scene_in_a_file_says_what_its_comments_say(captured):
    config = read_session(captured)
    path = captured / config.scene.file
    path.write_text(scene_with_light_moved(path, 0, np.array([1.0, -2.0, 0.5]), path.parent,
                                           moved("light")), encoding="utf-8")
    (light,), _ = scene_geometry(config.capture())
    assert light.what == f"light 'light' of {config.scene.file}" and light.stated is None
    np.testing.assert_array_equal(light.moved, [1, -2, 0.5])


def geometry():
    rng = np.random.default_rng(2)
    lamp = Placement("lamp", "measured with a tape, then moved", "mm", np.array([50.0, 270, 380]),
                     np.array([52.0, 269, 385]), np.array([2.0, -1, 5]), np.array([1.0, 1, 2]))
    camera = Placement("camera", "found from 8 marked corners", "mm", None,
                       np.array([30.12345, 180.5, 1099.9]), None, np.array([0.4, 0.5, 1.9]))
    view = MarkedView("", rng.uniform(size=(24, 2, 2)), ("back top left", "front top <left>"),
                      np.array([[0.2, 0.3], [0.6, 0.7]]), np.array([[0.21, 0.3], [0.6, 0.71]]),
                      np.array([0.7, 1.25]))
    return {"placements": (lamp, camera), "marked_views": (view,)}


def test_what_is_stored_comes_back():
    arrays: dict[str, np.ndarray] = {}
    before, = geometry()["marked_views"]
    node = json.loads(json.dumps(pack(geometry()["placements"], "placements", arrays)))
    lamp, camera = unpack(tuple[Placement, ...], node, arrays)
    assert (lamp.what, camera.what) == ("lamp", "camera") and camera.stated is None
    node = json.loads(json.dumps(pack(before, "view", arrays)))
    after = unpack(MarkedView, node, arrays)
    assert after.corners == before.corners
    np.testing.assert_array_equal(after.edges, before.edges)


def test_the_report_shows_what_moved(tmp_path):
    plain = example_session(tmp_path)
    assert "What moved" not in render_report(plain)[0]
    results = with_found(plain, **geometry())
    page = write_report(results)
    text = page.read_text(encoding="utf-8")
    assert "What moved" in text and "front top &lt;left&gt;" in text
    numbers = json.loads((tmp_path / "report.json").read_text(encoding="utf-8"))["geometry"]
    assert numbers["placements"][0]["moved"] == [2.0, -1.0, 5.0]
    assert numbers["views"][0]["corners"][1] == {"corner": "front top <left>", "residual_px": 1.25}
    assert ">30.12<" in text


def test_geometry_light_says_what_to_write_into_a_box(captured):
    from spectrabox.radiometry.records.spectra import Outcome
    from spectrabox.reconstruct.scene.box_scene import is_of_box
    from spectrabox.reconstruct.scene.light_position import LightPosition
    from spectrabox.session.commands.lamp import _light_text
    answer = CliRunner().invoke(app, ["geometry", "box", str(rewritten(captured, **FAR).folder)])
    assert answer.exit_code == 0, answer.output
    assert is_of_box(captured / "scene.xml")
    assert not is_of_box(captured / "scene" / "box.xml")
    estimate = LightPosition("lamp", np.array([2.0, -1.234, 5.0]), np.array([1.0, 1.0, 2.0]),
                             np.eye(3), 1.0, 0.1, 3.0, 1.1,
                             np.zeros((2, 3)), Outcome.CONVERGED)
    message = _light_text(estimate, captured / "lit.xml", True)
    assert "moved_mm = [2.0, -1.23, 5.0]\nmoved_error_mm = [1.0, 1.0, 2.0]" in message
    text = (captured / "session.toml").read_text(encoding="utf-8")
    lines = "\n".join(line for line in message.splitlines() if line.startswith("moved"))
    text = text.replace("radius_mm = 8 ", f"{lines}\nradius_mm = 8 ")
    (captured / "session.toml").write_text(text, encoding="utf-8")
    assert read_session(captured).box.lamp.position_mm == (52.0, 268.77, 385.0)


def test_an_error_without_its_move_is_refused():
    from pydantic import ValidationError
    with pytest.raises(ValidationError, match="moved_error_mm of the lamp are errors of moved_mm"):
        template_box(lamp={"at_mm": [0, 1, 2], "radius_mm": 3, "moved_error_mm": [1, 1, 1]})


def test_the_scene_of_a_moved_lamp_is_read(tmp_path):
    box = template_box(lamp={"at_mm": [50, 270, 380], "radius_mm": 8, "moved_mm": [2, -1, 5]})
    scene = scene_of_text(box_xml(box, (60, 40)), tmp_path / "scene.xml")
    centre = next(node for node in scene.root.iter("point") if node.get("name") == "center")
    assert centre.get("value") == "52, 269, 385"
