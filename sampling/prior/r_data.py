"""Numeric columns of a data frame saved by R (.rda), read and never executed.

The XDR serialisation, versions 2 and 3. Layout: "R Internals", section 1.8. Every item starts with
a 32-bit word: its type in the low byte, bit 9 for attributes, bit 10 for a tag.
"""
from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.system.archives import DamagedArchiveError, unpacked

PAIRLIST, SYMBOL, CHARACTERS, LOGICAL, INTEGER, REAL, STRINGS, LIST = 2, 1, 9, 10, 13, 14, 16, 19
REFERENCE, NIL = 255, 254
HAS_ATTRIBUTES, HAS_TAG = 1 << 9, 1 << 10


def read_r_columns(path: Path) -> dict[str, np.ndarray]:
    """Real and integer columns of every data frame of the file, by name.

    Parameters
    ----------
    path : Path

    Raises
    ------
    InputError
        If the file is no such file, is cut short, or holds more than plain vectors.
    """
    try:
        reader = _Reader(_unpacked(path.read_bytes()))
        top = reader.item()
    except (struct.error, IndexError, ValueError, OSError, RecursionError,
            DamagedArchiveError) as error:
        raise InputError(f"{path.name} is no R data file that can be read ({error}); export the "
                         "table as CSV") from None
    columns: dict[str, np.ndarray] = {}
    for frame in (top or {}).values() if isinstance(top, dict) else []:
        if isinstance(frame, tuple) and isinstance(frame[0], list):
            names = frame[1].get("names", [])
            columns |= {name: column for name, column in zip(names, frame[0], strict=False)
                        if isinstance(column, np.ndarray)}
    return columns


def _unpacked(raw: bytes) -> bytes:
    raw = unpacked(raw)
    if raw[:5] not in (b"RDX2\n", b"RDX3\n") or raw[5:7] != b"X\n":
        raise ValueError("it does not begin with RDX2 or RDX3")
    version = int.from_bytes(raw[7:11], "big")
    head = 19 if version == 2 else 23 + int.from_bytes(raw[19:23], "big")
    return raw[head:]


class _Reader:
    """A position in the bytes, and the symbols so far, to which later items refer by number."""

    def __init__(self, content: bytes) -> None:
        self.content, self.position = content, 0
        self.symbols: list[Any] = []

    def integer(self) -> int:
        self.position += 4
        return int(struct.unpack(">i", self.content[self.position - 4:self.position])[0])

    def array(self, dtype: str) -> np.ndarray:
        length, width = self.integer(), np.dtype(dtype).itemsize
        if length < 0 or self.position + length * width > len(self.content):
            raise ValueError("it is cut short")
        self.position += length * width
        start = self.position - length * width
        return np.frombuffer(self.content, dtype, length, start).astype(float)

    def item(self) -> Any:
        flags = self.integer()
        kind = flags & 255
        if kind == NIL:
            return None
        if kind == REFERENCE:
            return self.symbols[(flags >> 8) - 1]
        if kind == PAIRLIST:
            return self.pairs(flags)
        value = self.plain(kind)
        if flags & HAS_ATTRIBUTES and kind != CHARACTERS:
            return value, self.item() or {}
        return (value, {}) if kind == LIST else value

    def plain(self, kind: int) -> Any:
        if kind == SYMBOL:
            self.symbols.append(self.item())
            return self.symbols[-1]
        if kind == CHARACTERS:
            length = self.integer()
            self.position += max(length, 0)
            text = self.content[self.position - max(length, 0):self.position]
            return text.decode("utf-8", errors="replace")
        if kind in (LOGICAL, INTEGER):
            return self.array(">i4")
        if kind == REAL:
            return self.array(">f8")
        if kind in (STRINGS, LIST):
            return [self.item() for _ in range(self.integer())]
        raise ValueError(f"it holds an item of type {kind}")

    def pairs(self, flags: int) -> dict[str, Any]:
        tagged: dict[str, Any] = {}
        while flags & 255 == PAIRLIST:
            if flags & HAS_ATTRIBUTES:
                self.item()
            name = self.item() if flags & HAS_TAG else str(len(tagged))
            tagged[name] = self.item()
            flags = self.integer()
        return tagged
