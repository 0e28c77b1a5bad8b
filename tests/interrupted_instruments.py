"""Every instrument, interrupted by SIGINT, SIGTERM or SIGHUP throughout a conversation: is it ever
left with changed settings?
"""
from __future__ import annotations

import re
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any
from unittest import mock

import serial

from spectrabox.capture.meter import serial_line
from spectrabox.capture.meter.instruments.instrument_errors import InstrumentError
from spectrabox.capture.meter.instruments.jeti import DEFAULTS
from spectrabox.capture.meter.serial_line import Pace
from spectrabox.capture.transcripts.player import TranscriptPlayer
from spectrabox.capture.transcripts.transcript import Event, Transcript
from spectrabox.fixtures.meter_transcripts import SyntheticMeter
from spectrabox.session.terminal.progress_display import SIGNALS, held

from tests.transcript_trials import measure_played

PACE = Pace(scale=0.002, shortest_limit_s=0.5)
BUSY_S = 0.1                # a played measurement; the line is deaf to all that comes during it
# How a command of each instrument names a setting and its value.
SETTING = {"pr655": rb"(S[A-Z])(-?\d+)\r", "cs2000": rb"(RMTS|MSWE|SPMS|SCMS),(.*)\n",
           "cr250": rb"SM (\w+) (.*)\r", "specbos2501": rb"\*para:(\w+) (.*)\r",
           "specbos1211": rb"\*CON(?:F|TR):(\w+) (.*)\r", "pr650": rb"(?!)"}
MODES = {b"PHOTO": ("remote", b"1"), b"Q": ("remote", b"0")}


@dataclass(frozen=True)
class Interrupted:
    """One interruption and the state that it left."""

    instrument: str
    signal: str
    point: int
    interrupted: bool           # the work ended by it
    left: bool                  # every setting is as it was found
    seconds: float


class InterruptingPort:
    """A serial port at whose ``point``-th use this process receives a signal: before the use for
    even points, after it for odd ones.
    """

    def __init__(self, port: Any, point: int, number: int) -> None:
        self.__dict__.update(port=port, point=point, number=number, uses=0)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.port, name)

    def __setattr__(self, name: str, value: Any) -> None:
        setattr(self.port, name, value)

    def write(self, data: bytes) -> int:
        with self._used():
            return int(self.port.write(data))

    def read(self, size: int) -> bytes:
        with self._used():
            return bytes(self.port.read(size))

    @contextmanager
    def _used(self) -> Iterator[None]:
        self.__dict__["uses"] += 1
        due = self.uses == self.point
        if due and self.point % 2 == 0:
            signal.raise_signal(self.number)
        yield
        if due and self.point % 2 == 1:
            signal.raise_signal(self.number)


def conversation(meter: SyntheticMeter) -> Transcript:
    """A recording in which only the measurement takes time."""
    events = [Event(">", 0.0, sent) if reply is None else Event("<", delay, reply)
              for sent, replies in meter.exchanges
              for delay, reply in ((0.0, None), *((BUSY_S if delay_s >= 1 else 0.0, data)
                                                  for delay_s, data in replies))]
    return Transcript({"instrument": meter.driver, "line": meter.line, "settings": meter.settings},
                      tuple(events), meter.name)


def settings_left(driver: str, obeyed: list[bytes]) -> dict[str, bytes]:
    """The last value of each setting among the commands that an instrument understood."""
    state: dict[str, bytes] = {}
    for command in obeyed:
        if match := re.fullmatch(SETTING[driver], command):
            state[match[1].decode()] = match[2]
        elif command == DEFAULTS:
            state = {key: value for key, value in state.items() if key == "LASER"}
        elif command in MODES:
            key, value = MODES[command]
            state[key] = value
    return state


def run(meter: SyntheticMeter, point: int, number: int) -> tuple[bool, dict[str, bytes], int]:
    """Whether the work was interrupted, the settings it left, and how often the port was used."""
    transcript = conversation(meter)
    opened: list[InterruptingPort] = []
    open_port = serial.serial_for_url

    def interrupting(*arguments: Any, **options: Any) -> InterruptingPort:
        opened.append(InterruptingPort(open_port(*arguments, **options), point, number))
        return opened[-1]
    player = TranscriptPlayer(transcript, time_scale=1.0, strict=False, deaf_while_busy=True)
    interrupted = False
    with player, mock.patch.object(serial, "serial_for_url", interrupting), \
            mock.patch.object(serial_line, "INNER_TIMEOUT_S", 0.005):
        try:
            measure_played(transcript, player.port, PACE, held=held)
        except KeyboardInterrupt:
            interrupted = True
        except InstrumentError:
            if not point:
                raise
    return interrupted, settings_left(meter.driver, player.obeyed), opened[0].uses


def interruptions(meter: SyntheticMeter, points: int) -> list[Interrupted]:
    """Interruptions at ``points`` uses of the port spread over a conversation, signals in turn."""
    _, as_found, uses = run(meter, 0, signal.SIGINT)
    chosen = sorted({1 + index * uses // points for index in range(min(points, uses))})
    trials = []
    for index, point in enumerate(chosen):
        number = SIGNALS[index % len(SIGNALS)]
        started = time.monotonic()
        interrupted, state, _ = run(meter, point, number)
        left = all(as_found.get(key) == value for key, value in state.items())
        trials.append(Interrupted(meter.driver, number.name, point, interrupted, left,
                                  time.monotonic() - started))
    return trials
