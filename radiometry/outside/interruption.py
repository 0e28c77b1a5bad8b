"""Ctrl-C, a closed terminal and a request to end, held back where work must not be left half done.

An interrupt between the characters of a command would leave half of it in an instrument, which then
takes the next command, the one that puts a setting back, for the rest of it. One between making a
file and the moment that its removal is certain would leave the file behind. A closed terminal sends
two, the second of which would break off the tidying up.
"""
from __future__ import annotations

import contextlib
import math
import signal
import threading
import time
from collections.abc import Iterator
from types import FrameType, TracebackType
from typing import Any

SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP")
                if hasattr(signal, name))
TIDYING_S = 5.0     # removing what is unfinished takes far less
IMPORTING = "<frozen importlib._bootstrap>"     # where Python takes and gives back its locks
SENT_AGAIN_S = 0.01


def put_off(number: int, frame: FrameType | None) -> bool:
    """Whether a signal came amid Python's own steps of an import; it is sent again soon then.

    An exception raised there can be swallowed with a lock left taken, for which another thread that
    imports waits for ever, and then this one for that.
    """
    if frame is None or frame.f_code.co_filename != IMPORTING:
        return False

    def send_again() -> None:
        main = threading.main_thread().ident
        if hasattr(signal, "pthread_kill") and main is not None:
            signal.pthread_kill(main, number)
        else:                                       # Windows
            signal.raise_signal(number)

    again = threading.Timer(SENT_AGAIN_S, send_again)
    again.daemon = True
    again.start()
    return True


class Interruptions:
    """Lets the first of ``SIGNALS`` interrupt, at once or at the end of a hold.

    It raises what it raised before, a KeyboardInterrupt or a kind of it, also where it would have
    killed the process. Those that follow raise nothing for ``again_after_s``: they would break off
    the work of putting things right. Signals that were ignored stay so. Only the main thread
    receives signals; in others nothing is held and nothing is raised.

    Parameters
    ----------
    held : bool
        Begin with a hold, which lasts to the end but for what is ``released``.
    again_after_s : float
        Where a library may swallow an interrupt and go on for minutes, another must be heard.
    """

    def __init__(self, *, held: bool = False, again_after_s: float = math.inf) -> None:
        self._once_entered = (int(held), again_after_s)
        self._holds, self._again_after_s = 0, 0.0
        self._came: int | None = None
        self._deaf_until = -math.inf
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Interruptions:
        if threading.current_thread() is threading.main_thread():
            for number in SIGNALS:
                before = signal.getsignal(number)
                if before not in (signal.SIG_IGN, None):    # None: set by a library, not by Python
                    self._before[number] = before
                    signal.signal(number, self._heard)
        # Not earlier: where an interrupt keeps it from being entered, it passes on all it hears.
        self._holds, self._again_after_s = self._once_entered
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        # Nor later: the same where one keeps it from being left.
        self._holds, self._deaf_until, self._again_after_s = 0, -math.inf, 0.0
        for number, handler in self._before.items():
            signal.signal(number, handler)
        if kind is None or not issubclass(kind, KeyboardInterrupt):
            self._raise_once()

    @contextlib.contextmanager
    def held(self) -> Iterator[None]:
        """Nothing interrupts this block; what came meanwhile is raised after it."""
        self._holds += 1
        try:
            yield
        finally:
            self._holds -= 1
        self._raise_once()

    @contextlib.contextmanager
    def released(self) -> Iterator[None]:
        """This block can be interrupted amid a hold, also by what came before it."""
        self._holds -= 1
        try:
            self._raise_once()
            yield
        finally:
            self._holds += 1

    def hold(self) -> None:
        """Nothing interrupts from here to the end."""
        self._holds += 1

    def _heard(self, number: int, frame: FrameType | None) -> None:
        if put_off(number, frame):
            return
        self._came = number if self._came is None else self._came
        self._raise_once()

    def _raise_once(self) -> None:
        number = self._came
        if number is None or self._holds or time.monotonic() < self._deaf_until:
            return
        self._came = None
        self._deaf_until = time.monotonic() + self._again_after_s
        if not callable(before := self._before[number]):
            raise KeyboardInterrupt
        before(number, None)
