"""A command that ends with its standard input, a pipe whose other end the page holds.

A page that is killed closes it too. A process of its own watches the pipe: a thread of the command
would wait for a library that holds the interpreter. It loads what a run needs before it is told
which run, so that this goes on while the page is still being prepared.
"""
from __future__ import annotations

import contextlib
import importlib
import json
import os
import signal
import subprocess
import sys
import threading
import time
from queue import SimpleQueue

from spectrabox.session.cli import main as run_command
from spectrabox.session.cli import prepare_libraries
from spectrabox.session.page.process_groups import GRACE_S, SPECTRABOX, kill_group

NEEDED = ("session.stages.chart_stage", "session.stages.photo_stage",
          "session.stages.calibrate_stage", "session.pipeline")     # by a run up to the calibration


def main() -> None:
    """Run the command that the first line of standard input holds, a list of words as JSON, to its
    end or to that of standard input; one of this program in a copy of this process.
    """
    orders: SimpleQueue[list[str]] = SimpleQueue()
    command: list[int] = []         # the number of its process, once there is one
    threading.Thread(target=_follow_input, args=(orders, command), daemon=True).start()
    prepare_libraries()
    for module in NEEDED:
        importlib.import_module(f"spectrabox.{module}")
    words = orders.get()
    # elsewhere libraries do not work on in a copy of their process
    if words[:3] == SPECTRABOX and sys.platform == "linux":
        command.append(os.fork())
        if command[0] == 0:
            os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
            sys.argv = ["spectrabox", *words[3:]]
            run_command()
            return
    else:
        started = subprocess.Popen(words, stdin=subprocess.DEVNULL)
        command.append(started.pid)
    code = os.waitstatus_to_exitcode(os.waitpid(command[0], 0)[1])
    sys.exit(code if code >= 0 else 128 - code)


def _follow_input(orders: SimpleQueue[list[str]], command: list[int]) -> None:
    """Pass the order on, and end with the input."""
    with os.fdopen(0, "rb", closefd=False) as stream:
        if line := stream.readline():
            orders.put(json.loads(line))
        while stream.read(1):
            pass
    if not command:
        os._exit(128 + signal.SIGTERM)
    # not SIGINT, on which an interpreter that has just begun prints a traceback
    with contextlib.suppress(ProcessLookupError):
        os.kill(command[0], signal.SIGTERM)
    time.sleep(GRACE_S)     # this process is gone as soon as the command is
    with contextlib.suppress(ProcessLookupError):
        os.kill(command[0], getattr(signal, "SIGKILL", signal.SIGTERM))
    kill_group(0)


if __name__ == "__main__":
    main()
