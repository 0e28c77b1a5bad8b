"""Reflectance of every chart patch from its own signal and a calibration that never saw it: the one
check with a truth in every photo.
"""
from __future__ import annotations

import numpy as np

from spectrabox.calibrate.calibration import ChartCalibration
from spectrabox.radiometry.grid import interpolation_matrix
from spectrabox.radiometry.records import LeftOutPatches
from spectrabox.sampling.prior.mixture import GRID, LogitMixture, load_prior
from spectrabox.sampling.prior.summaries import summaries

LEVEL = 0.95
PASSES = 3              # errors of the calibration depend on the reflectance that is looked for
START = 0.4             # reflectance of the first pass


def left_out_patches(calibrated: ChartCalibration, reflectances: np.ndarray,
                     prior: LogitMixture | None = None) -> LeftOutPatches:
    """Reflectance of each patch by the learnt prior, its calibration being that without it.

    Parameters
    ----------
    calibrated : ChartCalibration
    reflectances : (I, P) array
        Of the chart, on the grid of the calibration.
    prior : LogitMixture or None
        The shipped one by default.
    """
    known = load_prior() if prior is None else prior
    without, nm = calibrated.without, calibrated.calibration.sensitivity.grid.nm
    fine = without.response
    white = fine.sum(axis=2)
    basis = interpolation_matrix(GRID.nm, nm)
    responses = fine @ basis / white[..., None]
    relative = (without.signal - without.offset) / white
    common = responses.mean(axis=0)         # signals are moved to what they would be under it
    estimate = np.full((len(white), GRID.nm.size), START)
    for _ in range(PASSES):
        covariance = without.error_covariance(estimate @ basis.T)
        moved = relative - np.einsum("ikp,ip->ik", responses - common, estimate)
        found = summaries(known, common, moved, {
            "calibration and photo": covariance / (white[:, :, None] * white[:, None, :])}, LEVEL)
        estimate = found.mean
    truth = np.array([np.interp(GRID.nm, nm, row) for row in reflectances])
    return LeftOutPatches(GRID, found.mean, found.lower, found.upper, truth, calibrated.kept_out,
                          LEVEL)
