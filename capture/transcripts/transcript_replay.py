"""Record a measurement as a transcript, and play one back through the driver's own code."""
from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from spectrabox.capture.meter.instruments.cr30 import Cr30
from spectrabox.capture.meter.instruments.drivers import driver_named
from spectrabox.capture.meter.instruments.interface import Identity, MeterSettings
from spectrabox.capture.meter.measurement import open_instrument, take_reading, trusted_identity
from spectrabox.capture.meter.serial_line import Pace
from spectrabox.capture.transcripts.cr30_traffic import cr30_traffic
from spectrabox.capture.transcripts.player import TranscriptPlayer
from spectrabox.capture.transcripts.transcript import Transcript, TranscriptWriter
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.spectra.readings import SpectralReading
from spectrabox.radiometry.system.words import is_whole_number

SETTINGS = {"integration_ms": float, "averages": int, "sync_hz": float}
PLAYED_LIMIT_S = 2.0        # shortest wait for a played reply
AT_ONCE = 0.01
UNKNOWN_CR30 = Identity("CR30", "not recorded", None)   # where a recording began later


@dataclass(frozen=True)
class Played:
    """What a driver read from a recording."""

    instrument: str
    synthetic: bool
    readings: tuple[SpectralReading, ...]
    problems: tuple[str, ...]       # where the driver left the recording


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
    driver = driver_named(instrument)
    now = datetime.now(UTC)
    line = driver.line_settings
    facts = {"instrument": driver.name, "line": f"{line.baud}{' rtscts' if line.rtscts else ''}",
             "recorded": now.isoformat(timespec="seconds"), "settings": settings_text(wanted)}
    writer = TranscriptWriter(folder / f"{now:%Y%m%dT%H%M%S.%f}.transcript", facts)
    try:
        yield writer
    finally:
        writer.close()


def replay_transcript(transcript: Transcript, *, speed: float = 0.0,
                      over_socket: bool = False) -> Played:
    """Play a recording to its driver and take the readings it holds.

    Parameters
    ----------
    transcript : Transcript
    speed : float
        1 plays in real time, 10 ten times as fast, 0 without any delay.
    over_socket : bool

    Raises
    ------
    InputError
        If the recording does not name its instrument or the speed of its line.
    InstrumentError
        If the driver cannot make sense of it.
    """
    name = transcript.facts.get("instrument")
    if name == Cr30.name or transcript.sniffed:
        return _replay_cr30(transcript, speed, over_socket)
    if name is None:
        raise InputError(f"{transcript.file} names no instrument; a line such as '# instrument: "
                         "pr655' is needed")
    scale = 1 / speed if speed else 0.0
    pace = Pace(scale or AT_ONCE, shortest_limit_s=PLAYED_LIMIT_S)
    readings: list[SpectralReading] = []
    count = _count(transcript)
    with TranscriptPlayer(transcript, time_scale=scale, over_socket=over_socket) as player, \
            open_instrument(name, player.port, lambda direction, data: None, pace) as meter:
        identity = trusted_identity(meter)
        meter.settings(settings_of(transcript))
        for _ in range(count):
            readings.append(take_reading(meter, identity, transcript=transcript.file))
    return Played(name, "synthetic" in transcript.facts, tuple(readings), tuple(player.problems))


def _replay_cr30(transcript: Transcript, speed: float, over_socket: bool) -> Played:
    """Play what a CR30 said, to whatever program it said it."""
    traffic = cr30_traffic(transcript)
    scale = 1 / speed if speed else 0.0
    pace = Pace(scale or AT_ONCE, shortest_limit_s=PLAYED_LIMIT_S)
    player = TranscriptPlayer(traffic.transcript(transcript.facts, transcript.file),
                              time_scale=scale, over_socket=over_socket)
    identity = UNKNOWN_CR30
    readings: list[SpectralReading] = []
    # the player after the line is open: a press of the button may be the first that is heard
    with open_instrument(Cr30.name, player.port, lambda direction, data: None, pace) as meter, \
            player:
        assert isinstance(meter, Cr30)
        for step in traffic.steps:
            if step.what == "connect":
                identity = meter.identify()
            elif step.what in meter.calibrations:
                meter.calibrate(step.what)
            else:
                meter.by_button = step.by_button
                readings.append(take_reading(meter, identity, transcript=transcript.file))
    return Played(Cr30.name, "synthetic" in transcript.facts, tuple(readings),
                  (*traffic.problems, *player.problems))


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
