"""What the steps of a measurement have made, as what was found."""
from __future__ import annotations

from typing import TYPE_CHECKING

from spectrabox.measure import captured, records
from spectrabox.measure.results.flat_result import FlatResult, flat_result
from spectrabox.measure.results.scene_result import SceneResult, scene_result

if TYPE_CHECKING:
    from spectrabox.measure.scene.rehearsal import Rehearsed


def result_of(capture: captured.FlatCapture | captured.SceneCapture,
              records: records.CaptureRecords, rehearsal: Rehearsed | None = None,
              picture_folder: str = "") -> FlatResult | SceneResult:
    """What was found, of a capture of either kind.

    Parameters
    ----------
    capture : FlatCapture or SceneCapture
    records : CaptureRecords
        Of all steps.
    rehearsal, picture_folder
        As of `scene_result`.
    """
    if isinstance(capture, captured.FlatCapture):
        return flat_result(capture, records, picture_folder)
    return scene_result(capture, records, rehearsal, picture_folder)
