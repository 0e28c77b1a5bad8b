"""What was estimated of a scene and written into it, kept as comments that the file carries along.

``geometry pose`` and ``geometry light`` write such comments; renderers pass over them.
"""
from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, ValidationError

from spectrabox.radiometry.checked_tables import ListOf, Table

MARK = " spectrabox estimated: "
Vector = Annotated[ListOf[float], Field(min_length=3, max_length=3)]


class Refinement(Table):
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
    root = ET.fromstring(path.read_text(encoding="utf-8-sig"),
                         ET.XMLParser(target=ET.TreeBuilder(insert_comments=True)))
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
    except (ValueError, ValidationError):
        return None
