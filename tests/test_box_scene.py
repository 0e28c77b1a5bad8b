"""A scene from a tape measure: the same light as a hand-written one, and a camera from marks."""
import json
import shutil
import tomllib

import numpy as np
import pytest

from spectrabox.fixtures.demos.demo_scenes import box_scene, chart_scene_xml
from spectrabox.measure.scene.box_camera import box_camera, scene_of
from spectrabox.measure.shoot.captures import box_photo, stated_scene
from spectrabox.measure.shoot.shoot import Shoot
from spectrabox.radiometry.errors import SpectraboxError
from spectrabox.reconstruct.scene.box_scene import box_edges, box_xml, chart_xml
from spectrabox.reconstruct.scene.box_tables import WALLS, BoxTable
from spectrabox.reconstruct.scene.scene_file import read_scene, scene_of_text
from spectrabox.session.box.box_overlay import corners_in_photo
from spectrabox.session.config.session_file import read_session, try_read_session
from spectrabox.session.config.template import TEMPLATES, template_names
from spectrabox.session.store.keys import InputFiles, step_keys

SIZE = (312, 208)
# the eight inner corners are in view from here
FAR = {"at_mm": [30.0, 180.0, 1100.0], "look_at_mm": [10.0, 150.0, -200.0], "fov_deg": 32.0}


def stated_photo(config, view=None):
    return box_photo(config, config.inputs, view)


def template_tables(name):
    return tomllib.loads((TEMPLATES / f"{name}.toml").read_text(encoding="utf-8"))


def template_box(**changes):
    return BoxTable.model_validate(template_tables("box")["scene"]["box"] | changes)


def as_toml(table):
    """A flat table as an inline table of TOML."""
    return "{ " + ", ".join(f"{json.dumps(key)} = {json.dumps(value)}"
                            for key, value in table.items()) + " }"


def rewritten(folder, **camera):
    """A session of the template's box with another camera, over photos that are there."""
    text = (TEMPLATES / "box.toml").read_text(encoding="utf-8")
    for key, value in {"at_mm = [0, 165, 690]": "at_mm", "look_at_mm = [0, 165, 0]": "look_at_mm",
                       "fov_deg = 37.3": "fov_deg"}.items():
        assert text.count(f"\n{key} ") == 1
        line = f"{value} = {json.dumps(camera[value])}" if value in camera else ""
        text = text.replace(f"\n{key} ", f"\n{line} #")
    if "corners_px" in camera:
        text = text.replace("[scene.box.chart]", f"corners_px = {as_toml(camera['corners_px'])}\n\n"
                            "[scene.box.chart]")
    (folder / "session.toml").write_text(text, encoding="utf-8")
    return read_session(folder)


def hits(text, unit_mm):
    """Where every camera ray meets what (3, n), in mm, and the name of that shape."""
    from spectrabox.reconstruct.rendering.renderer import start_mitsuba
    start_mitsuba("cpu")
    import mitsuba as mi
    scene = mi.load_string(text, optimize=False)        # else surfaces of one colour are merged
    across, down = np.meshgrid(np.arange(0.5, 48) / 48, np.arange(0.5, 32) / 32)
    sensor = scene.sensors()[0]
    ray, _ = sensor.sample_ray(0.0, 0.5, mi.Point2f(across.ravel(), down.ravel()),
                               mi.Point2f(0.5, 0.5))
    met = scene.ray_intersect(ray)
    shape = np.full(across.size, "nothing", dtype=object)
    for one in scene.shapes():
        shape[np.array(met.shape == mi.ShapePtr(one))] = one.id()
    return np.array(met.p) * unit_mm, shape


def test_the_template_is_the_scene_that_the_demo_writes_by_hand():
    ours, our_shape = hits(box_xml(template_box(), SIZE), 1.0)
    theirs, their_shape = hits(box_scene((SIZE[1], SIZE[0]), card=True), 10.0)
    called = {"lamp": "light", "back": "back_wall", "left": "left_wall", "right": "right_wall"}
    our_shape = np.array([called.get(name, name) for name in our_shape], dtype=object)
    assert np.mean(our_shape == their_shape) > 0.998        # a ray may graze an edge
    same = our_shape == their_shape
    np.testing.assert_allclose(ours[:, same], theirs[:, same], atol=0.01)
    assert set(our_shape) == {"back_wall", "left_wall", "right_wall", "floor", "ceiling", "block",
                              "grey_card"}


def surface_signals(text):
    """Mean signal of every surface, traced, by name; greys of their own for each paint."""
    from pathlib import Path

    from spectrabox.radiometry.interreflection import signal
    from spectrabox.reconstruct.rendering.renderer import load_scene, start_mitsuba
    from spectrabox.reconstruct.scene.scene_xml import scene_xml
    from spectrabox.reconstruct.scene.surfaces import block_regions, surface_map
    from spectrabox.reconstruct.tracer.transport import trace_transport
    from spectrabox.reconstruct.tracer.unit_scene import UnitScene
    start_mitsuba("cpu")
    size, ones = (48, 32), np.ones(2)
    scene = scene_of_text(text, Path("box.xml"))
    paints = tuple(dict.fromkeys(scene.surfaces.values()))
    loaded = load_scene(scene_xml(scene, reflectances=dict.fromkeys(paints, ones), light=ones,
                                  bands={"one": ones}, range_nm=(400.0, 700.0), size=size))
    shown = surface_map(loaded, tuple(scene.surfaces), size)
    region, group = block_regions(shown, np.ones(shown.shape, bool))
    unit = UnitScene(loaded, {paint: paint for paint in paints}, size, scene.max_depth - 1)
    traced = trace_transport(unit, region, spp=32, seed=1)
    grey = {"white": 0.8, "green": 0.3, "red": 0.25, "cube": 0.4, "card": 0.5}
    received = signal(traced.coefficients, traced.exponents,
                      np.array([np.full(2, grey[paint]) for paint in paints]),
                      np.full((1, 2), 0.5))[:, 0]
    pixels = np.bincount(region[region >= 0])
    names = [name.replace("_wall", "") for name in scene.surfaces]
    return {names[one]: np.average(received[group == one], weights=pixels[group == one])
            for one in np.unique(group)}


def test_the_template_gives_the_demo_s_signals_whatever_the_order_of_its_surfaces():
    import xml.etree.ElementTree as ET
    theirs = surface_signals(box_scene((SIZE[1], SIZE[0]), card=True))
    text = box_xml(template_box(), SIZE)
    root = ET.fromstring(text)
    shapes = root.findall("shape")
    for shape in shapes:
        root.remove(shape)
    root.extend(reversed(shapes))
    for ours in (surface_signals(text), surface_signals(ET.tostring(root, encoding="unicode"))):
        assert set(ours) == set(theirs)
        # the same paths: what is left is the rounding of places, in cm and in mm
        np.testing.assert_allclose([ours[name] for name in theirs], list(theirs.values()),
                                   rtol=2e-3)


def test_light_and_chart_stand_to_each_other_as_the_demo_has_them():
    from spectrabox.radiometry.chart import CLASSIC
    from spectrabox.reconstruct.rendering.renderer import patch_irradiance
    box = template_box(chart={"at_mm": [90, 170, -360], "look_at_mm": [90, 170, 0]})
    from pathlib import Path
    ours = scene_of_text(chart_xml(box, box.chart), Path("chart-scene.xml"))
    theirs = scene_of_text(chart_scene_xml((200, 300)), Path("chart.xml"))
    both = [patch_irradiance(scene, CLASSIC.centres_uv, CLASSIC.sizes_uv)
            for scene in (ours, theirs)]
    # of a spectrum of 1 at the lamp, whatever the unit of length
    np.testing.assert_allclose(both[0], both[1], rtol=2e-3)
    assert np.ptp(both[0]) / both[0].mean() > 0.02          # the lamp stands aside


@pytest.mark.parametrize("seed", range(4))
def test_eight_marked_corners_place_the_camera(captured, seed):
    stated = rewritten(captured, **FAR)
    seen = corners_in_photo(stated)
    inner = {name: px for name, px in seen.items() if not name.startswith("block")}
    rng = np.random.default_rng(seed)
    scale = 6000 / 312                                      # one pixel of a photo of 24 megapixels
    marked = {name: (np.array(px) + rng.normal(0, 1 / scale, 2)).tolist()
              for name, px in inner.items()}
    camera = box_camera(stated_photo(rewritten(captured, corners_px=marked)))
    distance = np.linalg.norm(np.subtract(FAR["at_mm"], FAR["look_at_mm"]))
    assert np.linalg.norm(np.subtract(camera.at_mm, FAR["at_mm"])) < 0.005 * distance
    assert camera.fov_deg == pytest.approx(FAR["fov_deg"], abs=0.2)
    ahead = np.array(camera.sensor["to_world"])[:3, 2]
    wanted = np.subtract(FAR["look_at_mm"], FAR["at_mm"]) / distance
    assert np.degrees(np.arccos(np.clip(ahead @ wanted, -1, 1))) < 0.2
    assert set(camera.residuals_px) == set(marked)


def test_the_camera_found_from_exact_corners_sees_what_the_measured_one_sees(captured):
    stated = rewritten(captured, **FAR)
    measured = hits(box_xml(stated.box, SIZE), 1.0)
    corners = {name: list(px) for name, px in corners_in_photo(stated).items()}
    camera = box_camera(stated_photo(rewritten(captured, corners_px=corners)))
    again = hits(box_xml(stated.box, SIZE, camera.sensor), 1.0)
    assert np.mean(measured[1] == again[1]) > 0.995
    same = measured[1] == again[1]
    np.testing.assert_allclose(measured[0][:, same], again[0][:, same], atol=0.5)
    assert max(camera.residuals_px.values()) < 1e-3


def test_corners_of_an_object_turn_with_it_and_carry_its_name(captured):
    turned = template_box().corner_positions()
    straight = template_box(objects=[template_tables("box")["scene"]["box"]["objects"][0]
                                     | {"turn_deg": 0}]).corner_positions()
    assert straight["block front top left"] == pytest.approx((-110, 120, -140))
    assert straight["block back bottom right"] == pytest.approx((10, 0, -260))
    # counter-clockwise from above: what was in front on the left comes round to the front
    middle = np.array([-50, 0, -200])
    before, after = (np.subtract(one["block front top left"], middle) for one in (straight, turned))
    angle = np.degrees(np.arctan2(-after[2], after[0]) - np.arctan2(-before[2], before[0]))
    assert angle % 360 == pytest.approx(28)
    assert len(box_edges(template_box())) == 36


def test_every_shape_of_object_stands_on_its_base():
    walls = {"floor": "grey"}
    from_above = {"at_mm": [0.0, 600.0, 500.0], "look_at_mm": [0, 0, -150], "fov_deg": 35.0}
    box = template_box(walls=walls, camera=from_above, objects=[
        {"name": "ball", "shape": "sphere", "material": "a", "at_mm": [-100, 0, -100],
         "radius_mm": 40.0},
        {"name": "can", "shape": "cylinder", "material": "b", "at_mm": [100, 0, -100],
         "radius_mm": 30.0, "height_mm": 90.0}])
    _, shape = hits(box_xml(box, SIZE), 1.0)
    assert set(shape) == {"floor", "ball", "can", "can top", "nothing"}
    assert box.materials == ("grey", "a", "b")


def test_a_turntable_moves_what_stands_on_it_about_its_axis():
    box = BoxTable.model_validate(template_tables("turntable")["scene"]["box"])
    block = template_tables("turntable")["scene"]["box"]["objects"][0]
    aside = box.model_copy(update={"turntable_mm": (0.0, -200.0)})
    there = aside.turned(90).objects[0]
    # 50 mm to the left of the axis comes to 50 mm in front of it, counter-clockwise from above
    assert there.at_mm == pytest.approx((0, 0, -150))
    assert there.turn_deg == pytest.approx(block["turn_deg"] + 90)
    whole = aside.turned(360).objects[0]
    assert whole.at_mm == pytest.approx(tuple(block["at_mm"]))
    still = template_box().turned(90)
    assert still == template_box()


@pytest.mark.parametrize("name", template_names())
def test_every_template_is_a_valid_session(tmp_path, name):
    from typer.testing import CliRunner

    from spectrabox.session.cli import app
    answer = CliRunner().invoke(app, ["new", str(tmp_path / "s"), "--template", name, "--json"])
    assert answer.exit_code == 0, answer.output
    config, problems = try_read_session(tmp_path / "s")
    assert problems == [] and config is not None
    assert (tmp_path / "s" / "photos").is_dir()
    assert {"box", "flat", "turntable", "views"} == set(template_names())


def test_an_unknown_template_is_refused(tmp_path):
    from typer.testing import CliRunner

    from spectrabox.session.cli import app
    answer = CliRunner().invoke(app, ["new", str(tmp_path / "s"), "--template", "boxes"])
    assert answer.exit_code != 0
    assert "box, flat, turntable, views" in answer.output
    assert not (tmp_path / "s").exists()


@pytest.mark.parametrize(("change", "message"), [
    ({"lamp": {"at_mm": [0, 0, 0]}}, "a ball with radius_mm, or a panel"),
    ({"lamp": {"at_mm": [0, 0, 0], "size_mm": [10.0, 10.0]}}, "belong together"),
    ({"lamp": {"at_mm": [0, 0, 0], "radius_mm": 5.0, "beam": "beam.csv"}}, "beam is of a panel"),
    ({"camera": {"at_mm": [0, 0, 0]}}, "lacks look_at_mm, fov_deg"),
    ({"camera": {**FAR, "corners_px": {}}}, "either estimated from the corners or measured"),
    ({"camera": {"corners_px": {f"back top {n}": [1, 1] for n in range(3)}}}, "6 or more"),
    ({"camera": {"corners_px": {f"back top {n}": [1, 1] for n in range(6)}}}, "corners are"),
    ({"camera": {**FAR, "up": [0, 0, 0]}}, "up of the camera"),
    ({"walls": {}, "objects": []}, "neither walls nor objects"),
    ({"objects": [{"name": "back", "shape": "sphere", "material": "a", "at_mm": [0, 0, 0],
                   "radius_mm": 1.0}]}, "two surfaces of the box are called 'back'"),
    ({"objects": [{"name": "a", "shape": "box", "material": "a", "at_mm": [0, 0, 0],
                   "radius_mm": 1.0}]}, "needs size_mm"),
    ({"objects": [{"name": "a", "shape": "sphere", "material": "a", "at_mm": [0, 0, 0],
                   "radius_mm": 1.0, "on_turntable": True}]}, "turntable_mm"),
])
def test_measures_that_make_no_box_are_said_in_a_sentence(change, message):
    from spectrabox.radiometry.checked_tables import checked
    from spectrabox.radiometry.errors import InputError
    tables = template_tables("box")
    tables["scene"]["box"] |= change
    with pytest.raises(InputError, match=message):
        checked(Shoot, tables, "session.toml")


def test_corners_of_another_box_are_refused(captured):
    stated = rewritten(captured, **FAR)
    wrong = {name: list(px) for name, px in corners_in_photo(stated).items()}
    wrong["front top left"] = [wrong["front top left"][0] + 20, wrong["front top left"][1]]
    with pytest.raises(SpectraboxError, match=r"corners_px: no pose.*'front top left'"):
        box_camera(stated_photo(rewritten(captured, corners_px=wrong)))


def test_the_scene_that_a_session_is_made_of_is_written_and_can_be_taken_over(captured):
    from typer.testing import CliRunner

    from spectrabox.session.cli import app
    config = rewritten(captured, **FAR)
    answer = CliRunner().invoke(app, ["geometry", "box", str(captured), "--json"])
    assert answer.exit_code == 0, answer.output
    names = [name.rsplit("/", 1)[-1] for name in json.loads(answer.output)["files"]]
    assert names == ["scene.xml", "chart-scene.xml", "box.png"]
    shutil.copy(captured / "scene.xml", captured / "scene" / "mine.xml")
    taken = read_scene(captured / "scene" / "mine.xml")
    drawn = scene_of(stated_scene(config, config.inputs))
    assert taken.surfaces == drawn.surfaces and set(drawn.surfaces) == {*WALLS, "block",
                                                                           "grey_card"}
    assert (taken.width, taken.height) == (312, 208)


def test_only_what_a_measure_changes_is_stale(captured):
    """The chart's place is nothing to the photo's scene, and the other way round."""
    def keys_of(config):
        return step_keys(config.capture(), InputFiles(config))

    one = keys_of(rewritten(captured, **FAR))
    text = (captured / "session.toml").read_text(encoding="utf-8")

    def changed(old, new):
        assert old in text
        (captured / "session.toml").write_text(text.replace(old, new), encoding="utf-8")
        config = read_session(captured)
        other = keys_of(config)
        return {name for name in one if {**one[name], "stages": {}} != {**other[name],
                                                                         "stages": {}}}
    assert changed("at_mm = [90, 170, -360]", "at_mm = [80, 170, -360]") == {"calibrate"}
    assert changed("at_mm = [-50, 0, -200]", "at_mm = [-40, 0, -200]") == {"reconstruct"}
    assert changed("at_mm = [50, 270, 380]", "at_mm = [50, 280, 380]") == {"calibrate",
                                                                           "reconstruct"}


def test_a_lamp_that_was_moved_for_a_view_stands_there_in_its_scene(captured):
    shutil.copy(captured / "photos" / "box.dng", captured / "photos" / "second.dng")
    rewritten(captured, **FAR)
    path = captured / "session.toml"
    path.write_text(path.read_text(encoding="utf-8") + '\n[views.second]\n'
                    'photo = "photos/second.dng"\nlamp_at_mm = [-140, 220, 340]\n',
                    encoding="utf-8")
    first, second = (scene_of(view.scene) for view in read_session(captured).capture().views)
    assert first.lamps != second.lamps
    assert "-140" in second.lamps and "-140" not in first.lamps
    assert first.surfaces == second.surfaces
    path.write_text(path.read_text(encoding="utf-8").replace(
        "lamp_at_mm = [-140", 'scene = "scene/box.xml"\nlamp_at_mm = [-140'), encoding="utf-8")
    with pytest.raises(SpectraboxError, match=r"views\.second\.lamp_at_mm moves the lamp"):
        read_session(captured)
