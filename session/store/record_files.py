"""Any frozen record to a pair of files and back: arrays as .npz, everything else as JSON. No
pickle.
"""
from __future__ import annotations

import contextlib
import dataclasses
import functools
import types
import typing
from collections.abc import Iterator, Mapping
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.shaped import Record
from spectrabox.radiometry.system.archives import DamagedArchiveError, opened_npz


class StoredByName(dict[str, Any]):
    """Records by the names of photos or surfaces, as an earlier session.toml may have had them."""

    def __missing__(self, name: str) -> Any:
        raise InputError("the stored results are of other photos or surfaces than session.toml "
                         f"names, and hold nothing of {name!r}: 'spectrabox run' makes them again")


def pack(value: Any, name: str, arrays: dict[str, np.ndarray]) -> Any:
    """JSON-able form of a record; its arrays are put into ``arrays`` under dotted names.

    Parameters
    ----------
    value : record, array, enumeration, tuple or dictionary of these, or what JSON holds
    name : str
        Of the value, empty of the whole; parts of a record add theirs after a dot.
    arrays : dict
        Takes the arrays; the only argument that is changed.
    """
    if isinstance(value, Record):
        value = {f.name: getattr(value, f.name)
                 for f in dataclasses.fields(value)}  # type: ignore[arg-type]
    if isinstance(value, dict):
        return {key: pack(item, f"{name}.{key}" if name else key, arrays)
                for key, item in value.items()}
    if isinstance(value, np.ndarray):
        arrays[name] = value
        return {"array": name}
    if isinstance(value, Enum):
        return value.name
    if isinstance(value, tuple):
        return [pack(item, f"{name}.{index}", arrays) for index, item in enumerate(value)]
    return value


def unpack(kind: Any, node: Any, arrays: Mapping[str, np.ndarray]) -> Any:
    """The value of type ``kind`` that ``pack`` wrote.

    Parameters
    ----------
    kind : type
        Of a record's field, or of the record.
    node : what ``pack`` returned, after JSON
    arrays : mapping
        From dotted names to arrays.
    """
    if node is None:
        return None
    if isinstance(kind, types.UnionType) or typing.get_origin(kind) is typing.Union:
        kind = next(option for option in typing.get_args(kind) if option is not types.NoneType)
    if typing.get_origin(kind) is dict:
        return StoredByName({key: unpack(typing.get_args(kind)[1], item, arrays)
                             for key, item in node.items()})
    if isinstance(node, dict) and set(node) == {"array"}:
        return arrays[node["array"]]
    if isinstance(kind, type) and issubclass(kind, Record):
        return kind(**{name: unpack(hint, node[name], arrays)
                       for name, hint in _field_types(typing.cast(Any, kind)).items()})
    if isinstance(kind, type) and issubclass(kind, Enum):
        return kind[node]
    if typing.get_origin(kind) is tuple:
        return tuple(unpack(typing.get_args(kind)[0], item, arrays) for item in node)
    return node


@functools.cache
def _field_types(record: Any) -> dict[str, Any]:
    """Types of the fields of a record, by name."""
    hints = typing.get_type_hints(record)
    return {field.name: hints[field.name]
            for field in dataclasses.fields(record)}


def save_arrays(path: Path, arrays: dict[str, np.ndarray]) -> None:
    """Arrays under their names into one .npz, as they are: draws and covariances hardly shrink, and
    packing them would take longer than drawing them.
    """
    np.savez(path, **arrays)  # type: ignore[arg-type]


@contextlib.contextmanager
def opened_arrays(path: Path) -> Iterator[Mapping[str, np.ndarray]]:
    """Arrays of one .npz by name, each read from disk when it is asked for.

    Raises
    ------
    InputError
        If the file is damaged, or holds anything but plain arrays.
    """
    try:
        with opened_npz(path) as stored:
            yield stored
    except (OSError, DamagedArchiveError) as error:
        raise InputError(f"the stored result {path.name} is damaged ({error}): remove "
                         f"{path.parent} and run again") from None
