"""Change of the light between the photo of the chart and that of the samples."""
from __future__ import annotations

from spectrabox.measure.captured import Capture
from spectrabox.measure.records import CaptureRecords
from spectrabox.radiometry.light_scale import drift_between
from spectrabox.radiometry.records.calibration import LightDrift


def drift_of(capture: Capture, records: CaptureRecords) -> LightDrift | None:
    """Change of the light between the first chart photo and object photo, where both show
    references.

    Parameters
    ----------
    capture : Capture
    records : CaptureRecords
        Of charts and photos.

    Raises
    ------
    InputError
        As ``drift_between``.
    """
    before, after = records.chart.references, records.photo.references
    if before is None or after is None:
        return None
    return drift_between(records.chart.charts[""].thumbnail, before, records.photo.photos[""],
                         after, capture.drift.relative_error)
