"""The order of the stages, what each was made from, and which must be run again."""
from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.light_drift import LightDrift
from spectrabox.radiometry.records import (
    Calibration,
    ChartDetection,
    JointReconstruction,
    LinearImage,
    PatchSamples,
    Reconstruction,
    SpectrumSummary,
)
from spectrabox.sampling.measurement import SpectralSamples
from spectrabox.session.config.session_schema import SessionConfig, Shot
from spectrabox.session.keys import Key, as_stored, stage_keys
from spectrabox.session.stages.calibrate_stage import calibrate_shots
from spectrabox.session.stages.photo_stages import bin_object_photos, find_and_sample_charts
from spectrabox.session.stages.reconstruct_stage import drift_of_light, invert_photos
from spectrabox.session.stages.sample_stage import sample_materials
from spectrabox.session.store.store import (
    StoredStage,
    load_stage,
    save_stage,
    stage_folder,
    why_stale,
)

TRACE = ".trace.npz"      # in the results, while a trace goes on and where it was stopped
STAGES = ("chart", "photo", "calibrate", "reconstruct", "sample")
Progress = Callable[[str, float, str], None]


@dataclass(frozen=True)
class StageState:
    """Where one stage stands: "done", "stale" (with reasons), "missing" or "not needed"."""

    name: str
    state: str
    reasons: tuple[str, ...]
    seconds: float | None


@dataclass(frozen=True)
class FinishedRun:
    """The stages of a run: stored results by name, and which were made now ("run") or found right
    ("kept").
    """

    stored: dict[str, StoredStage]
    states: dict[str, str]


def stage_states(config: SessionConfig) -> list[StageState]:
    """How far a session has come, and why any stage must be run again."""
    keys, states = stage_keys(config), []
    for name in STAGES:
        stored = load_stage(results_folder(config), name)
        if name not in keys:
            states.append(StageState(name, "not needed", (), None))
        elif stored is None:
            states.append(StageState(name, "missing", (), None))
        else:
            reasons = tuple(why_stale(stored.key, as_stored(keys[name])))
            states.append(StageState(name, "stale" if reasons else "done", reasons, stored.seconds))
    return states


def run_stages(config: SessionConfig, *, device: str, only: str | None, force: bool,
               progress: Progress) -> FinishedRun:
    """Run every stage whose inputs changed; results are replaced stage by stage, each whole.

    Parameters
    ----------
    device : {"auto", "cpu", "cuda"}
    only : str or None
        Run this stage alone, on the stored results of those before it.
    force : bool
        Run also what is up to date.
    progress : callable of (stage, fraction, message)

    Raises
    ------
    InputError
        If ``only`` names no stage of this session, or a stage before it is not up to date.
    """
    keys = stage_keys(config)
    if only is not None and only not in keys:
        raise InputError(f"there is no stage {only!r} in this session; it has {', '.join(keys)}")
    finished = FinishedRun({}, {})
    for name, key in keys.items():
        stored = load_stage(results_folder(config), name)
        fresh = stored is not None and stored.key == as_stored(key)
        if only is not None and name != only:
            if stored is not None and (fresh or STAGES.index(name) > STAGES.index(only)):
                finished.stored[name], finished.states[name] = stored, "kept" if fresh else "stale"
            elif STAGES.index(name) < STAGES.index(only):
                raise InputError(f"stage {name!r}, which comes before {only!r}, is not up to date: "
                                 "run without --only")
            continue
        wanted = force and only in (None, name)
        if stored is not None and fresh and not wanted:
            finished.stored[name], finished.states[name] = stored, "kept"
            progress(name, 1.0, "up to date")
        else:
            finished.stored[name] = _run_stage(config, name, key, device, finished.stored, progress)
            finished.states[name] = "run"
    return finished


def load_finished(config: SessionConfig) -> FinishedRun:
    """Stored results of all stages.

    Raises
    ------
    InputError
        If a stage has none.
    """
    stored = {name: load_stage(results_folder(config), name) for name in STAGES
              if name != "chart" or config.chart_shots}
    missing = [name for name, stage in stored.items() if stage is None]
    if missing:
        raise InputError(f"no results of stage {missing[0]!r} yet: run 'spectrabox run' first")
    return FinishedRun({name: stage for name, stage in stored.items() if stage is not None},
                       dict.fromkeys(stored, "kept"))


def results_folder(config: SessionConfig) -> Path:
    """Where the stages of a session keep their results."""
    return config.folder / "results"


def calibration_of(stored: dict[str, StoredStage]) -> Calibration:
    """The calibration of a finished run."""
    calibration: Calibration = stored["calibrate"].record(Calibration, "calibration")
    return calibration


def calibrations_of(config: SessionConfig, stored: dict[str, StoredStage]) -> list[Calibration]:
    """The calibration of every shot."""
    return [stored["calibrate"].record(Calibration, shot.record("calibration"))
            for shot in config.shots]


def joint_of(stored: dict[str, StoredStage]) -> JointReconstruction:
    """The reconstruction from all photos of a finished run."""
    joint: JointReconstruction = stored["reconstruct"].record(JointReconstruction, "joint")
    return joint


def reconstruction_of(stored: dict[str, StoredStage]) -> Reconstruction:
    """What the reconstruction says of the first photo."""
    return joint_of(stored).views[0]


def photo_of(stored: dict[str, StoredStage], shot: Shot | None = None) -> LinearImage:
    """The object photo at the render's size; of the first shot unless another is named."""
    photo: LinearImage = stored["photo"].record(LinearImage, shot.record("photo") if shot
                                                else "photo")
    return photo


def chart_of(stored: dict[str, StoredStage],
             shot: Shot | None = None) -> tuple[ChartDetection, PatchSamples, LinearImage] | None:
    """Detection, patch statistics and a thumbnail of the chart photo, where one was used."""
    detection, samples, thumbnail = (shot.record(kind) if shot else kind
                                     for kind in ("detection", "samples", "thumbnail"))
    stage = stored.get("chart")
    if stage is None or detection not in stage.facts["records"]:
        return None
    return (stage.record(ChartDetection, detection), stage.record(PatchSamples, samples),
            stage.record(LinearImage, thumbnail))


def samples_of(stored: dict[str, StoredStage], material: str) -> tuple[SpectralSamples,
                                                                       SpectrumSummary]:
    """Draws and summary of one unknown material."""
    stage = stored["sample"]
    return stage.record(SpectralSamples, f"samples {material}"), stage.record(SpectrumSummary,
                                                                              f"summary {material}")


def _drift(config: SessionConfig, stored: dict[str, StoredStage]) -> LightDrift | None:
    """Change of the light between the first chart photo and object photo, where both show
    references.
    """
    if not config.drift.chart_px:
        return None
    chart = chart_of(stored)
    assert chart is not None
    return drift_of_light(config, chart[2], stored["chart"].record(np.ndarray, "references"),
                          photo_of(stored), stored["photo"].record(np.ndarray, "references"))


def _chart_under_light(config: SessionConfig, stored: dict[str, StoredStage],
                       shot: Shot) -> tuple[ChartDetection, PatchSamples, LinearImage] | None:
    """The shot's own chart photo, else the first shot's where the light is the same."""
    first = config.shots[0]
    return chart_of(stored, shot) or (chart_of(stored, first) if shot.light == first.light
                                      else None)


def notes_of(stored: dict[str, StoredStage]) -> list[str]:
    """What the decoding of the photos found worth saying."""
    return [note for name in ("chart", "photo") if name in stored
            for note in stored[name].record(tuple[str, ...], "notes")]


def array_of(stage: StoredStage, name: str) -> np.ndarray | None:
    """A plain array that a stage stored."""
    array: np.ndarray | None = stage.record(np.ndarray, name)
    return array


def _run_stage(config: SessionConfig, name: str, key: Key, device: str,
               stored: dict[str, StoredStage],
               progress: Progress) -> StoredStage:
    start = time.perf_counter()
    progress(name, 0.0, "")

    def report(fraction: float, message: str) -> None:
        progress(name, fraction, message)

    with stage_folder(results_folder(config), name) as folder:
        if name == "chart":
            records = find_and_sample_charts(config, folder, report)
        elif name == "photo":
            records = bin_object_photos(config, folder, report)
        elif name == "calibrate":
            charts = [chart_of(stored, shot) for shot in config.shots]
            records = calibrate_shots(config, device, [chart and chart[1] for chart in charts],
                                      report)
        elif name == "reconstruct":
            charts = [_chart_under_light(config, stored, shot) for shot in config.shots]
            drift = _drift(config, stored)
            records = {"drift": drift, "joint": invert_photos(
                           config, device, [photo_of(stored, shot) for shot in config.shots],
                           calibrations_of(config, stored),
                           [chart and chart[2] for chart in charts], drift,
                           results_folder(config) / TRACE, report)}
        else:
            records = sample_materials(config, calibrations_of(config, stored), joint_of(stored),
                                       report)
        save_stage(folder, as_stored(key), records, time.perf_counter() - start, {"stage": name})
    finished = load_stage(results_folder(config), name)
    assert finished is not None
    progress(name, 1.0, f"{finished.seconds:.1f} s")
    return finished
