"""Ending a run's process with all that it has started."""
from __future__ import annotations

import contextlib
import os
import signal
import sys

GRACE_S = 1.0       # for a command that was asked to end
SPECTRABOX = [sys.executable, "-m", "spectrabox"]


def kill_group(leader: int) -> None:
    """End a process and what it has started, where the system has groups of processes.

    Parameters
    ----------
    leader : int
        0 for the group of this process.
    """
    if hasattr(os, "killpg"):
        with contextlib.suppress(ProcessLookupError):
            os.killpg(leader, signal.SIGKILL)
