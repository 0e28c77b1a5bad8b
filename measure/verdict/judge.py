"""The verdict on a measurement: PASS, WARN or FAIL, the worst of its criteria."""
from __future__ import annotations

from spectrabox.measure.verdict.calibration import (
    calibration_doubts,
    chart_agreement,
    held_out_patches,
    where_of,
)
from spectrabox.measure.verdict.criteria import (
    Criterion,
    Status,
    Verdict,
    graded,
    outcome_criterion,
)
from spectrabox.measure.verdict.evidence import CommonEvidence, FlatEvidence, SceneEvidence
from spectrabox.measure.verdict.flat import flat_conditions, flat_criteria
from spectrabox.measure.verdict.scene import scene_conditions, scene_criteria
from spectrabox.measure.verdict.surfaces import samplers, stated_truths, truth_coverage
from spectrabox.measure.words import percent

# clipped pixels are left out, so they cost coverage, not correctness
CLIPPED_LIMITS = (0.05, float("inf"))


def judge(evidence: SceneEvidence | FlatEvidence) -> Verdict:
    """Verdict on a session: PASS, WARN or FAIL, the worst of its criteria."""
    if isinstance(evidence, FlatEvidence):
        own = flat_criteria(evidence)
        good = "The chart fits, and the light on every region is known within the limits."
        conditions = flat_conditions(evidence)
    else:
        own, good = scene_criteria(evidence), \
            "Photo, rendering and calibration agree within the limits."
        conditions = scene_conditions(evidence)
    fits = {"": evidence.calibration, **evidence.other_calibrations}
    criteria = (*_processed(evidence), *own, *calibration_doubts(evidence),
                *chart_agreement(evidence), *held_out_patches(evidence), _clipped(evidence),
                *(outcome_criterion(f"Sensitivity fit{where_of(view)}", fit.sensitivity.outcome)
                  for view, fit in fits.items()), *samplers(evidence), truth_coverage(evidence),
                *stated_truths(evidence))
    status = max((criterion.status for criterion in criteria), key=lambda one: one.value)
    if status in (Status.WARN, Status.FAIL):
        reasons = dict.fromkeys(c.sentence for c in criteria if c.status is status)
        return Verdict(status, " ".join(reasons), criteria)
    return Verdict(status, f"{good} The bands hold if {conditions}.", criteria)


def _processed(evidence: CommonEvidence) -> list[Criterion]:
    """Whether a photo is not proportional to light, and was decoded as sRGB all the same."""
    return [Criterion("Photos proportional to light", None, "no", "yes", Status.WARN,
                      "A photo was processed by the camera and decoded as sRGB: its tone curve and "
                      "its colours remain in every spectrum, with errors that no band states. "
                      "Photograph raw.")] if evidence.processed else []


def _clipped(evidence: CommonEvidence) -> Criterion:
    share = float(evidence.photo.saturated.any(axis=2).mean())
    if isinstance(evidence, FlatEvidence):
        return graded("Clipped parts of the photo", share, CLIPPED_LIMITS,
                       f"{percent(share)} of the photo is clipped, none of it in a region.")
    return graded("Clipped pixels, left out of the fit", share, CLIPPED_LIMITS,
                   f"{percent(share)} of the object photo is clipped and was left out.")
