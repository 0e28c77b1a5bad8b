"""A scene with its camera replaced or a light moved, the rest left as it was."""
from __future__ import annotations

import copy
import dataclasses
import json
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, ValidationError

from spectrabox.radiometry import checked_tables, files
from spectrabox.radiometry.errors import InputError
from spectrabox.reconstruct.scene.scene_file import SceneFile, parse_scene

POSITIONED = {"area", "point", "spot", "projector", "directionalarea"}
REPLACED = {"fov", "fov_axis", "focal_length", "principal_point_offset_x",
            "principal_point_offset_y", "to_world"}


def scene_with_camera(path: Path, camera: Mapping[str, Any], size: tuple[int, int],
                      folder: Path, refinement: Refinement | None = None) -> str:
    """XML of the scene with another camera.

    Parameters
    ----------
    path : Path
        The operator's scene, which stays as it is.
    camera : mapping
        ``to_world`` (4, 4), ``fov`` in degrees, ``fov_axis`` and the principal point offsets of a
        ``perspective`` sensor.
    size : (width, height)
        Of the photo in pixels; the film keeps its own where it has the same shape.
    folder : Path
        Where the copy will lie.
    refinement : Refinement, optional
        What the copy says of this, in a comment.

    Raises
    ------
    InputError
        If the file is missing or no scene, its sensor is not a ``perspective`` one, or it names
        files that a copy in another folder would not find.
    """
    root = _parsed(path, folder)
    sensor = root.find("sensor")
    if sensor is None:
        raise InputError(f"{path.name} has no <sensor> of its own to be written over; add one of "
                         "type perspective")
    if sensor.get("type") != "perspective":
        raise InputError(f"{path.name}: the sensor is of type {sensor.get('type')!r}; the photo's "
                         "camera is a perspective one, change the type and run again")
    film = sensor.find("film")
    if film is None:
        film = ET.SubElement(sensor, "film", type="hdrfilm")
    for child in [child for child in sensor if child.get("name") in REPLACED]:
        sensor.remove(child)
    for index, node in enumerate(camera_nodes(camera)):
        sensor.insert(index, node)
    _shape_film(root, film, size)
    ET.indent(sensor, space="    ", level=1)
    if refinement is not None:
        add_refinement(root, refinement)
    return ET.tostring(root, encoding="unicode") + "\n"


def scene_with_light_moved(path: Path, number: int, offset: np.ndarray, folder: Path,
                           refinement: Refinement | None = None) -> str:
    """XML of the scene with one of its emitters moved.

    Parameters
    ----------
    path : Path
        The operator's scene, which stays as it is.
    number : int
        Of the emitter, counted from 0 in the order of the file.
    offset : (3,) array
        In the scene's unit.
    folder : Path
        Where the copy will lie.
    refinement : Refinement, optional
        What the copy says of this, in a comment.

    Raises
    ------
    InputError
        If the file is missing or no scene, names files that a copy in another folder would not
        find, or gives the light a position that is not three numbers.
    """
    root = _parsed(path, folder)
    move_light(root, number, offset)
    if refinement is not None:
        add_refinement(root, refinement)
    return ET.tostring(root, encoding="unicode") + "\n"


def _parsed(path: Path, folder: Path) -> ET.Element:
    try:
        root = parse_scene(files.read_text(path), path, comments=True)
    except OSError as error:
        raise InputError(
            f"{path} cannot be read ({error.strerror}); give the scene's right name") from None
    except ValueError as error:         # no UTF-8
        raise InputError(f"{path.name} is not well-formed XML: {error}") from None
    if root.find("include") is not None:
        raise InputError(f"{path.name} includes other files, whose parts a copy could not change; "
                         "put what they hold into it")
    named = [node for node in root.iter() if node.get("name") == "filename" or node.get("filename")]
    if named and folder.resolve() != path.parent.resolve():
        raise InputError(f"{path.name} names other files by paths relative to itself; write the "
                         f"copy into {path.parent}")
    return root


def camera_nodes(camera: Mapping[str, Any]) -> list[ET.Element]:
    """Parameters of a ``perspective`` sensor as XML.

    Parameters
    ----------
    camera : mapping
        As of ``scene_with_camera``.
    """
    nodes = [ET.Element("string", name="fov_axis", value=str(camera["fov_axis"]))]
    nodes += [ET.Element("float", name=name, value=f"{camera[name]:.10g}")
              for name in ("fov", "principal_point_offset_x", "principal_point_offset_y")]
    transform = ET.Element("transform", name="to_world")
    ET.SubElement(transform, "matrix", value="  ".join(" ".join(f"{value:.10g}" for value in row)
                                                       for row in np.asarray(camera["to_world"])))
    return [*nodes, transform]


def _shape_film(root: ET.Element, film: ET.Element, size: tuple[int, int]) -> None:
    """Give the film the photo's shape, which the field of view belongs to; if it has it, it stays.
    """
    defaults = {f"${node.get('name')}": node.get("value", "") for node in root.iter("default")}
    written = {node.get("name"): node for node in film.iter("integer")}
    values = [written[name].get("value", "") if name in written else ""
              for name in ("width", "height")]
    numbers = [defaults.get(value, value) for value in values]
    if (all(number.isdigit() for number in numbers)
            and int(numbers[0]) * size[1] == int(numbers[1]) * size[0]):
        return
    for name, pixels in zip(("width", "height"), size, strict=True):
        node = written[name] if name in written else ET.SubElement(film, "integer", name=name)
        node.set("value", str(pixels))
    for name in [name for name in written if name is not None and name.startswith("crop_")]:
        film.remove(written[name])


def light_number(scene_file: SceneFile, light_id: str | None) -> int:
    """Which of the scene's emitters is meant, counted from 0 in the order of the file.

    Parameters
    ----------
    scene_file : SceneFile
    light_id : str or None
        None takes the only one.

    Raises
    ------
    InputError
        If there are several and none is named, there is none of that name, or it has no position.
    """
    names = scene_file.light_ids
    if light_id is None and len(names) > 1:
        raise InputError(f"{scene_file.path.name} has {len(names)} lights; say which: "
                         f"{', '.join(names)}")
    if light_id is not None and light_id not in names:
        raise InputError(f"{scene_file.path.name} has no light {light_id!r}; it has "
                         f"{', '.join(names)}")
    number = 0 if light_id is None else names.index(light_id)
    kind = list(scene_file.root.iter("emitter"))[number].get("type", "")
    if kind not in POSITIONED:
        raise InputError(f"{scene_file.path.name}: the light {names[number]!r} is of type "
                         f"{kind!r}, which has no position to be estimated; "
                         f"{', '.join(sorted(POSITIONED))} have")
    return number


def with_light_moved(scene_file: SceneFile, number: int, offset: np.ndarray) -> SceneFile:
    """The scene with one of its emitters moved.

    Parameters
    ----------
    scene_file : SceneFile
        Stays as it is.
    number : int
        Of the emitter, as of ``light_number``.
    offset : (3,) array
        In the scene's unit.

    Raises
    ------
    InputError
        If the light's position is not three numbers.
    """
    root = copy.deepcopy(scene_file.root)
    move_light(root, number, offset)
    return dataclasses.replace(scene_file, root=root)


def with_camera_at(scene_file: SceneFile, to_world: np.ndarray) -> SceneFile:
    """The scene with its camera elsewhere, its lens as it is.

    Parameters
    ----------
    scene_file : SceneFile
        Stays as it is.
    to_world : (4, 4) array
        As of Mitsuba's sensors.
    """
    root = copy.deepcopy(scene_file.root)
    sensor = root.find("sensor")
    assert sensor is not None       # read_scene requires one
    for node in [node for node in sensor if node.tag == "transform"
                 and node.get("name") == "to_world"]:
        sensor.remove(node)
    transform = ET.SubElement(sensor, "transform", name="to_world")
    ET.SubElement(transform, "matrix", value=" ".join(f"{value:.10g}"
                                                      for value in to_world.ravel()))
    return dataclasses.replace(scene_file, root=root)


def move_light(root: ET.Element, number: int, offset: np.ndarray) -> None:
    """Move one emitter of a scene's XML, in place: its shape, or itself where it has none.

    Parameters
    ----------
    root : ET.Element
        The <scene>; it is changed.
    number : int
        Of the emitter, as of ``light_number``.
    offset : (3,) array
        In the scene's unit.

    Raises
    ------
    InputError
        If the light's position is not three numbers.
    """
    light = list(root.iter("emitter"))[number]
    node = next((shape for shape in root.iter("shape") if light in list(shape)), light)
    position = next((child for child in node if child.tag in ("point", "vector")
                     and child.get("name") == "position"), None)
    if position is not None:
        moved = _position(position) + offset
        position.attrib = {"name": "position",
                           "value": ", ".join(f"{value:.9g}" for value in moved)}
        return
    transform = next((child for child in node
                      if child.tag == "transform" and child.get("name") == "to_world"), None)
    if transform is None:
        transform = ET.SubElement(node, "transform", name="to_world")
    ET.SubElement(transform, "translate",
                  {axis: f"{value:.9g}" for axis, value in zip("xyz", offset, strict=True)})


def _position(node: ET.Element) -> np.ndarray:
    text = node.get("value")
    words = ([node.get(axis, "0") for axis in "xyz"] if text is None
             else text.replace(",", " ").split())
    try:
        position = np.array([float(word) for word in words])
    except ValueError:
        position = np.empty(0)
    if position.shape != (3,):
        raise InputError(f"the light's position {' '.join(words)!r} is not three numbers; write "
                         "them out in the scene")
    return position


# ---- refinements ---------------------------------------------------------------------------------
# What was estimated of a scene and written into it, kept as comments that the file carries along.
#
# ``geometry pose`` and ``geometry light`` write such comments; renderers pass over them.

MARK = " spectrabox estimated: "
Vector = Annotated[checked_tables.ListOf[float], Field(min_length=3, max_length=3)]


class Refinement(checked_tables.Table):
    """A camera placed, or a light moved, in the scene's unit."""

    what: Literal["camera", "light"]
    name: str
    how: str
    place: Vector | None = None         # of a camera
    moved: Vector | None = None         # of a light
    standard_error: Vector


def add_refinement(root: ET.Element, refinement: Refinement) -> None:
    """Put a comment at the top of a <scene>, in place; of a camera in place of an older one.

    Parameters
    ----------
    root : Element
        Is changed.
    refinement : Refinement
    """
    for node in [node for node in root if _read(node) is not None]:
        older = _read(node)
        if older is not None and older.what == refinement.what == "camera":
            root.remove(node)
    # two hyphens end a comment of XML
    text = refinement.model_dump_json(exclude_none=True).replace("--", "-\\u002d")
    comment = ET.Comment(f"{MARK}{text} ")
    comment.tail = "\n    "
    # after those that are there: lights may be moved one after the other
    root.insert(sum(_read(node) is not None for node in root), comment)


def refinements(path: Path) -> tuple[Refinement, ...]:
    """What a scene's comments say was estimated, in order; a comment that is no such one is none.

    Parameters
    ----------
    path : Path
        Of a scene that was read before.
    """
    root = parse_scene(files.read_text(path), path, comments=True)
    return tuple(refinement for node in root if (refinement := _read(node)) is not None)


def rounded(values: Sequence[float] | np.ndarray) -> tuple[float, ...]:
    """Numbers as they stand in a comment, to six digits."""
    return tuple(float(f"{value:.6g}") for value in values)


def _read(node: ET.Element) -> Refinement | None:
    text = node.text or ""
    if node.tag is not ET.Comment or not text.startswith(MARK):
        return None
    try:
        return Refinement.model_validate(json.loads(text.removeprefix(MARK)))
    except (ValueError, ValidationError, RecursionError):
        return None
