"""Memory that the machine can still give."""
from __future__ import annotations

import contextlib
import os
from pathlib import Path

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
