"""A CR30 that says what a genuine one said, step by step: connected, calibrated, measuring."""
from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from spectrabox.capture.meter.instruments.cr30 import HEADER
from spectrabox.capture.transcripts.cr30_traffic import cr30_traffic
from spectrabox.capture.transcripts.player import TranscriptPlayer
from spectrabox.capture.transcripts.sniffed_traffic import read_recording
from spectrabox.capture.transcripts.transcript import Event, Transcript

FOLDER = Path(__file__).parents[1] / "fixtures" / "cr30"


def steps_of(recording: Path) -> list[tuple[Event, ...]]:
    """What passed in each step of a recording, as our driver has it."""
    return [events for _, events in cr30_traffic(read_recording(recording))[0]]


def cr30_player(*recordings: Path, over_socket: bool = False,
                strict: bool = True) -> TranscriptPlayer:
    """An instrument that says who it is, then what recordings hold, but for who it is."""
    connect, = steps_of(FOLDER / "Connect.spm")
    steps = [connect, *(step for recording in recordings for step in steps_of(recording)
                        if step[0] != connect[0])]
    return TranscriptPlayer(Transcript({"line": "9600"}, tuple(event for step in steps
                                                               for event in step), "CR30"),
                            time_scale=0.0, over_socket=over_socket, strict=strict)


def measurements(recording: Path) -> list[tuple[Event, ...]]:
    """The measurements of a recording, each a trigger or a press with the spectrum."""
    return [step for step in steps_of(recording) if any(event.data[:3] == HEADER for event in step)]


def playing(steps: Sequence[tuple[Event, ...]]) -> TranscriptPlayer:
    """An instrument that says what was said in some steps, after who it is."""
    connect, = steps_of(FOLDER / "Connect.spm")
    return TranscriptPlayer(Transcript({"line": "9600"}, tuple(
        event for step in (connect, *steps) for event in step), "CR30"), time_scale=0.0)
