"""Gels and lamps that most people can have, for those who do not say which are at hand."""
from __future__ import annotations

import numpy as np
from scipy.interpolate import PchipInterpolator

from spectrabox.measure.more_bands.further_photos import LampsAtHand
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.spectra.filters import MIN_TRANSMITTANCE, stated_filter
from spectrabox.radiometry.spectra.named_spectra import light

# of gels for stage lamps, every 50 nm
GEL_NM = np.arange(400, 701, 50)
GELS = {"a magenta gel": (0.14, 0.47, 0.04, 0.002, 0.002, 0.02, 0.87),
        "an orange gel": (0.15, 0.10, 0.01, 0.02, 0.66, 0.88, 0.93)}
LAMPS = {"daylight": "D65", "a halogen lamp": "A", "a warm white LED lamp": "LED-B1",
         "a cold white LED lamp": "LED-B5", "an RGB LED lamp": "LED-RGB1",
         "a violet-pumped LED lamp": "LED-V1", "a fluorescent tube": "FL11"}


def usual_at_hand() -> LampsAtHand:
    """Common lamps, and two kinds of gels."""
    return LampsAtHand(
        {words: light(name, FINE_GRID) for words, name in LAMPS.items()},
        {words: stated_filter(words, np.clip(PchipInterpolator(GEL_NM, values)(FINE_GRID.nm),
                                             MIN_TRANSMITTANCE, 1))
         for words, values in GELS.items()})
