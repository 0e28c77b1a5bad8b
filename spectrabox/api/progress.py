"""A progress bar for calls that last: in notebooks and on terminals, elsewhere where it is asked
for.
"""
from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable, Iterator

from rich.console import Console
from rich.progress import Progress as Bars

Step = Callable[[float, str], None]
ProgressLike = bool | Step | None

SHOWN_AFTER_S = 1.0


@contextlib.contextmanager
def progress_steps(progress: ProgressLike, title: str) -> Iterator[Step]:
    """A function to call with the share that is done, and what is being done.

    Parameters
    ----------
    progress : bool, function or None
        The function itself; True for a bar, False for none, None for a bar in a notebook or on
        a terminal.
    title : str
        Of the bar, which is shown once the call has lasted a second.
    """
    if callable(progress):
        yield progress
        return
    if progress is False or (progress is None and "ipykernel" not in sys.modules
                              and not sys.stderr.isatty()):
        yield lambda share, message: None
        return
    with contextlib.ExitStack() as shown:
        started = time.monotonic()
        bars: list[tuple[Bars, int]] = []

        def step(share: float, message: str) -> None:
            if not bars and time.monotonic() - started > SHOWN_AFTER_S:
                display = shown.enter_context(Bars(transient=True, console=Console(stderr=True)))
                bars.append((display, int(display.add_task(title, total=1.0))))
            for display, task in bars:
                display.update(task, completed=share, description=f"{title}: {message}")  # type: ignore[arg-type]
        yield step
