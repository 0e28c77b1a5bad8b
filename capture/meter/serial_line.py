"""An open serial line with deadlines of its own (pyserial).

pyserial's time-out starts again with every byte, so that a line that dribbles never ends; here
every read has one wall-clock limit. After a disconnect pyserial raises OSError or its own subclass
of it: both become one sentence.
"""
from __future__ import annotations

import errno
import os
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import serial
from serial.tools.list_ports_common import ListPortInfo

from spectrabox.capture.meter.instruments import instrument_errors
from spectrabox.radiometry.errors import SpectraboxError

INNER_TIMEOUT_S = 0.02      # one pyserial read; short, so that a deadline is kept to within this
DRAINING_S = 5.0            # a line that is never quiet is drained for so long
WRITE_TIMEOUT_S = 5.0       # a port whose driver hangs on the first write must not hang us
SHOWN_BYTES = 60            # of a bad reply in an error sentence
Log = Callable[[str, bytes], None]
Hold = Callable[[], AbstractContextManager[None]]


@dataclass(frozen=True)
class Pace:
    """How fast time runs for limits and pauses: 1 with instruments, less for played transcripts."""

    scale: float = 1.0
    shortest_limit_s: float = 0.0

    def limit_s(self, seconds: float) -> float:
        """A deadline, never shorter than what the computer itself may need.

        Parameters
        ----------
        seconds : float
            Of the instrument.
        """
        return max(seconds * self.scale, self.shortest_limit_s)

    def sleep(self, seconds: float) -> None:
        """Pause for an instrument that needs time."""
        time.sleep(seconds * self.scale)


class SerialLine:
    """Bytes to and from an instrument; all that pass go to ``log`` as (">" or "<", bytes).

    ``held`` opens a block that no signal interrupts: a command is sent whole or not at all.
    ``character_pause_s`` is the pause after each character sent.
    """

    def __init__(self, port: Any, name: str, log: Log, pace: Pace, held: Hold = nullcontext,
                 character_pause_s: float = 0.0) -> None:
        self.name = name
        self.character_pause_s = character_pause_s
        self.pace = pace
        self.held = held
        self.unanswered = False         # a command was written whose reply was not waited for yet
        self._port = port
        self._log = log
        self._buffer = bytearray()

    def write(self, command: bytes) -> None:
        """Send a command, character by character where the instrument needs that.

        Parameters
        ----------
        command : bytes

        Raises
        ------
        LineFaultError
            If bytes lie waiting that no command asked for: the next reply would be taken for this
            one's.
        """
        self._take()
        if stray := bytes(self._buffer).strip(b"\r\n \x05"):
            self._buffer.clear()
            raise instrument_errors.LineFaultError(
                f"{self.name}: the instrument sent {shown(stray)} unasked; check "
                "the cable and that no other program uses this port, then measure "
                "again")
        self._buffer.clear()
        with self.held():
            self.send(command)
            self.unanswered = True

    def send(self, command: bytes) -> None:
        """Send without looking at what waits; for leaving and for flushing.

        Parameters
        ----------
        command : bytes
        """
        self._log(">", command)
        with self.held(), self._lost():
            if not self.character_pause_s:
                self._port.write(command)
                return
            for byte in command:
                self._port.write(bytes([byte]))
                self.pace.sleep(self.character_pause_s)

    def read_until(self, ends: tuple[bytes, ...], limit_s: float) -> bytes:
        """Bytes up to and including the first of ``ends``.

        Parameters
        ----------
        ends : tuple of bytes
        limit_s : float
            Wall clock.

        Raises
        ------
        NoReplyError
            If none of ``ends`` came within ``limit_s`` seconds of the wall clock.
        """
        deadline = time.monotonic() + self.pace.limit_s(limit_s)
        late = False
        while True:
            after = [at + len(end) for end in ends if (at := self._buffer.find(end)) >= 0]
            if after:
                taken = bytes(self._buffer[:min(after)])
                del self._buffer[:min(after)]
                self.unanswered = False
                return taken
            if late:
                raise self._no_reply(limit_s)
            # Once more when it is late: a busy computer may have had no look at what came in time.
            late = time.monotonic() > deadline
            self._take(wait=True)

    def read_line(self, limit_s: float, ends: tuple[bytes, ...] = (b"\n",)) -> str:
        """One line of ASCII without its end.

        Parameters
        ----------
        limit_s : float
            Wall clock.
        ends : tuple of bytes

        Raises
        ------
        NoReplyError, LineFaultError
        """
        return ascii_text(self.read_until(ends, limit_s), self.name).strip("\r\n")

    def read_byte(self, wanted: bytes, limit_s: float, skip: bytes = b"") -> bytes:
        """The next byte that is one of ``wanted``; bytes of ``skip`` are passed over.

        Parameters
        ----------
        wanted, skip : bytes
            Any of each.
        limit_s : float
            Wall clock.

        Raises
        ------
        NoReplyError, LineFaultError
        """
        deadline = time.monotonic() + self.pace.limit_s(limit_s)
        late = False
        while True:
            while self._buffer:
                byte = bytes([self._buffer.pop(0)])
                if byte in wanted:
                    self.unanswered = False
                    return byte
                if byte not in skip:
                    raise instrument_errors.LineFaultError(
                        f"{self.name}: {shown(byte + bytes(self._buffer))} arrived where one of "
                        f"{shown(wanted)} is needed; check speed and cable")
            if late:
                raise self._no_reply(limit_s)
            late = time.monotonic() > deadline
            self._take(wait=True)

    def read_count(self, count: int, limit_s: float) -> bytes:
        """The next ``count`` bytes, of a reply whose length is known.

        Parameters
        ----------
        count : int
        limit_s : float
            Wall clock.

        Raises
        ------
        NoReplyError
            If fewer came within ``limit_s`` seconds of the wall clock.
        """
        deadline = time.monotonic() + self.pace.limit_s(limit_s)
        late = False
        while len(self._buffer) < count:
            if late:
                raise self._no_reply(limit_s)
            late = time.monotonic() > deadline
            self._take(wait=True)
        taken = bytes(self._buffer[:count])
        del self._buffer[:count]
        self.unanswered = False
        return taken

    @property
    def waiting(self) -> bytes:
        """What arrived and was not taken yet."""
        return bytes(self._buffer)

    def await_bytes(self, limit_s: float) -> bool:
        """Whether something arrives within ``limit_s``; returns as soon as it does, nothing is
        taken.

        Parameters
        ----------
        limit_s : float
            Wall clock.
        """
        deadline = time.monotonic() + self.pace.limit_s(limit_s)
        while not self._buffer and time.monotonic() < deadline:
            self._take(wait=True)
        self.unanswered = False
        return bool(self._buffer)

    def drain(self, quiet_s: float) -> bytes:
        """Drop what arrives until the line is quiet; gives the bytes dropped.

        Parameters
        ----------
        quiet_s : float
            For which nothing may arrive; after ``DRAINING_S`` it ends all the same.
        """
        dropped = bytearray()
        deadline = time.monotonic() + self.pace.limit_s(DRAINING_S)
        quiet = time.monotonic() + self.pace.scale * quiet_s + INNER_TIMEOUT_S
        while time.monotonic() < min(quiet, deadline):
            self._take(wait=True)
            if self._buffer:
                dropped += self._buffer
                self._buffer.clear()
                quiet = time.monotonic() + self.pace.scale * quiet_s + INNER_TIMEOUT_S
        return bytes(dropped)

    def set_baud(self, baud: int) -> None:
        """Change the speed of an open line."""
        with self._lost():
            self._port.baudrate = baud
        self._buffer.clear()

    def pulse_rts(self, low_s: float) -> None:
        """Lower and raise RTS, where the line has it: resets a PR-650.

        Parameters
        ----------
        low_s : float
            For which it stays low.
        """
        with suppress(OSError):  # a pseudo-terminal has no RTS
            self._port.rts = False
            self.pace.sleep(low_s)
            self._port.rts = True

    def outlive_log(self) -> None:
        """From here on a log that fails, as on a full disk, stops no command."""
        log = self._log

        def log_where_possible(direction: str, passed: bytes) -> None:
            with suppress(SpectraboxError):
                log(direction, passed)
        self._log = log_where_possible

    def close(self) -> None:
        """Close the port; a line already lost is closed too."""
        with suppress(OSError):
            self._port.close()

    def _take(self, wait: bool = False) -> None:
        with self._lost():
            waiting = self._port.in_waiting
            arrived = self._port.read(waiting or 1) if wait or waiting else b""
        if arrived:
            self._log("<", arrived)
            self._buffer += arrived

    def _no_reply(self, limit_s: float) -> instrument_errors.NoReplyError:
        partial = bytes(self._buffer)
        self._buffer.clear()
        self.unanswered = False
        what = (f"only {len(partial)} bytes came, ending {shown(partial[-SHOWN_BYTES:])}" if partial
                else "nothing came")
        return instrument_errors.NoReplyError(
            f"{self.name}: no complete reply within {limit_s:g} s ({what}); check "
            "that the instrument is on, is the one named and is set to this speed, "
            "then try again")

    @contextmanager
    def _lost(self) -> Iterator[None]:
        try:
            yield
        except serial.SerialTimeoutException:
            raise instrument_errors.NoReplyError(
                f"{self.name} takes no bytes; unplug the instrument, plug it in and "
                "retry") from None
        except OSError as error:
            raise instrument_errors.LineLostError(
                f"{self.name}: the line broke ({error}); check the cable and that "
                "the instrument is on, then run the same command again: readings "
                "already taken are kept") from None


def open_line(port: str, baud: int, log: Log, pace: Pace | None = None, held: Hold = nullcontext, *,
              rtscts: bool = False, character_pause_s: float = 0.0) -> SerialLine:
    """Open a port for one program alone.

    Parameters
    ----------
    port : str
        A device such as ``/dev/ttyACM0`` or ``COM3``, or a pyserial address such as
        ``socket://127.0.0.1:2101``.
    baud : int
    log : function of (direction, bytes)
        Called with everything that passes.
    pace : Pace, optional
    held : function that gives a context, optional
    character_pause_s : float
        As ``SerialLine`` takes them.
    rtscts : bool
        Hardware flow control.

    Raises
    ------
    PortError
        If there is no such port, it is in use, or this user may not open it.
    """
    options: dict[str, Any] = {"timeout": INNER_TIMEOUT_S, "write_timeout": WRITE_TIMEOUT_S}
    if "://" not in port:
        options.update(baudrate=baud, rtscts=rtscts, exclusive=True)
    try:
        opened = serial.serial_for_url(port, **options)
    except (OSError, ValueError) as error:
        raise _port_error(port, error) from None
    return SerialLine(opened, port, log, pace or Pace(), held, character_pause_s)


def list_ports() -> list[ListPortInfo]:
    """The ports of this computer with what USB says of them; opens none, so that no instrument
    notices.
    """
    from serial.tools import list_ports as ports
    return sorted(ports.comports())


def shown(data: bytes) -> str:
    """Bytes as a person can read them, cut to a sensible length."""
    return repr(data[:SHOWN_BYTES])[1:] + ("..." if len(data) > SHOWN_BYTES else "")


def ascii_text(data: bytes, name: str) -> str:
    """Printable ASCII as text.

    Parameters
    ----------
    data : bytes
    name : str
        Of the line, for errors.

    Raises
    ------
    LineFaultError
        At any other byte: noise or a wrong speed is a fault of the line, never text to be skipped.
    """
    if any(byte > 0x7E or (byte < 0x20 and byte not in b"\t\r\n") for byte in data):
        raise instrument_errors.LineFaultError(
            f"{name}: {shown(data)} is not text; the speed is wrong or the line "
            "is noisy: check the instrument's speed setting and the cable")
    return data.decode("ascii")


def _port_error(port: str, error: Exception) -> instrument_errors.PortError:
    number = getattr(error, "errno", None)
    if number in (errno.EACCES, errno.EPERM):
        return instrument_errors.PortError(
            f"{port} may not be opened by this user: {_group_advice(port)}")
    if number in (errno.EBUSY, errno.EAGAIN):
        return instrument_errors.PortError(
            f"{port} is in use by another program; close that program, then try again")
    present = [each.device for each in list_ports()]
    # pyserial gives no number on Windows
    if number in (errno.ENOENT, errno.ENODEV, errno.ENXIO) or (
            number is None and os.name == "nt" and port not in present):
        return instrument_errors.PortError(f"there is no port {port}; ports of this computer: "
                         f"{', '.join(present) or 'none'}. Plug the instrument in, switch it on "
                         "and see 'spectrabox meter list'")
    return instrument_errors.PortError(
        f"{port} cannot be opened ({error}); see 'spectrabox meter list' for the "
        "ports of this computer")


def _group_advice(port: str) -> str:
    if os.name != "posix":
        return "ask the administrator of this computer"
    import grp
    try:
        group = grp.getgrgid(Path(port).stat().st_gid).gr_name
    except (KeyError, OSError):
        group = "dialout"
    return (f"it belongs to the group {group}; run 'sudo usermod -aG {group} $USER', then log in "
            "again")
