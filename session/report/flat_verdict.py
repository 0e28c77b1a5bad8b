"""Is a session of flat samples good? Its criteria: chart, light over the picture, samplers."""
from __future__ import annotations

import numpy as np

from spectrabox.session.flat.flat_results import FlatResults
from spectrabox.session.flat.white_at_regions import LEVEL_DOUBTED
from spectrabox.session.report.verdict import (
    Criterion,
    Status,
    Verdict,
    calibration_doubts,
    chart_agreement,
    coverage,
    graded,
    left_out,
    outcome_status,
    samplers,
)
from spectrabox.session.report.words import percent

LIGHT_LIMITS = (0.05, 0.15)             # relative error of the light on a region
CLIPPED_LIMITS = (0.05, float("inf"))   # of the photo; regions and chart are refused where clipped


def judge_flat(results: FlatResults) -> Verdict:
    """Verdict on a session of flat samples: PASS, WARN or FAIL."""
    fit = results.calibration.sensitivity.outcome
    criteria = (*_light(results), *_known_levels(results), chart_agreement(results),
                *left_out(results),
                *calibration_doubts(results),
                Criterion("Sensitivity fit", None, fit.name.replace("_", " ").lower(), "converged",
                          outcome_status(fit), f"Sensitivity fit: {fit.value}"),
                _clipped(results), *samplers(results), coverage(results))
    status = max((c.status for c in criteria), key=lambda s: s.value)
    if status in (Status.WARN, Status.FAIL):
        return Verdict(status, " ".join(c.says for c in criteria if c.status is status), criteria)
    return Verdict(status, "The chart is explained, and the light on every region is known within "
                   "the limits.", criteria)


def _light(results: FlatResults) -> list[Criterion]:
    """How well the light on the worst region is known, and how much it changes."""
    light = {(photo.name, name): found for photo in results.photos
             for name, found in photo.light.items()}
    (_, worst), (_, error) = max(light.items(), key=lambda item: item[1][1])
    levels = np.array([level for level, _ in light.values()] + [1.0])
    change = float(levels.max() / levels.min() - 1)
    known = graded("Error of the light on the regions, worst region", error, LIGHT_LIMITS,
                   f"The light on “{worst}” is known to {percent(error)}"
                   + ("." if error <= LIGHT_LIMITS[0] else ": it lies far from the chart, or the "
                      "light is uneven; put the chart or a white card beside it, or photograph a "
                      "white card in the samples' place as flat field."))
    return [known, Criterion("Change of the light from the chart to the regions", change,
                             percent(change), "corrected", Status.INFO,
                             f"The light changes by {percent(change)} between chart and regions, "
                             "which is corrected within its error.")]


def _known_levels(results: FlatResults) -> list[Criterion]:
    """How far the stated levels of known regions are from what the chart's light gives."""
    misfits = {name: misfit for photo in results.photos
               for name, misfit in photo.level_misfits.items()}
    if not misfits:
        return []
    worst = max(misfits, key=lambda name: abs(misfits[name]))
    size = abs(misfits[worst])
    status = Status.PASS if size <= LEVEL_DOUBTED else Status.WARN
    return [Criterion("Level of known regions against the chart's light, worst region", size,
                      f"{size:.1f} standard errors", f"pass up to {LEVEL_DOUBTED:.0f}", status,
                      f"The level of “{worst}”, of known spectrum, is {size:.1f} standard errors "
                      "from what the chart's light gives" + ("." if status is Status.PASS else
                      ": check its stated reflectance, and for a shadow on it or on the chart."))]


def _clipped(results: FlatResults) -> Criterion:
    value = float(results.photo.saturated.any(axis=2).mean())
    return graded("Clipped parts of the photo", value, CLIPPED_LIMITS,
                  f"{percent(value)} of the photo is clipped, none of it in a region.")
