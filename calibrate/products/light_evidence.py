"""Whether a chart contradicts the light that somebody stated: its evidence against any other's.

The same mixture is asked twice: with the stated spectrum alone under every camera, and with all
lamps that are known. A right spectrum explains the photo better than the average lamp does; a wrong
one has to be explained by a camera that no maker built.
"""
from __future__ import annotations

from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from spectrabox.calibrate.chart_equations import ChartEquations
from spectrabox.calibrate.prior.camera_prior import CameraPrior
from spectrabox.calibrate.products.lamps import Lamps, all_lamps
from spectrabox.calibrate.products.product_posterior import evidence_of_products
from spectrabox.calibrate.products.product_prior import product_prior
from spectrabox.radiometry.records import CalibrationDoubt, WavelengthGrid

SEED = 1                    # of the draws of cameras
# nats for another lamp, of photos of lamps of the prior by cameras of makers outside it: exceeded
# by right spectra in 2 % of cases (benchmarks/bench_unknown_light.py --shipped --naming)
CONTRADICTS = 7.0
UNKNOWN_KIND = 0            # of the stated lamp: no kind is asked for


def evidence_for_another_light(photos: list[ChartEquations], cameras: CameraPrior,
                               light: np.ndarray, grid: WavelengthGrid) -> float:
    """Logarithm of how much better the lamps that are known explain chart photos than a stated one.

    Parameters
    ----------
    photos : list of ChartEquations
        Of one camera under one light.
    cameras : CameraPrior
    light : (P,) array
        The stated spectrum, any unit.
    grid : WavelengthGrid
        Working grid, of P wavelengths, every nm from 400 to 700 nm.
    """
    unlit = [replace(photo, power=grid.weights_nm) for photo in photos]
    stated = Lamps((light / light.mean())[None], np.array([UNKNOWN_KIND]), np.ones(1), ("stated",))
    with threadpool_limits(1, "blas"):      # see fit_with_prior
        any_lamp, this_lamp = (
            evidence_of_products(unlit, product_prior(cameras, lamps, SEED))
            for lamps in (all_lamps(), stated))
    return any_lamp - this_lamp


def light_doubts(evidence: float) -> tuple[CalibrationDoubt, ...]:
    """The doubt that follows from ``evidence_for_another_light``.

    Parameters
    ----------
    evidence : float
    """
    return (CalibrationDoubt.WRONG_LIGHT,) if evidence > CONTRADICTS else ()
