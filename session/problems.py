"""Read every input of a session and say everything that is wrong with it at once."""
from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from spectrabox.capture.chart.patches import require_unclipped, sample_patches
from spectrabox.capture.develop.developed import open_any
from spectrabox.capture.photo.metadata import photo_metadata
from spectrabox.capture.photo.regions import sample_regions
from spectrabox.measure import captured, opened_photos
from spectrabox.measure.scene.box_camera import scene_of
from spectrabox.measure.shoot.captures import capture_with_faults
from spectrabox.measure.steps import declared_steps, inversion
from spectrabox.measure.steps.photos import find_stated_chart
from spectrabox.radiometry import errors
from spectrabox.radiometry.findings import Finding, each_once
from spectrabox.radiometry.records.photos import LinearImage
from spectrabox.radiometry.spectra.cameras import known_camera
from spectrabox.radiometry.system.archives import free_memory
from spectrabox.reconstruct.scene.scene_file import SceneFile, require_same_shape
from spectrabox.session import kept_stages, pipeline
from spectrabox.session.config.session_file import SessionConfig, try_read_session
from spectrabox.session.store.record_files import load_stage

LONG_STAGES = ("reconstruct", "sample")     # the first of them that a session has is not run
DEVICE = "cpu"
Attempt = Callable[..., Any]


@dataclass(frozen=True)
class CheckResult:
    """What a run of a session would meet."""

    problems: dict[str, int]    # sentences in the order of the inputs, with the exit code of each
    # by which a scene will be inverted, the seconds of processor that it will take, and the memory
    # of tracing besides the program; None where nothing is left to invert, or unknown
    engine: str | None = None
    seconds: float | None = None
    tracing_bytes: int | None = None
    # of what the scenes state: what is not kept, and how their lights are taken
    findings: tuple[Finding, ...] = ()
    # by whose curves the first photo's camera is known, where the session takes them from a chart
    known_camera: str | None = None

    @property
    def sentence(self) -> str:
        """How long the inversion will take, and what tracing of the memory that is free; empty
        where that is not known.
        """
        if self.seconds is None:
            return ""
        seconds = f"{self.seconds:.0f} s of processor"
        if self.tracing_bytes is None:
            return f"the descent through the renderer will take at most about {seconds}"
        free = free_memory()
        of_all = "" if free is None else f" of the {free / 2**30:.1f} GiB that are free"
        return (f"tracing light will take about {self.tracing_bytes / 2**20:.0f} MiB{of_all}, and "
                f"with the fit about {seconds}")


def check_session(folder: Path, allow_outside: bool = False, device: str = DEVICE,
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
    config, sentences = try_read_session(folder, allow_outside)
    problems = dict.fromkeys(sentences, errors.InputError.exit_code)
    if folder.is_dir() and not os.access(folder, os.W_OK):
        problems[f"{folder} cannot be written: change its permissions"] = \
            errors.EnvironmentProblem.exit_code
    if config is None:
        return CheckResult(problems)

    def attempt(read: Callable[..., Any], *arguments: Any) -> Any:
        """The result, or None with the problem noted."""
        try:
            return read(*arguments)
        except errors.SpectraboxError as error:
            for fault in error.faults:
                problems.setdefault(fault, error.exit_code)
            return None

    capture, faults = capture_with_faults(config, config.inputs)
    for fault in faults:
        attempt(_refuse, fault)
    _attempt_together(capture, attempt)
    scenes = [*_scenes(capture, attempt).values(), capture.chart_scene]
    findings = [one for scene in scenes if scene is not None for one in scene.left_out]
    engine = seconds = tracing_bytes = None
    if not problems and (foreseen := attempt(_run_up_to_tracing, config, device, shared)):
        engine, seconds, tracing_bytes, of_lights = foreseen
        findings += of_lights
    if problems:        # a stage stops at its first fault: say those of the other photos too
        _attempt_photos(capture, attempt)
    return CheckResult(problems, engine, seconds, tracing_bytes, each_once(findings),
                       _known_camera(config))


def _known_camera(config: SessionConfig) -> str | None:
    """Name of the first photo's camera, where its curves are known and a chart's are taken."""
    first = config.path(config.all_views[0].photo_files[0])
    if not (config.sensitivity.from_chart and first.is_file()):
        return None
    metadata = readable(photo_metadata, first)
    return None if metadata is None else known_camera(metadata.camera)


def _refuse(fault: errors.SpectraboxError) -> None:
    raise fault


def _attempt_together(capture: captured.Capture, attempt: Attempt) -> None:
    """Look for inputs that were each read and do not go together; what could not be read is None in
    the capture.
    """
    files = [file for view in capture.views for file in captured.files_of(view.photo)]
    if capture.sensitivity is not None and all(
            file.path is not None and file.path.is_file() for file in files):
        attempt(opened_photos.require_curves_of_bands, capture)
    for scene in _scenes(capture, attempt).values():
        attempt(inversion.require_materials, scene, capture.bsdfs)


def _scenes(capture: captured.Capture, attempt: Attempt) -> dict[str, SceneFile]:
    """The scenes of photos that can be made, by view."""
    scenes = {name: attempt(scene_of, stated) for name, stated in capture.scenes.items()
              if stated is not None}
    return {name: scene for name, scene in scenes.items() if scene is not None}


def _attempt_photos(capture: captured.Capture, attempt: Attempt) -> None:
    """Decode every photo and look for what the steps would refuse.

    Of a photo whose flat field or dark frame is at fault, its own faults are looked for without it.
    Parts of the capture that could not be read are None, and nothing is asked of them.
    """
    alone = dataclasses.replace(capture, flat_fields={}, dark_frames=())
    for file in (*capture.flat_fields.values(), *capture.dark_frames,
                 *(file for view in capture.views
                   for file in (*captured.files_of(view.photo), *captured.files_of(view.chart)))):
        if file.path is not None:
            attempt(open_any, file.path, capture.not_linear)

    def developed_photo(photo: captured.PhotoFiles) -> LinearImage | None:
        if any(file.path is None for file in captured.files_of(photo)):
            return None
        developed = attempt(opened_photos.develop, capture, photo) or readable(
            opened_photos.develop, alone, photo)
        return None if developed is None else developed[0]

    scenes = _scenes(capture, attempt)
    for view in capture.views:
        photo = developed_photo(view.photo)
        if photo is not None:
            attempt(opened_photos.require_exposed, photo, view.photo_names[0])
            for name, region in capture.regions_in(view).items():
                attempt(sample_regions, photo, {name: region.outline})
            if view.name in scenes:
                attempt(require_same_shape, photo, scenes[view.name], view.photo_names[0])
        if view.chart and capture.chart is not None:
            chart = developed_photo(view.chart)
            if chart is not None:
                attempt(require_chart, capture, view, chart)


def readable(read: Callable[..., Any], *arguments: Any) -> Any:
    """What a reader gives, or None where it refuses its input: that is said elsewhere."""
    try:
        return read(*arguments)
    except errors.SpectraboxError:
        return None


def _run_up_to_tracing(config: SessionConfig, device: str, shared: Path | None
                       ) -> tuple[str, float, int | None, tuple[Finding, ...]] | None:
    """Run the short stages as a run does, which then keeps them, and what the long ones ask before
    they begin; what the inversion will take, where something is left to invert, and findings.
    """
    long = next(name for name in kept_stages.stage_names(config) if name in LONG_STAGES)
    if load_stage(config.results_folder, long) is not None \
            and kept_stages.stage_states(config, device=device)[long][0] == "done":
        return None
    finished = pipeline.run_stages(config, device=device, only=None, force=False,
                          progress=lambda stage, done, what: None, before=long, shared=shared)
    if long != declared_steps.INVERSION.name:
        return None
    capture = captured.require_scene(finished.capture, "only a scene is traced")
    return inversion.require_invertible(capture, finished.records, device)


def require_chart(capture: captured.Capture, view: captured.View, photo: LinearImage) -> None:
    """Refuse a photo that shows no chart, or a clipped one.

    Parameters
    ----------
    capture : Capture
    view : View
        Whose chart photo it is.
    photo : LinearImage

    Raises
    ------
    InputError, CheckError
    """
    detection, _ = find_stated_chart(capture, view, photo)
    require_unclipped(sample_patches(photo, detection), capture.layout.names, view.chart_names[0],
                      capture.layout.neutrals, bands_may_drop=capture.bands_may_drop)
