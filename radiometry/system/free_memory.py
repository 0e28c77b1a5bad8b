"""Memory that the machine can still give, and that decoding a photo may take."""
from __future__ import annotations

import contextlib
import os
from pathlib import Path

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
