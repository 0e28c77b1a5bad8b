"""What a stage is given to work on."""
from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from spectrabox.radiometry.records import Progress
from spectrabox.session.config.session_schema import SessionConfig
from spectrabox.session.stages.inputs import OpenPhotos
from spectrabox.session.stages.records import SessionRecords


@dataclass(frozen=True)
class StageTask:
    """One run of one stage."""

    config: SessionConfig
    device: str                       # "auto", "cpu" or "cuda": where Mitsuba renders
    records: SessionRecords           # results of the stages before
    folder: Path                      # an empty folder that takes the stage's pictures
    progress: Progress
    photos: OpenPhotos = field(default_factory=OpenPhotos)  # of the run, shared by its stages
