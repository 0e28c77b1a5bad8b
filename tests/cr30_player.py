"""A CR30 that says what a genuine one said, step by step: connected, calibrated, measuring."""
from __future__ import annotations

from pathlib import Path

from spectrabox.capture.transcripts.cr30_traffic import cr30_traffic
from spectrabox.capture.transcripts.player import TranscriptPlayer
from spectrabox.capture.transcripts.sniffed_traffic import read_recording
from spectrabox.capture.transcripts.transcript import Event, Transcript

FOLDER = Path(__file__).parents[1] / "fixtures" / "cr30"


def steps_of(recording: Path) -> list[tuple[Event, ...]]:
    """What passed in each step of a recording, as our driver has it."""
    return [tuple(step.events()) for step in cr30_traffic(read_recording(recording)).steps]


def cr30_player(*recordings: Path, over_socket: bool = False,
                strict: bool = True) -> TranscriptPlayer:
    """An instrument that says who it is, then plays recordings in which it does not."""
    steps = [*steps_of(FOLDER / "Connect.spm"),
             *(step for recording in recordings for step in steps_of(recording))]
    return TranscriptPlayer(Transcript({"line": "9600"}, tuple(event for step in steps
                                                               for event in step), "CR30"),
                            time_scale=0.0, over_socket=over_socket, strict=strict)
