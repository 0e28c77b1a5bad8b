"""Patches that the other patches of a chart contradict, left out of the fit one after the other.

A patch that is off makes the fit take all patches for worse than they are, and may bend the light
over its neighbours: of the two that are furthest off the one is left out that is further off by a
fit without it, and so on.
"""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from spectrabox.calibrate.chart_photo import ChartPhoto, used_and_excluded
from spectrabox.calibrate.held_out_patches import PatchesWithout, in_chart_order
from spectrabox.calibrate.joint.veiling_glare import estimate_through_glare
from spectrabox.calibrate.prior.camera_prior import CameraPrior
from spectrabox.radiometry.records.spectra import WavelengthGrid

# Standard errors by which a patch is off, and the same over the rms of the other patches, beyond
# which it is a suspect; by chance in one chart of ten.
SUSPECT, SUSPECT_TO_OTHERS, MAX_SUSPECTS = 2.6, 3.5, 3


def without_suspects(photos: Sequence[ChartPhoto], cameras: CameraPrior, grid: WavelengthGrid,
                     without: PatchesWithout) -> PatchesWithout:
    """The first photo's patches once suspects are out of the fit.

    Parameters
    ----------
    photos : sequence of ChartPhoto
    cameras : CameraPrior
    grid : WavelengthGrid
        Working grid, of P wavelengths.
    without : PatchesWithout
        The first photo's patches by the fit that holds the suspects, in the order of the chart.
    """
    first = photos[0]
    suspects = np.zeros(len(first.reflectances), bool)
    for _ in range(MAX_SUSPECTS):
        brighter, error, _ = without.deviations(first.reflectances)
        off = np.where(first.used & ~suspects, np.abs(brighter / error), 0.0)
        others = np.sqrt((np.sum(off**2) - off**2) / (np.count_nonzero(off) - 1))
        furthest = np.argsort(-off)[:2].tolist()
        fits = []
        for patch in furthest:
            if off[patch] <= SUSPECT and off[patch] <= SUSPECT_TO_OTHERS * others[patch]:
                continue
            excluded = ~first.used | suspects
            excluded[patch] = True
            shown = replace(first, excluded=excluded)
            equations, left_out = used_and_excluded([shown, *photos[1:]], grid)
            fit, _ = estimate_through_glare(equations, first.light, cameras, grid, left_out)
            rest = in_chart_order(fit.without, shown.used)
            level, spread, _ = rest.deviations(first.reflectances)
            fits.append((abs(level[patch] / spread[patch]), patch, rest))
        if not fits:
            break
        _, patch, without = max(fits, key=lambda fit: fit[0])
        suspects[patch] = True
    return without
