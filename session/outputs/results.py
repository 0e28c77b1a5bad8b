"""Everything a finished session knows, as the report and the command line read it."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.measure.verdict.evidence import (
    CommonEvidence,
    FlatEvidence,
    PhotoOfRegions,
    SceneEvidence,
)
from spectrabox.radiometry.placements import SceneGeometry
from spectrabox.radiometry.records import WavelengthGrid
from spectrabox.session.pictures.picture_results import PictureOfSpectra


@dataclass(frozen=True, kw_only=True)
class CommonResults(CommonEvidence):
    """What the report of any session shows; ``folder`` is the session folder."""

    folder: Path
    name: str
    operator: str
    notes: str
    grid: WavelengthGrid              # of the spectra
    # role, file (relative), sha256, bytes; of photos also exposure_s, iso, camera ...
    inputs: list[dict[str, Any]]
    sensitivity_truth: tuple[np.ndarray, np.ndarray] | None  # nm (P,), curves (K, P)
    previews: dict[str, Path]         # PNG of each whole object photo by view, "" the first
    chart_overlay: Path               # PNG of the chart, where it was detected
    signal_bands: tuple[str, ...]     # J names: the bands of all photos that differ in light
    stages: list[dict[str, Any]]      # name, seconds, state ("run", "kept")
    # versions, command, seed, started, finished, machine facts without paths
    provenance: dict[str, Any]
    warnings: list[str] = field(default_factory=list)
    # digests of session.toml, of input files and of stored results
    input_digests: dict[str, Any] = field(default_factory=dict)
    swatches: str = ""                # what they did; empty without any
    picture: PictureOfSpectra | None = None     # where the session asks for one


@dataclass(frozen=True, kw_only=True)
class SceneResults(CommonResults, SceneEvidence):
    """What the report of a session of a scene shows."""

    geometry: SceneGeometry | None = None       # None where camera and lamp stand as stated


@dataclass(frozen=True, kw_only=True)
class FlatResults(CommonResults, FlatEvidence):
    """What the report of a session of flat samples shows."""

    photos: Sequence[PhotoOfRegions]


SessionResults = SceneResults | FlatResults
