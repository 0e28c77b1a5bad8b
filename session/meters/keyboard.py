"""Lines that an operator types, while an instrument may be the one that answers."""
from __future__ import annotations

import io
import os
import select
import sys
import time

LOOK_S = 0.1
NO_MORE = "q"       # what an ended input says


class Keyboard:
    """Standard input, line by line, without waiting for a line longer than wanted.

    Not by a thread: one that waits for input keeps the process from ending.
    """

    def __init__(self) -> None:
        self._typed = b""
        self._ended = False

    def line(self, limit_s: float | None) -> str | None:
        """The next line, small letters without blanks around; "q" at the end of the input.

        Parameters
        ----------
        limit_s : float or None
            None where none was typed within it; without a limit it is waited for.
        """
        deadline = None if limit_s is None else time.monotonic() + limit_s
        while b"\n" not in self._typed and not self._ended:
            left = LOOK_S if deadline is None else max(deadline - time.monotonic(), 0.0)
            if not self._take(min(left, LOOK_S)) and deadline is not None \
                    and time.monotonic() >= deadline:
                return None
        line, _, self._typed = self._typed.partition(b"\n")
        if self._ended and not line:
            return NO_MORE
        return line.decode(errors="replace").strip().lower()

    def _take(self, limit_s: float) -> bool:
        """Whether something was typed within a time."""
        try:
            descriptor = sys.stdin.fileno()
        except (io.UnsupportedOperation, AttributeError, ValueError):    # not a real input
            line = sys.stdin.readline() if sys.stdin is not None else ""
            self._typed += line.encode()
            self._ended = not line
            return True
        if not _is_ready(descriptor, limit_s):
            return False
        typed = os.read(descriptor, 4096)
        self._typed += typed
        self._ended = not typed
        return True


def _is_ready(descriptor: int, limit_s: float) -> bool:
    if os.name != "nt":
        return bool(select.select([descriptor], [], [], limit_s)[0])
    if not os.isatty(descriptor):
        return True
    import msvcrt
    deadline = time.monotonic() + limit_s
    while not msvcrt.kbhit():  # type: ignore[attr-defined,unused-ignore]
        if time.monotonic() >= deadline:
            return False
        time.sleep(0.02)
    return True
