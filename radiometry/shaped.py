"""Frozen records whose arrays are checked against letters and kept read-only.

A field is declared as ``mean: Annotated[np.ndarray, "4 2"]``. A letter is any size, the same
throughout the record; a number is that size. ``None`` passes where the annotation allows
it; of a dictionary of such arrays each is checked.
"""
from __future__ import annotations

import dataclasses
import functools
import typing
from typing import Any

import numpy as np


class Record:
    """Base of the frozen records: checks shapes, copies arrays that could be changed outside."""

    def __post_init__(self) -> None:
        sizes: dict[str, int] = {}
        for name, letters in array_fields(typing.cast(Any, type(self))).items():
            value, field = getattr(self, name), f"{type(self).__name__}.{name}"
            if value is None:
                continue
            checked = {key: _checked(each, f"{field}[{key!r}]", letters, sizes)
                       for key, each in value.items()} if isinstance(value, dict) \
                else _checked(value, field, letters, sizes)
            object.__setattr__(self, name, checked)


def _checked(value: Any, field: str, letters: str, sizes: dict[str, int]) -> np.ndarray:
    """A read-only array of the sizes that letters have, or will have, in ``sizes``."""
    array = np.asarray(value)
    if array.ndim != len(letters.split()):
        raise ValueError(f"{field} has shape {array.shape}; ({letters}) is needed")
    for size, letter in zip(array.shape, letters.split(), strict=True):
        expected = int(letter) if letter.isdigit() else sizes.setdefault(letter, size)
        if size != expected:
            raise ValueError(f"{field} has shape {array.shape}; ({letters}) with {letter} "
                             f"= {expected} is needed")
    if array.flags.writeable:
        array = array.copy() if array is value else array
        array.flags.writeable = False
    return array


@functools.cache
def array_fields(record: Any) -> dict[str, str]:
    """Names of the array fields of a record class, each with its shape letters."""
    hints = typing.get_type_hints(record, include_extras=True)
    return {field.name: letters for field in dataclasses.fields(record)
            if (letters := _letters(hints[field.name])) is not None}


def _letters(hint: Any) -> str | None:
    if typing.get_origin(hint) is typing.Annotated:
        return hint.__metadata__[0]
    inner = [letters for part in typing.get_args(hint) if (letters := _letters(part)) is not None]
    return inner[0] if inner else None
