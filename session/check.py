"""Read every input of a session and say everything that is wrong with it at once."""
from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.calibrate.geometry.lens_files import read_lens
from spectrabox.capture.chart.detection import find_chart
from spectrabox.capture.chart.patches import require_unclipped, sample_patches
from spectrabox.capture.develop.developed import open_any
from spectrabox.capture.photo.metadata import photo_metadata
from spectrabox.capture.photo.regions import sample_regions
from spectrabox.radiometry.chart import typical_camera_signals
from spectrabox.radiometry.errors import EnvironmentProblem, InputError, SpectraboxError
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.records import LinearImage
from spectrabox.radiometry.spectra.kept_cameras import known_camera
from spectrabox.radiometry.system.free_memory import free_memory
from spectrabox.reconstruct.scene.scene_file import require_same_shape
from spectrabox.session.config.session_chart import session_chart
from spectrabox.session.config.session_file import missing_files, try_read_session
from spectrabox.session.config.session_schema import SessionConfig, ViewInputs
from spectrabox.session.pipeline import run_stages, stage_states
from spectrabox.session.stages.inputs import (
    chart_corners,
    power_of,
    read_chart_reference,
    read_filter,
    read_light,
    read_light_of,
    read_photo,
    read_reflectance,
    read_sensitivities,
    require_curves_of_bands,
    require_exposed,
)
from spectrabox.session.stages.order import stages_of
from spectrabox.session.stages.reconstruct_stage import require_invertible
from spectrabox.session.stages.scenes import (
    read_chart_scene,
    read_session_scene,
    require_materials,
)
from spectrabox.session.store.store import load_stage

LONG_STAGES = ("reconstruct", "sample")     # the first of them that a session has is not run
DEVICE = "cpu"
Attempt = Callable[..., Any]


@dataclass(frozen=True)
class Problem:
    """One thing that is wrong, and the exit code that it means."""

    sentence: str
    exit_code: int


@dataclass(frozen=True)
class CheckResult:
    """What a run of a session would meet."""

    problems: list[Problem]     # each sentence once, in the order of the inputs
    # that tracing will take besides the program; None where nothing is left to trace, or unknown
    tracing_bytes: int | None
    # by whose curves the first photo's camera is known, where the session takes them from a chart
    known_camera: str | None = None

    @property
    def sentence(self) -> str:
        """What tracing will take of the memory that is free; empty where that is not known."""
        if self.tracing_bytes is None:
            return ""
        free = free_memory()
        of_all = "" if free is None else f" of the {free / 2**30:.1f} GiB that are free"
        return f"tracing light will take about {self.tracing_bytes / 2**20:.0f} MiB{of_all}"


def preflight_check(folder: Path, allow_outside: bool = False, device: str = DEVICE,
                    shared: Path | None = None) -> CheckResult:
    """Everything that would stop or spoil a run of this session, and what it will take.

    Parameters
    ----------
    allow_outside : bool
        Whether the session may name files outside its folder.
    device : {"auto", "cpu", "cuda"}
        Where what comes before the long stages is rendered.
    shared : Path, optional
        As of ``run_stages``.
    """
    problems: list[Problem] = []
    config, sentences = try_read_session(folder, allow_outside)
    problems += [Problem(sentence, InputError.exit_code) for sentence in sentences]
    if folder.is_dir() and not os.access(folder, os.W_OK):
        problems.append(Problem(f"{folder} cannot be written: change its permissions",
                                EnvironmentProblem.exit_code))
    missing = missing_files(folder)
    problems += [Problem(sentence, InputError.exit_code) for sentence in missing.values()]
    if config is None:
        return CheckResult(problems, None)

    def attempt(read: Callable[..., Any], *arguments: Any) -> Any:
        """The result, or None with the problem noted."""
        try:
            return read(*arguments)
        except SpectraboxError as error:
            problems.extend(Problem(sentence, error.exit_code)
                            for sentence in str(error).splitlines()
                            if sentence not in [problem.sentence for problem in problems]
                            and not any(str(path) in sentence for path in missing))
            return None

    _attempt_inputs(config, attempt)
    tracing_bytes = None if problems else attempt(_run_up_to_tracing, config, device, shared)
    if problems:        # a stage stops at its first fault: say those of the other photos too
        _attempt_photos(config, attempt)
    return CheckResult(problems, tracing_bytes, _known_camera(config))


def _known_camera(config: SessionConfig) -> str | None:
    """Name of the first photo's camera, where its curves are known and a chart's are taken."""
    first = config.path(config.all_views[0].photo_files[0])
    if not (config.sensitivity.from_chart and first.is_file()):
        return None
    metadata = readable(photo_metadata, first)
    return None if metadata is None else known_camera(metadata.camera)


def _attempt_inputs(config: SessionConfig, attempt: Attempt) -> None:
    """Read all but the photos."""
    for surface in config.surfaces.values():
        for table in (surface.measured, surface.truth):
            if table is not None:
                attempt(read_reflectance, config, table)
    if not config.sensitivity.from_chart:
        attempt(read_sensitivities, config)
        attempt(require_curves_of_bands, config)
    if config.views_with_chart:
        attempt(read_chart_reference, config)
        attempt(read_chart_scene, config)
    if config.camera.lens is not None:
        attempt(lambda: read_lens(config.path(config.camera.lens or "")))
    for view in config.all_views:
        for spectrum in view.all_lights:
            attempt(read_light, config, spectrum)
        if view.filter is not None:
            attempt(read_filter, config, view.filter)
        scene = None if config.flat else attempt(read_session_scene, config, view)
        if scene is not None:
            attempt(require_materials, scene, config.bsdfs)


def _attempt_photos(config: SessionConfig, attempt: Attempt) -> None:
    """Decode every photo and look for what the stages would refuse.

    Of a photo whose flat field or dark frame is at fault, its own faults are looked for without it.
    """
    photos = config.photos
    alone = config.model_copy(update={"photos": photos.model_copy(update={"flat": None,
                                                                          "dark": None})})
    frames = [*photos.flats.values(), *photos.dark_files]
    for name in (*frames, *(name for view in config.all_views
                            for name in (*view.photo_files, *view.chart_files))):
        attempt(lambda name: open_any(config.path(name), photos.not_linear), name)

    def developed_photo(photo: dict[str, tuple[str, ...]]) -> LinearImage | None:
        developed = attempt(read_photo, config, photo) or readable(read_photo, alone, photo)
        return None if developed is None else developed[0]

    for view in config.all_views:
        scene = None if config.flat else readable(read_session_scene, config, view)
        if (photo := developed_photo(view.photo)) is not None:
            attempt(require_exposed, photo, view.photo_files[0])
            for name, region in config.regions_in(view).items():
                attempt(sample_regions, photo, {name: region.outline()})
            if scene is not None:
                attempt(require_same_shape, photo, scene, view.photo_files[0])
        light = readable(read_light_of, config, view)
        chart_signals = readable(read_chart_reference, config)
        if view.chart and (chart := developed_photo(view.chart)) is not None \
                and light is not None and chart_signals is not None:
            attempt(require_chart, config, view, chart,
                    typical_camera_signals(chart_signals, FINE_GRID, power_of(light)))


def readable(read: Callable[..., Any], *arguments: Any) -> Any:
    """What a reader gives, or None where it refuses its input: that is said elsewhere."""
    try:
        return read(*arguments)
    except SpectraboxError:
        return None


def _run_up_to_tracing(config: SessionConfig, device: str, shared: Path | None) -> int | None:
    """Run the short stages as a run does, which then keeps them, and what the long ones ask before
    they begin; bytes that tracing will take, where something is left to trace.
    """
    long = next(name for name in stages_of(config) if name in LONG_STAGES)
    if load_stage(config.results_folder, long) is not None and any(
            state.name == long and state.state == "done" for state in stage_states(config)):
        return None
    finished = run_stages(config, device=device, only=None, force=False,
                          progress=lambda stage, done, what: None, before=long, shared=shared)
    if config.flat:
        return None
    return require_invertible(config, finished.records, device)


def require_chart(config: SessionConfig, view: ViewInputs, chart: LinearImage,
                  signals: np.ndarray) -> None:
    """Refuse a photo that shows no chart, or a clipped one.

    Parameters
    ----------
    config : SessionConfig
    view : ViewInputs
        Whose chart photo it is.
    chart : LinearImage
    signals : (I, 3) array
        That an ordinary camera would read off the chart.

    Raises
    ------
    InputError, CheckError
    """
    layout = session_chart(config)
    detection = find_chart(chart, signals, chart_corners(config, view), layout)
    require_unclipped(sample_patches(chart, detection), layout.names, view.chart_files[0],
                      layout.neutrals, bands_may_drop=config.flat)
