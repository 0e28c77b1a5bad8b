"""The verdict on a measurement: PASS, WARN or FAIL, the worst of its criteria."""
from __future__ import annotations

from typing import TYPE_CHECKING

from spectrabox.measure import rules, texts
from spectrabox.measure.verdict.conditions import condition_words
from spectrabox.measure.verdict.criterion import (
    Criterion,
    Status,
    Verdict,
    criterion_of,
    outcome_criterion,
    where_of,
)
from spectrabox.measure.verdict.surface_criteria import samplers, stated_truths, truth_coverage
from spectrabox.radiometry.findings import faults

if TYPE_CHECKING:
    from spectrabox.measure.results.capture_result import CaptureResult


def overall_verdict(found: CaptureResult) -> Verdict:
    """Verdict on a measurement: PASS, WARN or FAIL, the worst of its criteria."""
    fits = {"": found.calibration, **found.other_calibrations}
    # causes before symptoms: the first reason is the headline
    criteria = (*_processed(found), *_chart_photos(found),
                *map(criterion_of, rules.of_calibration(found)), *found.own_criteria,
                found.clipped_criterion(found.photo.clipped_share),
                *(outcome_criterion(f"Sensitivity fit{where_of(view)}", fit.sensitivity.outcome)
                  for view, fit in fits.items()), *samplers(found), truth_coverage(found),
                *stated_truths(found))
    status = max((criterion.status for criterion in criteria), key=lambda one: one.value)
    if status in (Status.WARN, Status.FAIL):
        reasons = dict.fromkeys(c.sentence for c in criteria if c.status is status)
        return Verdict(status, " ".join(reasons), criteria)
    return Verdict(status, found.good, criteria, condition_words(found.conditions))


def _processed(found: CaptureResult) -> list[Criterion]:
    """Whether a photo is not proportional to light, and was decoded as sRGB all the same."""
    if not found.processed:
        return []
    return [Criterion("Photos proportional to light", None, "no", "yes", Status.WARN,
                      "A photo was processed by the camera and decoded as sRGB: its tone curve and "
                      "its colours remain in every spectrum, with errors that no band states. "
                      "Photograph raw.")]


def _chart_photos(found: CaptureResult) -> list[Criterion]:
    """Whether each chart photo is good, as ``spectrabox chart`` says it of the same photo."""
    rows = []
    for view, findings in found.chart_findings.items():
        reasons = [texts.says(finding) for finding in faults(findings)]
        sentence = f"Shoot the chart{where_of(view)} again. {' '.join(reasons)}" if reasons \
            else f"The photo of the chart{where_of(view)} is good."
        rows.append(Criterion(f"Photo of the chart{where_of(view)}", float(len(reasons)),
                              "re-shoot" if reasons else "good", "good",
                              Status.WARN if reasons else Status.PASS, sentence))
    return rows
