"""Ctrl-C, a closed terminal and a request to end, held back where a line must not be left.

An interrupt between the characters of a command would leave half of it in the instrument, which
then takes the next command, the one that puts a setting back, for the rest of it.
"""
from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator
from types import TracebackType
from typing import Any

SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP")
                if hasattr(signal, name))


class Interruptions:
    """Lets the first of ``SIGNALS`` interrupt, at once or at the end of a hold.

    It raises what it raised before, a KeyboardInterrupt or a kind of it, also where it would have
    killed the process. Those that follow raise nothing: they would break off the work of putting
    things right. Signals that were ignored stay so. Only the main thread receives signals; in
    others nothing is held and nothing is raised.
    """

    def __init__(self) -> None:
        self._holds = 0
        self._came: int | None = None
        self._raised = False
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Interruptions:
        if threading.current_thread() is threading.main_thread():
            self._before = {number: signal.signal(number, self._heard) for number in SIGNALS
                            if signal.getsignal(number) is not signal.SIG_IGN}
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
        if kind is None:
            self._holds = 0
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

    def hold(self) -> None:
        """Nothing interrupts from here to the end."""
        self._holds += 1

    def _heard(self, number: int, frame: object) -> None:
        self._came = number if self._came is None else self._came
        self._raise_once()

    def _raise_once(self) -> None:
        if self._came is not None and not self._holds and not self._raised:
            self._raised = True
            if callable(before := self._before[self._came]):
                before(self._came, None)
            raise KeyboardInterrupt
