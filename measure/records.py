"""What each step of a measurement makes, which is kept and read as a whole: one record a step, or
records by the names of views or surfaces.
"""
from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import PurePosixPath
from typing import Annotated, Any, Protocol, TypeVar, cast, runtime_checkable

import numpy as np

from spectrabox.measure import captured, texts
from spectrabox.measure.pictures import pixel_flags
from spectrabox.radiometry import shaped
from spectrabox.radiometry.findings import Finding, each_once
from spectrabox.radiometry.records import calibration, scenes
from spectrabox.radiometry.records import photos as photo_records
from spectrabox.radiometry.records.spectra import SpectrumSummary, SurfaceSignals

Kind = TypeVar("Kind")
Record = shaped.Record | Mapping[str, shaped.Record]    # of a step

CALIBRATED = "calibrated"   # name of a photo's picture in the colours of its calibration


@runtime_checkable
class KeptRecord(Protocol):
    """The record of one step on disk."""

    def read(self, kind: type[Kind]) -> Kind:
        """The record, which is of this kind."""
        ...


@dataclass(frozen=True, eq=False)
class MeasuredChart(shaped.Record):
    """The chart in one photo; the step "chart" makes one for each view that has it."""

    detection: photo_records.ChartDetection
    samples: photo_records.PatchSamples
    thumbnail: photo_records.LinearImage        # of the photo, for its exposure and source
    light: Annotated[np.ndarray, "I"]           # on the patches, as it changes evenly over them
    findings: tuple[Finding, ...] = ()          # of the photo
    of_files: tuple[Finding, ...] = ()          # likewise, of its files and bands


@dataclass(frozen=True, eq=False)
class PhotoRecords(shaped.Record):
    """What the step "photo" makes."""

    photos: dict[str, photo_records.LinearImage]  # by view, at the render's size or thumbnails
    # of flat samples, by view, where some are shown
    regions: dict[str, photo_records.RegionSamples]
    # by view, of flat samples that the first shows too
    registrations: dict[str, photo_records.Registration]
    bands: tuple[str, ...]                      # names, of every photo
    findings: tuple[Finding, ...]               # of files and regions


@dataclass(frozen=True, eq=False)
class ChartFit(shaped.Record):
    """How the calibration explains the first chart photo."""

    predicted: Annotated[np.ndarray, "I K"]     # signals
    # relative, brightest 1; NaN on patches of which it is not known
    irradiance: Annotated[np.ndarray, "I"]
    # each patch by a calibration without it
    left_out: calibration.HeldOutPatches | None = None
    copy: calibration.ChartCopy | None = None  # None: the chart's reflectances were stated
    # of the prior's standard deviation, left, 0-1; None of curves that no prior was used for
    prior_share: Annotated[np.ndarray, "K P"] | None = None
    # of the prior: members and probability, likeliest first
    families: tuple[tuple[str, float], ...] = ()
    # a PatchError; None without a prior's fit
    patch_error: Annotated[np.ndarray, "2"] | None = None


@dataclass(frozen=True, eq=False)
class CalibrationRecords(shaped.Record):
    """What the step "calibrate" makes."""

    calibrations: dict[str, calibration.Calibration]        # by view, every one
    whites: dict[str, calibration.ChartWhite]  # by view with a chart, where a prior was fitted
    chart: ChartFit | None                      # None where the first view has no chart
    # by view, of charts with a fit of their own: each patch by a calibration without it
    other_charts: dict[str, calibration.HeldOutPatches]
    findings: tuple[Finding, ...]               # of charts and lights, beside each calibration's
    # certain veiling glare of the first chart photo, of its mean signal; K, or 1 for all bands
    glare: Annotated[np.ndarray, "J"]


@dataclass(frozen=True, eq=False)
class ReconstructionRecords(shaped.Record):
    """What the step "reconstruct" makes of a scene."""

    joint: scenes.JointReconstruction
    signals: SurfaceSignals
    placements: tuple[scenes.Placement, ...]    # of lamps and cameras that were estimated
    marked_views: tuple[scenes.MarkedView, ...]     # whose camera was estimated by marked corners
    # XML of the scenes of a measured box, by the first view of each; none of scenes in files
    box_scenes: dict[str, str]
    findings: tuple[Finding, ...] = ()          # of what the scenes state


@dataclass(frozen=True, eq=False)
class SignalRecords(shaped.Record):
    """What the step "signals" makes of flat samples."""

    signals: SurfaceSignals
    # by view that shows regions, of each: the light relative to the chart's mean, and its relative
    # error
    light: dict[str, dict[str, tuple[float, float]]]
    # by the same, of known regions that tell of the light: in standard errors
    level_misfits: dict[str, dict[str, float]]
    light_maps: dict[str, np.ndarray]           # by the same: light and error (2, H, W) over it
    findings: tuple[Finding, ...] = ()          # of samples in photos with the lamp moved


@dataclass(frozen=True, eq=False)
class PictureRecords(shaped.Record):
    """What the step "picture" makes beside its files; shares are of the pixels."""

    files: tuple[str, ...]                      # names in the stage's folder
    titles: tuple[str, ...]                     # of the maps
    previews: tuple[str, ...]                   # reduced PNGs of the maps
    size_px: tuple[int, ...]                    # width and height
    masked: float                               # without a spectrum
    beyond_white: float                         # brighter than white for certain
    novel: float                                # unlike what the prior was learnt from
    flag_shares: Annotated[np.ndarray, "F"]     # by measure.pictures.pixel_flags
    standard_deviation: float                   # mean over wavelengths and pixels
    # largest relative change of the light in each round in which light and spectra converged
    rounds: Annotated[np.ndarray, "I"] | None = None
    findings: tuple[Finding, ...] = ()          # of its photos and its light

    @property
    def reasons(self) -> list[tuple[str, str, float]]:
        """Words, colour on the map and share of every reason for which a pixel has no spectrum."""
        return [(words, f"#{bytes(colour).hex()}", share)
                for code, (words, colour, share) in enumerate(
                    zip(pixel_flags.WORDS, pixel_flags.COLOURS.tolist(),
                        self.flag_shares.tolist(), strict=True))
                if code != pixel_flags.SEEN and share > 0]

    def facts(self, folder: str) -> dict[str, Any]:
        """What is known of it, as plain numbers; its files are named as they lie in the folder."""
        return {"files": [PurePosixPath(folder, name).as_posix() for name in self.files],
                "size_px": list(self.size_px), "masked": self.masked,
                "masked_because": {words: share for words, _, share in self.reasons},
                "beyond_white": self.beyond_white, "unlike": self.novel,
                "standard_deviation": self.standard_deviation,
                "notes": [texts.says(one) for one in self.findings]}


class CaptureRecords:
    """What the steps of a measurement have made, each record read once, when it is asked for.

    Parameters
    ----------
    kept : mapping
        By the names of steps, each in memory or on disk; more may come while a measurement runs.
    """

    def __init__(self, kept: Mapping[str, Record | KeptRecord]) -> None:
        self._kept = kept

    def _read(self, step: str, kind: type[Kind]) -> Kind:
        kept = self._kept[step]
        return kept.read(kind) if isinstance(kept, KeptRecord) else cast(Kind, kept)

    @cached_property
    def charts(self) -> dict[str, MeasuredChart]:
        """By view, those that have a chart; none where none is needed."""
        return self._read("chart", dict[str, MeasuredChart]) if "chart" in self._kept else {}

    @cached_property
    def photo(self) -> PhotoRecords:
        return self._read("photo", PhotoRecords)

    @cached_property
    def calibrate(self) -> CalibrationRecords:
        return self._read("calibrate", CalibrationRecords)

    @cached_property
    def reconstruct(self) -> ReconstructionRecords:
        """Of a scene."""
        return self._read("reconstruct", ReconstructionRecords)

    @cached_property
    def flat_signals(self) -> SignalRecords:
        """What the step "signals" made, of flat samples alone."""
        return self._read("signals", SignalRecords)

    @cached_property
    def spectra(self) -> dict[str, SpectrumSummary]:
        """By surface, those that are not known."""
        return self._read("sample", dict[str, SpectrumSummary])

    @cached_property
    def picture(self) -> PictureRecords | None:
        """None where no picture was asked for."""
        return self._read("picture", PictureRecords) if "picture" in self._kept else None

    @property
    def signals(self) -> SurfaceSignals:
        """Of all surfaces, with their errors: where flat samples and scenes end alike."""
        return self.flat_signals.signals if "signals" in self._kept else self.reconstruct.signals

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What the steps up to the signals found, each once, but what is with a chart or a fit."""
        of_signals = self.flat_signals.findings if "signals" in self._kept else ()
        of_scene = self.reconstruct.findings if "reconstruct" in self._kept else ()
        of_charts = (one for chart in self.charts.values() for one in chart.of_files)
        return each_once((*of_charts, *self.photo.findings, *of_signals, *of_scene))

    def calibrations(self, views: tuple[captured.View, ...]) -> list[calibration.Calibration]:
        """The calibration of every view, in their order."""
        return [self.calibrate.calibrations[view.name] for view in views]
