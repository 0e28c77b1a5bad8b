"""Criteria of surfaces of any kind: draws, coverage, stated truths."""
from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from spectrabox.measure.verdict.criterion import Criterion, Status
from spectrabox.measure.words import percent
from spectrabox.radiometry.spectra.spectrum_files import spectrum_on_grid

if TYPE_CHECKING:
    from spectrabox.measure.results.capture_result import CaptureResult

# Standard deviations, rms over wavelengths, of a stated truth from the mean. Of 119 surfaces of
# published sets in a simulated camera's signals (1 %, D65) right truths reach 3.5, 1 in 100 exceeds
# 2.1; truths of another of these surfaces exceed 4 in more than nine of ten pairs.
ANOTHER_TRUTH = 4.0
SMALLEST_SPREAD = 0.002               # of white: what measured spectra repeat to


def samplers(found: CaptureResult) -> list[Criterion]:
    """Whether the draws of every estimated surface are as intended."""
    drawn = [(m.name, m.samples) for m in found.surfaces if m.samples is not None]
    if not drawn:
        return []
    doubtful = [(m.name, m.samples.sentence) for m in found.surfaces
                if m.doubtful and m.samples is not None]
    if not doubtful:
        return [Criterion("Samplers", None, "as intended", "as intended", Status.PASS,
                          "Sampler of every estimated material: "
                          f"{drawn[0][1].outcome.value}")]
    reservations = "; ".join(f"“{name}”: {sentence}" for name, sentence in doubtful)
    return [Criterion("Samplers", None, "see words", "as intended", Status.WARN,
                      f"Sampler of {reservations}", tuple(name for name, _ in doubtful))]


def truth_coverage(found: CaptureResult) -> Criterion:
    name = "Measured truth inside the band"
    tested = [(m.scores.coverage, m.summary.level) for m in found.surfaces
              if m.scores is not None and m.summary is not None]
    if not tested:
        return Criterion(name, None, "no truth given", "its level", Status.INFO,
                         "No measured spectrum was given to compare with.")
    share, level = np.mean(tested, axis=0)
    return Criterion(name, float(share), percent(share), f"{percent(level)} intended",
                     Status.INFO,
                     f"Over {len(tested)} materials with a measured spectrum, the band holds it at "
                     f"{percent(share)} of wavelengths; {percent(level)} is intended.")


def stated_truths(found: CaptureResult) -> list[Criterion]:
    """Whether each stated truth can be that of its surface."""
    far = {}
    for surface in found.surfaces:
        if surface.truth is not None and surface.summary is not None:
            off = spectrum_on_grid(surface.truth, surface.summary.grid) - surface.summary.mean
            spread = np.maximum(surface.summary.standard_deviation, SMALLEST_SPREAD)
            far[surface.name] = float(np.sqrt(np.mean((off / spread) ** 2)))
    if not far:
        return []
    worst = max(far, key=lambda name: far[name])
    another = far[worst] > ANOTHER_TRUTH
    return [Criterion(
        "Measured truth from the mean, worst surface", far[worst],
        f"{far[worst]:.1f} standard deviations", f"pass up to {ANOTHER_TRUTH:.0f}",
        Status.WARN if another else Status.PASS,
        f"The stated truth disagrees with every band of “{worst}”: it lies {far[worst]:.1f} "
        "standard deviations from the mean (rms over wavelengths); check that it is of this "
        "surface." if another else "Every stated truth can be that of its surface.",
        tuple(name for name, off in far.items() if off > ANOTHER_TRUTH))]
