"""A run of the session as a child process: what it says, stopping it, and that it ends with the
page.

A command that ends with its standard input, a pipe whose other end the page holds.

A page that is killed closes it too. A process of its own watches the pipe: a thread of the command
would wait for a library that holds the interpreter.
"""


from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

from spectrabox.radiometry.errors import CheckError, EnvironmentProblem

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


# ---- a run of the session as a child process: what it says, and stopping it ----------------------

MAX_LINES = 200
PATIENCE_S = GRACE_S + 0.5      # after which a run that was asked to stop is ended


class RunControl:
    """At most one run at a time of one session.

    Parameters
    ----------
    folder : Path
    options : tuple of str
        Further words of the command line.
    """

    def __init__(self, folder: Path, options: tuple[str, ...] = ()) -> None:
        self.folder = folder
        # -P: no module comes from the working folder, which may be a stranger's session
        self._command = [sys.executable, "-P", "-m", "spectrabox", "run", str(folder), "--json",
                         *options]
        self._holder = [sys.executable, "-P", "-m", "spectrabox.session.page.run_control"]
        self.when_ended: Callable[[], None] = lambda: None
        self._process: subprocess.Popen[str] | None = None
        self._lines: deque[str] = deque(maxlen=MAX_LINES)
        self._answer: dict[str, Any] | None = None
        self._code: int | None = None
        self._started = self._ended = 0.0
        self._stopped = False           # asked to end
        self._until: str | None = None  # the stage after which this run ends; None for all
        self._all_wanted = False        # once this run has ended
        self._lock = threading.Lock()

    @property
    def running(self) -> bool:
        """Whether a run is going on."""
        return self._process is not None and self._code is None

    @property
    def until(self) -> str | None:
        """The stage after which the latest run ends; None for all."""
        return self._until

    def start(self, until: str | None = None) -> None:
        """Begin a run; one of all stages begins as soon as a shorter one has ended.

        Parameters
        ----------
        until : str, optional
            The stage after which it ends.

        Raises
        ------
        CheckError
            If one is going on.
        EnvironmentProblem
            If the system starts no further process.
        """
        with self._lock:
            if self.running and until is None and self._until is not None:
                self._all_wanted = True
                return
            if self.running:
                raise CheckError("a run is going on; stop it first, or wait for its end")
            self._lines.clear()
            self._answer, self._code, self._started = None, None, time.monotonic()
            self._stopped, self._until, self._all_wanted = False, until, False
            options = [] if until is None else ["--until", until]
            # A group of its own: Ctrl-C at the page's terminal stops it through ``stop``.
            try:
                self._process = subprocess.Popen(
                    [*self._holder, *self._command, *options], stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                    errors="backslashreplace", start_new_session=True)
            except OSError as error:
                raise EnvironmentProblem(f"no run can be started ({error.strerror}): close other "
                                         "programs, and try again") from None
            for follow in (self._follow, self._wait):
                threading.Thread(target=follow, args=(self._process,), daemon=True).start()

    def stop(self) -> None:
        """Ask the run to end as Ctrl-C does; stages that are finished are kept."""
        process = self._process
        if process is None or not self.running:
            return
        self._stopped, self._all_wanted = True, False
        assert process.stdin is not None
        process.stdin.close()

    def end(self) -> None:
        """Stop the run and wait for its end, for when the page closes."""
        self.stop()
        if self._process is None:
            return
        try:
            self._process.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            kill_group(self._process.pid)

    def state(self) -> dict[str, Any]:
        """What the page shows: ``running``, ``until``, ``waiting``, ``seconds``, ``lines``,
        ``exit_code``, ``stopped``, ``verdict``, ``says``, ``error``.
        """
        answer = self._answer or {}
        until = time.monotonic() if self.running else self._ended
        return {"running": self.running, "until": self._until, "waiting": self._all_wanted,
                "seconds": max(until - self._started, 0.0) if self._process else 0.0,
                "lines": list(self._lines), "exit_code": self._code,
                "stopped": self._stopped and self._code != 0,
                **{name: answer.get(name) for name in ("verdict", "says", "error")}}

    def _follow(self, process: subprocess.Popen[str]) -> None:
        assert process.stderr is not None
        with process.stderr:
            for line in process.stderr:
                self._lines.append(line.rstrip())

    def _wait(self, process: subprocess.Popen[str]) -> None:
        assert process.stdout is not None
        with process.stdout:
            output = process.stdout.read()
        code = process.wait()
        assert process.stdin is not None
        process.stdin.close()
        try:
            self._answer = json.loads(output)
        except ValueError:          # a run that was killed says nothing
            self._answer = None
        self._ended = time.monotonic()
        self._code = code
        self.when_ended()
        if self._all_wanted and code == 0:
            self.start()
