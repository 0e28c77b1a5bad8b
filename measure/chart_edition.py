"""Whether a ColorChecker was made before or since November 2014, as its photo tells.

Camera and light are fitted to the chart together, by either edition; what the photo says for one of
them is how much better that one explains it, with the differences that copies have in any case.
"""
from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from spectrabox.calibrate.chart_calibration import calibrate_chart
from spectrabox.calibrate.chart_photo import ChartPhoto
from spectrabox.measure.extras import FailedExtra, attempt
from spectrabox.measure.results.chart_words import (
    BEFORE,
    edition_told,
    evidence_since,
    evidence_words,
)
from spectrabox.radiometry.chart import COPIES_SINCE_2014, Chart
from spectrabox.radiometry.charts.classic_copies import editions
from spectrabox.radiometry.errors import SpectraboxError
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.records.photos import LinearImage, PatchSamples, PhotoKind
from spectrabox.radiometry.records.spectra import UnknownLight


@dataclass(frozen=True)
class ChartEdition:
    """What a photo says of the edition of its chart.

    Attributes
    ----------
    edition : str or None
        "since November 2014" or "before November 2014"; None where the photo does not tell.
    evidence : float or None
        Nats for the edition since over the one before; None where nothing was compared.
    says : str
        The same in a sentence, or why it cannot be told.
    failed : FailedExtra or None
        Where telling it failed.
    """

    edition: str | None
    evidence: float | None
    says: str
    failed: FailedExtra | None = None

    @property
    def facts(self) -> dict[str, Any]:
        """For JSON."""
        return {"edition": self.edition, "evidence": self.evidence, "says": self.says}


def edition_in_photo(image: LinearImage, chart: Chart, samples: PatchSamples) -> ChartEdition:
    """The edition of the chart in a photo, whatever its camera and its light.

    Parameters
    ----------
    image : LinearImage
    chart : Chart
    samples : PatchSamples
    """
    edition, failed = attempt("edition of the chart", lambda: _edition(image, chart, samples), None)
    if failed is not None:
        return replace(_not_told(failed.error), failed=failed)
    assert edition is not None
    return edition


def _edition(image: LinearImage, chart: Chart, samples: PatchSamples) -> ChartEdition:
    if COPIES_SINCE_2014 not in chart.references:
        return _not_told(f"of the {chart.name} no two editions are published" if chart.references
                         else f"nothing is published of the reflectances of the {chart.name}")
    if image.kind is PhotoKind.PROCESSED:
        return _not_told("the camera processed the photo; a raw photo tells")
    of = editions(chart, samples.taken_at)
    if len(of) == 1:
        return ChartEdition(BEFORE, None, f"{BEFORE}: the photo itself is older, taken on "
                                          f"{samples.taken_at[:10]} by the camera's clock")
    try:
        copy = calibrate_chart([ChartPhoto(samples, of[0].mean, UnknownLight(), chart=chart,
                                           editions=of)], FINE_GRID).copy
    except SpectraboxError as error:
        return _not_told(str(error))
    if copy is None:
        return _not_told("nothing could be fitted to the chart")
    return ChartEdition(edition_told(copy), evidence_since(copy), evidence_words(copy))


def _not_told(why: str) -> ChartEdition:
    return ChartEdition(None, None, f"cannot be told: {why}")
