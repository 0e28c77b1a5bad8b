"""Ctrl-C, a closed terminal and a request to end: one handler.

A command ends by KeyboardInterrupt, so that what it holds open is put right on the way out. An
interrupt between the characters of a command to an instrument would leave half of it there, which
then takes the next command for the rest of it: such work holds interrupts back.
"""
from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator
from types import FrameType

SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP")
                if hasattr(signal, name))           # Windows has no SIGHUP


class _Waiting:
    """How many holds there are, and whether a signal waits for their end."""

    holds = 0
    interrupt = False


def stop_on_signals() -> None:
    """Let SIGTERM and SIGHUP end a command as Ctrl-C does, unless the caller has them ignored."""
    for number in SIGNALS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _interrupt)


def _interrupt(number: int, frame: FrameType | None) -> None:
    if not _Waiting.holds:
        raise KeyboardInterrupt
    _Waiting.interrupt = True


@contextlib.contextmanager
def held() -> Iterator[None]:
    """Nothing that ``stop_on_signals`` hears interrupts this block; what came is raised after it.

    Only the main thread receives signals: in others nothing is held.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    _Waiting.holds += 1
    try:
        yield
    finally:
        _Waiting.holds -= 1
        if _Waiting.interrupt and not _Waiting.holds:
            _Waiting.interrupt = False
            raise KeyboardInterrupt
