"""A command that ends with its standard input, a pipe whose other end the page holds.

A page that is killed closes it too. A process of its own watches the pipe: a thread of the command
would wait for a library that holds the interpreter.
"""
from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading

GRACE_S = 1.0       # for a command that was asked to end


def main() -> None:
    """Run the command of the arguments, to its end or to that of standard input."""
    command = subprocess.Popen(sys.argv[1:], stdin=subprocess.DEVNULL)
    threading.Thread(target=_end_with_input, args=(command,), daemon=True).start()
    code = command.wait()
    sys.exit(code if code >= 0 else 128 - code)


def _end_with_input(command: subprocess.Popen[bytes]) -> None:
    while os.read(0, 1):
        pass
    # not SIGINT, on which an interpreter that has just begun prints a traceback
    command.terminate()
    try:
        command.wait(GRACE_S)
    except subprocess.TimeoutExpired:
        command.kill()
        kill_group(0)


def kill_group(leader: int) -> None:
    """End a process and what it has started, where the system has groups of processes.

    Parameters
    ----------
    leader : int
        0 for the group of this process.
    """
    if hasattr(os, "killpg"):
        with contextlib.suppress(ProcessLookupError):
            os.killpg(leader, signal.SIGKILL)


if __name__ == "__main__":
    main()
