"""What operators may call the families of surfaces. Imports nothing heavy: session files use it."""
from __future__ import annotations

from collections.abc import Sequence

NAMES = ("paint", "textile", "leaves", "skin", "white", "earth", "animal")
WORDS = {name: name for name in NAMES} | {
    "pigment": "paint", "dye": "textile", "cloth": "textile", "paper": "textile",
    "plastic": "textile", "leaf": "leaves", "flower": "leaves", "flowers": "leaves",
    "petal": "leaves", "tile": "white", "grey": "white", "wood": "earth", "soil": "earth",
    "stone": "earth", "mineral": "earth", "hair": "animal", "fur": "animal", "feather": "animal"}


def unknown_families(words: Sequence[str]) -> str | None:
    """A sentence where some word names no family of surfaces."""
    for word in words:
        if word.lower() not in WORDS:
            others = ", ".join(word for word in WORDS if word not in NAMES)
            return (f"{word!r} is no family of surfaces; known are {', '.join(NAMES)}, and for "
                    f"them {others}")
    return None
