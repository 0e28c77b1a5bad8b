"""Criteria of flat samples: light, known levels, uneven regions, edges."""
from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from spectrabox.calibrate import chart_findings
from spectrabox.measure import texts
from spectrabox.measure.regions.edge_words import edge_sentence
from spectrabox.measure.regions.white import LEVEL_DOUBTED
from spectrabox.measure.verdict.conditions import (
    LIGHT_CAUSES,
    darker_by,
    error_by,
    share_by,
)
from spectrabox.measure.verdict.criterion import (
    CLIPPED_LIMITS,
    Criterion,
    Status,
    graded,
)
from spectrabox.measure.words import percent

if TYPE_CHECKING:
    from spectrabox.measure.results.flat_result import FlatResult
    from spectrabox.measure.results.surface_result import SurfaceResult

# standard error of L* by the light: two just noticeable steps, and another colour by any account
LIGHTNESS_LIMITS = (2.0, 5.0)
MOST_OF_A_BAND = 0.5          # share of a spectrum's variance: the light is the largest cause
# Relative scatter of a region's pixels. One paint whose relief slopes by 20 degrees (rms) scatters
# by 0.25 in light from 45 degrees; halves of two paints of a ColorChecker by more in 93 % of pairs,
# three paints in 99 %.
ONE_PAINT = 0.25


def flat_criteria(found: FlatResult) -> list[Criterion]:
    """Light on the regions, levels of known ones, scatter of their pixels, edges across them."""
    return [*_light(found), *_known_levels(found), *_uneven_regions(found), *_edges(found)]


def _light(found: FlatResult) -> list[Criterion]:
    """What the error of the light costs the answer, and how much the light changes.

    A light that is known badly does harm where it makes most of a band, or moves L* by what can be
    seen; one that is known to 8 % beside bands that are wide for other reasons does none.
    """
    effects = {surface.name: light_effect(surface) for surface in found.surfaces
               if not surface.known}
    name = "Effect of the light's error, worst region"
    limit = (f"L* ± {LIGHTNESS_LIMITS[0]:g} and {percent(MOST_OF_A_BAND, 0)} of a variance; fail "
             f"beyond L* ± {LIGHTNESS_LIMITS[1]:g}")
    worst = max(effects, key=lambda region: effects[region].badness)
    effect = effects[worst]
    share = "" if effect.share is None else \
        f"{percent(effect.share, 0)} of the variance of its spectrum and "
    sentence = (f"The light on “{worst}” is known to {percent(effect.error)}, which makes "
                f"{share}L* ± {effect.lightness:.1f}")
    light = "" if found.calibration.products else found.calibration.light.source
    at_fault = chart_findings.chart_at_fault(
        found.chart.left_out, found.chart.layout.names, light) \
        if found.chart is not None and found.chart.left_out is not None else None
    if effect.status is Status.PASS:
        sentence += "."
    elif at_fault is not None:
        sentence += f", since the chart tells it badly. {texts.says(at_fault)}"
    else:
        sentence += (": it lies far from the chart, or the light is uneven; put the chart or a "
                     "white card next to it, or photograph a white card in the samples' place as "
                     "flat field.")
    known = Criterion(name, effect.lightness, f"L* ± {effect.lightness:.1f}"
                      + ("" if effect.share is None else f", {percent(effect.share, 0)}"), limit,
                      effect.status, sentence, tuple(region for region, each in effects.items()
                            if each.status is not Status.PASS))
    levels = np.array([level for photo in found.photos for level, _ in photo.light.values()]
                      + [1.0])
    change = float(levels.max() / levels.min() - 1)
    return [known, Criterion("Change of the light from the chart to the regions", change,
                             percent(change), "corrected", Status.INFO,
                             f"The light changes by {percent(change)} between chart and regions, "
                             "which is corrected within its error.")]


@dataclass(frozen=True)
class LightEffect:
    """What the error of the light on a region costs its spectrum."""

    error: float                # of the light, relative
    share: float | None         # of the spectrum's variance; None: draws do not tell it
    lightness: float            # standard error of L* by the light alone

    @property
    def badness(self) -> float:
        """The effect by the limits of a PASS: 1 is just one."""
        return max((self.share or 0.0) / MOST_OF_A_BAND, self.lightness / LIGHTNESS_LIMITS[0])

    @property
    def status(self) -> Status:
        if self.lightness > LIGHTNESS_LIMITS[1]:
            return Status.FAIL
        return Status.PASS if self.badness <= 1 else Status.WARN


def light_effect(surface: SurfaceResult) -> LightEffect:
    """What the error of the light costs a region; its plane is a condition of its own, which no
    chart that lies nearer makes better.
    """
    error = error_by(surface, LIGHT_CAUSES) or 0.0
    lightness = abs(darker_by([surface], error) or 0.0)
    share = share_by(surface, LIGHT_CAUSES) if surface.variance_shares else None
    return LightEffect(error, share, lightness)


def _known_levels(found: FlatResult) -> list[Criterion]:
    """How far the stated levels of known regions are from what the chart's light gives."""
    misfits = {name: misfit for photo in found.photos
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
                      ": check its stated reflectance, and for a shadow on it or on the chart."),
                      tuple(name for name, misfit in misfits.items()
                            if abs(misfit) > LEVEL_DOUBTED))]


def _uneven_regions(found: FlatResult) -> list[Criterion]:
    """Whether each region can be one paint, by what its pixels scatter."""
    scatter = {name: value for photo in found.photos for name, value in photo.scatter.items()}
    if not scatter:
        return []
    worst = max(scatter, key=lambda name: scatter[name])
    several = scatter[worst] > ONE_PAINT
    return [Criterion(
        "Scatter of pixels beyond noise and light, worst region", scatter[worst],
        percent(scatter[worst]), f"pass up to {percent(ONE_PAINT, 0)}",
        Status.WARN if several else Status.PASS,
        f"The pixels of “{worst}” scatter by {percent(scatter[worst])} beyond noise and even light"
        + (", more than one paint does: its spectrum is the mean of several; outline a part of one "
           "paint." if several else "."),
        tuple(name for name, value in scatter.items() if value > ONE_PAINT))]


def _edges(found: FlatResult) -> list[Criterion]:
    """Whether a shadow's edge, a fold or two paints lie in a region."""
    edges = {name: (edge, photo) for photo in reversed(found.photos)
             for name, edge in photo.edges.items()}
    shown = sum(len(photo.scatter) for photo in found.photos)
    if not shown:
        return []
    said = ["no region holds one"]
    if edges:
        several = len(found.photos) > 1
        said = [f"“{name}”" + (f", photo {photo.name}" if several else "")
                + f": {edge_sentence(edge)}" for name, (edge, photo) in edges.items()]
    return [Criterion("Edges inside regions", float(len(edges)),
                      f"{len(edges)} of {len(found.light)}", "none",
                      Status.WARN if edges else Status.PASS,
                      f"Edges inside regions: {'; '.join(said)}.", tuple(edges))]


def clipped_photo(share: float) -> Criterion:
    """Whether much of the photo is clipped; of a region nothing is, or it would have been refused.
    """
    return graded("Clipped parts of the photo", share, CLIPPED_LIMITS,
                  f"{percent(share)} of the photo is clipped, none of it in a region.")
