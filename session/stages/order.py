"""The stages of a session, in the order in which they run."""
from __future__ import annotations

from collections.abc import Callable
from typing import Any

from spectrabox.session.stages.calibrate_stage import calibrate_views
from spectrabox.session.stages.photo_stages import bin_object_photos, find_and_sample_charts
from spectrabox.session.stages.reconstruct_stage import invert_photos
from spectrabox.session.stages.sample_stage import sample_materials
from spectrabox.session.stages.stage_task import StageTask

STAGES: dict[str, Callable[[StageTask], dict[str, Any]]] = {
    "chart": find_and_sample_charts, "photo": bin_object_photos, "calibrate": calibrate_views,
    "reconstruct": invert_photos, "sample": sample_materials}
