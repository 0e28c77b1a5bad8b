"""Progress on standard error, and how a command hears Ctrl-C, a closed terminal and a request to
end.

Ctrl-C, a closed terminal and a request to end: one handler.

A command ends by KeyboardInterrupt, so that what it holds open is put right on the way out. An
interrupt between the characters of a command to an instrument would leave half of it there, which
then takes the next command for the rest of it: such work holds interrupts back.
"""


from __future__ import annotations

import contextlib
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from types import FrameType

from spectrabox.radiometry.system.words import plain

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


# ---- progress on standard error: a live bar on a terminal, one line a stage elsewhere ------------

StageProgress = Callable[[str, float, str], None]  # stage, share of it that is done, message


@contextlib.contextmanager
def progress_display(quiet: bool = False) -> Iterator[StageProgress]:
    """A function of (stage, fraction, message) that shows how far the work has come."""
    if quiet:
        yield lambda stage, fraction, message: None
    elif sys.stderr.isatty():
        with _live_bars() as show:
            yield show
    else:
        yield _print_line


def with_time_left(show: StageProgress) -> StageProgress:
    """The same display, its messages saying how many seconds a stage will still take.

    Parameters
    ----------
    show : function of (stage, share of it that is done, message)
    """
    started: dict[str, float] = {}

    def say(stage: str, fraction: float, message: str) -> None:
        if stage not in started:
            started[stage] = time.monotonic()
            if fraction > 0:
                show(stage, 0.0, "")
        taken = time.monotonic() - started[stage]
        left = f"{taken * (1 - fraction) / fraction:.0f} s left" if 0 < fraction < 1 else ""
        show(stage, fraction, message or left)

    return say


def _print_line(stage: str, fraction: float, message: str) -> None:
    if fraction in (0.0, 1.0):
        said = message or ("started" if fraction == 0.0 else "done")
        print(plain(f"{stage:<12} {said}"), file=sys.stderr, flush=True)


@contextlib.contextmanager
def _live_bars() -> Iterator[StageProgress]:
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bars

    with Bars(TextColumn("{task.fields[stage]:<12}"), BarColumn(),
              TextColumn("{task.percentage:>3.0f}%"), TimeElapsedColumn(),
              TextColumn("{task.fields[message]}", markup=False),
              console=Console(stderr=True)) as bars:
        tasks: dict[str, object] = {}

        def show(stage: str, fraction: float, message: str) -> None:
            if stage not in tasks:
                tasks[stage] = bars.add_task("", total=1.0, stage=stage, message="")
            bars.update(tasks[stage], completed=fraction, message=plain(message))  # type: ignore[arg-type]

        yield show
