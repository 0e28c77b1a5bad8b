"""Everything a finished session knows, as the report and the command line read it."""
from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.measure.scene.placements import SceneGeometry
from spectrabox.measure.surface_spectra import Scores
from spectrabox.radiometry.chart import CLASSIC, Chart
from spectrabox.radiometry.records import (
    Calibration,
    ChartDetection,
    HeldOutPatches,
    LightScale,
    LinearImage,
    Outcome,
    PatchSamples,
    PriorInfluence,
    Reconstruction,
    Spectrum,
    SpectrumSamples,
    SpectrumSummary,
)
from spectrabox.sampling.prior.family_coverage import FamilyCoverage
from spectrabox.session.pictures.picture_results import PictureOfSpectra

# outcomes of a sampler without reservation
VALID_OUTCOMES = frozenset({Outcome.EXACT, Outcome.FAMILIAR, Outcome.THROUGH_TRANSPORT})


@dataclass(frozen=True)
class MaterialResult:
    """One material of the scene, or region of a flat sample."""

    name: str
    # (P,) of inverse rendering, or as given; on the working grid. None of an estimated region
    spectrum: np.ndarray | None
    signal: np.ndarray                # (J,) relative to white, in the bands of all photos
    signal_covariance: np.ndarray     # (J, J) noise
    model_covariance: np.ndarray      # (J, J) relative: photo and model disagree
    summary: SpectrumSummary | None   # None where the spectrum was given
    samples: SpectrumSamples | None
    # cause -> (K,) relative standard error of this material's signal
    error_budget: dict[str, np.ndarray]
    truth: Spectrum | None
    scores: Scores | None
    # cause -> share of the spectrum's variance
    variance_shares: dict[str, float] = field(default_factory=dict)
    # of surfaces that the signal allows, or that were stated; none without the learnt prior
    families: tuple[FamilyCoverage, ...] = ()

    @property
    def doubtful(self) -> bool:
        """Whether its draws ended with a reservation."""
        return self.samples is not None and self.samples.outcome not in VALID_OUTCOMES


@dataclass(frozen=True)
class ChartResult:
    """The chart photo as it was used."""

    detection: ChartDetection
    samples: PatchSamples
    predicted: np.ndarray             # (I, K) signal that the calibration predicts
    irradiance: np.ndarray            # (I,) relative irradiance of each patch, brightest 1
    overlay: Path                     # PNG
    layout: Chart = CLASSIC
    left_out: HeldOutPatches | None = None      # each patch by a calibration without it
    prior: PriorInfluence | None = None          # None of curves that no prior was used for


@dataclass(frozen=True)
class ViewResult:
    """A further photo of the same materials."""

    name: str
    bands: tuple[str, ...]
    calibration: Calibration          # with the light of this view
    photo_preview: Path               # PNG
    reconstruction: Reconstruction


@dataclass(frozen=True, kw_only=True)
class CommonResults:
    """What the report of any session shows; ``folder`` is the session folder."""

    folder: Path
    name: str
    operator: str
    notes: str
    bands: tuple[str, ...]            # band names, "R", "G", "B" for a colour camera
    # role, file (relative), sha256, bytes; of photos also exposure_s, iso, camera ...
    inputs: list[dict[str, Any]]
    chart: ChartResult | None         # None where sensitivities came from a file
    calibration: Calibration
    sensitivity_truth: tuple[np.ndarray, np.ndarray] | None  # nm (P,), curves (K, P)
    photo: LinearImage                # at the render's size, or a thumbnail
    photo_preview: Path               # PNG of the whole object photo
    materials: list[MaterialResult]
    signal_bands: tuple[str, ...]     # J names: the bands of all photos that differ in light
    stages: list[dict[str, Any]]      # name, seconds, state ("run", "kept")
    # versions, command, seed, started, finished, machine facts without paths
    provenance: dict[str, Any]
    warnings: list[str] = field(default_factory=list)
    # digests of session.toml, of input files and of stored results
    input_digests: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class SessionResults(CommonResults):
    """What the report of a session of a scene shows."""

    light_scale: LightScale
    reconstruction: Reconstruction
    views: list[ViewResult] = field(default_factory=list)  # photos beyond the first
    geometry: SceneGeometry | None = None       # None where camera and lamp stand as stated
    rehearsal: dict[str, Any] | None = None     # facts of the last one of these results
    picture: PictureOfSpectra | None = None     # where the session asks for one
