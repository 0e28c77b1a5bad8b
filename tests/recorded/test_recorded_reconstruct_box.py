"""Recorded: a box that was measured with a tape, its corners and scenes, and what is refused."""
import numpy as np
from recorded_refusals import said

from spectrabox.radiometry.checked_tables import checked
from spectrabox.reconstruct.scene.box_scene import (
    box_edges,
    box_xml,
    chart_xml,
    is_of_box,
)
from spectrabox.reconstruct.scene.box_tables import BoxTable, CameraTable, ChartPlaceTable

OBJECTS = [
    {"name": "block", "shape": "box", "material": "red", "at_mm": [-60.0, 0.0, -150.0],
     "size_mm": [70.0, 110.0, 50.0], "turn_deg": 20.0, "on_turntable": True},
    {"name": "ball", "shape": "sphere", "material": "green", "at_mm": [80.0, 0.0, -90.0],
     "radius_mm": 35.0},
    {"name": "can", "shape": "cylinder", "material": "red", "at_mm": [20.0, 5.0, -220.0],
     "radius_mm": 30.0, "height_mm": 90.0, "on_turntable": True}]
LAMP = {"at_mm": [10.0, 290.0, -120.0], "size_mm": [60.0, 40.0], "look_at_mm": [10.0, 0.0, -120.0]}
BALL = {"at_mm": [10.0, 290.0, -120.0], "radius_mm": 20.0}
CAMERA = {"at_mm": [5.0, 160.0, 700.0], "look_at_mm": [0.0, 150.0, -10.0], "fov_deg": 37.5}
BOX = {"width_mm": 330.0, "height_mm": 310.0, "depth_mm": 300.0,
       "walls": {"back": "white", "left": "green", "right": "red", "floor": "white",
                 "ceiling": "white"},
       "objects": OBJECTS, "turntable_mm": [15.0, -140.0], "lamp": LAMP, "camera": CAMERA}
CHART = {"at_mm": [0.0, 20.0, -130.0], "look_at_mm": [10.0, 290.0, -120.0], "up": [0.0, 0.0, -1.0]}
CORNERS = [f"{depth} {height} {side}" for depth in ("front", "back") for height in ("bottom", "top")
           for side in ("left", "right")]
MARKS = {name: [10.0 + 3 * number, 20.0 + number**2] for number, name in enumerate(CORNERS)}
COLMAP = {"folder": "model", "corners_px": {"a.jpg": MARKS, "b.jpg": MARKS}}


def box(**changes):
    written = {key: value for key, value in (BOX | changes).items() if value is not None}
    return checked(BoxTable, written, "session.toml")


def without(table, *names, **more):
    return {key: value for key, value in table.items() if key not in names} | more


POSE = {"to_world": np.arange(16).reshape(4, 4) / 3, "fov": 33.3, "fov_axis": "x",
        "principal_point_offset_x": 0.01, "principal_point_offset_y": -0.02}


def test_scenes_of_a_box(recorded, tmp_path):
    whole = box(objects=OBJECTS)
    recorded({
        "box": box_xml(whole, (312, 208)), "pose": box_xml(whole, (300, 200), POSE)[:1500],
        "ball": box_xml(box(lamp=BALL | {"moved_mm": [1.0, -2.0, 0.5]}, walls={"back": "white"},
                            objects=[]), (30, 20)),
        "beam": box_xml(box(lamp=LAMP | {"beam": "lamp.csv", "look_at_mm": [60.0, 0.0, -100.0]},
                            objects=[]), (30, 20)),
        "camera": box_xml(box(objects=[]), (3, 2), None, CameraTable.model_validate(
            CAMERA | {"at_mm": [1.0, 2.0, 3.0], "up": [0.0, 0.0, 1.0]}))[:1300],
        "chart": chart_xml(whole, ChartPlaceTable.model_validate(CHART)),
        "other chart": chart_xml(box(lamp=BALL), ChartPlaceTable.model_validate(
            CHART | {"size_mm": [100.0, 70.0], "lamp_at_mm": [0.0, 200.0, -100.0]}))})
    (tmp_path / "a.xml").write_text(box_xml(whole, (3, 2)), "utf-8")
    (tmp_path / "b.xml").write_text("<scene/>", "utf-8")
    assert is_of_box(tmp_path / "a.xml") and not is_of_box(tmp_path / "b.xml")


def test_corners_and_turns(recorded):
    whole = box()
    recorded({"corners": whole.corner_positions(), "edges": box_edges(whole),
              "materials": whole.materials, "walls": whole.walls.materials,
              "turned": {f"{angle}": [(one.at_mm, one.turn_deg)
                                      for one in whole.turned(angle).objects]
                         for angle in (0.0, 35.0, -110.0)},
              "corners after": whole.turned(35.0).corner_positions()["block front top left"],
              "place": [box(lamp=lamp).lamp.place_mm for lamp in (
                  LAMP, BALL | {"moved_mm": [1.5, -2.0, 3.25]})],
              "measured": [CameraTable.model_validate(each).measured for each in (
                  CAMERA, {"corners_px": MARKS}, {"image": "a.jpg"})]})
    # turned all the way round everything stands where it stood
    for one, before in zip(whole.turned(360.0).objects, whole.objects, strict=True):
        np.testing.assert_allclose(one.at_mm, before.at_mm, atol=1e-9)


REFUSED = {
    "fine": {}, "flat": {"width_mm": 0.09}, "least": {"width_mm": 0.1}, "most": {"depth_mm": 1e5},
    "wide": {"depth_mm": 100_001.0}, "nothing": {"walls": {}, "objects": []},
    "twice": {"objects": [OBJECTS[0], OBJECTS[1] | {"name": "block"}]},
    "wall twice": {"objects": [OBJECTS[1] | {"name": "floor"}]},
    "reserved": {"objects": [OBJECTS[1] | {"name": "lamp"}]},
    "two points": {"objects": [OBJECTS[1] | {"at_mm": [1.0, 2.0]}]},
    "no turntable": {"turntable_mm": None}, "shape": {"objects": [OBJECTS[0] | {"shape": "cone"}]},
    "sphere of size": {"objects": [OBJECTS[0] | {"shape": "sphere"}]},
    "box of radius": {"objects": [OBJECTS[0] | {"radius_mm": 3.0}]},
    "cylinder": {"objects": [without(OBJECTS[2], "height_mm")]},
    "nothing of it": {"objects": [without(OBJECTS[1], "radius_mm")]},
    "flat box": {"objects": [OBJECTS[0] | {"size_mm": [1.0, 0.0, 1.0]}]},
    **{f"turn {turn}": {"objects": [OBJECTS[0] | {"turn_deg": turn}]}
       for turn in (-360.0, -361.0, 360.0, 361.0)},
    "both lamps": {"lamp": LAMP | {"radius_mm": 3.0}}, "no lamp": {"lamp": {"at_mm": [1.0, 2, 3]}},
    "panel to nowhere": {"lamp": without(LAMP, "look_at_mm")},
    "ball to": {"lamp": BALL | {"look_at_mm": [1.0, 2.0, 3.0]}},
    "beam of a ball": {"lamp": BALL | {"beam": "a.csv"}},
    "lamp at itself": {"lamp": LAMP | {"look_at_mm": LAMP["at_mm"]}},
    "error alone": {"lamp": LAMP | {"moved_error_mm": [1.0, 1.0, 1.0]}},
    "camera at itself": {"camera": CAMERA | {"look_at_mm": CAMERA["at_mm"]}},
    "camera up": {"camera": CAMERA | {"up": [-5.0, -10.0, -710.0]}},
    **{f"nearly up {off}": {"camera": CAMERA | {"up": [-5.0, -10.0, -710.0 - off]}}
       for off in (0.0445, 0.0457)},     # a millionth of a radian
    "no up": {"camera": CAMERA | {"up": [0.0, 0.0, 0.0]}},
    "no camera": {"camera": without(CAMERA, "fov_deg", "at_mm")},
    **{f"fov {fov}": {"camera": CAMERA | {"fov_deg": fov}} for fov in (0.9, 1.0, 150.0, 151.0)},
    "found and measured": {"camera": {"corners_px": MARKS, "at_mm": [1.0, 2.0, 3.0]}},
    "found": {"camera": {"corners_px": MARKS}},
    "five": {"camera": {"corners_px": dict(list(MARKS.items())[:5])}},
    "six": {"camera": {"corners_px": dict(list(MARKS.items())[:6])}},
    "odd corner": {"camera": {"corners_px": MARKS | {"ball front top left": [1.0, 2.0]}}},
    "of a block": {"camera": {"corners_px": MARKS | {"block front top left": [1.0, 2.0]}}},
    "no model": {"camera": {"image": "a.jpg"}},
    "model": {"camera": {"image": "a.jpg"}, "colmap": COLMAP},
    "image too": {"camera": {"image": "a.jpg", "fov_deg": 30.0}, "colmap": COLMAP},
    "one picture": {"colmap": COLMAP | {"corners_px": {"a.jpg": MARKS}}},
    "odd tie": {"colmap": COLMAP | {"corners_px": {"a.jpg": MARKS, "b.jpg": {"top": [1.0, 2]}}}},
    "turning tie": {"colmap": COLMAP | {"corners_px": {"a.jpg": MARKS, "b.jpg": {
        "block front top left": [1.0, 2.0]}}}},
    "chart": {"chart": CHART}, "chart up": {"chart": CHART | {"up": [10.0, 270.0, 10.0]}},
    "chart of one side": {"chart": CHART | {"size_mm": [290.0]}}}


def test_boxes_that_are_refused(recorded):
    recorded({name: said(lambda change=change: box(**change) and "fits")
              for name, change in REFUSED.items()})
