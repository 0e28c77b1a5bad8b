"""Everything a finished session of flat samples knows, as the report and the command line read it.
"""
from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.radiometry.records import SurfaceSignals
from spectrabox.session.pictures.picture_results import PictureOfSpectra
from spectrabox.session.store.results import CommonResults


@dataclass(frozen=True)
class PhotoOfRegions:
    """One photo of a session with what it shows."""

    name: str
    preview: Path                       # PNG of the whole photo
    size_px: tuple[int, int]            # width and height of the photo itself
    outlines: dict[str, np.ndarray]     # (C, 2) corners of each region in its pixels
    chart_px: np.ndarray | None         # (I, 4, 2) patches, where the chart lies in this photo
    # of each region: light relative to the chart's mean, and its relative standard error
    light: dict[str, tuple[float, float]]
    # over the photo: light and its relative error, (2, h, w); None where it shows no region
    light_map: np.ndarray | None
    # of each known region: its level against the light's, in standard errors of both
    level_misfits: dict[str, float]


@dataclass(frozen=True, kw_only=True)
class FlatResults(CommonResults):
    """What the report of a session of flat samples shows."""

    photos: list[PhotoOfRegions]
    signals: SurfaceSignals
    light: dict[str, Any]               # kind, wavelengths_nm, mean, lower, upper
    picture: PictureOfSpectra | None    # where the session asks for one
