"""What the stages of a run stored, read back as records."""
from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from spectrabox.measure.scene.placements import SceneGeometry
from spectrabox.radiometry.records import (
    Calibration,
    ChartDetection,
    ChartWhite,
    HeldOutPatches,
    JointReconstruction,
    LinearImage,
    PatchSamples,
    PriorInfluence,
    Reconstruction,
    SpectrumSamples,
    SpectrumSummary,
    SurfaceSignals,
    SurfaceSpectrum,
)
from spectrabox.session.config.session_schema import SessionConfig, ViewInputs
from spectrabox.session.store.store import StoredStage


def photo_of(stored: Mapping[str, StoredStage], view: ViewInputs | None = None) -> LinearImage:
    """The object photo at the render's size; of the first view unless another is named."""
    photo: LinearImage = stored["photo"].record(LinearImage,
                                                view.record("photo") if view else "photo")
    return photo


def chart_of(stored: Mapping[str, StoredStage], view: ViewInputs | None = None
             ) -> tuple[ChartDetection, PatchSamples, LinearImage] | None:
    """Detection, patch statistics and a thumbnail of the chart photo, where one was used."""
    detection, samples, thumbnail = (view.record(kind) if view else kind
                                     for kind in ("detection", "samples", "thumbnail"))
    stage = stored.get("chart")
    if stage is None or detection not in stage.facts["records"]:
        return None
    return (stage.record(ChartDetection, detection), stage.record(PatchSamples, samples),
            stage.record(LinearImage, thumbnail))


def reference_signals(stage: StoredStage) -> np.ndarray:
    """Signals (Q, K) of the neutral references in the first view's chart photo or object photo."""
    signals: np.ndarray = stage.record(np.ndarray, "references")
    return signals


def notes_of(stored: Mapping[str, StoredStage]) -> list[str]:
    """What the stages noted, each note once."""
    return [*dict.fromkeys(note for name in ("chart", "photo", "calibrate", "signals")
                           if name in stored
                           for note in stored[name].record(tuple[str, ...], "notes"))]


def calibrations_of(config: SessionConfig, stored: Mapping[str, StoredStage]) -> list[Calibration]:
    """The calibration of every view."""
    return [stored["calibrate"].record(Calibration, view.record("calibration"))
            for view in config.all_views]


def chart_fit_of(stored: Mapping[str, StoredStage]) -> tuple[np.ndarray, np.ndarray]:
    """Signals (I, K) that the calibration predicts for the first chart, and irradiance (I,)."""
    stage = stored["calibrate"]
    return stage.record(np.ndarray, "predicted"), stage.record(np.ndarray, "irradiance")


def chart_glare_of(stored: Mapping[str, StoredStage]) -> np.ndarray:
    """Veiling glare (K,) that the first chart photo shows for certain, of its mean signal."""
    glare: np.ndarray = stored["calibrate"].record(np.ndarray, "glare")
    return glare


def left_out_of(stored: Mapping[str, StoredStage]) -> HeldOutPatches | None:
    """The first chart's patches, each by a calibration without it; None without a chart photo."""
    patches: HeldOutPatches | None = stored["calibrate"].record(HeldOutPatches, "left out")
    return patches


def prior_influence_of(stored: Mapping[str, StoredStage]) -> PriorInfluence | None:
    """What of the camera's curves is the prior's; None where none was used."""
    standing: PriorInfluence | None = stored["calibrate"].record(PriorInfluence, "prior")
    return standing


def chart_white_of(stored: Mapping[str, StoredStage]) -> ChartWhite | None:
    """White, field and glare of the first chart photo, where the calibration fitted them."""
    white: ChartWhite | None = stored["calibrate"].record(ChartWhite, "white")
    return white


def joint_of(stored: Mapping[str, StoredStage]) -> JointReconstruction:
    """The reconstruction from all photos."""
    joint: JointReconstruction = stored["reconstruct"].record(JointReconstruction, "joint")
    return joint


def geometry_of(stored: Mapping[str, StoredStage]) -> SceneGeometry | None:
    """What of the scene was estimated; None where nothing was."""
    geometry: SceneGeometry = stored["reconstruct"].record(SceneGeometry, "geometry")
    return geometry if geometry.placements else None


def signals_of(stored: Mapping[str, StoredStage]) -> SurfaceSignals:
    """The signals of all surfaces, with their errors, of flat samples or of a scene."""
    stage = stored["signals"] if "signals" in stored else stored["reconstruct"]
    signals: SurfaceSignals = stage.record(SurfaceSignals, "signals")
    return signals


def reconstruction_of(stored: Mapping[str, StoredStage]) -> Reconstruction:
    """What the reconstruction says of the first photo."""
    return joint_of(stored).views[0]


def spectrum_of(stored: Mapping[str, StoredStage], name: str) -> SurfaceSpectrum:
    """What is known of the spectrum of one unknown surface."""
    stage = stored["sample"]
    return SurfaceSpectrum(*samples_of(stored, name), stage.record(dict, f"variance shares {name}"),
                           stage.record(dict, f"family shares {name}"))


def samples_of(stored: Mapping[str, StoredStage],
               material: str) -> tuple[SpectrumSamples, SpectrumSummary]:
    """Draws and summary of one unknown material."""
    stage = stored["sample"]
    return (stage.record(SpectrumSamples, f"samples {material}"),
            stage.record(SpectrumSummary, f"summary {material}"))
