"""An estimated camera or light written into a copy of a Mitsuba scene, the rest left as it was."""
from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.reconstruct.scene.moved_light import move_light
from spectrabox.reconstruct.scene.refinements import Refinement, add_refinement

REPLACED = {"fov", "fov_axis", "focal_length", "principal_point_offset_x",
            "principal_point_offset_y", "to_world"}


def scene_with_camera(path: Path, camera: Mapping[str, Any], size: tuple[int, int],
                      folder: Path, said: Refinement | None = None) -> str:
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
    said : Refinement, optional
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
    if said is not None:
        add_refinement(root, said)
    return ET.tostring(root, encoding="unicode") + "\n"


def scene_with_light_moved(path: Path, number: int, offset: np.ndarray, folder: Path,
                           said: Refinement | None = None) -> str:
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
    said : Refinement, optional
        What the copy says of this, in a comment.

    Raises
    ------
    InputError
        If the file is missing or no scene, names files that a copy in another folder would not
        find, or gives the light a position that is not three numbers.
    """
    root = _parsed(path, folder)
    move_light(root, number, offset)
    if said is not None:
        add_refinement(root, said)
    return ET.tostring(root, encoding="unicode") + "\n"


def _parsed(path: Path, folder: Path) -> ET.Element:
    try:
        root = ET.fromstring(path.read_text(encoding="utf-8-sig"),
                             ET.XMLParser(target=ET.TreeBuilder(insert_comments=True)))
    except OSError as error:
        raise InputError(
            f"{path} cannot be read ({error.strerror}); give the scene's right name") from None
    except (ET.ParseError, ValueError, RecursionError) as error:
        raise InputError(f"{path.name} is not well-formed XML: {error}") from None
    if root.tag != "scene":
        raise InputError(f"{path.name} is not a Mitsuba scene: its root is <{root.tag}>, <scene> "
                         "is needed")
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
