"""Gels and lamps that most people can have, and how to expose with them."""
from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from spectrabox.measure.more_bands.further_photos import FurtherPhoto, LampsAtHand
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.spectra.filters import MIN_TRANSMITTANCE, stated_filter
from spectrabox.radiometry.spectra.named_spectra import light
from spectrabox.radiometry.spectra.resampling import pchip

STOPS = 0.05                # of exposure: less is not said
# of gels for stage lamps, every 50 nm
GEL_NM = np.arange(400.0, 701.0, 50.0)
GELS = {"a magenta gel": (0.14, 0.47, 0.04, 0.002, 0.002, 0.02, 0.87),
        "an orange gel": (0.15, 0.10, 0.01, 0.02, 0.66, 0.88, 0.93)}
LAMPS = {"daylight": "D65", "a halogen lamp": "A", "a cold white LED lamp": "LED-B5",
         "an RGB LED lamp": "LED-RGB1"}


def usual_at_hand() -> LampsAtHand:
    """Common lamps, and two kinds of gels."""
    return LampsAtHand(
        {words: light(name, FINE_GRID) for words, name in LAMPS.items()},
        {words: stated_filter(words, np.clip(pchip(GEL_NM, np.array(values), FINE_GRID.nm),
                                             MIN_TRANSMITTANCE, 1))
         for words, values in GELS.items()})


def exposure(photos: Sequence[FurtherPhoto]) -> tuple[list[float], list[int]]:
    """Stops to add to the exposure of photos, none where no photo needs any, and numbers of the
    further bands, from 1, that they leave dark.

    Parameters
    ----------
    photos : sequence of FurtherPhoto
    """
    stops = [float(photo.stops) for photo in photos]
    dark = [number * len(photo.white) + int(band) + 1
            for number, photo in enumerate(photos) for band in photo.dark]
    return stops if max(map(abs, stops)) >= STOPS else [], dark
