"""Plays a transcript to a driver's own serial code, through a pseudo-terminal or a loopback socket.

The line's settings are read from the pseudo-terminal itself, so that a driver at the wrong speed
gets garbage. A clean recording may be distorted, as by a faulty line.
"""


from __future__ import annotations

import contextlib
import os
import random
import select
import socket
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from spectrabox.capture.meter import measurement, serial_line
from spectrabox.capture.meter.instruments import cr30, drivers, instrument_errors
from spectrabox.capture.meter.instruments.interface import Identity, MeterSettings
from spectrabox.capture.transcripts.cr30_traffic import as_our_driver_has_it, cr30_traffic
from spectrabox.capture.transcripts.transcript import Transcript, TranscriptWriter
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.spectra.readings import SpectralReading
from spectrabox.radiometry.system.words import is_whole_number

SETTLE_LOOKS = 3            # of 10 ms each without a byte: the computer has finished
# From a step of the recording, its reply and the command before it to the parts that are sent, each
# after a pause in seconds; None closes the line.
Distortion = Callable[[int, bytes, bytes], Sequence[tuple[float, bytes | None]]]


class TranscriptPlayer:
    """An instrument that says what it said when it was recorded.

    Parameters
    ----------
    transcript : Transcript
    time_scale : float
        Multiplies the recorded delays.
    strict : bool
        True: what the computer sends must follow the recording, else ``problems`` says where it
        left it and the line goes mute. False: a command out of turn is looked up in the recording,
        as a live instrument would answer it.
    distort : Distortion, optional
        Of the replies.
    character_gap_s : float
        Characters that follow each other faster are lost, as PR-655s lose them.
    over_socket : bool
        Serve a loopback socket in place of a pseudo-terminal.
    deaf_while_busy : bool
        What arrives before a reply has been given is lost, as most instruments lose it.
    """

    def __init__(self, transcript: Transcript, *, time_scale: float = 1.0, strict: bool = True,
                 distort: Distortion | None = None, character_gap_s: float = 0.0,
                 over_socket: bool = False, deaf_while_busy: bool = False,
                 seed: int = 0) -> None:
        self.transcript = transcript
        self._baud = transcript.baud    # here, where an error of the file reaches the caller
        self.problems: list[str] = []
        self.heard = bytearray()
        self.obeyed: list[bytes] = []   # commands as the instrument understood them
        self.mute = False               # it hears, and answers nothing
        self._scale = time_scale
        self._strict = strict
        self._distort = distort
        self._gap = character_gap_s
        self._deaf = deaf_while_busy
        self._random = random.Random(seed)
        self._step = 0
        self._pending = b""
        self._command = b""
        self._arrived_at = 0.0
        self._stop = threading.Event()
        over_socket = over_socket or not hasattr(os, "openpty")
        self._line: Any = _SocketEnd() if over_socket else _TerminalEnd()
        self.port: str = self._line.port
        self._thread = threading.Thread(target=self._serve, daemon=True)

    def __enter__(self) -> TranscriptPlayer:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._settle()
        self._stop.set()
        self._thread.join(5)
        self._line.close()

    @property
    def finished(self) -> bool:
        """Whether the whole recording was played."""
        return self._step >= len(self.transcript.events)

    def unplug(self) -> None:
        """Break the line."""
        self._stop.set()
        self._thread.join(5)
        self._line.close()

    def _settle(self) -> None:
        """Let the last bytes of the computer arrive."""
        quiet = 0
        while quiet < SETTLE_LOOKS and self._thread.is_alive():
            seen = len(self.heard)
            time.sleep(0.01)
            quiet = quiet + 1 if seen == len(self.heard) else 0

    def _serve(self) -> None:
        with contextlib.suppress(OSError):
            while not self._stop.is_set():
                if not self.finished and self.transcript.events[self._step].direction == "<":
                    self._speak(self._step)
                    self._step += 1
                else:
                    self._listen()

    def _speak(self, step: int) -> None:
        event = self.transcript.events[step]
        self._wait(event.delay_s * self._scale)
        if self.mute:
            return
        if self._wrong_speed():
            self._line.write(self._garbage(len(event.data)))
            return
        parts: Sequence[tuple[float, bytes | None]] = [(0.0, event.data)]
        if self._distort is not None:
            parts = self._distort(step, event.data, self._command)
        for pause, part in parts:
            self._wait(pause)
            if part is None:
                self._line.close()
                self._stop.set()
                return
            self._line.write(part)

    def _listen(self) -> None:
        arrived = self._line.read(0.01)
        if arrived:
            self._take_in(arrived)
            if self._wrong_speed():
                self._pending = b""
                self._line.write(self._garbage(len(arrived)))
        elif not self._pending:
            return
        while self._pending and self._matched():
            if not self.finished and self.transcript.events[self._step].direction == "<":
                return

    def _matched(self) -> bool:
        if not self.finished:
            wanted = self.transcript.events[self._step].data
            if self._pending.startswith(wanted):
                return self._advance(self._step)
            if wanted.startswith(self._pending):
                return False
        if self._strict:
            wanted = b"nothing more" if self.finished else self.transcript.events[self._step].data
            self.problems.append(f"step {self._step}: the recording has {wanted!r}, the computer "
                                 f"sent {self._pending!r}")
            self._pending = b""
            return False
        return self._looked_up()

    def _looked_up(self) -> bool:
        events = self.transcript.events
        order = [*range(self._step, len(events)), *range(self._step)]
        asked = [step for step in order if events[step].direction == ">"]
        for step in asked:
            if self._pending.startswith(events[step].data):
                return self._advance(step)
        if any(events[step].data.startswith(self._pending) for step in asked):
            return False
        cut = min((at + 1 for end in (b"\r", b"\n") if (at := self._pending.find(end)) >= 0),
                  default=1)
        self.problems.append(f"not in the recording: {self._pending[:cut]!r}")
        self._pending = self._pending[cut:]
        return True

    def _advance(self, step: int) -> bool:
        self._command = self.transcript.events[step].data
        self.obeyed.append(self._command)
        self._pending = self._pending[len(self._command):]
        self._step = step + 1
        return True

    def _take_in(self, arrived: bytes) -> None:
        """Note what arrived; an instrument that wants gaps loses what follows too fast."""
        self.heard += arrived
        now = time.monotonic()
        if self._gap:
            arrived = arrived[:1] if now - self._arrived_at >= self._gap else b""
        self._arrived_at = now
        self._pending += arrived

    def _wrong_speed(self) -> bool:
        speed = self._line.speed()
        if speed is None or speed == self._baud:
            return False
        self.problems.append(f"the computer's speed is {speed}, the instrument's {self._baud}")
        return True

    def _garbage(self, count: int) -> bytes:
        return bytes(self._random.randrange(128, 256) for _ in range(max(1, count // 3)))

    def _wait(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        while not self._stop.is_set() and (left := end - time.monotonic()) > 0:
            if arrived := self._line.read(min(left, 0.01)):
                if self._deaf:
                    self.heard += arrived
                else:
                    self._take_in(arrived)


class _TerminalEnd:
    """The instrument's end of a pseudo-terminal."""

    def __init__(self) -> None:
        import tty
        self._master, self._slave = os.openpty()
        # before the name is handed out: echo and newline mapping corrupt the first bytes
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        # our own end stays open: the driver may close and open again
        self.port = os.ttyname(self._slave)
        self._open = True

    def read(self, limit_s: float) -> bytes:
        ready, _, _ = select.select([self._master], [], [], limit_s)
        return os.read(self._master, 4096) if ready else b""

    def write(self, data: bytes) -> None:
        while data:
            try:
                data = data[os.write(self._master, data):]
            except BlockingIOError:
                select.select([], [self._master], [], 0.1)

    def speed(self) -> int | None:
        import termios
        code = termios.tcgetattr(self._master)[5]
        names = {getattr(termios, name): int(name[1:]) for name in dir(termios)
                 if name[0] == "B" and name[1:].isdigit()}
        return names.get(code, code)

    def close(self) -> None:
        if self._open:
            self._open = False
            os.close(self._slave)
            os.close(self._master)


class _SocketEnd:
    """The instrument's end of a loopback socket; speed means nothing here."""

    def __init__(self) -> None:
        self._server = socket.create_server(("127.0.0.1", 0))
        self._server.settimeout(0.05)
        self.port = f"socket://127.0.0.1:{self._server.getsockname()[1]}"
        self._peer: socket.socket | None = None

    def read(self, limit_s: float) -> bytes:
        if self._peer is None:
            with contextlib.suppress(TimeoutError):
                self._peer = self._server.accept()[0]
            return b""
        ready, _, _ = select.select([self._peer], [], [], limit_s)
        data = self._peer.recv(4096) if ready else b""
        if ready and not data:
            self._peer.close()
            self._peer = None
        return data

    def write(self, data: bytes) -> None:
        if self._peer is not None:
            self._peer.sendall(data)

    def speed(self) -> int | None:
        return None

    def close(self) -> None:
        if self._peer is not None:
            self._peer.close()
        self._server.close()


# ---- record a measurement as a transcript, and play one back through the driver's own code -------

SETTINGS = {"integration_ms": float, "averages": int, "sync_hz": float}
PLAYED_LIMIT_S = 2.0        # shortest wait for a played reply
AT_ONCE = 0.01
UNKNOWN_CR30 = Identity("CR30", "not recorded", None)   # where a recording began later


@contextlib.contextmanager
def record(folder: Path, instrument: str, wanted: MeterSettings) -> Iterator[TranscriptWriter]:
    """A transcript of a run, named after its time, in a folder.

    Parameters
    ----------
    folder : Path
    instrument : str
        As ``driver_named`` takes it.
    wanted : MeterSettings
        Stored in the transcript.

    Raises
    ------
    InputError, EnvironmentProblem
    """
    driver = drivers.driver_named(instrument)
    now = datetime.now(UTC)
    facts = {"instrument": driver.name,
             "line": f"{driver.baud}{' rtscts' if driver.rtscts else ''}",
             "recorded": now.isoformat(timespec="seconds"), "settings": settings_text(wanted)}
    writer = TranscriptWriter(folder / f"{now:%Y%m%dT%H%M%S.%f}.transcript", facts)
    try:
        yield writer
    finally:
        writer.close()


def replay_transcript(transcript: Transcript, *, speed: float = 0.0,
                      over_socket: bool = False) -> tuple[list[SpectralReading], list[str]]:
    """Play a recording to its driver and take the readings it holds.

    Parameters
    ----------
    transcript : Transcript
    speed : float
        1 plays in real time, 10 ten times as fast, 0 without any delay.
    over_socket : bool

    Returns
    -------
    readings : list of SpectralReading
    problems : list of str
        Where the driver left the recording.

    Raises
    ------
    InputError
        If the recording does not name its instrument or the speed of its line.
    InstrumentError
        If the driver cannot make sense of it.
    """
    name = transcript.facts.get("instrument")
    if name == cr30.Cr30.name:
        return _replay_cr30(transcript, speed, over_socket)
    if name is None:
        raise InputError(f"{transcript.file} names no instrument; a line such as '# instrument: "
                         "pr655' is needed")
    scale = 1 / speed if speed else 0.0
    pace = serial_line.Pace(scale or AT_ONCE, shortest_limit_s=PLAYED_LIMIT_S)
    readings: list[SpectralReading] = []
    count = _count(transcript)
    with TranscriptPlayer(transcript, time_scale=scale, over_socket=over_socket) as player, \
            measurement.open_instrument(name, player.port, lambda direction, data: None,
                                        pace) as meter, _ending_as_recorded(player, readings):
        identity = measurement.trusted_identity(meter)
        meter.settings(settings_of(transcript))
        for _ in range(count):
            readings.append(measurement.take_reading(meter, identity,
                                                     transcript=transcript.file))
    return readings, player.problems


@contextlib.contextmanager
def _ending_as_recorded(player: TranscriptPlayer,
                        readings: Sequence[SpectralReading]) -> Iterator[None]:
    """A recording that ends while the driver waits says so: as a problem after readings, else as
    the error.
    """
    try:
        yield
    except instrument_errors.InstrumentError as error:
        if not player.finished:
            raise
        asked = (player.obeyed or [b""])[-1].decode("ascii", "replace").strip()
        ended = (f"the recording ends after {len(player.transcript.events)} lines, where the "
                 f"driver waits for the reply to {asked!r}: it was cut, or the instrument went "
                 "silent there")
        if not readings:
            raise instrument_errors.InstrumentError(
                f"{player.transcript.file}: {ended}; no reading is whole") \
                from error
        player.problems.append(ended)


def _replay_cr30(transcript: Transcript, speed: float,
                 over_socket: bool) -> tuple[list[SpectralReading], list[str]]:
    """Play what a CR30 said, to whatever program it said it."""
    steps, problems = cr30_traffic(transcript)
    scale = 1 / speed if speed else 0.0
    pace = serial_line.Pace(scale or AT_ONCE, shortest_limit_s=PLAYED_LIMIT_S)
    player = TranscriptPlayer(as_our_driver_has_it(transcript, steps), time_scale=scale,
                              over_socket=over_socket)
    identity = UNKNOWN_CR30
    readings: list[SpectralReading] = []
    # the player after the line is open: a press of the button may be the first that is heard
    with measurement.open_instrument(cr30.Cr30.name, player.port, lambda direction, data: None,
                                     pace) as meter, player:
        assert isinstance(meter, cr30.Cr30)
        for what, events in steps:
            if what == "connect":
                identity = meter.identify()
            elif what in meter.calibrations:
                meter.calibrate(what)
            else:
                meter.by_button = events[0].direction == "<"
                readings.append(
                    measurement.take_reading(meter, identity, transcript=transcript.file))
    return readings, [*problems, *player.problems]


def settings_text(wanted: MeterSettings) -> str:
    """Settings as one line of a transcript; undone by ``settings_of``.

    Parameters
    ----------
    wanted : MeterSettings
    """
    return " ".join(f"{key}={value:g}" for key in SETTINGS
                    if (value := getattr(wanted, key)) is not None)


def settings_of(transcript: Transcript) -> MeterSettings:
    """The settings that the operator asked for when the recording was made.

    Parameters
    ----------
    transcript : Transcript

    Raises
    ------
    InputError
    """
    wanted: dict[str, float] = {}
    for part in transcript.facts.get("settings", "").split():
        key, _, value = part.partition("=")
        try:
            wanted[key] = SETTINGS[key](value)
        except (KeyError, ValueError):
            raise InputError(f"{transcript.file} states the setting {part!r}; known are "
                             f"{', '.join(f'{name}=...' for name in SETTINGS)}") from None
    return MeterSettings(**wanted)  # type: ignore[arg-type]


def _count(transcript: Transcript) -> int:
    text = transcript.facts.get("readings", "1")
    if not is_whole_number(text):
        raise InputError(f"{transcript.file} states {text!r} readings; a number is needed")
    return int(text)
