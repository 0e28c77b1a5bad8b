"""A prior on curves of which only smoothness is known: multispectral bands, unusual sensors.

Every band is a Gaussian process of wavelength about a constant: the level that the photo itself
shows. How far it departs from that level, and over how many nanometres, are the components of the
mixture; the evidence of the photo weighs them. Bands are independent; exposure, illumination field,
glare and model error are joint, as with any prior.
"""
from __future__ import annotations

from itertools import product

import numpy as np

from spectrabox.calibrate.chart_equations import ChartEquations
from spectrabox.calibrate.prior.camera_prior import CameraPrior
from spectrabox.radiometry.records import WavelengthGrid

LENGTHS_NM = (15.0, 25.0, 40.0, 70.0)
# standard deviation over mean: a narrow band is far from its mean nearly everywhere
DEPARTURES = (1.5, 3.0)
FEW_BANDS = 4                # more bands take coarser wavelengths, to stay within seconds
STEP_NM, COARSE_STEP_NM = 5.0, 10.0
SMOOTH_SOURCE = "smooth curves, no measured camera"


def smooth_prior(photos: list[ChartEquations], grid: WavelengthGrid) -> CameraPrior:
    """Prior for the camera of some photos, knowing only the level of each band.

    Parameters
    ----------
    photos : list of ChartEquations
        The first gives the level of each band.
    grid : WavelengthGrid
        Its range is that of the prior.
    """
    first = photos[0]
    bands = first.signal.shape[1]
    nm = np.arange(grid.nm[0], grid.nm[-1] + 1, STEP_NM if bands <= FEW_BANDS else COARSE_STEP_NM)
    lit = (first.reflectances * first.power * (first.irradiance / np.pi)[:, None]).sum()
    mean = np.repeat(first.signal.sum(axis=0) / lit, nm.size)
    kinds = list(product(DEPARTURES, LENGTHS_NM))
    departures = np.array([[0.0, 1.0, sd, length, 0.0, 1.0] for sd, length in kinds])
    return CameraPrior(nm, np.full(len(kinds), 1 / len(kinds)), np.tile(mean, (len(kinds), 1)),
                       np.arange(len(kinds)), np.zeros((len(kinds), 2)), departures,
                       np.ones(len(kinds)), np.zeros((mean.size, 0)), np.zeros((mean.size, 0)),
                       tuple(f"curves smooth over {length:g} nm" for _, length in kinds),
                       SMOOTH_SOURCE, "none")
