"""The position of a light in an operator's scene, and the scene with it moved."""
from __future__ import annotations

import copy
import dataclasses
import xml.etree.ElementTree as ET

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.reconstruct.scene.scene_file import SceneFile

POSITIONED = {"area", "point", "spot", "projector", "directionalarea"}


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
