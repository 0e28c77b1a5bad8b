"""Who takes readings: an instrument on its own line, or the installed spotread."""
from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Protocol, TypeAlias

from spectrabox.capture.meter.instruments.interface import Identity, Instrument, MeterSettings
from spectrabox.capture.meter.measurement import open_instrument, take_reading, trusted_identity
from spectrabox.capture.meter.meter_calibration import Maker
from spectrabox.capture.meter.serial_line import Log, Pace, shown
from spectrabox.capture.meter.spotread import NAME, spotread_reading
from spectrabox.capture.transcripts.transcript import TranscriptWriter
from spectrabox.capture.transcripts.transcript_replay import record
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.radiometry.spectra.readings import SpectralReading
from spectrabox.radiometry.system.words import plain
from spectrabox.session.terminal.interruption import held

REPLAY_LIMIT_S = 2.0
Check: TypeAlias = Callable[[Maker], None]      # objects to an instrument that may not measure here


class Reader(Protocol):
    """Takes readings, once ``begin`` has let it."""

    @property
    def meter(self) -> Instrument | None:
        """The instrument; None of one that another program drives."""

    def begin(self, check: Check) -> None:
        """Say who it is to a check, and take its settings."""

    def take(self) -> SpectralReading:
        """The next reading."""


Source: TypeAlias = Callable[[Path], contextlib.AbstractContextManager[Reader]]


class LineReader:
    """An instrument on its own line, set as wanted once ``begin`` lets it measure."""

    def __init__(self, meter: Instrument, wanted: MeterSettings, log: TranscriptWriter) -> None:
        self.meter: Instrument = meter
        self._wanted = wanted
        self._log = log
        self._identity: Identity | None = None
        self._count = 0

    def begin(self, check: Check) -> None:
        identity = trusted_identity(self.meter)
        check((identity.model, identity.serial_number))
        self.meter.settings(self._wanted)
        self._identity = identity

    def take(self) -> SpectralReading:
        assert self._identity is not None, "begin comes first"
        reading = take_reading(self.meter, self._identity, transcript=self._log.path.name)
        self._count += 1
        self._log.note("readings", str(self._count))
        return reading


class SpotreadReader:
    """The installed spotread, which says who it is with its first reading."""

    meter: Instrument | None = None

    def __init__(self, number: int, quantity: Quantity, log: TranscriptWriter) -> None:
        self._number, self._quantity, self._log = number, quantity, log
        self._check: Check | None = None
        self._calibrated = False

    def begin(self, check: Check) -> None:
        self._check = check

    def take(self) -> SpectralReading:
        reading = spotread_reading(self._quantity, self._number, self._log,
                                   lambda text: print(plain(text), end="", file=sys.stderr,
                                                      flush=True),
                                   calibrated=self._calibrated, transcript=self._log.path.name)
        if self._check is not None:
            self._check((reading.instrument, reading.serial_number))
        self._calibrated = True
        return reading


@contextlib.contextmanager
def line_reader(folder: Path, instrument: str, port: str,
                wanted: MeterSettings) -> Iterator[Reader]:
    """An instrument by its name and port; what passes is recorded in a folder.

    Parameters
    ----------
    folder : Path
    instrument, port : str
    wanted : MeterSettings
    """
    with record(folder, instrument, wanted) as log, \
            operated_instrument(instrument, port, log) as meter:
        yield LineReader(meter, wanted, log)


@contextlib.contextmanager
def spotread_reader(folder: Path, number: int, ambient: bool) -> Iterator[Reader]:
    """The installed spotread; what it prints is recorded in a folder.

    Parameters
    ----------
    folder : Path
    number : int
        Of the instrument in its list.
    ambient : bool
        Irradiance, through the diffuser.
    """
    now = datetime.now(UTC)
    log = TranscriptWriter(folder / f"{now:%Y%m%dT%H%M%S.%f}.transcript",
                           {"instrument": NAME, "recorded": now.isoformat(timespec="seconds")})
    with contextlib.closing(log):
        yield SpotreadReader(number, Quantity.IRRADIANCE if ambient else Quantity.RADIANCE, log)


@contextlib.contextmanager
def operated_instrument(name: str, port: str, log: Log) -> Iterator[Instrument]:
    """An open instrument that is left as it was found, or else the operator is told so.

    Parameters
    ----------
    name, port : str
    log : function of (direction, bytes)
    """
    opened: list[Instrument] = []
    try:
        with open_instrument(name, port, log, meter_pace(), held) as meter:
            opened.append(meter)
            try:
                yield meter
            except KeyboardInterrupt:
                print("interrupted: the instrument ends what it was told to do and gets its "
                      "settings back; its measurement may have to end first", file=sys.stderr,
                      flush=True)
                raise
    finally:
        if opened and opened[0].restore:
            commands = ", ".join(shown(command) for command in opened[0].restore)
            print(f"spectrabox: {port}: the {opened[0].family} did not confirm that its settings "
                  f"were put back ({commands}): look at its settings, or switch it off and on",
                  file=sys.stderr)


def meter_pace() -> Pace:
    """Real time; a recording played for a test may run faster."""
    text = os.environ.get("SPECTRABOX_METER_PACE", "1")
    try:
        scale = float(text)
    except ValueError:
        raise InputError(
            f"SPECTRABOX_METER_PACE is {text!r}; a number such as 0.01 is needed") from None
    return Pace() if scale == 1 else Pace(scale, shortest_limit_s=REPLAY_LIMIT_S)
