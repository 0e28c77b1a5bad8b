"""The stages of a session, in the order in which they run; each is imported when it runs."""
from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import TYPE_CHECKING

from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

if TYPE_CHECKING:
    from spectrabox.radiometry.shaped import Record
    from spectrabox.session.config.session_schema import SessionConfig
    from spectrabox.session.stages.stage_task import StageTask


@dataclass(frozen=True)
class Stage:
    """The function that makes a stage's records from its task."""

    module: str
    function: str
    rooms: tuple[str, ...]      # whose code and models its records depend on

    def run(self, task: StageTask) -> Record:
        """The stage's record, the same to the last bit on any number of cores."""
        function = getattr(importlib.import_module(self.module), self.function)
        # BLAS splits its sums by the cores; SciPy's own, where it is loaded later, asks `main`
        with threadpool_limits(1, user_api="blas"):
            record: Record = function(task)
        return record


ROOM, PICTURE_ROOM = "spectrabox.session.stages", "spectrabox.session.pictures"
# An edit in one of these rooms makes the results of a stage stale.
CHART_ROOMS = ("radiometry", "capture", "reconstruct", "session/stages")
PHOTO_ROOMS = (*CHART_ROOMS, "calibrate", "measure", "session/box")
FIT_ROOMS = (*PHOTO_ROOMS, "sampling")
PICTURE_ROOMS = (*FIT_ROOMS, "session/pictures")
FIRST = {"chart": Stage(f"{ROOM}.chart_stage", "find_and_sample_charts", CHART_ROOMS),
         "photo": Stage(f"{ROOM}.photo_stage", "measure_photos", PHOTO_ROOMS),
         "calibrate": Stage(f"{ROOM}.calibrate_stage", "calibrate_views", FIT_ROOMS)}
SAMPLE = {"sample": Stage(f"{ROOM}.sample_stage", "draw_surfaces", FIT_ROOMS)}
STAGES = {**FIRST, "reconstruct": Stage(f"{ROOM}.reconstruct_stage", "invert_photos", FIT_ROOMS),
          **SAMPLE}
# where the session asks for one
SCENE_PICTURE = {"picture": Stage(f"{PICTURE_ROOM}.scene_stage", "picture_of_scene", PICTURE_ROOMS)}
FLAT_STAGES = {**FIRST, "signals": Stage(f"{ROOM}.signals_stage", "find_signals", FIT_ROOMS),
               **SAMPLE,
               "picture": Stage(f"{PICTURE_ROOM}.flat_stage", "picture_of_spectra", PICTURE_ROOMS)}


def stages_of(config: SessionConfig) -> dict[str, Stage]:
    """The stages that a session needs, in order."""
    unneeded = {name for name, needed in (("chart", config.views_with_chart),
                                          ("picture", config.picture)) if not needed}
    stages = FLAT_STAGES if config.flat else STAGES | SCENE_PICTURE
    return {name: stage for name, stage in stages.items() if name not in unneeded}


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
    return sorted(set(words), key=lambda word: order.index(word) if word in order else -1) \
        if words else [None]
