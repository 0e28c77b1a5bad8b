"""Memory that the machine can still give."""
from __future__ import annotations

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
        machine: int | None = int(lines["MemAvailable"].split()[0]) * 1024
    except (OSError, KeyError, ValueError):
        machine = _built_in()
    free = [left for limit, used in GROUPS if (left := _left_of_group(limit, used)) is not None]
    free += [] if machine is None else [machine]
    return min(free, default=None)


def _built_in() -> int | None:
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, OSError, ValueError):       # not on Windows
        return None


def _left_of_group(limit: Path, used: Path) -> int | None:
    try:
        return max(int(limit.read_text()) - int(used.read_text()), 0)
    except (OSError, ValueError):       # no group, or its limit is "max"
        return None
