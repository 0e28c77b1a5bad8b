"""One way from photos to spectra, where every door meets: `measure` runs the steps, a keeper keeps.

A step is a function of a capture, of the records before it, and of what it is lent; it returns one
record. `measure` takes a keeper: one that holds records in memory, or a session's, which keeps
them on disk and hands out those that are up to date.
"""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from spectrabox.measure import captured, opened_photos
from spectrabox.measure.records import CaptureRecords, KeptRecord, Record
from spectrabox.measure.steps import calibration, declared_steps, inversion, photos, pictures
from spectrabox.measure.steps.signals import draw_surfaces, find_signals
from spectrabox.measure.steps.work import Work
from spectrabox.radiometry.records.spectra import Progress
from spectrabox.radiometry.system.threads import one_blas_thread

StepFunction = Callable[[Any, CaptureRecords, Work], Record]
FUNCTIONS: dict[declared_steps.Step, StepFunction] = {
    declared_steps.CHART: photos.find_charts,
    declared_steps.FLAT_PHOTOS: photos.measure_flat_photos,
    declared_steps.FLAT_CALIBRATION: calibration.calibrate_flat,
    declared_steps.SIGNALS: find_signals,
    declared_steps.FLAT_SPECTRA: draw_surfaces,
    declared_steps.FLAT_PICTURE: pictures.flat_picture,
    declared_steps.SCENE_PHOTOS: photos.measure_scene_photos,
    declared_steps.SCENE_CALIBRATION: calibration.calibrate_scene,
    declared_steps.INVERSION: inversion.invert_photos,
    declared_steps.SCENE_SPECTRA: draw_surfaces,
    declared_steps.SCENE_PICTURE: pictures.scene_picture}


class Keeper(Protocol):
    """Who keeps the records of a measurement."""

    @property
    def records(self) -> CaptureRecords:
        """What has been kept so far."""
        ...

    def keep(self, step: declared_steps.Step, compute: Callable[[Progress, Path | None],
                                                                Record]) -> None:
        """Keep the record of a step: one that is up to date, or the one that is computed now.

        Parameters
        ----------
        step : Step
        compute : function of progress and of an empty folder for pictures, or None
            Its record.
        """
        ...


@dataclass(frozen=True, eq=False)
class MemoryKeeper:
    """Keeps records in memory; those of some steps may be known beforehand."""

    progress: Callable[[str, float, str], None] = lambda step, share, message: None
    kept: dict[str, Record | KeptRecord] = field(default_factory=dict)
    pictures: Path | None = None        # folder that takes the files of a picture of spectra

    @property
    def records(self) -> CaptureRecords:
        return CaptureRecords(self.kept)

    def keep(self, step: declared_steps.Step, compute: Callable[[Progress, Path | None],
                                                                Record]) -> None:
        """As of ``Keeper``."""
        if step.name in self.kept:
            return
        folder = self.pictures if step.name == "picture" else None
        self.kept[step.name] = compute(
            lambda share, message: self.progress(step.name, share, message), folder)


def measure(capture: captured.Capture, keeper: Keeper, *, device: str = "auto",
            checkpoints: Path | None = None, before: str | None = None) -> CaptureRecords:
    """Photos to spectra: the steps that the capture needs, in their order.

    Parameters
    ----------
    capture : FlatCapture or SceneCapture
    keeper : Keeper
    device : {"auto", "cpu", "cuda"}
        Where Mitsuba renders.
    checkpoints : Path, optional
        Folder that a stopped trace goes on from.
    before : str, optional
        Name of the step at which to stop, itself not run.

    Returns
    -------
    CaptureRecords
        Of all steps.

    Raises
    ------
    SpectraboxError
        As the steps.
    """
    photos = opened_photos.OpenPhotos(capture)
    for step in declared_steps.steps_of(capture):
        if step.name == before:
            break

        def compute(progress: Progress, folder: Path | None,
                    function: StepFunction = FUNCTIONS[step]) -> Record:
            work = Work(photos, progress, device, folder, checkpoints)
            with one_blas_thread():
                return function(capture, keeper.records, work)

        keeper.keep(step, compute)
    return keeper.records
