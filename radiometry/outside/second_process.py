"""Work that a second process does beside this one, where there is a core for it."""
from __future__ import annotations

import contextlib
import gc
import os
import pickle
import select
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterable, Iterator
from typing import BinaryIO, NoReturn, TypeVar

from spectrabox.radiometry.outside.interruption import SIGNALS

T = TypeVar("T")
PATIENCE_S = 60.0   # with a process that gives no answer


@contextlib.contextmanager
def beside(work: Callable[[], T]) -> Iterator[Callable[[], T]]:
    """Begin ``work`` in a second process; the block is given a function that waits for its result.

    The second process is a copy of this one (fork), so that nothing is imported or handed over.
    Where there is none, with one core, another system than Linux or in another thread than the main
    one (a second process would be without those that may hold what it waits for), or where it fails
    in any way, the function does the work here, and raises what it raises.

    Parameters
    ----------
    work : function
        Changes nothing, and gives what pickle takes. It may not use threads that others began:
        the copy has none of them.
    """
    if (sys.platform != "linux" or len(os.sched_getaffinity(0)) < 2
            or threading.current_thread() is not threading.main_thread()):
        yield work
        return
    reading, writing = os.pipe()
    # Python swallows what is raised amid a fork, by the hooks of libraries
    before = signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)     # that threads are not copied
            process = os.fork()
    except BaseException:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        raise
    if process == 0:
        _answer(work, writing, before)
    os.close(writing)
    try:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)      # what came meanwhile is heard here
        with os.fdopen(reading, "rb") as answer:
            yield lambda: _result(answer, work)
    finally:
        with contextlib.suppress(ChildProcessError):    # the system may take it away itself
            if os.waitpid(process, os.WNOHANG) == (0, 0):
                os.kill(process, signal.SIGKILL)
                os.waitpid(process, 0)


def _answer(work: Callable[[], T], writing: int, heard: Iterable[int]) -> NoReturn:
    """Write the result, or nothing where there is none, and leave without any tidying up: what is
    to be tidied up belongs to the other process.
    """
    try:
        for number in SIGNALS:
            signal.signal(number, signal.SIG_DFL)
        signal.pthread_sigmask(signal.SIG_SETMASK, heard)
        gc.disable()        # what it would take apart may belong to threads that are not there
        with os.fdopen(writing, "wb") as answer:
            pickle.dump(work(), answer)
    finally:
        os._exit(0)


def _result(answer: BinaryIO, work: Callable[[], T]) -> T:
    if not select.select([answer], [], [], PATIENCE_S)[0]:
        return work()
    try:
        result: T = pickle.load(answer)    # noqa: S301 - written by a copy of this process
    except (EOFError, pickle.UnpicklingError):
        return work()
    return result
