"""Criteria and conditions of flat samples: light, known levels, uneven regions, edges."""
from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from spectrabox.measure.regions.edge_words import edge_sentence
from spectrabox.measure.regions.white import FAR, LEVEL_DOUBTED
from spectrabox.measure.verdict.criterion import (
    CLIPPED_LIMITS,
    Criterion,
    Status,
    graded,
)
from spectrabox.measure.words import listed, percent

if TYPE_CHECKING:
    from spectrabox.measure.results.flat_result import FlatResult

LIGHT_LIMITS = (FAR, 0.15)    # relative error of the light on a region of a flat sample
# Relative scatter of a region's pixels. One paint whose relief slopes by 20 degrees (rms) scatters
# by 0.25 in light from 45 degrees; halves of two paints of a ColorChecker by more in 93 % of pairs,
# three paints in 99 %.
ONE_PAINT = 0.25


def flat_criteria(found: FlatResult) -> list[Criterion]:
    """Light on the regions, levels of known ones, scatter of their pixels, edges across them."""
    return [*_light(found), *_known_levels(found), *_uneven_regions(found), *_edges(found)]


def _light(found: FlatResult) -> list[Criterion]:
    """How well the light on the worst region is known, and how much it changes."""
    light = {(photo.name, name): level_and_error for photo in found.photos
             for name, level_and_error in photo.light.items()}
    (_, worst), (_, error) = max(light.items(), key=lambda item: item[1][1])
    levels = np.array([level for level, _ in light.values()] + [1.0])
    change = float(levels.max() / levels.min() - 1)
    known = graded("Error of the light on the regions, worst region", error, LIGHT_LIMITS,
                    f"The light on “{worst}” is known to {percent(error)}"
                    + ("." if error <= LIGHT_LIMITS[0] else ": it lies far from the chart, or the "
                       "light is uneven; put the chart or a white card next to it, or photograph "
                       "a white card in the samples' place as flat field."),
                    tuple(name for (_, name), (_, own) in light.items()
                          if own > LIGHT_LIMITS[0]))
    return [known, Criterion("Change of the light from the chart to the regions", change,
                             percent(change), "corrected", Status.INFO,
                             f"The light changes by {percent(change)} between chart and regions, "
                             "which is corrected within its error.")]


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


def flat_conditions(found: FlatResult) -> str:
    """What no photo shows and the estimates rest on: how the samples must lie."""
    matt = [] if found.surfaces_stated else ["matt"]
    card = all(photo.level_misfits for photo in found.photos if photo.light)
    return "the samples are " + listed([*matt, "flat", *(
        ["in the white card's plane"] if card else ["in the chart's plane", "in no shadow"])])
