"""Reflectance of every chart patch from its own signal and a calibration that never saw it.

It is the one check with a truth in every photo.
"""
from __future__ import annotations

import numpy as np

from spectrabox.calibrate.chart_calibration import ChartCalibration
from spectrabox.calibrate.held_out_patches import PatchesWithout
from spectrabox.radiometry.grid import interpolation_matrix
from spectrabox.radiometry.records import HeldOutPatches, WavelengthGrid, share_inside
from spectrabox.sampling.prior.mixture import PRIOR_GRID, LogitMixture, load_prior
from spectrabox.sampling.prior.summaries import PriorSummaries, summaries

LEVEL = 0.95
PASSES = 3              # errors of the calibration depend on the reflectance that is looked for
START = 0.4             # reflectance of the first pass
SHADED, BRIGHT = 0.06, 0.03     # darker than this is a shadow; of the brightest signal


def held_out_patches(calibrated: ChartCalibration, reflectances: np.ndarray,
                     prior: LogitMixture | None = None) -> HeldOutPatches:
    """Reflectance of each patch by the learnt prior, its calibration being that without it.

    Beside it stands how much of each band would hold if photo and calibration had not erred at all:
    the prior's bands are made to hold for surfaces of every kind, the colours of a chart are
    familiar, and so nearly all of theirs holds.

    Parameters
    ----------
    calibrated : ChartCalibration
    reflectances : (I, P) array
        Of the chart, on the grid of the calibration.
    prior : LogitMixture or None
        The shipped one by default.
    """
    return patches_without(calibrated.without, calibrated.calibration.sensitivity.grid,
                           reflectances, calibrated.excluded, prior)


def patches_without(without: PatchesWithout, grid: WavelengthGrid, reflectances: np.ndarray,
                    excluded: np.ndarray, prior: LogitMixture | None = None) -> HeldOutPatches:
    """The same from what fits without each patch say.

    Parameters
    ----------
    without : PatchesWithout
    grid : WavelengthGrid
        Of the fits, of P wavelengths.
    reflectances : (I, P) array
    excluded : (I,) bool array
        Patches that were in no fit.
    prior : LogitMixture or None
    """
    known = load_prior() if prior is None else prior
    fine = without.response
    white = fine.sum(axis=2)
    basis = interpolation_matrix(PRIOR_GRID.nm, grid.nm)
    responses = fine @ basis / white[..., None]
    relative = (without.signal - without.offset) / white
    common = responses.mean(axis=0)         # signals are moved to what they would be under it
    truth = np.array([np.interp(PRIOR_GRID.nm, grid.nm, row) for row in reflectances])

    def summarised(signals: np.ndarray, spectra: np.ndarray) -> PriorSummaries:
        """Of signals (I, K) under the common response, their errors by spectra (I, 61)."""
        covariance = without.error_covariance(spectra @ basis.T)
        return summaries(known, common, signals, {
            "calibration and photo": covariance / (white[:, :, None] * white[:, None, :])}, LEVEL)

    estimate = np.full(truth.shape, START)
    for _ in range(PASSES):
        each = summarised(relative - np.einsum("ikp,ip->ik", responses - common, estimate),
                          estimate)
        estimate = each.mean
    exact = summarised(truth @ common.T, truth)
    return HeldOutPatches(PRIOR_GRID, each.mean, each.lower, each.upper, truth, excluded,
                          share_inside(exact.lower, exact.upper, truth), LEVEL)


def shadow_depths(calibrated: ChartCalibration) -> np.ndarray:
    """How much darker each patch (I,) is, in all bands alike, than the other patches predict: a
    share of its signal where a shadow or dirt explains that, 0 elsewhere.

    Parameters
    ----------
    calibrated : ChartCalibration
    """
    expected, residuals = calibrated.held_out, calibrated.calibration.sensitivity.residuals
    assert residuals is not None
    bright = expected.min(axis=1) > BRIGHT * expected.max()
    measured = calibrated.predicted / (1 - residuals)
    off = measured / np.where(bright[:, None], expected, np.inf) - 1
    depth = -off.mean(axis=1)
    return np.where(bright & (depth > SHADED) & (np.ptp(off, axis=1) < depth), depth, 0.0)
