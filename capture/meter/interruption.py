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

SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP")
                if hasattr(signal, name))


class Interruptions:
    """Turns the first of ``SIGNALS`` into one KeyboardInterrupt, at once or at the end of a hold.

    Those that follow are not raised: they would break off the work of putting things right. Only
    the main thread receives signals; in others nothing is held and nothing is raised.
    """

    def __init__(self) -> None:
        self._holds = 0
        self._came = False
        self._raised = False
        self._before: list[object] = []

    def __enter__(self) -> Interruptions:
        if threading.current_thread() is threading.main_thread():
            self._before = [signal.signal(number, self._heard) for number in SIGNALS]
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        for number, handler in zip(SIGNALS, self._before, strict=False):
            signal.signal(number, handler)  # type: ignore[arg-type]
        if kind is None and self._came and not self._raised:
            raise KeyboardInterrupt

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
        self._came = True
        self._raise_once()

    def _raise_once(self) -> None:
        if self._came and not self._holds and not self._raised:
            self._raised = True
            raise KeyboardInterrupt
