"""What a session has kept of its stages, and which of it is up to date."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from spectrabox.measure.captured import Capture, FlatCapture, SceneCapture
from spectrabox.measure.records import CaptureRecords
from spectrabox.measure.steps.declared_steps import needed_steps
from spectrabox.radiometry.errors import InputError, SpectraboxError
from spectrabox.session.config.session_file import FILE_NAME, SessionConfig
from spectrabox.session.store import record_files
from spectrabox.session.store.keys import GPU, InputFiles, input_files, step_keys
from spectrabox.session.terminal.progress_display import StageProgress

# where each stage stands: "done", "stale", "missing" or "not needed", and why it is stale
StageStates = dict[str, tuple[str, tuple[str, ...]]]


@dataclass(frozen=True)
class FinishedRun:
    """Stored results of a run's stages by name, with their states: computed now ("run"), copied
    from another session with the same inputs ("copied") or up to date before ("kept").
    """

    capture: FlatCapture | SceneCapture
    stored: dict[str, record_files.StoredStage]
    states: dict[str, str]

    @cached_property
    def records(self) -> CaptureRecords:
        """What the stages stored, read when it is asked for."""
        return CaptureRecords(self.stored)

    def fingerprints(self) -> dict[str, str]:
        """What each stage was made from, as a fingerprint of its key."""
        return {name: record_files.fingerprint(stage.key) for name, stage in self.stored.items()}

    def input_digests(self, config: SessionConfig) -> dict[str, Any]:
        """Digests of all that a report depends on.

        Parameters
        ----------
        config : SessionConfig

        Returns
        -------
        dict
            ``session`` and ``files``: SHA-256 by name as seen from the session folder; ``stages``:
            the fingerprint of each stage's key.
        """
        return {"session": {FILE_NAME: config.toml_sha256},
                "files": InputFiles(config).digests(*input_files(config, self.capture)),
                "stages": self.fingerprints()}


def stage_states(config: SessionConfig, capture: Capture | None = None,
                 device: str | None = None) -> StageStates:
    """How far a session has come, and why any stage must be run again.

    Parameters
    ----------
    config : SessionConfig
    capture : Capture, optional
        Of the session, where it is read already.
    device : {"auto", "cpu", "cuda"}, optional
        That is to render; by default that of the stored results.

    Returns
    -------
    dict
        Of all stages, in order.
    """
    keys = step_keys(capture or config.capture(), InputFiles(config),
                     device or _device_kept(config))
    states: StageStates = {} if "chart" in keys else {"chart": ("not needed", ())}
    for name, key in keys.items():
        stored = record_files.load_stage(config.results_folder, name)
        if stored is None:
            states[name] = ("missing", ())
        else:
            reasons = tuple(record_files.why_stale(stored.key, key)) if stored.fault is None \
                else (f"its stored results {stored.fault}",)
            states[name] = ("stale" if reasons else "done", reasons)
    return states


def _device_kept(config: SessionConfig) -> str:
    """The device that rendered what is stored."""
    stored = [record_files.load_stage(config.results_folder, name) for name in stage_names(config)]
    return next((GPU for stage in stored if stage is not None
                 and stage.key.get("versions", {}).get("device") == GPU), "auto")


def states_without_inputs(config: SessionConfig) -> StageStates:
    """How far a session has come of which an input is missing: what is stored is of other inputs.

    Parameters
    ----------
    config : SessionConfig
    """
    return {name: ("missing", ()) if record_files.load_stage(config.results_folder, name) is None
            else ("stale", ("an input is missing",)) for name in stage_names(config)}


def warn_of_stale_stages(config: SessionConfig, capture: Capture,
                         tell: Callable[[str], None]) -> list[str]:
    """Names of the stages whose stored results are of other inputs than the session has now.

    Parameters
    ----------
    config : SessionConfig
    capture : Capture
        Of the session.
    tell : function of a sentence
        Warns whoever is shown these results all the same.
    """
    try:
        stale = {name: reasons for name, (state, reasons) in stage_states(config, capture).items()
                 if state == "stale"}
    except SpectraboxError as error:
        tell(f"warning: whether results are up to date is not known: {error}")
        return []
    if stale:
        first, reasons = next(iter(stale.items()))
        tell(f"warning: stored results are of an earlier run ({first}: "
             f"{', '.join(reasons)}): 'spectrabox run {config.folder.name}' brings them "
             "up to date")
    return list(stale)


def kept_run(config: SessionConfig, device: str, progress: StageProgress) -> FinishedRun | None:
    """Stored results of all stages where every one is up to date; None where something is to do.

    Parameters
    ----------
    config : SessionConfig
    device : {"auto", "cpu", "cuda"}
        Results of another are not up to date.
    progress : function of a stage, a share and a message
        Told that each is up to date.
    """
    capture = config.capture()
    stored = {}
    for name, key in step_keys(capture, InputFiles(config), device).items():
        stage = record_files.load_stage(config.results_folder, name)
        if stage is None or stage.fault or stage.key != key:
            return None
        stored[name] = stage
    for name in stored:
        progress(name, 1.0, "up to date")
    return FinishedRun(capture, stored, dict.fromkeys(stored, "kept"))


def load_finished(config: SessionConfig, before: FinishedRun | None = None) -> FinishedRun:
    """Stored results of all stages.

    Parameters
    ----------
    config : SessionConfig
    before : FinishedRun, optional
        Of the same configuration, read earlier. It is returned where nothing was stored since.

    Raises
    ------
    InputError
        If a stage has none, or damaged ones; or if an input file cannot be read.
    """
    stored = {
        name: record_files.load_stage(config.results_folder, name)
        for name in stage_names(config)
    }
    missing = [name for name, stage in stored.items() if stage is None]
    if missing:
        raise InputError(f"no results of stage {missing[0]!r} yet: run 'spectrabox run' first")
    for name, stage in stored.items():
        if stage is not None and stage.fault:
            raise InputError(f"the stored results of stage {name!r} {stage.fault}: 'spectrabox "
                             "run' makes them again")
    done = {name: stage for name, stage in stored.items() if stage is not None}
    if before is not None and before.stored == done:
        return before
    return FinishedRun(config.capture(), done, dict.fromkeys(done, "kept"))


def stage_names(config: SessionConfig) -> list[str]:
    """Names of the stages that a session needs, in order."""
    return [step.name for step in needed_steps(config.steps, bool(config.views_with_chart),
                                               config.picture is not None)]


def stages_in_order(only: str | None, order: list[str]) -> list[str | None]:
    """The stages that are to be run alone, first things first; None alone for all of them.

    Parameters
    ----------
    only : str or None
        Names with commas between them, in any order.
    order : list of str
        Of the session's stages. A name that is none of them comes first, to be refused before
        anything has run.
    """
    words = [word.strip() for word in (only or "").split(",") if word.strip()]
    if not words:
        return [None]
    return sorted(set(words), key=lambda word: order.index(word) if word in order else -1)
