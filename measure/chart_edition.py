"""Whether a ColorChecker was made before or since November 2014, as its photo tells.

Camera and light are fitted to the chart together, by either edition; what the photo says for one of
them is how much better that one explains it, with the differences that copies have in any case.
"""
from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from spectrabox.calibrate import chart_findings
from spectrabox.calibrate.chart_calibration import calibrate_chart
from spectrabox.calibrate.chart_photo import ChartPhoto
from spectrabox.measure import texts
from spectrabox.measure.extras import attempt
from spectrabox.radiometry.chart import BEFORE_2014, COPIES_SINCE_2014, Chart
from spectrabox.radiometry.charts.classic_copies import editions
from spectrabox.radiometry.errors import SpectraboxError
from spectrabox.radiometry.findings import Finding, Severity
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
    finding : Finding
        The same, or why it cannot be told.
    failed : Finding or None
        Where telling it failed.
    """

    edition: str | None
    evidence: float | None
    finding: Finding
    failed: Finding | None = None

    @property
    def says(self) -> str:
        """The finding in a sentence."""
        return texts.says(self.finding)

    @property
    def facts(self) -> dict[str, Any]:
        """For JSON."""
        return {"edition": self.edition, "evidence": self.evidence, "says": self.says,
                "findings": [texts.facts(self.finding)]}


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
        return replace(_not_fitted(failed.values["error"]), failed=failed)
    assert edition is not None
    return edition


def _edition(image: LinearImage, chart: Chart, samples: PatchSamples) -> ChartEdition:
    if COPIES_SINCE_2014 not in chart.references:
        return _not_told(Finding("edition.unpublished", Severity.INFO, values={
            "chart": chart.name, "any": bool(chart.references)}))
    if image.kind is PhotoKind.PROCESSED:
        return _not_told(Finding("edition.processed", Severity.INFO))
    of = editions(chart, samples.taken_at)
    if len(of) == 1:
        return ChartEdition(BEFORE_2014, None, Finding("edition.by-date", Severity.INFO, values={
            "told": BEFORE_2014, "date": samples.taken_at[:10]}))
    try:
        copy = calibrate_chart([ChartPhoto(samples, of[0].mean, UnknownLight(), chart=chart,
                                           editions=of)], FINE_GRID).copy
    except SpectraboxError as error:
        return _not_fitted(str(error))
    assert copy is not None, "a chart of several editions has a copy"
    told, nats = chart_findings.edition_told(copy), chart_findings.evidence_since(copy)
    return ChartEdition(told, nats, Finding("edition.told", Severity.INFO, values={
        "told": told, "nats": nats, "needed": chart_findings.TOLD}))


def _not_told(finding: Finding) -> ChartEdition:
    return ChartEdition(None, None, finding)


def _not_fitted(error: str) -> ChartEdition:
    return _not_told(Finding("edition.not-fitted", Severity.INFO, values={"error": error}))
