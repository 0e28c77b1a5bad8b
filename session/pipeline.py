"""Which stages of a session must be run again, and running them."""
from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.files import sha256_of
from spectrabox.session.config.session_schema import FILE_NAME, SessionConfig
from spectrabox.session.keys import Key, stage_keys
from spectrabox.session.stages.inputs import OpenPhotos
from spectrabox.session.stages.order import stages_of
from spectrabox.session.stages.records import SessionRecords
from spectrabox.session.stages.stage_task import StageTask
from spectrabox.session.store.input_files import InputFiles
from spectrabox.session.store.shared_stages import share_stage, shared_stage
from spectrabox.session.store.store import (
    ARRAYS,
    FACTS,
    StoredStage,
    copy_stage,
    fingerprint,
    load_stage,
    save_stage,
    stage_folder,
    why_stale,
)
from spectrabox.session.terminal.progress_display import StageProgress


@dataclass(frozen=True)
class StageState:
    """Where one stage stands: "done", "stale" (with reasons), "missing" or "not needed"."""

    name: str
    state: str
    reasons: tuple[str, ...]
    seconds: float | None


@dataclass(frozen=True)
class FinishedRun:
    """Stored results of a run's stages by name, with their states: computed now ("run"), copied
    from another session with the same inputs ("copied") or up to date before ("kept").
    """

    stored: dict[str, StoredStage]
    states: dict[str, str]

    @cached_property
    def records(self) -> SessionRecords:
        """What the stages stored, read when it is asked for."""
        return SessionRecords(self.stored)

    def result_digests(self) -> dict[str, str]:
        """SHA-256 of the stored results of all stages, by their names below the results' folder."""
        return {f"{name}/{part}": sha256_of(stage.folder / part)
                for name, stage in self.stored.items() for part in (FACTS, ARRAYS)}

    def input_digests(self, config: SessionConfig) -> dict[str, Any]:
        """Digests of all that a report depends on.

        Returns
        -------
        dict
            ``session``, ``files`` and ``results``: SHA-256 by name as seen from the session
            folder; ``stages``: the fingerprint of each stage's key.
        """
        files = {name: digest for stage in self.stored.values()
                 for name, digest in stage.key.get("files", {}).items()}
        folder = config.results_folder.relative_to(config.folder).as_posix()
        return {"session": {FILE_NAME: config.toml_sha256}, "files": files,
                "results": {f"{folder}/{name}": digest
                            for name, digest in self.result_digests().items()},
                "stages": {name: fingerprint(stage.key) for name, stage in self.stored.items()}}


def stage_states(config: SessionConfig) -> list[StageState]:
    """How far a session has come, and why any stage must be run again.

    Returns
    -------
    list of StageState
        Of all stages, in order.
    """
    keys = stage_keys(config, InputFiles(config))
    states = [] if "chart" in keys else [StageState("chart", "not needed", (), None)]
    for name, key in keys.items():
        stored = load_stage(config.results_folder, name)
        if stored is None:
            states.append(StageState(name, "missing", (), None))
        else:
            reasons = tuple(why_stale(stored.key, key)) if stored.fault is None \
                else (f"its stored results {stored.fault}",)
            states.append(StageState(name, "stale" if reasons else "done", reasons, stored.seconds))
    return states


def warn_of_stale_stages(config: SessionConfig, tell: Callable[[str], None]) -> list[str]:
    """Names of the stages whose stored results are of other inputs than the session has now.

    Parameters
    ----------
    config : SessionConfig
    tell : function of a sentence
        Warns whoever is shown these results all the same.
    """
    try:
        stale = [state for state in stage_states(config) if state.state == "stale"]
    except InputError as error:
        tell(f"warning: whether results are up to date is not known: {error}")
        return []
    if stale:
        tell(f"warning: stored results are of an earlier run ({stale[0].name}: "
             f"{', '.join(stale[0].reasons)}): 'spectrabox run {config.folder.name}' brings them "
             "up to date")
    return [state.name for state in stale]


def run_stages(config: SessionConfig, *, device: str, only: str | None, force: bool,
               progress: StageProgress, before: str | None = None,
               shared: Path | None = None) -> FinishedRun:
    """Run every stage whose inputs changed; results are replaced stage by stage, each whole.

    Parameters
    ----------
    device : {"auto", "cpu", "cuda"}
    only : str or None
        Run this stage alone, on the stored results of those before it.
    force : bool
        Run also what is up to date.
    before : str, optional
        Stage at which to stop, itself not run.
    shared : Path, optional
        Folder where sessions that have a calibration in common keep it.

    Raises
    ------
    InputError
        If ``only`` names no stage of this session, or a stage before it is not up to date.
    """
    inputs = InputFiles(config)
    keys = stage_keys(config, inputs)
    order = list(keys)
    if only is not None and only not in keys:
        raise InputError(f"there is no stage {only!r} in this session; it has {', '.join(keys)}")
    finished, photos = FinishedRun({}, {}), OpenPhotos()
    for name, key in keys.items():
        if name == before:
            break
        stored = load_stage(config.results_folder, name)
        fresh = stored is not None and not stored.fault and stored.key == key
        if only is not None and name != only:
            later = order.index(name) > order.index(only)
            if stored is not None and not stored.fault and (fresh or later):
                finished.stored[name] = stored
                finished.states[name] = "kept" if fresh else "stale"
            elif not later:
                raise InputError(f"stage {name!r}, which comes before {only!r}, is not up to "
                                 "date: run without --only")
            continue
        if stored is not None and fresh and not (force and only in (None, name)):
            finished.stored[name], finished.states[name] = stored, "kept"
            progress(name, 1.0, "up to date")
            continue
        if stored is not None and stored.fault:
            progress(name, 0.0, f"run again: its stored results {stored.fault}")
        with shared_stage(shared, name, key) as other:
            if other is not None:
                stored = _store_stage(config, name, key, inputs, partial(copy_stage, other))
                progress(name, 1.0, "as another session made it")
            else:
                run = partial(_run_stage, config, name, key, device, finished.records, progress,
                              photos)
                stored = _store_stage(config, name, key, inputs, run)
                progress(name, 1.0, f"{stored.seconds:.1f} s")
                share_stage(shared, name, stored)
        finished.stored[name], finished.states[name] = stored, "copied" if other else "run"
    return finished


def load_finished(config: SessionConfig) -> FinishedRun:
    """Stored results of all stages.

    Raises
    ------
    InputError
        If a stage has none, or damaged ones.
    """
    stored = {name: load_stage(config.results_folder, name) for name in stages_of(config)}
    missing = [name for name, stage in stored.items() if stage is None]
    if missing:
        raise InputError(f"no results of stage {missing[0]!r} yet: run 'spectrabox run' first")
    for name, stage in stored.items():
        if stage is not None and stage.fault:
            raise InputError(f"the stored results of stage {name!r} {stage.fault}: 'spectrabox "
                             "run' makes them again")
    return FinishedRun({name: stage for name, stage in stored.items() if stage is not None},
                       dict.fromkeys(stored, "kept"))


def _store_stage(config: SessionConfig, name: str, key: Key, inputs: InputFiles,
                 fill: Callable[[Path], None]) -> StoredStage:
    """Results of a stage, which a function writes into an empty folder, in place of the old ones.
    """
    with stage_folder(config.results_folder, name) as folder:
        fill(folder)
        inputs.require_unchanged(key["files"])
    finished = load_stage(config.results_folder, name)
    assert finished is not None
    return finished


def _run_stage(config: SessionConfig, name: str, key: Key, device: str, records: SessionRecords,
               progress: StageProgress, photos: OpenPhotos, folder: Path) -> None:
    """Run a stage and save its record into a folder."""
    start = time.perf_counter()
    progress(name, 0.0, "")
    task = StageTask(config, device, records, folder, partial(progress, name), photos)
    record = stages_of(config)[name].run(task)
    save_stage(folder, key, record, time.perf_counter() - start, {"stage": name})
