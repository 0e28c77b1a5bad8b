"""Mitsuba scenes of a box that was measured with a tape (``box_tables``), as XML to read and keep.

Reflectances and radiance are placeholders, as in a scene that an operator writes: the session puts
the spectra in. Lengths are in millimetres.
"""
from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.reconstruct.scene import box_tables, edit_scene, scene_file

MAX_DEPTH = 8               # segments of a path in the box
CHART_DEPTH = 2             # the chart is lit by the lamp alone
CHART_VIEW = 2.0            # distance of the chart scene's camera, in widths of the card
PLACEHOLDER = "0.5"
TAKE_OVER = (" Made from [scene.box] of session.toml. To go on by hand, copy this file into scene/ "
             "and name the copy as {key} in session.toml, in position of the tables. ")
FRAME = (" Lengths in mm: x to the right, y up, z out of the box's opening; (0, 0, 0) is the "
         "middle of the opening's lower edge. Reflectances and radiance are placeholders. ")


def box_xml(box: box_tables.BoxTable, size: tuple[int, int], pose: Mapping[str, Any] | None = None,
            camera: box_tables.CameraTable | None = None) -> str:
    """The scene of the box's photo.

    Parameters
    ----------
    box : BoxTable
    size : (width, height)
        Of the photo in pixels.
    pose : mapping, optional
        ``to_world``, ``fov`` and so on of a ``perspective`` sensor, where the camera was estimated
        from the photo; by default the camera's measured pose.
    camera : CameraTable, optional
        That was measured, where it is not the box's.
    """
    root = _scene(MAX_DEPTH, TAKE_OVER.format(key="scene.file"))
    _add_sensor(root, _stated(camera or box.camera) if pose is None
                else edit_scene.camera_nodes(pose), size)
    _add_lamp(root, box.lamp, box.lamp.position_mm)
    for name in box.materials:
        bsdf = ET.SubElement(root, "bsdf", type="diffuse", id=name)
        ET.SubElement(bsdf, "spectrum", name="reflectance", value=PLACEHOLDER)
    for wall, material in box.walls.materials.items():
        root.append(_shape("rectangle", wall, material, _wall_steps(box, wall)))
    for one in box.objects:
        root.extend(_object(one))
    return _text(root)


def chart_xml(box: box_tables.BoxTable, chart: box_tables.ChartPlaceTable) -> str:
    """The scene of the chart photo: the same lamp, and the card where it stood.

    Nothing of it depends on the camera, which stands in front of the card.

    Parameters
    ----------
    box : BoxTable
    chart : ChartPlaceTable
    """
    root = _scene(CHART_DEPTH, TAKE_OVER.format(key="chart.scene"))
    at, width = np.array(chart.at_mm), chart.size_mm[0]
    facing = np.array(chart.look_at_mm) - at
    eye = at + CHART_VIEW * width * facing / np.linalg.norm(facing)
    _add_sensor(root, [_float("fov", 40.0), _string("fov_axis", "x"),
                       _transform([_lookat(eye, at, chart.up)])], (600, 400))
    _add_lamp(root, box.lamp, chart.lamp_at_mm or box.lamp.position_mm)
    bsdf = ET.SubElement(root, "bsdf", type="diffuse", id="card")
    ET.SubElement(bsdf, "spectrum", name="reflectance", value="0.2")
    root.append(_shape("rectangle", "chart", "card",
                       [_scale(chart.size_mm[0] / 2, chart.size_mm[1] / 2, 1),
                        _lookat(at, chart.look_at_mm, chart.up)]))
    return _text(root)


def is_of_box(path: Path) -> bool:
    """Whether a scene was made from [scene.box], as its comment says.

    Parameters
    ----------
    path : Path
        Of a scene that was read before.
    """
    return TAKE_OVER.split("{")[0].strip() in path.read_text(encoding="utf-8-sig")


def box_edges(box: box_tables.BoxTable) -> list[tuple[str, str]]:
    """Names of the corners at both ends of each edge of the box, and of boxes in it."""
    of_one = [(one, other) for number, one in enumerate(box_tables.CORNERS)
              for other in box_tables.CORNERS[number + 1:]
              if sum(a != b for a, b in zip(one.split(), other.split(), strict=True)) == 1]
    boxes = [one.name for one in box.objects if one.size_mm is not None]
    return of_one + [(f"{name} {one}", f"{name} {other}") for name in boxes
                     for one, other in of_one]


def _wall_steps(box: box_tables.BoxTable, wall: str) -> list[ET.Element]:
    """A rectangle, which spans -1 to 1 and faces +z, turned and moved to its position."""
    half_width, half_height, half_depth = box.width_mm / 2, box.height_mm / 2, box.depth_mm / 2
    if wall == "back":
        return [_scale(half_width, half_height, 1), _translate((0, half_height, -box.depth_mm))]
    if wall in ("floor", "ceiling"):
        up = wall == "floor"
        return [_scale(half_width, half_depth, 1), _rotate("x", -90 if up else 90),
                _translate((0, 0 if up else box.height_mm, -half_depth))]
    left = wall == "left"
    return [_scale(half_depth, half_height, 1), _rotate("y", 90 if left else -90),
            _translate((-half_width if left else half_width, half_height, -half_depth))]


def _object(one: box_tables.ObjectTable) -> list[ET.Element]:
    """Its shapes; a cylinder has a side and a top."""
    x, y, z = one.at_mm
    if one.shape == "box":
        assert one.size_mm is not None
        width, height, depth = one.size_mm
        return [_shape("cube", one.name, one.material,
                       [_scale(width / 2, height / 2, depth / 2), _rotate("y", one.turn_deg),
                        _translate((x, y + height / 2, z))])]
    assert one.radius_mm is not None
    if one.shape == "sphere":
        ball = _shape("sphere", one.name, one.material, [])
        ball.append(_float("radius", one.radius_mm))
        ball.append(_point("center", (x, y + one.radius_mm, z)))
        return [ball]
    assert one.height_mm is not None
    side = _shape("cylinder", one.name, one.material, [])
    side.append(_float("radius", one.radius_mm))
    side.append(_point("p0", (x, y, z)))
    side.append(_point("p1", (x, y + one.height_mm, z)))
    top = _shape("disk", f"{one.name} top", one.material,
                 [_scale(one.radius_mm, one.radius_mm, 1), _rotate("x", -90),
                  _translate((x, y + one.height_mm, z))])
    return [side, top]


def _add_lamp(root: ET.Element, lamp: box_tables.LampTable, at_mm: Sequence[float]) -> None:
    if lamp.radius_mm is not None:
        shape = ET.SubElement(root, "shape", type="sphere", id="lamp")
        shape.append(_float("radius", lamp.radius_mm))
        shape.append(_point("center", at_mm))
    else:
        assert lamp.size_mm is not None and lamp.look_at_mm is not None
        shape = ET.SubElement(root, "shape", type="rectangle", id="lamp")
        target = np.array(lamp.look_at_mm) - np.array(lamp.at_mm) + np.array(at_mm)
        shape.append(_transform([_scale(lamp.size_mm[0] / 2, lamp.size_mm[1] / 2, 1),
                                 _lookat(at_mm, target, _upright(target - np.array(at_mm)))]))
    emitter = ET.SubElement(shape, "emitter", type="area")
    ET.SubElement(emitter, "spectrum", name="radiance", value="1")
    if lamp.beam is not None:
        emitter.append(_string(scene_file.PROFILE, lamp.beam))


def _upright(direction: np.ndarray) -> tuple[float, float, float]:
    """Up, or towards the camera for what looks straight up or down."""
    across = np.linalg.norm(np.cross(direction, (0.0, 1.0, 0.0)))
    return (0.0, 1.0, 0.0) if across > 1e-3 * np.linalg.norm(direction) else (0.0, 0.0, 1.0)


def _stated(camera: box_tables.CameraTable) -> list[ET.Element]:
    assert camera.at_mm is not None and camera.look_at_mm is not None
    assert camera.fov_deg is not None
    return [_string("fov_axis", "x"), _float("fov", camera.fov_deg),
            _transform([_lookat(camera.at_mm, camera.look_at_mm, camera.up)])]


def _scene(max_depth: int, comment: str) -> ET.Element:
    root = ET.Element("scene", version="3.0.0")
    root.append(ET.Comment(comment))
    root.append(ET.Comment(FRAME))
    integrator = ET.SubElement(root, "integrator", type="path")
    ET.SubElement(integrator, "integer", name="max_depth", value=str(max_depth))
    return root


def _add_sensor(root: ET.Element, nodes: list[ET.Element], size: tuple[int, int]) -> None:
    sensor = ET.SubElement(root, "sensor", type="perspective", id="camera")
    sensor.extend(nodes)
    film = ET.SubElement(sensor, "film", type="hdrfilm")
    for name, pixels in zip(("width", "height"), size, strict=True):
        ET.SubElement(film, "integer", name=name, value=str(pixels))
    ET.SubElement(film, "rfilter", type="box")


def _shape(kind: str, name: str, material: str, steps: list[ET.Element]) -> ET.Element:
    shape = ET.Element("shape", type=kind, id=name)
    ET.SubElement(shape, "ref", id=material)
    if steps:
        shape.append(_transform(steps))
    return shape


def _transform(steps: list[ET.Element]) -> ET.Element:
    node = ET.Element("transform", name="to_world")
    node.extend(steps)
    return node


def _scale(x: float, y: float, z: float) -> ET.Element:
    return ET.Element("scale", x=f"{x:.10g}", y=f"{y:.10g}", z=f"{z:.10g}")


def _rotate(axis: str, angle_deg: float) -> ET.Element:
    return ET.Element("rotate", {axis: "1", "angle": f"{angle_deg:.10g}"})


def _translate(position: Sequence[float]) -> ET.Element:
    x, y, z = position
    return ET.Element("translate", x=f"{x:.10g}", y=f"{y:.10g}", z=f"{z:.10g}")


def _lookat(origin: Sequence[float] | np.ndarray, target: Sequence[float] | np.ndarray,
            up: Sequence[float]) -> ET.Element:
    return ET.Element("lookat", origin=_numbers(origin), target=_numbers(target), up=_numbers(up))


def _point(name: str, position: Sequence[float]) -> ET.Element:
    return ET.Element("point", name=name, value=_numbers(position))


def _float(name: str, value: float) -> ET.Element:
    return ET.Element("float", name=name, value=f"{value:.10g}")


def _string(name: str, value: str) -> ET.Element:
    return ET.Element("string", name=name, value=value)


def _numbers(values: Sequence[float] | np.ndarray) -> str:
    return ", ".join(f"{value:.10g}" for value in values)


def _text(root: ET.Element) -> str:
    ET.indent(root, space="    ")
    return ET.tostring(root, encoding="unicode") + "\n"
