"""The ColorChecker Classic as it has been made since November 2014, from the colours of both.

Its maker publishes colours of both generations (L*, a*, b* under D50) and spectra of neither. The
measured average is of charts made before: each of its spectra is multiplied by the smoothest factor
that changes its tristimulus values by as much as the published ones have changed.
"""
from __future__ import annotations

import numpy as np

from spectrabox.radiometry.appearance import tristimulus_weights
from spectrabox.radiometry.published.published_tables import published_colours
from spectrabox.radiometry.records import WavelengthGrid

BEFORE, AFTER = (f"ColorChecker24 - {when} November 2014" for when in ("Before", "After"))
SMOOTH_NM = 80.0             # over which the change of a paint changes
LEVEL_SD = 2.0               # of its level, in units of the change within the spectrum
STEPS = 6                    # of Newton's method: round-off after four
RIDGE = 1e-9


def later_generation(earlier: np.ndarray, grid: WavelengthGrid) -> np.ndarray:
    """Reflectances (24, P) of charts made since November 2014, from those made before.

    Parameters
    ----------
    earlier : (24, P) array
    grid : WavelengthGrid
        Working grid, of P wavelengths.
    """
    weights = tristimulus_weights(grid.nm, "D50")
    wanted = earlier @ weights.T * published_colours(AFTER) / published_colours(BEFORE)
    apart = (grid.nm[:, None] - grid.nm) / SMOOTH_NM
    smooth = LEVEL_SD**2 + np.exp(-0.5 * apart**2)
    later = []
    for reflectance, target in zip(earlier, wanted, strict=True):
        change = np.zeros(grid.nm.size)                 # of the logarithm
        for _ in range(STEPS):
            seen = weights * reflectance * np.exp(change)
            colour = seen.sum(axis=1)
            slope = seen / colour[:, None]
            off = np.log(target / colour) + slope @ change
            change = smooth @ slope.T @ np.linalg.solve(slope @ smooth @ slope.T
                                                        + RIDGE * np.eye(3), off)
        later.append(reflectance * np.exp(change))
    return np.array(later)
