"""Progress on standard error: a live bar on a terminal, one line a stage elsewhere."""
from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable, Iterator

from spectrabox.radiometry.system.words import plain

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
