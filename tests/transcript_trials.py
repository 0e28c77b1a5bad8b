"""Every fault at every position of a recording: the driver's result, and its leave-taking."""
from __future__ import annotations

import contextlib
import dataclasses
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from spectrabox.capture.meter.instruments.instrument_errors import InstrumentError
from spectrabox.capture.meter.measurement import open_instrument, take_reading, trusted_identity
from spectrabox.capture.meter.serial_line import Hold, Pace
from spectrabox.capture.transcripts.player import TranscriptPlayer, settings_of
from spectrabox.capture.transcripts.transcript import Event, Transcript
from spectrabox.fixtures.line_faults import Fault, FaultKind, distortion
from spectrabox.fixtures.meter_transcripts import SpectrumFault, SyntheticMeter
from spectrabox.measure import texts
from spectrabox.radiometry.spectra.readings import SpectralReading

# 240 s become 0.48 s; below 0.25 s a busy computer looks like a mute line
FAST = Pace(scale=0.002, shortest_limit_s=0.25)
UNHURRIED = Pace(scale=0.002, shortest_limit_s=5.0)
# of one trial at that pace: two silent replies, re-reads, leaving, and a busy computer
DEADLINE_S = 5.0
WRONG_SPEED, TOO_FAST = "wrong speed", "typing too fast"
TOO_FAST_GAP_S = 5e-5       # at that pace the PR-655's 50 ms are 1e-4 s
OTHER_SPEEDS = {115200: 9600, 9600: 19200, 921600: 38400}
# none may be wrong
FACTS = ("quantity", "instrument", "serial_number", "firmware", "integration_ms", "luminance")


@dataclass(frozen=True)
class Subject:
    """A recording with what it must be read as and how the instrument is given back."""

    transcript: Transcript
    values: np.ndarray
    clean: SpectralReading          # without a fault
    change: bytes
    leave: bytes


@dataclass(frozen=True)
class Trial:
    """One fault at one position, and what came of it."""

    instrument: str
    fault: str
    step: int
    position: float
    result: str             # "spectrum", "no reading", or the name of the error
    sentence: str
    wrong: bool             # a spectrum was accepted that is not the true one
    left: bool  # the instrument was given back, or the line was dead, or nothing had been changed
    seconds: float


def measure_played(transcript: Transcript, port: str, pace: Pace, driver: str | None = None,
                   held: Hold = contextlib.nullcontext) -> SpectralReading:
    """One reading of a recording that is played at a port, with the settings it states."""
    with open_instrument(driver or transcript.facts["instrument"], port,
                         lambda direction, data: None, pace, held) as meter:
        identity = trusted_identity(meter)
        meter.settings(settings_of(transcript))
        return take_reading(meter, identity)


def subject_of(transcript: Transcript, values: np.ndarray, change: bytes, leave: bytes) -> Subject:
    """A recording, played once without a fault; ``values`` (P,) are its true ones."""
    with TranscriptPlayer(transcript, time_scale=0.0) as player:
        clean = measure_played(transcript, player.port, UNHURRIED)
    return Subject(transcript, values, clean, change, leave)


def trials(subject: Subject, positions: int) -> Iterator[tuple[str, Fault | None]]:
    """Faults of one recording: each kind at some positions, spread over and within its replies."""
    replies = [step for step, event in enumerate(subject.transcript.events) if event.direction
               == "<"]
    for number, kind in enumerate(FaultKind):
        for index in range(positions):
            # Shifted from kind to kind, so that together they cover the whole exchange.
            within_exchange = (index + (number % 4) / 4) / positions
            step = replies[min(int(within_exchange * len(replies)), len(replies) - 1)]
            within = (0.03, 0.37, 0.61, 0.97)[(index + number) % 4]
            yield kind.value, Fault(kind, step, within, 0.6 if kind is FaultKind.LONG_STALL
                                    else 0.05)
    yield WRONG_SPEED, None
    yield TOO_FAST, None


def run_trial(subject: Subject, name: str, fault: Fault | None) -> Trial:
    """Measure against one recording with one fault laid over it."""
    transcript = subject.transcript
    if name == WRONG_SPEED:
        facts = {**transcript.facts, "line": str(OTHER_SPEEDS[transcript.baud])}
        transcript = dataclasses.replace(transcript, facts=facts)
    player = TranscriptPlayer(transcript, time_scale=0.0, strict=False, distort=distortion(fault),
                              character_gap_s=TOO_FAST_GAP_S if name == TOO_FAST else 0.0)
    started = time.monotonic()
    with player:
        result, sentence, reading = _outcome(transcript, player.port)
        seconds = time.monotonic() - started
    wrong = reading is not None and reading.spectrum is not None and not _is_true(reading, subject)
    dead = fault is not None and fault.kind is FaultKind.DISCONNECT
    return Trial(transcript.facts["instrument"], name, fault.step if fault else 0,
                 fault.position if fault else 0.0, result,
                 sentence, wrong, dead or _given_back(bytes(player.heard), subject), seconds)


def spectrum_trial(meter: SyntheticMeter, fault: SpectrumFault) -> Trial:
    """Measure with an instrument that sends another spectrum than it computed its figures from."""
    transcript = Transcript({"instrument": meter.driver, "line": meter.line,
                             "settings": meter.settings},
                            tuple(Event(direction, 0.0, data) for sent, replies in meter.exchanges
                                  for direction, data in ((">", sent), *(("<", reply) for _, reply
                                                                         in replies))), meter.name)
    started = time.monotonic()
    with TranscriptPlayer(transcript, time_scale=0.0) as player:
        result, sentence, reading = _outcome(transcript, player.port)
    wrong = reading is not None and reading.spectrum is not None \
        and not np.array_equal(reading.spectrum.values, meter.values)
    return Trial(meter.driver, fault.name, 0, 0.0, result, sentence, wrong, True,
                 time.monotonic() - started)


def run_all(subjects: list[Subject], positions: int, workers: int,
            done: Callable[[Trial], None] | None = None) -> list[Trial]:
    """Every trial of every subject, several at a time: they mostly wait."""
    cases = [(subject, name, fault) for subject in subjects
             for name, fault in trials(subject, positions)]
    results = []
    with ThreadPoolExecutor(workers) as pool:
        for trial in pool.map(lambda case: run_trial(*case), cases):
            results.append(trial)
            if done is not None:
                done(trial)
    return results


def _outcome(transcript: Transcript, port: str) -> tuple[str, str, SpectralReading | None]:
    try:
        reading = measure_played(transcript, port, FAST)
    except InstrumentError as error:
        return type(error).__name__, str(error), None
    return ("spectrum" if reading.spectrum is not None else "no reading",
            texts.says(reading.outcome.finding), reading)


def _is_true(reading: SpectralReading, subject: Subject) -> bool:
    clean = subject.clean
    return reading.spectrum is not None and clean.spectrum is not None \
        and np.array_equal(reading.spectrum.values, subject.values) \
        and np.array_equal(reading.spectrum.grid.nm, clean.spectrum.grid.nm) \
        and all(getattr(reading, fact) == getattr(clean, fact) for fact in FACTS)


def _given_back(heard: bytes, subject: Subject) -> bool:
    changed = heard.rfind(subject.change) if subject.change else -1
    return changed < 0 or heard.find(subject.leave, changed + len(subject.change)) >= 0
