"""A prior on the curves of a camera that was measured: these, and what measurements get wrong."""
from __future__ import annotations

import numpy as np

from spectrabox.calibrate.prior.camera_prior import CameraPrior
from spectrabox.radiometry.records import WavelengthGrid

STEP_NM = 5.0
LENGTH_NM = 40.0            # over which the error of a measured curve changes
ADDED = 0.2                 # of the relative error: what is added to a curve, of the largest value


def prior_of_curves(grid: WavelengthGrid, curves: np.ndarray, relative_error: float) -> CameraPrior:
    """One component about measured curves, so that a chart fit finds white, field and glare.

    Parameters
    ----------
    grid : WavelengthGrid
        Of the curves, P wavelengths.
    curves : (K, P) array
    relative_error : float
        Standard deviation of each curve, relative to it.
    """
    nm = np.arange(grid.nm[0], grid.nm[-1] + 1, STEP_NM)
    means = np.array([np.interp(nm, grid.nm, curve) for curve in curves]).reshape(1, -1)
    nothing = np.zeros((means.size, 0))
    departures = np.array([[ADDED * relative_error, LENGTH_NM, relative_error, LENGTH_NM, 0.0,
                            1.0]])
    return CameraPrior(nm, np.ones(1), means, np.zeros(1, int), np.zeros((1, 2)), departures,
                       np.ones(1), nothing, nothing, ("measured curves",),
                       "measured curves from a file", "none")
