"""A scene in several files, or of an older Mitsuba, as one tree of Mitsuba 3.

``<include>`` is replaced by what the file holds, ``<path>`` names folders in which files are looked
for, ``$NAME`` in a file's name is the <default> of that name, and names of Mitsuba 0.x
("toWorld", "lookAt") become those of Mitsuba 3 ("to_world", "lookat").
"""
from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.files import is_there, read_text

MAX_INCLUDES = 100
RENAMED = {"lookAt": "lookat", "srgb": "rgb"}
CURRENT = "3.0.0"


@dataclass(frozen=True)
class IncludedFiles:
    """Files that a scene includes, and what is wrong with them; the lists grow as they are read."""

    files: list[Path] = field(default_factory=list)         # included
    folders: list[Path] = field(default_factory=list)       # in which files are looked for
    problems: list[str] = field(default_factory=list)


def resolve_includes(root: ET.Element, scene: Path, inside: Path | None = None) -> IncludedFiles:
    """Replace every <include> and <path> of a <scene>, in place, and bring names up to date.

    Parameters
    ----------
    root : Element
        Is changed.
    scene : Path
        Its file.
    inside : Path, optional
        Included files must lie in here; None allows any.
    """
    included = IncludedFiles(folders=[scene.parent])
    _upgrade(root)
    while (node := next((child for child in root if child.tag in ("include", "path")), None)
           ) is not None:
        position, defaults = list(root).index(node), defaults_of(root)
        root.remove(node)
        if node.tag == "path":
            folder = scene.parent / substitute_defaults(node.get("value", ""), defaults)
            included.folders.append(folder)
            continue
        name = substitute_defaults(node.get("filename", ""), defaults)
        file = find_file(name, included.folders)
        if file is None:
            included.problems.append(f"includes {name!r}, which is missing; copy it next to the "
                                     "scene")
            continue
        if inside is not None and not file.resolve().is_relative_to(inside.resolve()):
            included.problems.append(f"includes {name!r}, which lies outside the session folder; "
                                     "copy it into scene/")
            continue
        if len(included.files) == MAX_INCLUDES:
            included.problems.append(f"includes more than {MAX_INCLUDES} files; {name!r} may "
                                     "include itself")
            break
        included.files.append(file)
        included.folders.append(file.parent)
        if (part := _scene_of(file, included)) is not None:
            _upgrade(part)
            for index, child in enumerate(list(part)):
                root.insert(position + index, child)
    return included


def defaults_of(root: ET.Element) -> dict[str, str]:
    """Values of a scene's <default>s by name; the first of a name counts."""
    values: dict[str, str] = {}
    for node in root.iter("default"):
        values.setdefault(node.get("name", ""), node.get("value", ""))
    return values


def substitute_defaults(text: str, defaults: Mapping[str, str]) -> str:
    """A value with every $NAME replaced by its default; one that has none stays.

    Parameters
    ----------
    text : str
    defaults : mapping
    """
    return re.sub(r"\$(\w+)", lambda name: defaults.get(name[1], name[0]), text)


def find_file(name: str, folders: list[Path]) -> Path | None:
    """The first of some folders' files of a name, None where no folder has one."""
    return next((folder / name for folder in folders if is_there(folder / name)), None)


def _scene_of(file: Path, included: IncludedFiles) -> ET.Element | None:
    try:
        root = ET.fromstring(read_text(file))
    except (InputError, OSError, ET.ParseError, ValueError, RecursionError) as error:
        included.problems.append(f"includes {file.name!r}, which cannot be read: {error}")
        return None
    if root.tag != "scene":
        included.problems.append(f"includes {file.name!r}, whose root is <{root.tag}>; <scene> is "
                              "needed")
        return None
    return root


def _upgrade(root: ET.Element) -> None:
    """Names of Mitsuba 0.x become those that Mitsuba has since 2.0."""
    if not re.match(r"[01]\.", root.get("version", "")):
        return
    root.set("version", CURRENT)
    for node in root.iter():
        node.tag = RENAMED.get(node.tag, node.tag)
        if "name" in node.attrib and node.tag != "default":
            # "toWorld" becomes "to_world", "intIOR" "int_ior"
            node.set("name", re.sub(r"(?<=[a-z0-9])([A-Z]+)", r"_\1",
                                    node.get("name", "")).lower())
