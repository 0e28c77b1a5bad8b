"""Ctrl-C, a closed terminal and a request to end: how a command hears them.

A command ends by an exception, so that what it holds open is put right on the way out. A closed
terminal sends two signals, the second of which would break that off: it is ignored for a while. An
interrupt between the characters of a command to an instrument would leave half of it there, which
then takes the next command, the one that puts a setting back, for the rest of it: such work holds
interrupts back.
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
                if hasattr(signal, name))           # Windows has no SIGHUP
TIDYING_S = 5.0     # removing what is unfinished takes far less


class Stopped(KeyboardInterrupt):
    """Asked to end by the system: SIGTERM or SIGHUP, which end a command as Ctrl-C does."""

    def __init__(self, number: int) -> None:
        super().__init__(f"signal {number}")
        self.exit_code = 128 + number


def stop_on_signals() -> None:
    """Let SIGTERM and SIGHUP end a command as Ctrl-C does, unless the caller has them ignored.

    Those that follow within ``TIDYING_S`` raise nothing; a later one does, since a library may
    have swallowed the first.
    """
    ignored_until = -math.inf

    def stop(number: int, frame: FrameType | None) -> None:
        nonlocal ignored_until
        if time.monotonic() < ignored_until:
            return
        ignored_until = time.monotonic() + TIDYING_S
        if number == signal.SIGINT:
            raise KeyboardInterrupt
        raise Stopped(number)

    for number in SIGNALS:
        if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
            signal.signal(number, stop)


class Interruptions:
    """Lets the first of ``SIGNALS`` interrupt, at once or at the end of a hold.

    It raises what it raised before, a KeyboardInterrupt or a kind of it, also where it would have
    killed the process. Those that follow raise nothing: they would break off the work of putting
    things right. Signals that were ignored stay so. Only the main thread receives signals; in
    others nothing is held and nothing is raised.
    """

    def __init__(self) -> None:
        self._holds = 0
        self._received: int | None = None
        self._raised = False
        self._handlers: dict[int, Any] = {}         # those of before

    def __enter__(self) -> Interruptions:
        if threading.current_thread() is threading.main_thread():
            for number in SIGNALS:
                before = signal.getsignal(number)
                if before not in (signal.SIG_IGN, None):    # None: set by a library, not by Python
                    self._handlers[number] = before
                    signal.signal(number, self._receive)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        for number, handler in self._handlers.items():
            signal.signal(number, handler)
        self._holds = 0
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

    def _receive(self, number: int, frame: FrameType | None) -> None:
        self._received = number if self._received is None else self._received
        self._raise_once()

    def _raise_once(self) -> None:
        if self._received is None or self._holds or self._raised:
            return
        self._raised = True
        handler = self._handlers[self._received]
        if not callable(handler):
            raise KeyboardInterrupt
        handler(self._received, None)
