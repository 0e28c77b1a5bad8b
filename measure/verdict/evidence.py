"""What a measurement found: what a verdict rests on, for every door to it.

There is no folder and no file in it, so that what was never stored can be judged too; what only a
report shows is added by ``session.outputs.results``.
"""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from spectrabox.measure.scene.rehearsed import Rehearsed
from spectrabox.measure.surfaces.surface_spectra import Scores
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
    def band_width(self) -> float | None:
        """Mean width of the band over wavelength; None where the spectrum was given."""
        return None if self.summary is None else float(np.average(
            self.summary.upper - self.summary.lower, weights=self.summary.grid.weights_nm))

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
    layout: Chart = CLASSIC
    left_out: HeldOutPatches | None = None      # each patch by a calibration without it
    prior: PriorInfluence | None = None          # None of curves that no prior was used for
    # left out too, of charts with a fit of their own, by view
    others: Mapping[str, HeldOutPatches] = field(default_factory=dict)


@dataclass(frozen=True)
class ViewResult:
    """A further photo of the same materials."""

    name: str
    bands: tuple[str, ...]
    calibration: Calibration          # with the light of this view
    reconstruction: Reconstruction


@dataclass(frozen=True)
class LitRegions:
    """The light on the regions that one photo of flat samples shows."""

    name: str                           # of the photo
    # of each region: light relative to the chart's mean, and its relative standard error
    light: dict[str, tuple[float, float]]
    # of each known region: its level against the light's, in standard errors of both
    level_misfits: dict[str, float]
    # of each region: relative scatter of its pixels beyond noise and a plane, in the worst band
    scatter: dict[str, float]


@dataclass(frozen=True)
class PhotoOfRegions(LitRegions):
    """One photo of flat samples with what it shows."""

    view: str                           # name of the photo, empty of the first
    size_px: tuple[int, int]            # width and height of the photo itself
    outlines: dict[str, np.ndarray]     # (C, 2) corners of each region in its pixels
    chart_px: np.ndarray | None         # (I, 4, 2) patches, where the chart lies in this photo
    # over the photo: light and its relative error, (2, h, w); None where it shows no region
    light_map: np.ndarray | None
    lamp: str = ""                      # what lights it, in words
    shift_px: float | None = None       # against the first photo; None: not compared
    residual_px: float | None = None    # what the registration left
    silent_bands: tuple[str, ...] = ()  # too dark or saturated on all its regions
    # of a chart with a fit of its own: mean share of the bands of left-out patches that hold
    chart_held: float | None = None

    @property
    def sentence(self) -> str:
        """Its light, its chart, how it was registered and what it does not tell."""
        said = [self.lamp]
        if self.chart_held is not None:
            said.append(f"bands of its chart's left-out patches hold {self.chart_held:.0%}")
        if self.shift_px is not None:
            left = "" if self.residual_px is None else f", within {self.residual_px:.1f}"
            said.append(f"shifted by {self.shift_px:.1f} pixels against the first photo{left}")
        if self.silent_bands:
            said.append(f"too dark or saturated and left out: {', '.join(self.silent_bands)}")
        return "; ".join(said)


@dataclass(frozen=True, kw_only=True)
class CommonEvidence:
    """What the verdict on any session rests on."""

    bands: tuple[str, ...]            # band names, "R", "G", "B" for a colour camera
    chart: ChartResult | None         # None where sensitivities came from a file
    calibration: Calibration
    # by view, of further photos whose charts are a fit of their own
    other_calibrations: Mapping[str, Calibration] = field(default_factory=dict)
    photo: LinearImage                # at the render's size, or a thumbnail
    materials: list[MaterialResult]
    surfaces_stated: bool           # matt, satin or glossy, of every surface that is estimated
    with_picture: bool = False          # every pixel has a spectrum of its own, too
    processed: bool = False         # a photo by the camera, and decoded as sRGB


@dataclass(frozen=True, kw_only=True)
class SceneEvidence(CommonEvidence):
    """What the verdict on a session of a scene rests on."""

    reconstruction: Reconstruction
    views: list[ViewResult] = field(default_factory=list)  # photos beyond the first
    rehearsal: Rehearsed | None = None          # the last one of these results

    @property
    def light_scale(self) -> LightScale:
        """Of the first photo."""
        return self.reconstruction.light_scale


@dataclass(frozen=True, kw_only=True)
class FlatEvidence(CommonEvidence):
    """What the verdict on a session of flat samples rests on."""

    photos: Sequence[LitRegions]
