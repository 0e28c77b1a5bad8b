"""Reflectance of every chart patch from its own signal and a calibration that never saw it.

It is the one check with a truth in every photo.
"""
from __future__ import annotations

import dataclasses

import numpy as np

from spectrabox.calibrate.chart_calibration import ChartCalibration
from spectrabox.calibrate.held_out_patches import PatchesWithout
from spectrabox.measure.surfaces import colour_comparison, surface_signals
from spectrabox.radiometry.grid import interpolation_matrix
from spectrabox.radiometry.records.calibration import HeldOutPatches, share_inside
from spectrabox.radiometry.records.spectra import WavelengthGrid
from spectrabox.sampling.prior import mixture
from spectrabox.sampling.prior.summaries import PriorSummaries, summaries

LEVEL = 0.95
PASSES = 3              # errors of the calibration depend on the reflectance that is looked for
START = 0.4             # reflectance of the first pass


def held_out_patches(calibrated: ChartCalibration, reflectances: np.ndarray
                     ) -> HeldOutPatches:
    """Reflectance of each patch by the learnt prior, its calibration being that without it.

    Beside it stands how much of each band would hold if photo and calibration had not erred at all:
    the prior's bands are made to hold for surfaces of every kind, the colours of a chart are
    familiar, and so nearly all of theirs holds.

    Parameters
    ----------
    calibrated : ChartCalibration
    reflectances : (I, P) array
        Of the chart, on the grid of the calibration.
    """
    patches = patches_without(calibrated.without, calibrated.calibration.sensitivity.grid,
                              reflectances, calibrated.excluded, None, calibrated.saturated)
    brighter, error, chance = calibrated.cleaned.deviations(reflectances)
    return dataclasses.replace(patches, brighter=brighter, brighter_error=error,
                               colour_chance=chance)


def patches_without(without: PatchesWithout, grid: WavelengthGrid, reflectances: np.ndarray,
                    excluded: np.ndarray, prior: mixture.LogitMixture | None = None,
                    saturated: np.ndarray | None = None) -> HeldOutPatches:
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
    saturated : (I,) bool array or None
        Patches whose own signal is not known.
    """
    known = mixture.load_prior() if prior is None else prior
    fine = without.response
    white = fine.sum(axis=2)
    basis = interpolation_matrix(mixture.PRIOR_GRID.nm, grid.nm)
    responses = fine @ basis / white[..., None]
    relative = (without.signal - without.offset) / white
    common = responses.mean(axis=0)         # signals are moved to what they would be under it
    truth = np.array([np.interp(mixture.PRIOR_GRID.nm, grid.nm, row) for row in reflectances])

    def summarised(signals: np.ndarray, spectra: np.ndarray) -> PriorSummaries:
        """Of signals (I, K) under the common response, their errors by spectra (I, 61)."""
        covariance = without.error_covariance(spectra @ basis.T) / (
            white[:, :, None] * white[:, None, :])
        response = common
        if common.shape[0] > surface_signals.FEW_BANDS:     # of which some are sums of others
            each = [colour_comparison.independent_bands((fine / white[..., None]).mean(axis=0), one)
                    for one in covariance]
            gains = np.array([gain for _, gain in each])
            response = common[each[0][0]]
            signals = np.einsum("irk,ik->ir", gains, signals)
            covariance = gains @ covariance @ gains.transpose(0, 2, 1)
        return summaries(known, response, signals, {"calibration and photo": covariance}, LEVEL)

    estimate = np.full(truth.shape, START)
    for _ in range(PASSES):
        each = summarised(relative - np.einsum("ikp,ip->ik", responses - common, estimate),
                          estimate)
        estimate = each.mean
    exact = summarised(truth @ common.T, truth)
    return HeldOutPatches(mixture.PRIOR_GRID, each.mean, each.lower, each.upper, truth, excluded,
                          share_inside(exact.lower, exact.upper, truth), LEVEL,
                          *without.deviations(reflectances), saturated)
