"""Records, arrays, enumerations and paths as what JSON can hold."""
from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from pathlib import Path
from typing import Any

PLAIN = {float, int, str, bool, type(None)}     # what JSON holds as it is, most of a long answer


def to_json(value: Any) -> Any:
    """What JSON can hold of a value, the keys of a record being the names of its fields.

    Parameters
    ----------
    value : Any
        Records (dataclasses), arrays, mappings, sequences, enumerations (by their values), paths,
        numbers, text, None; nested as one likes.

    Returns
    -------
    dict, list, str, int, float, bool or None
    """
    if type(value) in PLAIN:
        return value
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: to_json(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, Mapping):
        return {key: to_json(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [each if type(each) in PLAIN else to_json(each) for each in value]
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, Path):
        return str(value)
    # arrays and numbers of NumPy, which need not be imported to know them
    return value.tolist() if hasattr(value, "tolist") else value
