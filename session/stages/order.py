"""The stages of a session, in the order in which they run; each is imported when it runs."""
from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from spectrabox.session.stages.stage_task import StageTask


@dataclass(frozen=True)
class Stage:
    """The function that makes a stage's records from its task."""

    module: str
    function: str

    def run(self, task: StageTask) -> dict[str, Any]:
        """Records of the stage by name, the same to the last bit on any number of cores."""
        from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]
        function = getattr(importlib.import_module(self.module), self.function)
        importlib.import_module("scipy.linalg")  # brings its own BLAS, which is limited too
        with threadpool_limits(1, user_api="blas"):  # BLAS splits its sums by the cores
            records: dict[str, Any] = function(task)
        return records


ROOM = "spectrabox.session.stages"
STAGES = {"chart": Stage(f"{ROOM}.photo_stages", "find_and_sample_charts"),
          "photo": Stage(f"{ROOM}.photo_stages", "bin_object_photos"),
          "calibrate": Stage(f"{ROOM}.calibrate_stage", "calibrate_views"),
          "reconstruct": Stage(f"{ROOM}.reconstruct_stage", "invert_photos"),
          "sample": Stage(f"{ROOM}.sample_stage", "sample_materials")}
