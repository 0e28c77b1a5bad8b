"""Read every input of a session and say everything that is wrong with it at once."""
from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.calibrate.geometry.lens_files import read_lens
from spectrabox.capture.chart.detection import find_chart
from spectrabox.capture.chart.patches import require_unclipped, sample_patches
from spectrabox.radiometry.chart import PATCH_NAMES, typical_camera_signals
from spectrabox.radiometry.errors import EnvironmentProblem, InputError, SpectraboxError
from spectrabox.radiometry.records import LinearImage
from spectrabox.radiometry.spectra.spectrum_files import spectrum_on_grid
from spectrabox.session.config.session_file import try_read_session
from spectrabox.session.config.session_schema import SessionConfig, SpectrumTable, ViewInputs
from spectrabox.session.keys import stage_keys
from spectrabox.session.stages.inputs import (
    GRID,
    chart_corners,
    read_chart_reference,
    read_light,
    read_photo,
    read_reflectance,
    read_sensitivities,
    require_exposed,
)
from spectrabox.session.stages.order import STAGES
from spectrabox.session.stages.reconstruct_stage import require_invertible
from spectrabox.session.stages.scenes import (
    check_aspect,
    read_chart_scene,
    read_session_scene,
    require_materials,
)
from spectrabox.session.stages.stage_task import StageTask
from spectrabox.session.store.input_files import InputFiles
from spectrabox.session.store.store import StoredStage, load_stage, save_stage, stage_folder

LONG_STAGE, DEVICE = "reconstruct", "cpu"


@dataclass(frozen=True)
class Problem:
    """One thing that is wrong, and the exit code that it means."""

    sentence: str
    exit_code: int


def find_problems(folder: Path, allow_outside: bool = False) -> list[Problem]:
    """Everything that would stop or spoil a run of this session; empty when it is ready.

    Parameters
    ----------
    allow_outside : bool
        Whether the session may name files outside its folder.

    Returns
    -------
    list of Problem
        Each sentence once, in the order of the inputs.
    """
    problems: list[Problem] = []
    config, sentences = try_read_session(folder, allow_outside)
    problems += [Problem(sentence, InputError.exit_code) for sentence in sentences]
    if folder.is_dir() and not os.access(folder, os.W_OK):
        problems.append(Problem(f"{folder} cannot be written: change its permissions",
                                EnvironmentProblem.exit_code))
    if config is None:
        return problems

    def attempt(read: Callable[..., Any], *arguments: Any) -> Any:
        """The result, or None with the problem noted."""
        try:
            return read(*arguments)
        except SpectraboxError as error:
            problems.extend(Problem(sentence, error.exit_code)
                            for sentence in str(error).splitlines()
                            if sentence not in [problem.sentence for problem in problems])
            return None

    for reference in _reflectances(config):
        attempt(read_reflectance, config, reference)
    if not config.sensitivity.from_chart:
        attempt(read_sensitivities, config)
    chart_signals = None
    if config.views_with_chart:
        attempt(read_chart_scene, config)
        chart_signals = attempt(read_chart_reference, config)
    bsdfs = {name: material.bsdf for name, material in config.materials.items()}
    if config.camera.lens is not None:
        attempt(lambda: read_lens(config.path(config.camera.lens or "")))
    for view in config.all_views:
        light, scene = attempt(read_light, config, view.light), attempt(read_session_scene, config,
                                                                        view.scene)
        if scene is not None:
            attempt(require_materials, scene, bsdfs)
        for spectrum in view.all_lights[1:]:
            attempt(read_light, config, spectrum)
        if (developed := attempt(read_photo, config, view.photo)) is not None:
            attempt(require_exposed, developed[0], view.photo_files[0])
            if scene is not None:
                attempt(check_aspect, developed[0], scene, view.photo_files[0])
        if view.chart and (chart := attempt(read_photo, config, view.chart)) is not None \
                and light is not None and chart_signals is not None:
            attempt(_check_chart, config, view, chart[0],
                    typical_camera_signals(chart_signals, GRID, spectrum_on_grid(light, GRID)))
    if not problems:
        attempt(_run_up_to_tracing, config)
    return problems


def _run_up_to_tracing(config: SessionConfig) -> None:
    """Run the short stages as a run does, in a folder that vanishes, and what the long ones ask
    before they begin.
    """
    stored: dict[str, StoredStage] = {}
    with tempfile.TemporaryDirectory() as folder:
        keys = stage_keys(config, InputFiles(config))
        for name in takewhile(lambda name: name != LONG_STAGE, keys):
            with stage_folder(Path(folder), name) as new:
                task = StageTask(config, DEVICE, stored, new, lambda done, what: None)
                save_stage(new, {}, STAGES[name].run(task), 0.0, {})
            finished = load_stage(Path(folder), name)
            assert finished is not None
            stored[name] = finished
        require_invertible(config, stored, DEVICE)


def _reflectances(config: SessionConfig) -> list[SpectrumTable]:
    both = [(material.known, material.truth) for material in config.materials.values()]
    return [reference for pair in both for reference in pair if reference is not None]


def _check_chart(config: SessionConfig, view: ViewInputs, chart: LinearImage,
                 signals: np.ndarray) -> None:
    detection = find_chart(chart, signals, chart_corners(config, view))
    require_unclipped(sample_patches(chart, detection), PATCH_NAMES, view.chart_files[0])
