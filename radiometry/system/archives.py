"""Memory that the machine can still give, and archives whose members are judged before they are
unpacked.
"""


from __future__ import annotations

import bz2
import contextlib
import gzip
import io
import lzma
import os
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.radiometry.errors import InputError

PHOTO_LIMIT = "SPECTRABOX_PHOTO_GB"     # variable of the environment that sets another limit
MAX_PHOTO_GB = 6.0                      # 100 megapixels of three bands, however they are stored
MEMINFO = Path("/proc/meminfo")
# of a container: limit and use, by control groups of version 2 and 1
GROUPS = ((Path("/sys/fs/cgroup/memory.max"), Path("/sys/fs/cgroup/memory.current")),
          (Path("/sys/fs/cgroup/memory/memory.limit_in_bytes"),
           Path("/sys/fs/cgroup/memory/memory.usage_in_bytes")))


def free_memory() -> int | None:
    """Bytes that a program can have before the machine, or its container, runs out; None where the
    system does not say.

    Linux says what is available (MemAvailable in proc(5)); elsewhere all that is built in counts.
    """
    try:
        lines = dict(line.split(":", 1) for line in MEMINFO.read_text().splitlines())
        free = [int(lines["MemAvailable"].split()[0]) * 1024]
    except (OSError, KeyError, ValueError):
        try:
            free = [os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")]
        except (AttributeError, OSError, ValueError):       # not on Windows
            free = []
    for limit, used in GROUPS:
        # no group, or its limit is "max"
        with contextlib.suppress(OSError, ValueError):
            free.append(max(int(limit.read_text()) - int(used.read_text()), 0))
    return min(free, default=None)


def require_room(name: str, width: int, height: int, channels: int, value_bytes: float) -> None:
    """Refuse a photo by what its header states, before memory is taken for it.

    Compressed, a picture of a single colour is a thousandth of what it becomes.

    Parameters
    ----------
    name : str
        Of its file.
    width, height : int
        Of what is held at once, in pixels.
    channels : int
    value_bytes : float
        That decoding takes at its worst for each value of a channel, working copies among them.

    Raises
    ------
    InputError
        If it takes more than 6 GB, or the limit that the environment sets.
    """
    stated = os.environ.get(PHOTO_LIMIT, "")
    try:
        limit_gb = float(stated or MAX_PHOTO_GB)
    except ValueError:
        raise InputError(f"{PHOTO_LIMIT} is {stated!r:.40}; a number of gigabytes is needed, such "
                         "as 12") from None
    needed_gb = width * height * channels * value_bytes / 1e9
    if not needed_gb <= limit_gb:
        raise InputError(f"photo {name} states {width} x {height} pixels of {channels} channels, "
                         f"which take {needed_gb:.3g} GB of memory to decode; {limit_gb:g} GB is "
                         "the limit: crop it, or, if you know the photo and the memory is there, "
                         f"set the variable {PHOTO_LIMIT} to {needed_gb * 1.05:.2g}")


# ---- archives from outside -----------------------------------------------------------------------

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
