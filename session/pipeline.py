"""Which stages of a session are up to date, and running the others with their records kept."""
from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

from spectrabox.measure.records import CaptureRecords, Record
from spectrabox.measure.steps import declared_steps, measurement
from spectrabox.radiometry import errors
from spectrabox.radiometry.records.spectra import Progress
from spectrabox.session.config.session_file import SessionConfig
from spectrabox.session.kept_stages import FinishedRun
from spectrabox.session.store import keys, locks, record_files
from spectrabox.session.terminal.progress_display import StageProgress


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
    keeper = FolderKeeper(config, only=only, force=force, progress=progress, shared=shared,
                          device=device)
    measurement.measure(keeper.finished.capture, keeper, device=device,
                        checkpoints=config.results_folder, before=before)
    return keeper.finished


class FolderKeeper:
    """Keeps the records of a session in its results folder, and hands out those that are up to
    date.

    Parameters
    ----------
    config, only, force, progress, shared, device
        As of ``run_stages``.
    """

    def __init__(self, config: SessionConfig, *, only: str | None, force: bool,
                 progress: StageProgress, shared: Path | None, device: str) -> None:
        self._config, self._inputs = config, keys.InputFiles(config)
        capture = config.capture()
        self._keys = keys.step_keys(capture, self._inputs, device)
        if only is not None and only not in self._keys:
            raise errors.InputError(f"there is no stage {only!r} in this session; it has "
                             f"{', '.join(self._keys)}")
        self._only, self._force, self._progress, self._shared = only, force, progress, shared
        self.finished = FinishedRun(capture, {}, {})

    @property
    def records(self) -> CaptureRecords:
        return self.finished.records

    def keep(self, step: declared_steps.Step,
             compute: Callable[[Progress, Path | None], Record]) -> None:
        """The step's record as it is stored, if that is up to date; else as it is computed now."""
        name, key = step.name, self._keys[step.name]
        stored = record_files.load_stage(self._config.results_folder, name)
        usable = stored is not None and not stored.fault
        fresh = usable and stored is not None and stored.key == key
        if self._only is not None and name != self._only:
            self._keep_beside(name, stored if usable else None, fresh)
            return
        if stored is not None and fresh and not self._force:
            self._note(name, stored, "kept")
            self._progress(name, 1.0, "up to date")
            return
        if stored is not None and stored.fault:
            self._progress(name, 0.0, f"run again: its stored results {stored.fault}")
        with locks.shared_stage(self._shared, name, key) as other:
            if other is not None:
                stored = self._store(name, partial(record_files.copy_stage, other))
                self._progress(name, 1.0, "as another session made it")
            else:
                stored = self._store(name, partial(self._compute, name, compute))
                self._progress(name, 1.0, f"{stored.seconds:.1f} s")
                locks.share_stage(self._shared, name, stored)
        self._note(name, stored, "copied" if other else "run")

    def _keep_beside(self, name: str, stored: record_files.StoredStage | None, fresh: bool) -> None:
        """Keep what is stored of a step beside the one that is run alone."""
        order = list(self._keys)
        later = order.index(name) > order.index(self._only or "")
        if stored is not None and (fresh or later):
            self._note(name, stored, "kept" if fresh else "stale")
        elif not later:
            raise errors.InputError(
                f"stage {name!r}, which comes before {self._only!r}, is not up to "
                "date: run without --only")

    def _note(self, name: str, stored: record_files.StoredStage, state: str) -> None:
        self.finished.stored[name], self.finished.states[name] = stored, state

    def _store(self, name: str, fill: Callable[[Path], None]) -> record_files.StoredStage:
        """Results of a step, which a function writes into an empty folder, in place of the old
        ones.
        """
        with record_files.stage_folder(self._config.results_folder, name) as folder:
            fill(folder)
            self._inputs.require_unchanged(self._keys[name]["files"])
        stored = record_files.load_stage(self._config.results_folder, name)
        assert stored is not None
        return stored

    def _compute(self, name: str, compute: Callable[[Progress, Path | None], Record],
                 folder: Path) -> None:
        """Compute the record of a step and save it into a folder."""
        start = time.perf_counter()
        self._progress(name, 0.0, "")
        record = compute(partial(self._progress, name), folder)
        record_files.save_stage(folder, self._keys[name], record,
                                time.perf_counter() - start, {"stage": name})
