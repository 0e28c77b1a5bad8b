"""Archives from outside: what a member would unpack to is known before it is unpacked, and damage
of any kind is one error.
"""
from __future__ import annotations

import bz2
import contextlib
import gzip
import io
import lzma
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

MAX_UNPACKED = 1_500_000_000        # bytes of one archive
CHUNK = 1 << 20
# What damaged bytes make NumPy, zipfile and the unpackers raise, beside errors of their own.
DAMAGE = (ValueError, TypeError, EOFError, OSError, KeyError, IndexError, OverflowError,
          MemoryError, SyntaxError, NotImplementedError, RuntimeError, AttributeError,
          tokenize.TokenError, struct.error, zlib.error, lzma.LZMAError, zipfile.BadZipFile)


class DamagedArchiveError(Exception):
    """An archive that cannot be unpacked, with the reason as a few words."""


@contextlib.contextmanager
def opened_npz(path: Path) -> Iterator[Mapping[str, np.ndarray]]:
    """Arrays of a .npz by name, each read from disk when it is asked for; no pickle.

    Raises
    ------
    DamagedArchiveError
        If the file is damaged, unpacks to more than ``MAX_UNPACKED`` bytes, or what is done with
        the arrays in the block fails as it does on damaged ones.
    FileNotFoundError
        If there is no such file.
    """
    with _damage_reported(), path.open("rb") as file:
        with zipfile.ZipFile(file) as archive:
            _require_small(archive)
        file.seek(0)
        with np.load(file, allow_pickle=False) as stored:
            if not isinstance(stored, np.lib.npyio.NpzFile):
                raise ValueError("it holds one array")
            yield stored


@contextlib.contextmanager
def opened_zip(path: Path) -> Iterator[zipfile.ZipFile]:
    """A zip archive whose members together unpack to no more than ``MAX_UNPACKED`` bytes.

    Raises
    ------
    DamagedArchiveError
        As ``opened_npz``.
    """
    with _damage_reported(), zipfile.ZipFile(path) as archive:
        _require_small(archive)
        yield archive


def _require_small(archive: zipfile.ZipFile) -> None:
    """Refuse an archive whose members state too many bytes; none can hold more than it states."""
    size = sum(member.file_size for member in archive.infolist())
    if size > MAX_UNPACKED:
        raise ValueError(f"it unpacks to {size / 1e9:.1f} GB; {MAX_UNPACKED / 1e9:.1f} GB is the "
                         "limit")


def unpacked(content: bytes) -> bytes:
    """Unpack gzip, bzip2 or xz; anything else is returned as it is.

    Raises
    ------
    DamagedArchiveError
        If it is damaged, or unpacks to more than ``MAX_UNPACKED`` bytes.
    """
    opening: dict[bytes, Any] = {b"BZh": bz2.open, b"\x1f\x8b": gzip.open, b"\xfd7zXZ": lzma.open}
    opened = next((each for magic, each in opening.items() if content.startswith(magic)), None)
    if opened is None:
        return content
    parts, size = [], 0
    with _damage_reported(), opened(io.BytesIO(content)) as source:
        while part := source.read(CHUNK):
            size += len(part)
            if size > MAX_UNPACKED:
                raise ValueError(f"it unpacks to more than {MAX_UNPACKED / 1e9:.1f} GB")
            parts.append(part)
    return b"".join(parts)


@contextlib.contextmanager
def _damage_reported() -> Iterator[None]:
    try:
        yield
    except FileNotFoundError:
        raise
    except DAMAGE as error:
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise DamagedArchiveError(reason) from None
