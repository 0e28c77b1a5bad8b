"""Priors on curves that need no database of cameras: smoothness alone, or measured curves.

Of multispectral bands and unusual sensors only smoothness is known. Every band is a Gaussian
process of wavelength about a constant: the level that the photo itself shows. How far it departs
from that level, and over how many nanometres, are the components of the mixture; the evidence of
the photo weighs them. Bands are independent; exposure, illumination field, glare and model error
are joint, as with any prior.
"""
from __future__ import annotations

from itertools import product

import numpy as np

from spectrabox.calibrate.chart_equations import ChartEquations
from spectrabox.calibrate.prior.camera_prior import CameraPrior
from spectrabox.radiometry.records.spectra import WavelengthGrid

LENGTHS_NM = (15.0, 25.0, 40.0, 70.0)
# standard deviation over mean: a narrow band is far from its mean nearly everywhere
DEPARTURES = (1.5, 3.0)
FEW_BANDS = 4                # more bands take coarser wavelengths, to stay within seconds
STEP_NM, COARSE_STEP_NM = 5.0, 10.0
SMOOTH_SOURCE = "smooth curves, no measured camera"
MEASURED_LENGTH_NM = 40.0    # over which the error of a measured curve changes
ADDED = 0.2                  # of the relative error: what is added to a curve, of the largest value


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
    unit_signal = (first.reflectances * first.power * (first.irradiance / np.pi)[:, None]).sum(1)
    # of patches that can be read in the band; of all where none can
    counted = first.readable | ~first.readable.any(axis=0)
    mean = np.repeat((counted * first.signal).sum(axis=0) / (unit_signal @ counted), nm.size)
    kinds = list(product(DEPARTURES, LENGTHS_NM))
    departures = np.array([[0.0, 1.0, sd, length, 0.0, 1.0] for sd, length in kinds])
    return CameraPrior(nm, np.full(len(kinds), 1 / len(kinds)), np.tile(mean, (len(kinds), 1)),
                       np.arange(len(kinds)), np.zeros((len(kinds), 2)), departures,
                       np.ones(len(kinds)), np.zeros((mean.size, 0)), np.zeros((mean.size, 0)),
                       tuple(f"curves smooth over {length:g} nm" for _, length in kinds),
                       SMOOTH_SOURCE, "none")


def prior_of_curves(grid: WavelengthGrid, curves: np.ndarray, relative_error: float) -> CameraPrior:
    """Prior about measured curves, so that a chart fit gives white, field and glare.

    Parameters
    ----------
    grid : WavelengthGrid
        Of the curves, P wavelengths.
    curves : (K, P) array
    relative_error : float
        Standard deviation of each curve, relative to it.
    """
    return prior_about(grid, curves, (ADDED * relative_error, MEASURED_LENGTH_NM, relative_error,
                                      MEASURED_LENGTH_NM, 0.0, 1.0), "measured curves from a file")


def prior_about(grid: WavelengthGrid, curves: np.ndarray, departures: tuple[float, ...],
                source: str) -> CameraPrior:
    """Prior of one Gaussian about given curves.

    Parameters
    ----------
    grid : WavelengthGrid
        Of the curves, P wavelengths.
    curves : (K, P) array
    departures : tuple of six float
        As ``CameraPrior.departures``.
    source : str
        Stored with the prior.
    """
    nm = np.arange(grid.nm[0], grid.nm[-1] + 1, STEP_NM)
    means = np.array([np.interp(nm, grid.nm, curve) for curve in curves]).reshape(1, -1)
    none = np.zeros((means.size, 0))
    return CameraPrior(nm, np.ones(1), means, np.zeros(1, int), np.zeros((1, 2)),
                       np.array([departures]), np.ones(1), none, none, ("measured curves",),
                       source, "none")
