"""Modules and tables loaded in a thread, while libraries at work leave Python free."""
from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator

from spectrabox.radiometry.errors import SpectraboxError

PATIENCE_S = 5.0        # with a thread, where the block has failed; it takes a tenth of that


@contextlib.contextmanager
def loaded_beside(load: Callable[[], None]) -> Iterator[Callable[[], None]]:
    """Begin ``load`` in a thread; the block is given a function that waits for its end.

    What cannot be loaded is left to whoever needs it. A block that fails, or is interrupted, waits
    for the thread too, since a program that ends amid the start of a library can crash; but not for
    ever. Hence no pool, which does.

    Parameters
    ----------
    load : function
        Imports, and reads what is then kept.
    """
    def run() -> None:
        with contextlib.suppress(ImportError, OSError, SpectraboxError):
            load()

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        yield thread.join
    except BaseException:
        thread.join(PATIENCE_S)
        raise
    thread.join()
