"""Leaving the program without taking its modules apart, which takes a tenth of a second or more."""
from __future__ import annotations

import atexit
import os
import sys
import threading
from collections.abc import Callable
from typing import NoReturn

NOT_WRITTEN = 120       # Python's own exit code where what was printed cannot be written out


def run_and_leave(main: Callable[[], object]) -> NoReturn:
    """Call a program's ``main`` and end the process with the exit code that it leaves by.

    Done as Python does it: threads are waited for, whoever asked to be called at exit is called,
    and what was printed is written out. Left out is what comes then, where every module and object
    is taken apart: none of ours has anything left to do there. Of an error other than
    ``SystemExit``, Python ends the program.
    """
    try:
        main()
        code = 0
    except SystemExit as left:
        if not isinstance(left.code, int | None):
            raise               # a sentence, which Python prints
        code = left.code or 0
    # As multiprocessing ends its processes: pools of threads are told to end before they are
    # waited for, which no public function does.
    threading._shutdown()       # type: ignore[attr-defined]
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        try:
            if stream is not None and not stream.closed:
                stream.flush()
        except OSError:
            code = NOT_WRITTEN
    os._exit(code)
